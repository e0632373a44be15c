"""STOP that is not confirmed, or pressed before anything runs: what the page says, and what comes of it."""

from __future__ import annotations

import signal
import socket
import threading

import pytest

from mesotap.console import session_link
from mesotap.console.frames import frame
from mesotap.console.session_link import SessionLink
from tests.mesotap.console.consoles import console_in, needs_chromium
from tests.mesotap.console.pages import begin, opened, reach, shows


@pytest.mark.slow
def test_a_console_that_says_nothing_is_one_that_has_gone(monkeypatch):
    monkeypatch.setattr(session_link, "SILENT_S", 0.5)
    ours, theirs = socket.socketpair()
    heard, lost = threading.Event(), threading.Event()
    link = SessionLink(theirs, lambda message: heard.set(), lost.set)
    link.start()
    ours.sendall(frame({"do": "beat"}))
    assert heard.wait(30)
    assert lost.wait(30)
    link.end()
    ours.close()


@needs_chromium
@pytest.mark.long
def test_stop_into_a_console_that_hangs_is_told_and_the_session_ends_by_itself(chromium, tmp_path):
    with console_in(tmp_path, "--speed", "1", "--set", "mesotap.impacts_per_load=50") as console:
        page = opened(chromium, console)
        begin(page)
        reach(page, "calibrating")
        console.process.send_signal(signal.SIGSTOP)
        try:
            page.click("#stop")
            shows(page, "#alert", "STOP is not confirmed")
            shows(page, "#next", "back the micrometer off by hand")  # the connection counts as lost, too
            shows(page, "#words", "no connection")
        finally:
            console.process.send_signal(signal.SIGCONT)
        reach(page, "ended")
        shows(page, "#alert", "has gone or hangs|STOP in the console")
        assert page.faults == []


@needs_chromium
@pytest.mark.long
def test_stop_while_a_session_is_started_is_received_and_ends_it(chromium, tmp_path):
    with console_in(tmp_path, "--speed", "1") as console:
        page = opened(chromium, console)
        begin(page)
        reach(page, "starting")
        page.click("#stop")
        shows(page, "#next", "STOP was received")
        reach(page, "ended")
        shows(page, "#alert", "STOP in the console")
        assert page.faults == []
