"""Who is let in, and who is not."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.mesotap.console.consoles import Client, console_in


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    """A console, its client, and the cookie as it was set."""
    with console_in(tmp_path_factory.mktemp("gate")) as console:
        client = Client.__new__(Client)
        client.port = console.port
        status, headers, _ = client.request("GET", console.path)
        assert status == 303
        client.cookie = headers["set-cookie"].partition(";")[0]
        yield console, client, headers["set-cookie"].lower()


@pytest.fixture
def client(opened):
    return opened[1]


def test_the_link_opens_once(opened):
    console, client, _ = opened
    assert client.request("GET", console.path)[0] == 403
    assert client.request("GET", "/")[0] == 200


def test_the_cookie_is_kept_from_scripts_and_from_other_sites(opened):
    said = opened[2]
    assert "httponly" in said
    assert "samesite=strict" in said


@pytest.mark.parametrize(
    ("method", "path", "headers", "status"),
    [
        ("GET", "/", {"Cookie": ""}, 401),
        ("GET", "/", {"Cookie": "mesotap=guess"}, 401),
        ("GET", "/", {"Host": "evil.example"}, 421),
        ("GET", "/", {"Host": "127.0.0.1"}, 421),
        ("PUT", "/api/stop", {}, 405),
        ("DELETE", "/", {}, 405),
        ("GET", "/api/stop", {}, 405),
        ("POST", "/api/stop", {"Content-Type": "application/json"}, 403),
        ("POST", "/api/stop", {"X-Mesotap": "1", "Content-Type": "text/plain"}, 415),
        ("POST", "/api/stop", {"X-Mesotap": "1", "Content-Type": "application/json", "Origin": "http://evil"}, 403),
        ("POST", "/api/run", {"X-Mesotap": "1", "Content-Type": "application/json"}, 403),
        ("GET", "/open?token=guess", {"Cookie": ""}, 403),
        ("GET", "/sessions/..%2f..%2fetc/report", {}, 404),
        ("GET", "/static/../server.py", {}, 404),
        ("GET", "/static/%2e%2e/server.py", {}, 404),
    ],
)
def test_what_is_refused(client, method, path, headers, status):
    body = b"{}" if method == "POST" else None
    assert client.request(method, path, body, headers)[0] == status


def test_nothing_runs_in_a_page_but_its_own_scripts(client):
    policy = client.request("GET", "/")[1]["content-security-policy"]
    assert "script-src 'self'" in policy
    assert "unsafe" not in policy


def test_the_server_serves_without_the_numerics():
    """They take 170 MB and a second; only the processes that it starts compute."""
    loads = "import sys, mesotap.commands.console; print({'numba', 'scipy.stats', 'matplotlib'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", loads], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
