"""Self-test of a rig before a session: noise floor, gauge zero, a step of the stage, a tap at the smallest load.

Everything that moves is moved by the interlock, and whatever happens, the surfaces are apart at the end.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from daq.trigger import NoTap, record_impact
from mesotap.configuration.config import Config
from mesotap.session.impacts import judged_impact
from rig import GaugeScale, Rig, RigError, SessionAborted
from rig.attention import Attention, Hold
from rig.interface import Waiting, nothing
from rig.interlock import Interlock
from rig.watch import LoadWatch

NOISE_S = 0.5  # of quiet recording
ZERO_S = 1.0  # of the gauge's reading
STEP_BACK_UM = 5.0  # first away from contact, past the largest play that most micrometers have ...
SHARE_OF_STEP = 0.5  # ... then towards it by the interlock's step; off by more than this share of a step is a fault
LARGEST_NOISE_SHARE = 1 / 3  # of the contact threshold, of one gauge reading
TAPS = 3


@dataclass(frozen=True, slots=True)
class Verdict:
    """One line of the self-test.

    Attributes
    ----------
    name
        What was tested.
    passed
        True, False, or None where it was left out.
    says
        What was found, or what to do.
    """

    name: str
    passed: bool | None
    says: str


def self_test(
    rig: Rig,
    config: Config,
    touch: bool = True,
    beat: Callable[[], None] = nothing,
    heed: Callable[[Hold | None], None] = lambda hold: None,
    operator: Waiting | None = None,
) -> Iterator[Verdict]:
    """Test an opened rig part by part, and yield a verdict on each.

    Parameters
    ----------
    rig
        Opened, its surfaces apart.
    config
        Limits and what is expected.
    touch
        Whether the surfaces may be brought together for a tap at the smallest load of the plan.
    beat, heed
        See `rig.attention.Attention`.
    operator
        Who may be waited for.
    """
    yield _mechanical_stop(config)
    yield _tried("noise floor", lambda: _noise_floor(rig, config))
    zero = math.nan

    def gauge() -> tuple[bool, str]:
        nonlocal zero
        zero, passed, says = gauge_zero(rig, config)
        return passed, says

    verdict = _tried("gauge zero", gauge)
    yield verdict
    if not verdict.passed:
        for name in ("stage step", "tap"):
            yield Verdict(name, None, "left out: nothing moves without a gauge")
        return
    scale = GaugeScale(config.rig.gauge_sensitivity_mv_per_mn, zero)
    interlock = Interlock(rig, config.rig.limits, scale, config.rig.spring_stiffness())
    watch = LoadWatch(rig, interlock, config.rig.limits.stale_reading_s)
    attention = Attention(rig, watch, beat, heed)
    attention.attend(*(() if operator is None else (operator,)))
    attention.watch_moves()
    found: list[Verdict] = []
    try:
        with interlock, _leaving(attention):
            found.append(_tried("stage step", lambda: _stage_step(rig, interlock, config)))
            if not touch:
                found.append(Verdict("tap", None, "left out, as asked"))
            elif not found[0].passed:
                found.append(Verdict("tap", None, "left out: nothing is touched with a stage in doubt"))
            else:
                found.append(_tried("tap", lambda: _tap(rig, interlock, attention, config)))
    finally:
        yield from found  # told once the surfaces are apart: nobody who reads it is waited for under load


@contextmanager
def _leaving(attention: Attention) -> Iterator[None]:
    """From the end on nothing interrupts."""
    try:
        yield
    finally:
        attention.leaving = True


def _tried(name: str, test: Callable[[], tuple[bool, str]]) -> Verdict:
    try:
        passed, says = test()
    except SessionAborted:
        raise
    except RigError as error:
        return Verdict(name, False, str(error))
    return Verdict(name, passed, says)


def _mechanical_stop(config: Config) -> Verdict:
    """Say what only a mechanical stop can prevent; there may be reasons to do without one, so that it fails nothing."""
    worst = config.rig.worst_unwatched_load_mn()
    limits = config.rig.limits
    if limits.mechanical_stop_um is not None and worst <= limits.load_mn:
        return Verdict("mechanical stop", True, f"at {limits.mechanical_stop_um:g} um, declared and not tried")
    said = "none is declared" if limits.mechanical_stop_um is None else f"at {limits.mechanical_stop_um:g} um"
    reach = limits.expected_contact_um + limits.search_beyond_um
    return Verdict(
        "mechanical stop",
        None,
        f"{said}: should the gauge die with its noise after its calibration, and the surface lie higher than "
        f"declared, the first approach goes on to {reach:g} um and could make up to {worst / 1e3:.1f} N; fit a stop "
        "just past the contact and declare it as rig.limits.mechanical_stop_um",
    )


def _noise_floor(rig: Rig, config: Config) -> tuple[bool, str]:
    recorder = rig.accelerometers
    recorder.start()
    try:
        blocks = [recorder.read_block()]
        while sum(b.acceleration.shape[1] for b in blocks) < NOISE_S * recorder.sample_rate_hz:
            blocks.append(recorder.read_block())
    finally:
        recorder.stop()
    quiet = np.concatenate([b.acceleration for b in blocks], axis=1)
    rms = quiet.std(axis=1)
    limit = config.daq.quality.largest_noise_m_s2
    said = f"A {rms[0]:.2g}, B {rms[1]:.2g} m/s2 rms"
    dead = [name for name, level in zip("AB", rms, strict=True) if level == 0.0]
    if dead:
        return False, f"{said}: {' and '.join(dead)} shows nothing at all; check sensor, cable and conditioner"
    if rms.max() > limit:
        return False, f"{said}, more than {limit:g}: wait until the bench is quiet, and check the cables"
    return True, said


def gauge_zero(rig: Rig, config: Config) -> tuple[float, bool, str]:
    """Return what the gauge reads with the surfaces apart, mV, whether it can be used, and what was found."""
    reading = rig.load_cell.read(ZERO_S)
    sensitivity = config.rig.gauge_sensitivity_mv_per_mn
    threshold = config.rig.limits.contact_threshold_mn
    noise = reading.spread_mv / sensitivity
    said = f"{reading.voltage_mv:.3f} mV, noise {reading.spread_mv:.2g} mV ({noise:.2g} mN)"
    if not math.isfinite(reading.voltage_mv):
        return math.nan, False, "the amplifier answers no number: check the bridge's wiring"
    if reading.spread_mv == 0.0 and not reading.quantum_mv:
        return math.nan, False, f"{said}: {reading.samples} readings are the same; restart the amplifier"
    if noise > LARGEST_NOISE_SHARE * threshold:
        return math.nan, False, f"{said}, too much to feel a contact of {threshold:g} mN: check cables and shielding"
    return reading.voltage_mv, True, said


def _stage_step(rig: Rig, interlock: Interlock, config: Config) -> tuple[bool, str]:
    step = config.rig.limits.largest_approach_step_um
    rig.stage.unlock()
    before = rig.stage.read().position_um
    load_before = interlock.check()
    load_after = interlock.move_by(-STEP_BACK_UM, "trying the stage, away from contact")
    back = rig.stage.read().position_um
    interlock.move_by(step, "trying the stage, one step")
    there = rig.stage.read().position_um
    threshold = config.rig.limits.contact_threshold_mn
    if load_before - load_after > threshold:
        return False, f"the load fell by {load_before - load_after:.0f} mN: the surfaces were not apart; begin again"
    if not math.isfinite(before):
        return True, "turned by hand: it has no encoder to compare with"
    moved = back - before, there - back
    said = f"moved {moved[0]:+.2f} and {moved[1]:+.2f} um"
    off = max(abs(moved[0] + STEP_BACK_UM), abs(moved[1] - step))
    if off > SHARE_OF_STEP * step:
        return False, f"{said} instead of {-STEP_BACK_UM:+.2f} and {step:+.2f}: check the stage's settings"
    return True, said


def _tap(rig: Rig, interlock: Interlock, attention: Attention, config: Config) -> tuple[bool, str]:
    target = min(config.mesotap.load_plan_mn)
    interlock.approach()
    interlock.set_load(target, config.mesotap.load_tolerance_mn)
    interlock.lock()
    reason = ""
    for number in range(TAPS):
        before = interlock.read_load()
        attention.watch.taps = True
        try:
            trigger = config.daq.trigger
            record = record_impact(
                rig.accelerometers, rig.impactor, rig.clock, trigger, before[0], reason, attention.idle
            )
        except NoTap as missed:
            reason = str(missed)
            continue
        finally:
            attention.watch.taps = False
        place = (number, 0, target)
        impact = judged_impact(record, before, interlock.read_load(), place, config, rig.accelerometers)
        if impact.accepted:
            peak = float(np.abs(impact.acceleration).max())
            return True, f"good at {before[0]:.0f} mN, peak {peak:.2g} m/s2, tap {number + 1}"
        reason = impact.reject_reason
    return False, f"none of {TAPS} was good at {target:.0f} mN; the last: {reason}"
