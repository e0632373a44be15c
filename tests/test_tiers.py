"""What ``make test`` runs: something of every folder of tests."""

from __future__ import annotations

from pathlib import Path

import pytest

TESTS = Path(__file__).parent


def test_every_folder_has_tests_that_are_quick(request: pytest.FixtureRequest) -> None:
    if [Path(given).resolve() for given in request.config.args] != [TESTS] or request.config.option.keyword:
        pytest.skip("only a part of the tests was asked for")
    quick = {
        item.path.parent
        for item in request.session.items
        if not {"slow", "long"} & {m.name for m in item.iter_markers()}
    }
    assert {file.parent for file in TESTS.rglob("test_*.py")} == quick
