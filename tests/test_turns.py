from __future__ import annotations

from collections import Counter

import pytest

from tests.conftest import pytest_collection_modifyitems
from tests.turns import read_turn, turn_of

TURNS = 6


class Item:
    def __init__(self, nodeid: str, *marks: str):
        self.nodeid, self.marks = nodeid, marks

    def get_closest_marker(self, name: str) -> str | None:
        return name if name in self.marks else None


class Config:
    def __init__(self) -> None:
        self.left: list[Item] = []
        self.hook = self

    def pytest_deselected(self, items: list[Item]) -> None:
        self.left += items


def kept(turn: str | None, items: list[Item], monkeypatch: pytest.MonkeyPatch) -> list[str]:
    monkeypatch.delenv("MESOTAP_TURN", raising=False)
    if turn is not None:
        monkeypatch.setenv("MESOTAP_TURN", turn)
    config, mine = Config(), list(items)
    pytest_collection_modifyitems(config, mine)  # type: ignore[arg-type]
    assert {i.nodeid for i in mine} | {i.nodeid for i in config.left} == {i.nodeid for i in items}
    return [i.nodeid for i in mine]


def test_each_slow_test_has_one_turn_of_all_and_quick_ones_have_each(monkeypatch: pytest.MonkeyPatch) -> None:
    slow = [Item(f"tests/test_a.py::test_b[{k}]", "slow") for k in range(600)]
    quick = [Item(f"tests/test_a.py::test_c[{k}]") for k in range(50)]
    counts: Counter[str] = Counter()
    for second in range(140, 140 + TURNS):
        counts.update(kept(f"{second}/{TURNS}", slow + quick, monkeypatch))
    assert {counts[i.nodeid] for i in slow} == {1}
    assert {counts[i.nodeid] for i in quick} == {TURNS}


def test_turns_are_about_equal() -> None:
    sizes = Counter(turn_of(f"tests/test_a.py::test_b[{k}]", TURNS) for k in range(600))
    assert len(sizes) == TURNS
    assert max(sizes.values()) < 1.4 * 600 / TURNS


def test_without_a_turn_all_are_run(monkeypatch: pytest.MonkeyPatch) -> None:
    items = [Item(f"tests/test_a.py::test_b[{k}]", "slow") for k in range(20)]
    assert kept(None, items, monkeypatch) == [i.nodeid for i in items]


def test_a_turn_is_a_number_in_so_many() -> None:
    assert read_turn("1403/6") == (5, 6)
    assert turn_of("tests/test_tiers.py::test_x", 6) == turn_of("tests/test_tiers.py::test_x", 6) < 6
