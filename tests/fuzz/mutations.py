"""How much is fuzzed, and how sound bytes are damaged."""

from __future__ import annotations

import os
from collections.abc import Callable

from hypothesis import HealthCheck, seed, settings
from hypothesis import strategies as st

EXAMPLES = int(os.environ.get("MESOTAP_FUZZ", "300"))
SEED = os.environ.get("MESOTAP_FUZZ_SEED")

_KINDS = ("flip", "set", "insert", "delete", "truncate", "repeat", "zero", "number")
_STRANGE = (b"\xff" * 8, b"\0" * 8, b"\x7f" + b"\xff" * 7, b"\x01" + b"\0" * 7, b"-1", b"nan", b"1e999", b"\x80\0\0\0")

Damage = list[tuple[str, int, int]]


class Content(bytes):
    """Bytes of a sound file, which nobody wants to see printed."""

    def __repr__(self) -> str:
        return f"<{len(self)} bytes>"


def fuzzed(test: Callable[..., None]) -> Callable[..., None]:
    """Run a test on as many examples as asked for: the same ones each time, others for another seed."""
    chosen = settings(
        max_examples=EXAMPLES,
        deadline=None,
        database=None,
        derandomize=SEED is None,
        suppress_health_check=list(HealthCheck),
    )(test)
    return chosen if SEED is None else seed(int(SEED))(chosen)


def damages(most: int = 6) -> st.SearchStrategy[Damage]:
    """A few things to do to a file: what, where (wrapped around its length), and with which byte."""
    one = st.tuples(st.sampled_from(_KINDS), st.integers(0, 2**24), st.integers(0, 255))
    return st.lists(one, min_size=1, max_size=most)


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
