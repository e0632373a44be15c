"""Random fault schedules: a small session to which several things happen, at moments that nobody chose.

The seed also chooses the devices: the amplifier on a serial line or on Ethernet, with a maker's map or one of its own,
either controller, taps by hand or by the solenoid.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np

from daq.journal import SessionFolder
from mesotap.session.progress import assemble, progress_of
from mesotap.session.states import State
from rig import SessionAborted
from rig.drivers.newport_codes import PositionerError
from rig.drivers.settings import AmplifierTcp
from sim_backend.emulators.disturbance import WireFault
from tests.faults.bench import SOLENOID, TCP, FaultyBench, Killed, allowed_mn, impacts_of, quick_config
from tests.faults.cases import cut_power, end_in_the_way, fill_the_disk, gauge, set_the_clock_back, setting, usb, wire

SAFE_WITHIN_S = 0.5
ROUND_TRIPS_S = (0.0, 0.016, 0.026, 0.05)
MOST_RUNS = 12  # starts that a session with a few faults may take
MOST_FAULTS = 5
STATES = (
    State.PRE_CALIBRATION,
    State.APPROACH,
    State.APPROACH,
    State.SET_LOAD,
    State.SET_LOAD,
    State.LOCK,
    State.TAP,
    State.TAP,
    State.RETRACT,
    State.POST_CALIBRATION,
)
CONFIGS = (quick_config(), quick_config(*TCP), quick_config(*SOLENOID))


Menu = tuple[Callable[[FaultyBench], None], ...]


def abort(bench: FaultyBench) -> None:
    raise SessionAborted("session ended by the operator")


GAUGES: Menu = tuple(
    gauge(fault) for fault in (("offset", 10.0), ("offset", -10.0), ("offset", 1e3), ("scale", 0.5), ("scale", -1.0))
)
# TCP has check bytes of its own, below what a device sees: a damaged reply is one that does not come
FLIPS = tuple(
    wire("amplifier", fault, times)
    for fault, times in ((WireFault.FLIPPED_REQUEST, 1), (WireFault.FLIPPED_REPLY, 1), (WireFault.FLIPPED_REPLY, 3))
)
MENU: Menu = (
    *(
        wire("amplifier", fault)
        for fault in WireFault
        if fault not in (WireFault.FLIPPED_REQUEST, WireFault.FLIPPED_REPLY)
    ),
    *(wire("stage", fault) for fault in WireFault),
    wire("stage", WireFault.FLIPPED_REPLY, 3),
    setting("amplifier", "fault", 4),
    setting("amplifier", "fault", 6),
    setting("amplifier", "fault", "frozen"),
    setting("amplifier", "fault", "nan"),
    *GAUGES,
    setting("controller", "stalled", True),
    *(setting("controller", "fails_next", bit) for bit in (PositionerError.FOLLOWING, PositionerError.RMS_CURRENT)),
    end_in_the_way,
    cut_power,
    *(usb(fault) for fault in ("overrun", "stall", "timeout", "hang", "silent", "short", "empty", "truncated", "odd")),
    *(usb(fault) for fault in ("overflow", "foreign", "stopped", "unplug", "replug", "swapped")),
    usb("unplug", "plug"),
    fill_the_disk,
    set_the_clock_back,
    abort,
    lambda bench: os.kill(os.getpid(), signal.SIGTERM),
    lambda bench: bench.kill(),
    lambda bench: bench.kill(),
)


def run_schedule(path: Path, seed: int) -> dict[str, int]:
    """Run one session through the faults that a seed draws, and hold it to what is promised.

    Returns
    -------
    dict
        ``faults`` drawn, ``runs`` it took, ``ended`` how many of them ended early.

    Raises
    ------
    AssertionError
        A promise was broken; the seed makes it happen again.
    """
    rng = np.random.default_rng([seed, 13])
    config = CONFIGS[seed % len(CONFIGS)]
    bench = FaultyBench(path, config, seed, round_trip_s=ROUND_TRIPS_S[seed // len(CONFIGS) % len(ROUND_TRIPS_S)])
    menu = MENU if isinstance(config.rig.parts.load_cell, AmplifierTcp) else MENU + FLIPS
    faults = int(rng.integers(1, MOST_FAULTS + 1))
    kept: dict[int, tuple] = {}
    ended = 0
    pending = [_draw(rng, menu) for _ in range(faults)]
    for runs in range(1, MOST_RUNS + 1):
        for state, load_set, nth, delay, make in pending:
            bench.when(state, load_set, nth, _later(bench, delay, make))
        outcome = bench.run()
        left = {(entry[0], entry[1], entry[2]) for entry in bench._waiting}
        pending = [entry for entry in pending if entry[:3] in left]
        peak = bench.rig.physics.peak_true_load_mn
        assert peak <= allowed_mn(config), f"seed {seed}: the load went to {peak:.0f} mN"
        if outcome.error is not None:
            ended += 1
            _hold_to_safety(bench, outcome, seed)
        bench.mend()
        now = bench.accepted()
        lost = [number for number, impact in kept.items() if now.get(number) != impact]
        assert not lost, f"seed {seed}: accepted shots {lost} were lost or altered"
        kept = now
        if outcome.error is None:
            _hold_to_the_end(bench, seed)
            return {"faults": faults, "runs": runs, "ended": ended}
    raise AssertionError(f"seed {seed}: not finished after {MOST_RUNS} starts: {outcome.reads}")


def _draw(rng: np.random.Generator, menu: Menu) -> tuple[State, int, int, float, Callable[[FaultyBench], None]]:
    state = STATES[rng.integers(len(STATES))]
    later = state in (State.SET_LOAD, State.LOCK, State.TAP, State.RETRACT, State.POST_CALIBRATION)
    load_set = int(rng.integers(2)) if later else 0
    if state in (State.RETRACT, State.POST_CALIBRATION):
        load_set = 1
    # looks at the keys come every tenth of a second of rig time, and more often: any moment of a state is drawn
    usual = {State.APPROACH: 10.0, State.SET_LOAD: 8.0, State.LOCK: 6.0, State.TAP: 25.0}
    nth = 1 + int(rng.exponential(usual.get(state, 0.7)))
    # a gauge that is calibrated while its zero is off and mended afterwards needs a new session, whatever one does
    fit = [make for make in menu if make not in GAUGES] if state is State.PRE_CALIBRATION else menu
    return state, load_set, nth, float(rng.uniform(0, 0.4)), fit[rng.integers(len(fit))]


def _later(bench: FaultyBench, delay_s: float, make: Callable[[FaultyBench], None]) -> Callable[[], None]:
    return lambda: bench.after(delay_s, lambda: make(bench))


def _hold_to_safety(bench: FaultyBench, outcome, seed: int) -> None:
    """Apart within half a second, or the operator is told to do it by hand."""
    if isinstance(outcome.error, Killed):
        return
    said = outcome.reads
    assert "\n" not in said, f"seed {seed}: {said!r}"
    step = bench.config.rig.limits.largest_approach_step_um
    assert outcome.further_um <= step, f"seed {seed}: went on by {outcome.further_um:.2f} um after: {said}"
    by_hand = "by hand" in said or "nothing was moved" in said
    waited = outcome.apart_s - outcome.noticed_s
    assert by_hand or waited <= SAFE_WITHIN_S, f"seed {seed}: apart after {waited:.2f} s: {said}"


def _hold_to_the_end(bench: FaultyBench, seed: int) -> None:
    """The plan carried out: the taps asked for at each load, and a session to be written."""
    with SessionFolder.open(bench.path) as folder:
        progress = progress_of(folder.events())
        session = assemble(folder.header, bench.config, progress, impacts_of(folder))
    assert progress.state is State.FILE, f"seed {seed}: {progress.state}"
    for load_set in range(len(bench.config.mesotap.load_plan_mn)):
        good = sum(s.accepted and s.load_set == load_set for s in session.impacts)
        assert good == bench.config.mesotap.impacts_per_load, f"seed {seed}: {good} taps at load {load_set}"
    assert bench.rig.physics.true_load_mn() == 0.0, f"seed {seed}: the surfaces are not apart"
