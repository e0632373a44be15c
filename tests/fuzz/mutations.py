"""How sound bytes are damaged."""

from __future__ import annotations

from collections.abc import Callable

from tests.fuzz.source import Source

_KINDS = ("flip", "set", "insert", "delete", "truncate", "repeat", "zero", "number")
_STRANGE = (b"\xff" * 8, b"\0" * 8, b"\x7f" + b"\xff" * 7, b"\x01" + b"\0" * 7, b"-1", b"nan", b"1e999", b"\x80\0\0\0")

Damage = list[tuple[str, int, int]]


class Content(bytes):
    """Bytes of a sound file, which nobody wants to see printed."""

    def __repr__(self) -> str:
        return f"<{len(self)} bytes>"


def damages(most: int = 6) -> Callable[[Source], Damage]:
    """A few things to do to a file: what, where (wrapped around its length), and with which byte."""

    def one(source: Source) -> tuple[str, int, int]:
        return source.choice(_KINDS), source.integer(0, 2**24), source.integer(0, 255)

    return lambda source: source.several(one, 1, most)


def damaged(content: bytes, damage: Damage) -> bytes:
    """Do them."""
    data = bytearray(content)
    for kind, where, byte in damage:
        at = where % max(1, len(data))
        if kind == "flip" and data:
            data[at] ^= 1 << byte % 8
        elif kind == "set" and data:
            data[at] = byte
        elif kind == "insert":
            data[at:at] = bytes([byte]) * (1 + byte % 9)
        elif kind == "delete":
            del data[at : at + 1 + byte % 64]
        elif kind == "truncate":
            del data[at:]
        elif kind == "repeat":
            data[at:at] = data[at : at + 1 + byte]
        elif kind == "zero":
            data[at : at + 1 + byte] = bytes(len(data[at : at + 1 + byte]))
        elif kind == "number":
            strange = _STRANGE[byte % len(_STRANGE)]
            data[at : at + len(strange)] = strange
    return bytes(data)
