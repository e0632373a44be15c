"""One page drives, others watch; closing, reloading and losing pages changes nothing on the rig."""

from __future__ import annotations

import pytest

from mesotap.console import audience
from mesotap.console.audience import RECORDS_WAITING, Audience, Outbox
from tests.mesotap.console.consoles import Client, console_in, journal_of
from tests.mesotap.console.plain_page import PlainPage

SLOW = ("--speed", "20", "--set", "mesotap.dwell_s=300")


class Later:
    """An event loop that calls what is due when it is told to."""

    def __init__(self) -> None:
        self.due: list = []

    def call_later(self, seconds, call):
        entry = [call]
        self.due.append(entry)

        class Handle:
            def cancel(self) -> None:
                entry.clear()

        return Handle()

    def pass_time(self) -> None:
        for entry in self.due:
            for call in entry:
                call()
        self.due.clear()


@pytest.fixture
def later(monkeypatch):
    loop = Later()
    monkeypatch.setattr(audience.asyncio, "get_running_loop", lambda: loop)
    return loop


def test_the_first_page_drives_and_hands_over(later):
    pages = Audience(lambda: None)
    first, second = pages.enter("a" * 16), pages.enter("b" * 16)
    assert pages.holds_control(first.key)
    assert not pages.take(second.key)
    assert pages.ask(second.key)
    assert not pages.give(second.key, 1)
    assert pages.give(first.key, second.number)
    assert pages.holds_control(second.key)
    assert not pages.holds_control(first.key)


def test_control_comes_back_with_a_page_that_was_lost(later):
    pages = Audience(lambda: None)
    first, second = pages.enter("a" * 16), pages.enter("b" * 16)
    pages.leave(first)
    assert not pages.take(second.key)
    pages.enter(first.key)
    later.pass_time()
    assert pages.holds_control(first.key)


def test_control_is_taken_back_from_a_page_that_stays_away(later):
    pages = Audience(lambda: None)
    first, second = pages.enter("a" * 16), pages.enter("b" * 16)
    pages.leave(first)
    later.pass_time()
    assert not pages.holds_control(first.key)
    assert pages.take(second.key)
    assert pages.enter(first.key).number == first.number
    assert not pages.holds_control(first.key)


def test_numbers_of_pages_that_are_gone_are_forgotten(later):
    pages = Audience(lambda: None)
    driver = pages.enter("d" * 16)
    for i in range(3 * audience.NUMBERS_KEPT):
        pages.leave(pages.enter(f"{i:016d}"))
    pages.leave(driver)
    assert len(pages._numbers) <= audience.NUMBERS_KEPT
    assert pages.enter(f"{i:016d}").number == 3 * audience.NUMBERS_KEPT + 1
    assert pages.enter("e" * 16).number == 3 * audience.NUMBERS_KEPT + 2
    assert pages.enter(driver.key).number == 1
    assert pages.holds_control(driver.key)


def test_a_slow_page_gets_the_newest_and_costs_nobody_memory():
    box = Outbox()
    for i in range(1000):
        box.put("load", bytes([i % 256]))
        box.put_record(bytes([i % 256]))
    assert box.parts == {"load": bytes([999 % 256])}
    assert list(box.records) == [bytes([i % 256]) for i in range(1000 - RECORDS_WAITING, 1000)]
    assert box.dropped == 999 + 1000 - RECORDS_WAITING


@pytest.mark.slow
def test_who_watches_may_only_stop(tmp_path):
    with console_in(tmp_path, *SLOW) as console:
        client = Client(console)
        driver, watcher = PlainPage(console, client), PlainPage(console, client)
        assert driver.drives
        assert not watcher.drives
        for what, content in (("run", {}), ("pause", {}), ("judge", {"number": 0, "accepted": False, "reason": "x"})):
            status, answer = watcher.post(what, content)
            assert status == 403, (what, answer)
        assert driver.post("run")[0] == 200
        watcher.reach("APPROACH", "SET_LOAD", "LOCK")
        driver.close()  # nobody holds control, and the session goes on
        watcher.until(lambda: watcher.parts["audience"]["holder_open"] is False)
        watcher.reach("LOCK")
        assert watcher.post("stop") == (200, {"stopped": True})
        watcher.until(lambda: watcher.state["ended"] is not None)
        assert "the surfaces are apart" in watcher.state["ended"]["text"]
        back = PlainPage(console, client, driver.key)
        assert back.drives
        assert back.state["ended"] == watcher.state["ended"]
        for page in (watcher, back):
            page.close()
    assert [e["event"] for e in journal_of(console)][-2:] == ["safe", "hardware"]


@pytest.mark.slow
def test_a_tap_rejected_in_the_page_is_made_up_for(tmp_path):
    with console_in(tmp_path, "--speed", "3") as console:
        page = PlainPage(console, Client(console))
        assert page.post("run")[0] == 200
        page.until(lambda: page.parts["taps"]["taps"])
        assert page.post("judge", {"number": 0, "accepted": False, "reason": " "})[0] == 400
        assert page.post("judge", {"number": 7, "accepted": False, "reason": "no such"})[0] == 400
        for reason in ("a door was slammed", "pressed twice"):
            assert page.post("judge", {"number": 0, "accepted": False, "reason": reason})[0] == 200
        page.until(lambda: page.state["state"] == "DONE")
        page.until(lambda: not page.state["running"])
        taps = page.parts["taps"]["taps"]
        page.close()
    assert [t["reason"] for t in taps if not t["accepted"]] == ["by hand: a door was slammed"]
    assert sum(t["accepted"] for t in taps) >= 3
    (entry,) = [e for e in journal_of(console) if e["event"] == "judged by hand"]
    assert (entry["number"], entry["accepted"], entry["reason"]) == (0, False, "a door was slammed")
