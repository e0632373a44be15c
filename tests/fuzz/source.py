"""What inputs are drawn from: a number generator here, hypothesis in the tests. What is drawn is written once."""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

T = TypeVar("T")

_STRANGE_NUMBERS = (0.0, -0.0, 1.0, -1.0, math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, 1e-300, 0.1, 25000.0)
_SYNTAX = "".join(chr(code) for code in range(32, 127)) + "\n\t"
_PUNCTUATION = ":-[]{},#&*!|>'\"%@`?~. \n\t0123456789eE+_<="
_STRANGE_TEXT = "\0\x01\x07\x0b\x0c\r\x1a\x1f\x7f\x80\x85\xa0\xad²µ٣ÿŀǰ\u2028\u200b\u202e\ufeff\ufffe\uffff𝟙😀"
_WIDE = 2**32
_LAST_CHARACTER = 0x10FFFF
_SURROGATES = range(0xD800, 0xE000)


class Source(Protocol):
    """Draws the parts of an input."""

    def choice(self, of: Sequence[T]) -> T:
        """Draw one of several."""

    def integer(self, least: int, most: int) -> int:
        """Draw a whole number, both ends included."""

    def number(self) -> float:
        """Draw any float64, infinities and NaN included."""

    def text(self, most: int) -> str:
        """Draw a text of at most so many characters, without surrogates."""

    def content(self, most: int) -> bytes:
        """Draw at most so many bytes."""

    def several(self, one: Callable[[Source], T], least: int, most: int) -> list[T]:
        """Draw a list."""


@dataclass(frozen=True)
class Target:
    """A kind of input: how one is drawn, and the check that has to hold for each of them."""

    draw: Callable[[Source], Any]
    check: Callable[[Any], None]


class Plain:
    """Draws at random, and the same again for the same seed."""

    def __init__(self, seed: str) -> None:
        self._random = random.Random(seed)

    def choice(self, of: Sequence[T]) -> T:
        return of[int(self._random.random() * len(of))]

    def integer(self, least: int, most: int) -> int:
        if most - least > _WIDE and self._random.random() < 0.5:  # as many small numbers as large ones
            span = 10 ** self.integer(0, 19)
            least, most = max(least, -span), min(most, max(span, least))
        return self._random.randint(least, most)

    def number(self) -> float:
        kind = self._random.random()
        if kind < 0.3:
            return self.choice(_STRANGE_NUMBERS)
        if kind < 0.6:
            return float(struct.unpack("<d", self._random.randbytes(8))[0])
        if kind < 0.8:
            return float(self.integer(-1000, 1000))
        return self._random.gauss(0.0, 10.0 ** self.integer(-6, 6))

    def text(self, most: int) -> str:
        length = self.integer(0, most)
        kind = self._random.random()
        if kind < 0.3:
            return "".join(self._random.choices(_SYNTAX, k=length))
        if kind < 0.6:
            return "".join(self._random.choices(_PUNCTUATION, k=length))
        if kind < 0.8:
            return "".join(self._random.choices(_SYNTAX + _STRANGE_TEXT, k=length))
        codes = (int(_LAST_CHARACTER ** self._random.random()) for _ in range(length))
        return "".join(chr(code) for code in codes if code not in _SURROGATES)

    def content(self, most: int) -> bytes:
        return self._random.randbytes(self.integer(0, most))

    def several(self, one: Callable[[Source], T], least: int, most: int) -> list[T]:
        return [one(self) for _ in range(self.integer(least, most))]
