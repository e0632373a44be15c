"""Hostile requests at a console whose session runs: each is refused or cut off, and the session goes on to its end."""

from __future__ import annotations

import contextlib
import json
import shutil

import pytest

from mesotap.console.session_people import PageOperator
from tests.mesotap.console.consoles import console_in
from tests.mesotap.console.raw_requests import INNER, RAW
from tests.mesotap.console.siege import (
    SPECIMEN,
    Siege,
    all_of,
    closed_in_time,
    request,
    sessions_listed,
    statuses,
    ws_frame,
)

pytestmark = pytest.mark.slow
TEXT, BINARY, CONTINUED, CLOSE, PING = 1, 2, 0, 8, 9
MANY = 200
VIEW = [f"view/{act}" for act in ("begin", "show", "reset", "check", "tap", "end")]


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    with console_in(tmp_path_factory.mktemp("siege"), "--speed", "20", "--set", "mesotap.dwell_s=40") as console:
        siege = Siege(console)
        yield siege
        siege.end()


@pytest.fixture
def siege(begun):
    yield begun
    begun.unharmed()


@pytest.mark.parametrize("name", RAW)
def test_raw_requests(siege, name):
    status, text = RAW[name]
    assert statuses(siege.sent(siege.filled(text))) == [status]


@pytest.mark.parametrize(
    "path",
    [
        "/../../etc/passwd", "/static/../gate.py", "/static/%2e%2e/gate.py", "/static/..%2fgate.py",
        "/static/%252e%252e/gate.py", "/static/..%5cgate.py", "/static/..\\gate.py", "/static//etc/passwd",
        "/static/%2fetc%2fpasswd", "/static/%00", "/static/main.js%00.css", "/static/" + "a" * 400, "/static/%ff%fe",
        "/static/", "/static", "//evil.example/", "/\\evil.example", "/.git/config", "/sessions/", "/%2e%2e%2f",
        "/sessions/../report", "/sessions/%2e%2e/report", "/sessions/..%2f..%2fetc/report",
        "/sessions/{id}/journal.jsonl",
        "/sessions/{id}/..%2fconfig.yaml", "/sessions/{id}%00/report", "/sessions/{id}/report/..", "/sessions/0/report",
        "/sessions/" + "f" * 20 + "/report", "/sessions/%3Cscript%3E/report", "/api/taps/-1", "/api/taps/0x0",
        "/api/taps/" + "9" * 400, "/api/taps/1e3", "/api/move", "/api", "/open/../api/sessions", "/api/sessions/",
    ],
)  # fmt: skip
def test_paths(siege, path):
    path = path.replace("{id}", siege.driver.state["session"])
    status, headers, body = siege.client.request("GET", path)
    assert status in (404, 307)
    if status == 307:  # an address without its last stroke: the same place, and only there
        assert headers["location"].startswith(f"http://127.0.0.1:{siege.console.port}/")
    assert b"root:" not in body
    assert b"import" not in body


DEEP = b'{"id":' + b"[" * 100_000
BODIES = {
    "nested lists": b"[" * 100_000 + b"]" * 100_000,
    "nested objects": b'{"a":' * 20_000 + b"1" + b"}" * 20_000,
    "nested and open": DEEP,
    "beyond floats": b'{"id":1e999,"number":1e999,"to":1e999,"do":"give","accepted":true,"reason":"x"}',
    "infinite": b'{"id":Infinity,"number":Infinity,"to":-Infinity,"do":"give","accepted":true,"reason":"x"}',
    "no number": b'{"id":NaN,"number":NaN,"to":NaN,"do":"give","accepted":true,"reason":"x"}',
    "5000 digits": b'{"id":' + b"9" * 5000 + b"}",
    "other types": b'{"id":{},"number":[],"to":null,"do":{"a":1},"accepted":"true","reason":7}',
    "a list": b"[]",
    "null": b"null",
    "not JSON": b"stop",
    "cut off": b'{"id":',
    "two at once": b"{}{}",
    "not UTF-8": b"\xff\xfe\xfd",
    "NUL": b'{"id":"\0"}',
    "nothing": b"{}",
    "not asked": b'{"id":1000000,"number":1000000,"to":1000000,"do":"give","accepted":false,"reason":"x"}',
}


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("what", ["answer", "judge", "resume", "control"])
def test_bodies_from_the_page_in_control(siege, what, body):
    headers = {"X-Mesotap": "1", "Content-Type": "application/json", "X-Mesotap-Page": siege.driver.key}
    status, _, answer = siege.client.request("POST", f"/api/{what}", BODIES[body], headers)
    assert status in ((400, 403) if what == "control" else (400,))
    assert len(json.loads(answer)["error"]) < 250


@pytest.mark.parametrize(
    "name", ["a\u202eb", "a\nb", "\0", "\ud800", "\u2028", "x" * 201, ["a"], {"a": 1}, 7], ids=ascii
)
def test_names_that_are_none(siege, name):
    status, answer = siege.driver.post("run", {"specimen": name})
    assert status == 400
    assert "specimen" in answer["error"]


def test_a_second_session_is_not_begun(siege):
    status, answer = siege.driver.post("run", {"specimen": "Ж 測 😀 \"'\\ #: {x}"})
    assert (status, "runs already" in answer["error"]) == (400, True)


@pytest.mark.parametrize("key", ["{watcher}", "", "0" * 32, "{driver}0", "../{driver}"])
@pytest.mark.parametrize("what", ["run", "pause", "answer", "resume", "judge", "link", "control", *VIEW])
def test_commands_without_control(siege, what, key):
    body = '{"id":1,"number":0,"accepted":false,"reason":"x","do":"take"}'
    answer = siege.sent(
        siege.filled(request(f"POST /api/{what} HTTP/1.1", body, X_Mesotap_Page=key, Connection="close"))
    )
    assert statuses(answer) == [403]


def test_control_is_not_given_by_who_has_none(siege):
    number = siege.watcher.parts["you"]["number"]
    assert siege.watcher.post("control", {"do": "give", "to": number})[0] == 403
    assert siege.watcher.post("control", {"do": "seize"})[0] == 400


def test_the_key_of_an_open_page_opens_no_second(siege):
    assert siege.closed_with(line="GET /ws?page={driver} HTTP/1.1") == 4001


FRAMES = {
    "STOP without a mask": (1002, [ws_frame(TEXT, b"stop", masked=False)]),
    "STOP as bytes": (1008, [ws_frame(BINARY, b"stop")]),
    "STOP shouted": (1008, [ws_frame(TEXT, b"STOP")]),
    "STOP and more": (1008, [ws_frame(TEXT, b"stop\n")]),
    "STOP in JSON": (1008, [ws_frame(TEXT, b'{"do":"stop"}')]),
    "STOP with NUL": (1008, [ws_frame(TEXT, b"stop\0")]),
    "nothing": (1008, [ws_frame(TEXT, b"")]),
    "another command": (1008, [ws_frame(TEXT, b"pause")]),
    "too long": (1009, [ws_frame(TEXT, b"s" * 1025)]),
    "said to be 2^62 bytes": (1009, [b"\x81\xff" + (2**62).to_bytes(8) + bytes(4)]),
    "length with its sign set": (1009, [b"\x81\xff" + (2**63 + 5).to_bytes(8) + bytes(4)]),
    "too long in pieces": (1009, [ws_frame(TEXT, b"s" * 600, end=False), ws_frame(CONTINUED, b"s" * 600)]),
    "in pieces": (1008, [ws_frame(TEXT, b"st", end=False), ws_frame(CONTINUED, b"opx")]),
    "pieces of two": (1002, [ws_frame(TEXT, b"st", end=False), ws_frame(TEXT, b"op")]),
    "a piece of nothing": (1002, [ws_frame(CONTINUED, b"stop")]),
    "unknown kind": (1002, [ws_frame(3, b"stop")]),
    "unknown control": (1002, [ws_frame(11, b"stop")]),
    "compressed": (1002, [ws_frame(TEXT, b"stop", reserved=0x40)]),
    "reserved": (1002, [ws_frame(TEXT, b"stop", reserved=0x10)]),
    "not UTF-8": (1007, [ws_frame(TEXT, b"\xc3\x28")]),
    "ping too long": (1002, [ws_frame(PING, b"p" * 126)]),
    "ping in pieces": (1002, [ws_frame(PING, b"p", end=False)]),
    "close without a code": (1002, [ws_frame(CLOSE, b"\x03")]),
    "close with no such code": (1002, [ws_frame(CLOSE, (999).to_bytes(2))]),
    "HTTP": (1002, [INNER.encode()]),
    "pings, then nonsense": (1008, [*[ws_frame(PING, b"p")] * 500, ws_frame(TEXT, b"x")]),
}


@pytest.mark.parametrize("name", FRAMES)
def test_frames(siege, name):
    code, frames = FRAMES[name]
    assert siege.closed_with(*frames) == code


def test_200_connections_at_once(siege):
    with contextlib.ExitStack() as all_open:
        connections = [all_open.enter_context(siege.connect()) for _ in range(MANY)]
        assert siege.client.request("GET", "/")[0] == 200
        assert siege.watcher.post("pause")[0] == 403
        closed_in_time(connections)


def test_200_connections_kept_after_a_refusal(siege):
    """One that is refused is closed: else a hundred of them would keep the page out."""
    refused = siege.filled(request("GET / HTTP/1.1", "", Cookie=None, Content_Length=None, Connection="keep-alive"))
    with contextlib.ExitStack() as all_open:
        for _ in range(MANY):
            connection = all_open.enter_context(siege.connect())
            connection.sendall(refused)
            assert statuses(all_of(connection)) == [401]


def test_slow_requests(siege):
    """Each is cut off though a byte comes four times a second; meanwhile pages are served."""
    whole = siege.filled(request(body="x" * 1000))
    begun = [b"", b"P", whole[:40], whole[:-1000], whole[:-500]]
    with contextlib.ExitStack() as all_open:
        connections = [all_open.enter_context(siege.connect()) for _ in begun]
        for connection, data in zip(connections, begun, strict=True):
            connection.sendall(data)
        assert siege.client.request("GET", "/")[0] == 200
        closed_in_time(connections, trickled=b"x")


@pytest.mark.parametrize("share", [0.0, 0.1, 0.9])
def test_half_closed(siege, share):
    whole = siege.filled(request(X_Mesotap=None))
    assert statuses(siege.sent(whole[: int(share * len(whole))], half_close=True)) in ([], [400], [403])


def test_asking_for_the_head_of_a_link_does_not_use_it_up(siege):
    path = siege.driver.post("link", {})[1]["path"]
    assert siege.client.request("HEAD", path)[0] == 405
    assert siege.client.request("GET", path)[0] == 303


def test_no_traceback_is_printed(siege):
    assert siege.closed_with(*FRAMES["not UTF-8"][1]) == 1007
    assert "Traceback" not in siege.console.errors()


def test_an_answer_to_what_was_not_asked_yet_answers_nothing():
    operator = PageOperator(lambda *message: None)
    operator.answer(1_000_000)
    with operator._asking("hang 500 mN", "do") as number:
        assert not operator._done(number)
        operator.answer(number)
        assert operator._done(number)


@pytest.mark.long
def test_the_session_goes_on_to_its_end(begun, tmp_path):
    """Last of all: what was paused goes on, and crafted names neither run nor leave the folder."""
    link = begun.driver.post("link")[1]["path"]
    assert begun.client.request("GET", link[:-1])[0] == 403
    assert begun.client.request("GET", link + "A")[0] == 403
    assert begun.client.request("GET", link)[0] == 303
    assert begun.driver.post("pause")[0] == 200
    begun.driver.until(lambda: not begun.driver.state["running"])
    assert begun.driver.state["ended"]["how"] == "filed"
    events = [json.loads(line)["event"] for line in begun.journal().splitlines()]
    assert (events[-1], events.count("shot"), "safe" in events) == ("filed", 4, False)
    report = (begun.folder / "report.html").read_text()
    assert SPECIMEN not in report
    assert "<img src=x" not in report
    folder, root = begun.folder, begun.console.sessions
    assert folder.name.replace("-", "").isdigit()
    crafted, outside = root / "<img src=x onerror=alert(1)>\u202e", tmp_path / "outside"
    for copy in (crafted, outside):
        shutil.copytree(folder, copy)
    (root / "linked").symlink_to(outside)
    (crafted / "report.html").unlink()
    (crafted / "report.html").symlink_to("/etc/passwd")
    listed = {s["name"]: s for s in sessions_listed(begun.client)}
    assert set(listed) == {folder.name, crafted.name}
    assert listed[folder.name]["specimen"] == SPECIMEN
    assert begun.client.request("GET", f"/sessions/{listed[crafted.name]['id']}/report")[0] == 404
    status, headers, _ = begun.client.request("GET", f"/sessions/{listed[folder.name]['id']}/report")
    assert (status, headers["content-security-policy"].startswith("sandbox; default-src 'none'")) == (200, True)
