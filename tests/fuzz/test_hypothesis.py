"""Every target, its inputs drawn by hypothesis: what fails is made small and shown."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import pytest
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

from tests.fuzz.plain import named
from tests.fuzz.source import Source

EXAMPLES = int(os.environ.get("MESOTAP_FUZZ", "300"))
SEED = os.environ.get("MESOTAP_FUZZ_SEED")
T = TypeVar("T")

numbers = st.floats()


class Drawn:
    """Draws as hypothesis likes."""

    def __init__(self, draw: Callable[[st.SearchStrategy[Any]], Any]) -> None:
        self._draw = draw

    def choice(self, of: Sequence[T]) -> T:
        return self._draw(st.sampled_from(of))

    def integer(self, least: int, most: int) -> int:
        return self._draw(st.integers(least, most))

    def number(self) -> float:
        return self._draw(numbers)

    def text(self, most: int) -> str:
        return self._draw(st.text(max_size=most))

    def content(self, most: int) -> bytes:
        return self._draw(st.binary(max_size=most))

    def several(self, one: Callable[[Source], T], least: int, most: int) -> list[T]:
        return self._draw(st.lists(drawn(one), min_size=least, max_size=most))


@st.composite
def drawn(draw: Callable[[st.SearchStrategy[Any]], Any], one: Callable[[Source], T]) -> T:
    return one(Drawn(draw))


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


@pytest.mark.slow
@pytest.mark.parametrize(("name", "make"), [pytest.param(name, make, id=name) for name, make in named("all")])
def test_target(tmp_path, name, make):
    target = make(tmp_path)

    @fuzzed
    @given(drawn(target.draw))
    def holds(an_input):
        target.check(an_input)

    holds()
