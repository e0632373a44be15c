"""A page that drives loses its connection without a word: it gets control back in time, and else another takes it."""

from __future__ import annotations

import pytest

from tests.mesotap.console.consoles import Client, client_of, console_in, needs_chromium
from tests.mesotap.console.pages import begin, opened, reach, shows
from tests.mesotap.console.plain_page import PlainPage
from tests.mesotap.console.silent_wire import ADDRESS, SilentWire

HELD = ("--speed", "20", "--set", "mesotap.dwell_s=2000")


@pytest.fixture
def held(tmp_path):
    """A console under two names, and a wire to it that can go dead."""
    with console_in(tmp_path, *HELD, "--name", ADDRESS) as console:
        wire = SilentWire(console.port)
        yield console, wire
        wire.close()


@needs_chromium
@pytest.mark.long
def test_a_lost_page_gets_control_back_and_then_loses_it(chromium, held):
    console, wire = held
    page = opened(chromium, console, console.link.replace("127.0.0.1", ADDRESS))
    shows(page, "#who", "holds control")
    client = client_of(page, console)
    watcher = PlainPage(console, client)
    begin(page)
    reach(page, "locking")
    wire.die()
    shows(page, "#alert", "control is kept for this page for ten seconds")
    assert watcher.post("control", {"do": "take"})[0] == 403
    wire.come_back()
    shows(page, "#who", "holds control, kept for it")
    assert page.is_hidden("#alert")
    assert page.is_enabled("#pause")
    assert not watcher.drives

    wire.die()
    watcher.until(lambda: watcher.parts["audience"]["holder"] is None)
    assert watcher.post("control", {"do": "take"})[0] == 200
    watcher.until(lambda: watcher.drives)
    wire.come_back()
    shows(page, "#who", "lost its connection for more than ten seconds, and watches; page 2 holds control")
    assert page.is_disabled("#pause")
    assert watcher.state["state"] == "LOCK", "the session went on all the time"
    assert watcher.post("stop")[0] == 200
    reach(page, "ended")
    watcher.close()
    assert page.faults == []


@pytest.mark.slow
def test_only_so_many_pages_and_a_copy_is_told(tmp_path):
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect
    from websockets.typing import Origin

    from mesotap.console.page_sockets import AGAIN, FULL, MOST_PAGES

    def code(console, client, key):
        address, origin = f"ws://127.0.0.1:{console.port}/ws?page={key}", f"http://127.0.0.1:{console.port}"
        with connect(address, additional_headers={"Cookie": client.cookie}, origin=Origin(origin)) as socket:
            with pytest.raises(ConnectionClosed) as closed:
                socket.recv(20)
            return closed.value.rcvd.code

    with console_in(tmp_path) as console:
        client = Client(console)
        pages = [PlainPage(console, client) for _ in range(MOST_PAGES)]
        assert code(console, client, pages[0].key) == AGAIN
        assert code(console, client, "f" * 32) == FULL
        pages[0].silent = True  # lost: another with its key is the same page again
        pages.append(PlainPage(console, client, pages[0].key))
        assert pages[-1].drives
        assert pages[-1].parts["you"]["number"] == pages[0].parts["you"]["number"]
        pages[1].close()
        PlainPage(console, client).close()
        for page in pages:
            page.close()
