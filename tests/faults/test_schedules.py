"""Random fault schedules over whole sessions: nothing accepted is lost, the limit holds, nothing hangs.

``MESOTAP_FAULT_SCHEDULES`` sets their number (``make faults`` takes 2,000), ``MESOTAP_FAULT_SEED`` the first seed.
"""

from __future__ import annotations

import os

import pytest

from tests.faults.schedules import run_schedule

SCHEDULES = int(os.environ.get("MESOTAP_FAULT_SCHEDULES", "50"))
FIRST = int(os.environ.get("MESOTAP_FAULT_SEED", "0"))
CHUNK = 25


@pytest.mark.slow
@pytest.mark.parametrize("first", range(FIRST, FIRST + SCHEDULES, CHUNK))
def test_random_faults_cost_nothing_that_was_accepted(tmp_path, first):
    faults = ended = 0
    for seed in range(first, min(first + CHUNK, FIRST + SCHEDULES)):
        came = run_schedule(tmp_path / str(seed), seed)
        faults += came["faults"]
        ended += came["ended"]
    assert faults > 0
    assert ended > 0, "no schedule ended a session: the faults do not happen"
