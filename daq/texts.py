"""What texts a session file can keep."""

from __future__ import annotations

LONGEST_TEXT = 60_000
"""Bytes of a text that is kept as an attribute; HDF5 ends at 64 kB."""


def is_storable(text: str) -> bool:
    """Return whether HDF5 can keep a text: no zeros within, and all of it UTF-8."""
    try:
        return b"\0" not in text.encode()
    except UnicodeEncodeError:
        return False


def refuse_unstorable(text: str) -> str:
    """Return a text that an attribute can keep.

    Raises
    ------
    ValueError
        It cannot.
    """
    if not is_storable(text):
        raise ValueError("holds a zero or half a character, which no session file can keep; remove it")
    length = len(text.encode())
    if length > LONGEST_TEXT:
        raise ValueError(f"is {length} bytes long, a session file can keep {LONGEST_TEXT}; shorten it")
    return text
