"""Sessions ended from outside on emulated devices that outlive them: the surfaces are apart, and nothing is lost.

``MESOTAP_GUARDED_KILLS`` sets how many at random moments (``make kills`` takes 134: half of them SIGKILL, half other
signals), besides one for each running state; in the suite some of these are tried, and how long it takes is not judged.
"""

from __future__ import annotations

import os
import random
import signal
from concurrent.futures import ThreadPoolExecutor

import pytest

from mesotap.operator.console import ENDING_SIGNALS
from tests.mesotap.session.separate import killed_and_resumed

RANDOM = int(os.environ.get("MESOTAP_GUARDED_KILLS", "0"))
AT_A_TIME = 5
LASTS_S = 10.0  # a session from its first calibration on
STATES = {
    "calibrating": ("calibrating before the test", 1),
    "approaching": ("approaching", 1),
    "loading": ("setting the load", 1),
    "dwelling": ("locking and dwelling", 2),
    "tapping": ("locking and dwelling", 2),  # and then a second later
    "retracting": ("taking the surfaces apart", 1),
}
IN_EVERY_STATE = [
    ("approaching", signal.SIGKILL, 0.3),
    ("tapping", signal.SIGKILL, 1.3),
    ("dwelling", signal.SIGHUP, 0.5),
    ("dwelling", signal.SIGSTOP, 0.5),
    ("loading", signal.SIGQUIT, 0.2),
    ("calibrating", signal.SIGKILL, 0.3),
    ("loading", signal.SIGKILL, 0.2),
    ("dwelling", signal.SIGKILL, 0.5),
    ("retracting", signal.SIGINT, 0.1),
    ("retracting", signal.SIGKILL, 0.1),
    ("tapping", signal.SIGUSR1, 1.3),
    ("approaching", signal.SIGXCPU, 0.3),
]
USUAL = 5  # of them, in the suite


@pytest.mark.long
def test_whatever_ends_a_session_in_whatever_state(tmp_path):
    def one(i: int) -> bool:
        state, number, wait_s = IN_EVERY_STATE[i]
        return killed_and_resumed(tmp_path / str(i), i + 1, number, STATES[state], wait_s, timed=bool(RANDOM))

    with ThreadPoolExecutor(AT_A_TIME) as pool:
        tried = len(IN_EVERY_STATE) if RANDOM else USUAL
        assert all(pool.map(one, range(tried))), "a session had come to its end before"


@pytest.mark.slow
@pytest.mark.skipif(not RANDOM, reason="make kills: many sessions ended at random moments")
def test_sessions_ended_at_random_moments(tmp_path):
    rng = random.Random(20261122)
    names = [name for name in ENDING_SIGNALS if name != "SIGINT"]
    plan = []
    for i in range(RANDOM):
        number = signal.SIGKILL if i % 2 == 0 else getattr(signal, rng.choice(["SIGINT", *names]))
        plan.append((i + 1, number, rng.uniform(0.0, LASTS_S)))

    def one(entry: tuple[int, int, float]) -> bool:
        seed, number, wait_s = entry
        return killed_and_resumed(tmp_path / str(seed), seed, number, STATES["calibrating"], wait_s, timed=True)

    with ThreadPoolExecutor(AT_A_TIME) as pool:
        happened = list(pool.map(one, plan))
    print(f"{sum(happened)} of {len(plan)} sessions were ended before their end, and resumed")
    assert sum(happened) > RANDOM / 2
