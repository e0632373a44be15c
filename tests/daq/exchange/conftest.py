from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def _in_forks(in_forks: None) -> None:
    """Read in forks, all of these tests."""
