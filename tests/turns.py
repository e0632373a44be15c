"""Slow tests in turn: of so many turns each slow test belongs to one, the same on every machine."""

from __future__ import annotations

import zlib


def turn_of(name: str, turns: int) -> int:
    """Return the turn, from 0, of a test by its name, as ``tests/folder/test_file.py::test_name[parameters]``."""
    return zlib.crc32(name.encode()) % turns


def read_turn(text: str) -> tuple[int, int]:
    """Return turn and number of turns of ``k/n``; k may be any number, as the time of a commit."""
    count, turns = (int(part) for part in text.split("/"))
    return count % turns, turns
