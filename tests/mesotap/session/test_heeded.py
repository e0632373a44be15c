"""How soon a session notices that it is to end, in rig time: whatever it waits for, it looks every few hundredths."""

from __future__ import annotations

from daq.journal import SessionFolder
from mesotap.session.bench import emulated_rig, truth_now
from mesotap.session.runner import Bench, SessionRunner
from mesotap.session.states import State
from tests.mesotap.benches import Silent, Watching, header_of, simulated_rig, small_config

LONGEST_S = 0.03
"""Slices of 0.02 s, and what a sample of the gauge adds; the wire's own time, which is not in it here, is its."""

ALREADY = (State.CONNECT, State.RETRACT)  # nothing was moved; the surfaces are on their way apart


class Looks:
    """A control that only notes how long nobody asked it."""

    def __init__(self, clock) -> None:
        self.clock, self.last, self.longest = clock, clock.now(), {}
        self.state = lambda: State.CONNECT

    def check(self, hold) -> None:
        now = self.clock.now()
        if self.state() not in ALREADY:
            self.longest[self.state()] = max(self.longest.get(self.state(), 0.0), now - self.last)
        self.last = now


def longest_waits(path, rig) -> dict[State, float]:
    config = small_config("mesotap.dwell_s=2", "sim_backend.gauge.weight_settling_s=2")
    looks = Looks(rig.clock)
    with SessionFolder.create(path, header_of(config)) as folder:
        runner = SessionRunner(config, folder, Bench(rig, Silent(), Watching(), looks, lambda: truth_now(rig)))
        looks.state = lambda: runner.progress.state
        runner.run()
    assert set(looks.longest) == {
        *(State.PRE_CALIBRATION, State.APPROACH, State.SET_LOAD, State.LOCK, State.TAP, State.POST_CALIBRATION)
    }
    return looks.longest


def test_on_the_simulated_rig(tmp_path):
    config = small_config("mesotap.dwell_s=2", "sim_backend.gauge.weight_settling_s=2")
    waits = longest_waits(tmp_path / "s", simulated_rig(config))
    assert all(wait < LONGEST_S for wait in waits.values()), waits


def test_with_the_drivers(tmp_path):
    config = small_config("mesotap.dwell_s=2", "sim_backend.gauge.weight_settling_s=2")
    waits = longest_waits(tmp_path / "s", emulated_rig(config))
    assert all(wait < LONGEST_S for wait in waits.values()), waits
