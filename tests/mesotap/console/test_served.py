"""The console beyond this machine: its warnings, its names, TLS, and what cannot be served."""

from __future__ import annotations

import http.client
import json
import signal
import socket
import ssl
import subprocess
import sys
import time

import pytest
import trustme
from websockets.exceptions import InvalidHandshake
from websockets.sync.client import connect

from mesotap.console.server import Address, ConsoleError, ConsoleServer
from tests.mesotap.console.consoles import PATIENCE_MS, console_in, needs_chromium
from tests.mesotap.console.pages import begin, opened, reach


def own_address() -> str:
    """Return an address of this machine that is not 127.0.0.1; nothing is sent to find it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        try:
            asking.connect(("198.51.100.1", 9))
        except OSError:
            pytest.skip("this machine has no address but its own")
        return str(asking.getsockname()[0])


@pytest.fixture(scope="module")
def certified(tmp_path_factory):
    """Files of an authority, of a certificate for this machine, and of its key."""
    folder, authority = tmp_path_factory.mktemp("certificates"), trustme.CA()
    names = (socket.gethostname(), "localhost", "127.0.0.1", own_address(), "bench.example")
    own = authority.issue_cert(*names)
    authority.cert_pem.write_to_path(folder / "authority.pem")
    own.cert_chain_pems[0].write_to_path(folder / "certificate.pem")
    own.private_key_pem.write_to_path(folder / "key.pem")
    return folder


def asked(host: str, port: int, path: str, name: str, context: ssl.SSLContext | None = None, cookie: str = ""):
    """Return status, cookie of one request, in which the Host is ``name``."""
    connection = (
        http.client.HTTPConnection(host, port, timeout=60)
        if context is None
        else http.client.HTTPSConnection(host, port, timeout=60, context=context)
    )
    try:
        connection.request("GET", path, headers={"Host": f"{name}:{port}", "Cookie": cookie})
        answer = connection.getresponse()
        answer.read()
        return answer.status, answer.headers.get("set-cookie", "")
    finally:
        connection.close()


def test_every_address_with_a_warning_and_under_its_own_names_only(tmp_path):
    with console_in(tmp_path, "--host", "0.0.0.0", "--name", "bench.example") as console:
        assert "can be reached by other machines" in console.warned
        assert "whoever listens on the network reads the link" in console.warned
        assert console.host == "bench.example"
        address = own_address()
        assert asked(address, console.port, "/", "evil.example")[0] == 421
        assert asked(address, console.port, "/", "198.51.100.7")[0] == 421
        assert asked(address, console.port, "/", address)[0] == 401
        status, cookie = asked(address, console.port, console.path, "bench.example")
        assert status == 303
        for name in (address, "localhost", "127.0.0.1", "Bench.Example"):
            assert asked(address, console.port, "/", name, cookie=cookie.partition(";")[0])[0] == 200, name


@pytest.mark.slow
def test_the_link_of_every_address_is_one_that_is_served(tmp_path):
    with console_in(tmp_path, "--host", "0.0.0.0") as console:
        assert console.host == socket.gethostname()
        assert asked("127.0.0.1", console.port, console.path, console.host)[0] == 303


def test_over_tls_the_cookie_is_for_tls_alone_and_an_origin_without_it_is_foreign(tmp_path, certified):
    files = ("--certfile", str(certified / "certificate.pem"), "--keyfile", str(certified / "key.pem"))
    trusting = ssl.create_default_context(cafile=str(certified / "authority.pem"))
    with console_in(tmp_path, "--host", "0.0.0.0", *files) as console:
        assert console.link.startswith("https://")
        assert "listens on the network" not in console.warned
        status, cookie = asked("127.0.0.1", console.port, console.path, "localhost", trusting)
        assert status == 303
        assert "; secure" in cookie.lower()
        with pytest.raises((OSError, http.client.HTTPException)):
            asked("127.0.0.1", console.port, "/", "localhost")
        more = {"additional_headers": {"Cookie": cookie.partition(";")[0]}, "ssl": trusting}
        address = f"wss://localhost:{console.port}/ws?page={'a' * 32}"
        with connect(address, origin=f"https://localhost:{console.port}", **more) as socket_:
            assert socket_.recv(30)
        with pytest.raises(InvalidHandshake):  # its status, or the end of the connection where that comes first
            connect(address, origin=f"http://localhost:{console.port}", **more)


@pytest.mark.slow
@needs_chromium
def test_a_session_is_run_over_tls_from_an_address_of_the_network(tmp_path, certified, chromium):
    files = ("--certfile", str(certified / "certificate.pem"), "--keyfile", str(certified / "key.pem"))
    slow = ("--speed", "20", "--set", "mesotap.dwell_s=100")
    with console_in(tmp_path, "--host", "0.0.0.0", *slow, *files) as console:
        link = console.link.replace(f"//{console.host}:", f"//{own_address()}:")
        page = opened(chromium, console, link, ignore_https_errors=True)
        begin(page)
        reach(page, "locking")
        page.keyboard.press("Space")
        page.wait_for_selector("#run:enabled")
        assert page.faults == []


def said(**given) -> str:
    with pytest.raises(ConsoleError) as told:
        ConsoleServer(None, Address(**given), print)  # type: ignore[arg-type]
    return str(told.value)


def test_what_cannot_be_served_is_one_sentence(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        assert said(port=taken.getsockname()[1]).endswith("name another --port")
    assert said(host="198.51.100.7").endswith("name another --host")
    assert said(host="999.1.1.1").endswith("name another --host")
    assert (
        said(key=tmp_path / "key.pem") == "--keyfile: a key is of no use without its certificate; give --certfile too"
    )


def test_programs_are_told_where_it_is_before_it_serves(tmp_path):
    place = tmp_path / "place.json"
    with console_in(tmp_path, "--json", str(place)) as served:
        until = time.monotonic() + PATIENCE_MS / 1000
        while not place.exists() and time.monotonic() < until:
            time.sleep(0.02)
        told = json.loads(place.read_text())
        assert told["link"] == served.link
        assert told["address"] == f"http://{served.host}:{served.port}"
        assert told["sessions"] == str(served.sessions.absolute())
        assert place.stat().st_mode & 0o077 == 0


def test_standard_output_holds_the_answer_for_programs_alone(tmp_path):
    command = [sys.executable, "-m", "mesotap", "console", "--scope", "--simulate", "--port", "0", "--no-browser"]
    with subprocess.Popen(
        [*command, "--json", "-"], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            text = ""
            while not text.endswith("}\n"):
                line = process.stdout.readline()
                assert line
                text += line
            told = json.loads(text)
            assert (told["format"], told["sessions"]) == ("mesotap-console", None)
            assert told["link"].startswith(told["address"])
        finally:
            process.send_signal(signal.SIGINT)
            assert process.stdout is not None
            assert process.stdout.read() == ""
