"""A concealed session: a plan with effects of a graded strength, its signals, its session file and its truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.records import Impact, RigDescription, Session
from mesotap.proof.generator.effect import FULL, Character, Effect
from mesotap.proof.generator.integration import integrate
from mesotap.proof.generator.plan import PRETRIGGER, RATE_HZ, Plan, machine_of
from mesotap.proof.generator.recorder import BITS, converted, filtered, full_scale, noise_of, sampled
from mesotap.proof.generator.survival import Refit, knowing_rms, refit

Real = NDArray[np.float64]

CLOSE = 0.08  # relative: near enough to the d that was asked for
TRIALS = 12
QUIETEST = 0.1  # of the noise that was drawn
LOAD_NOISE_N = 3e-4


@dataclass(frozen=True, slots=True)
class Hidden:
    """An effect with its strength and character, and what of it survives the refit."""

    effect: Effect
    strength: float
    character: Character
    d: float = math.nan


@dataclass(frozen=True, slots=True)
class Concealed:
    """A session and what is hidden in it.

    ``undeclared_hz`` is the corner of a low-pass that the session file does not tell of, ``drift_n`` the change of the
    load that the gauge pretends: neither leaves a trace in a free decay.
    """

    plan: Plan
    hidden: tuple[Hidden, ...] = ()
    undeclared_hz: float = math.inf
    drift_n: float = 0.0


def signals(session: Concealed) -> Real:
    """Return the (n, 2, samples) channels from the tap on, without noise, m/s2."""
    plan = session.plan
    machine = machine_of(plan)
    delay: float | Real = 0.0
    for h in _in_order(session.hidden):
        if h.effect.machined is not None:
            machine = h.effect.machined(machine, plan, h.strength, h.character)
        if h.effect.delay is not None:
            delay = delay + h.effect.delay(plan, h.strength, h.character)
    seen = integrate(machine, plan.steps, plan.step_s)
    for h in _in_order(session.hidden):
        if h.effect.mounted is not None:
            seen = h.effect.mounted(np.broadcast_to(seen, (len(seen), 2, seen.shape[2])), plan, h.strength, h.character)
    y = sampled(plan, filtered(plan, seen, session.undeclared_hz), delay)
    for h in _in_order(session.hidden):
        if h.effect.sensed is not None:
            y = h.effect.sensed(y, plan, h.strength, h.character)
    return y


def _in_order(hidden: Sequence[Hidden]) -> list[Hidden]:
    """Laws before what limits them: surfaces that part, an input that saturates."""
    return sorted(hidden, key=lambda h: h.effect.id in ("contact_loss", "clipping"))


def surviving(session: Concealed) -> Refit:
    """Return what of a session survives the refit of Eq. 9."""
    return refit(session.plan, signals(session))


def conceal(plan: Plan, effect: Effect, character: Character, d: float, beside: Sequence[Hidden] = ()) -> Concealed:
    """Return a session in which ``effect`` survives the refit by ``d``, as nearly as its range allows.

    The strength is found by bisection and secants on logarithms. An effect without a strength of its own gets louder or
    softer taps. Where no strength shows as much as ``d``, the noise is lowered; ``Hidden.d`` is what was reached.
    """

    def at(strength: float) -> tuple[Plan, Hidden, float]:
        louder = plan.louder(strength) if effect.fixed else plan
        hidden = Hidden(effect, FULL if effect.fixed else strength, character)
        found = surviving(Concealed(louder, (hidden,)))
        return louder, hidden, found.d

    strength, low, high = min(effect.first, effect.largest), 0.0, math.inf
    best: tuple[Plan, Hidden, float] | None = None
    below: tuple[float, float] | None = None
    for _ in range(TRIALS):
        now = at(strength)
        reached = now[2]
        if math.isfinite(reached) and (
            best is None or abs(math.log(max(reached, 1e-9) / d)) < abs(math.log(max(best[2], 1e-9) / d))
        ):
            best = now
        if abs(reached / d - 1) < CLOSE or (reached < d and strength >= effect.largest):
            break
        if reached < d:
            low = strength
        else:
            high = strength
        slope = 1.0
        if below is not None and 0 < reached < math.inf and 0 < below[1] < math.inf and strength != below[0]:
            slope = float(np.clip(math.log(reached / below[1]) / math.log(strength / below[0]), 0.5, 6.0))
        below = (strength, reached)
        following = strength * (d / max(reached, 1e-3 * d)) ** (1 / slope) if math.isfinite(reached) else strength / 4
        if not low < following < high:
            following = math.sqrt(low * high) if low > 0 and math.isfinite(high) else (4 * low if low > 0 else high / 4)
        strength = min(following, effect.largest)
    if best is None:
        raise ArithmeticError(f"{effect.id}: no strength gives a motion that stays finite")
    chosen, hidden, reached = best
    if reached < (1 - CLOSE) * d:
        quieter = replace(chosen.noise, rms=chosen.noise.rms * max(reached / d, QUIETEST))
        chosen = replace(chosen, noise=quieter)
        reached = surviving(Concealed(chosen, (hidden,))).d
    return Concealed(chosen, (*beside, replace(hidden, d=reached)))


@dataclass(frozen=True, slots=True)
class Recorded:
    """A concealed session as it is recorded, and the rms that a fit which knows the answer leaves on it, m/s2."""

    session: Session
    knowing_rms: float


def record(rng: np.random.Generator, concealed: Concealed, number: int) -> Recorded:
    """Add noise, convert, and write down what a session file tells."""
    plan = concealed.plan
    clean = signals(concealed)
    whole = np.concatenate([np.zeros((*clean.shape[:2], PRETRIGGER)), clean], axis=2)
    for h in concealed.hidden:
        if h.effect.id == "mains_hum" and h.effect.sensed is not None:
            before = h.effect.sensed(np.zeros_like(whole), plan, h.strength, h.character)
            whole[:, :, :PRETRIGGER] = before[:, :, :PRETRIGGER]
    disturbed = whole + noise_of(rng, plan.noise, whole.shape)
    for h in concealed.hidden:
        if h.effect.id == "clipping" and h.effect.sensed is not None:
            level = (1 - h.strength) * float(np.abs(_unclipped(concealed)).max())
            disturbed = np.clip(disturbed, -level, level)
    scale = full_scale(disturbed)
    y = converted(disturbed, scale)
    noise = (y - whole)[:, :, PRETRIGGER:]
    began = datetime(2026, 1, 5, 9, 0, tzinfo=UTC) + timedelta(days=number)
    impacts = []
    for i, g in enumerate(plan.group.tolist()):
        drift = concealed.drift_n * i / max(plan.group.size - 1, 1)
        load = (plan.loads[g] + drift + LOAD_NOISE_N * rng.standard_normal(2)) * 1e3
        impacts.append(
            Impact(
                number=i,
                load_set=g,
                target_load_mn=float(round(plan.loads[g] * 1e3, 1)),
                load_before_mn=float(load[0]),
                load_after_mn=float(load[1]),
                time=(began + timedelta(seconds=20 * i)).isoformat(),
                sample_rate_hz=RATE_HZ,
                pretrigger=PRETRIGGER,
                acceleration=y[i].astype(np.float32).astype(float),
                accepted=True,
            )
        )
    rig = RigDescription(
        m1_kg=plan.declared_masses[0],
        m2_kg=plan.declared_masses[1],
        k1_n_per_m=plan.declared_springs[0],
        k2_n_per_m=plan.declared_springs[1],
        sample_rate_hz=RATE_HZ,
        highpass_hz=plan.highpass_hz,
        highpass_order=1,
        lowpass_hz=plan.lowpass_hz,
        lowpass_order=4,
        filter_family="butterworth",
        full_scale_m_s2=scale,
        bits=BITS,
    )
    session = Session(created=began.isoformat(), rig=rig, impacts=tuple(impacts), software="concealed", complete=True)
    return Recorded(session, knowing_rms(plan, noise))


def _unclipped(concealed: Concealed) -> Real:
    rest = tuple(h for h in concealed.hidden if h.effect.id != "clipping")
    return signals(replace(concealed, hidden=rest))


def truth(concealed: Concealed, d: float, knowing: float) -> dict[str, Any]:
    """Return what was concealed, laid out as other concealed sessions have it (`kinds`, `effect`, `d`, ...)."""
    plan = concealed.plan
    effect: dict[str, Any] = {}
    for h in concealed.hidden:
        effect |= h.effect.parameters(plan, h.strength, h.character)
    return {
        "kinds": [h.effect.id for h in concealed.hidden],
        "components": [h.effect.component for h in concealed.hidden],
        "outside": any(not h.effect.listed for h in concealed.hidden),
        "laws": [h.effect.nature.told(h.character) for h in concealed.hidden if h.effect.nature is not None],
        "effect": effect,
        "strength": [h.strength for h in concealed.hidden],
        "d": d,
        "d_of_each": [h.d for h in concealed.hidden],
        "noise": plan.noise.rms,
        "slow_share": plan.noise.slow_share,
        "corner_hz": plan.noise.corner_hz,
        "knowing_rms": knowing,
        "K1": plan.springs[0],
        "K2": plan.springs[1],
        "masses_kg": list(plan.masses),
        "loads_n": plan.loads.tolist(),
        "kc": plan.kc.tolist(),
        "cc": plan.cc.tolist(),
        "exponent": plan.exponent,
        "undeclared_hz": concealed.undeclared_hz if math.isfinite(concealed.undeclared_hz) else None,
        "load_drift_n": concealed.drift_n,
        "impacts": int(plan.group.size),
        "samples": plan.samples,
    }
