"""Session folders that several tests damage, each in a copy of its own."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.fuzz.session_folders import finished, unfinished


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
