"""Session folders that several tests damage, each in a copy of its own, and a browser for pages."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.fuzz.session_folders import finished, unfinished
from tests.mesotap.console.consoles import CHROMIUM, FLAGS


@pytest.fixture(scope="session")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two sound sessions, ``unfinished`` and ``finished``; nobody writes there."""
    place = tmp_path_factory.mktemp("sound")
    unfinished(place / "unfinished")
    finished(place / "finished")
    return place


@pytest.fixture
def folder(sound: Path, tmp_path: Path) -> Path:
    """A copy of the unfinished session."""
    return Path(shutil.copytree(sound / "unfinished", tmp_path / "run"))


@pytest.fixture(scope="session")
def chromium() -> Iterator[object]:
    """The machine's Chromium; there can be one of it in a process."""
    if CHROMIUM is None:
        pytest.skip("there is no chromium on this machine")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()
