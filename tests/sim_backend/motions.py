"""Motions of small rigs with one mechanism each, and the same motions by scipy's DOP853 with located kinks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from sim_backend.mechanisms.catalogue import catalogue
from sim_backend.propagate import TOLERANCE, Clock, Given, Impact, Motion, Rigs, laws_of, propagate

Real = NDArray[np.float64]

RATE_HZ, SAMPLES = 25e3, 400
PRELOAD, STIFFNESS, DAMPING = 0.4, 8e6, 8.0
TWO = (
    np.array([0.107, 0.108]),
    np.array([[DAMPING, -DAMPING], [-DAMPING, DAMPING]]),
    np.array([[STIFFNESS + 4.6e5, -STIFFNESS], [-STIFFNESS, STIFFNESS + 4.7e5]]),
)
CONTACT = (np.array([1.0, -1.0]), STIFFNESS, DAMPING)
GUIDE = (np.array([1.0, 0.0]), 0.0, 0.0)
SPEED = 8e-4  # of the upper mass after the tap, m/s
NUDGE_S = 1e-12  # past a kink

Extra = Callable[[float, float, float, Real], tuple[float, Real]]
"""Deformation, its rate, time and inner states to the extra force and the inner states' rates."""


def no_inner(force: Callable[[float, float, float], float]) -> Extra:
    return lambda d, v, t, s: (force(d, v, t), np.zeros(0))


@dataclass(frozen=True)
class Case:
    """A law in an element of a rig, as the program has it and as an ordinary differential equation."""

    name: str
    law: object
    constants: tuple[float, ...]
    extra: Extra
    element: tuple[Real, float, float] = CONTACT
    rig: tuple[Real, Real, Real] = TWO
    kinks: tuple[Callable[[float, float, Real], float], ...] = ()  # of deformation, rate and inner states
    inner: int = 0
    speed: float = SPEED
    inputs: Callable[[float], float] | None = None  # N on the upper mass
    given: Callable[[float, int], Given] | None = None  # the same for a step and a number of them
    impact: tuple[int, float] | None = None  # sample at which the upper mass is struck again, by how much, m/s
    breaks: Real = field(default_factory=lambda: np.zeros(0))

    def start(self) -> Real:
        n = len(self.rig[0])
        z = np.zeros(2 * n)
        z[n] = self.speed
        return z


def reference(case: Case) -> Real:
    """Return displacements (samples, n), by DOP853 to a relative 1e-12."""
    mass, damping, stiffness = case.rig
    n, row = len(mass), case.element[0]

    def slope(t: float, z: Real) -> Real:
        x, v, s = z[:n], z[n : 2 * n], z[2 * n :]
        force, inner = case.extra(float(row @ x), float(row @ v), t, s)
        push = -stiffness @ x - damping @ v - row * force
        if case.inputs is not None:
            push[0] += case.inputs(t)
        return np.concatenate([v, push / mass, inner])

    def event(kink: Callable[[float, float, Real], float]) -> Callable[[float, Real], float]:
        def found(t: float, z: Real) -> float:
            return kink(float(row @ z[:n]), float(row @ z[n : 2 * n]), z[2 * n :])

        found.terminal = True  # type: ignore[attr-defined]
        return found

    events = [event(kink) for kink in case.kinks]
    times = np.arange(SAMPLES) / RATE_HZ
    out = np.zeros((SAMPLES, n))
    z = np.concatenate([case.start(), np.zeros(case.inner)])
    scale = np.concatenate([np.full(n, case.speed / 1e4), np.full(n, case.speed), np.full(case.inner, 1e-2)])
    ends = [times[-1] + 1e-9, *case.breaks.tolist()]
    if case.impact is not None:
        ends.append(case.impact[0] / RATE_HZ)
    t = 0.0
    for end in sorted({e for e in ends if 0 < e <= times[-1] + 1e-9}):
        while t < end:
            run = solve_ivp(
                slope, (t, end), z, "DOP853", events=events, rtol=1e-12, atol=1e-13 * scale,
                max_step=0.5 / RATE_HZ, dense_output=True,
            )  # fmt: skip
            at = (times >= t) & (times <= run.t[-1])
            if np.any(at):
                out[at] = run.sol(times[at])[:n].T
            t, z = float(run.t[-1]), run.y[:, -1]
            if t < end:
                past = min(NUDGE_S, end - t)
                t, z = t + past, z + past * slope(t, z)
        if case.impact is not None and abs(t - case.impact[0] / RATE_HZ) < 1e-12:
            z = z.copy()
            z[n] += case.impact[1]
    return out


def motion(case: Case, substeps: int, tolerance: float = TOLERANCE, runs: int = 1) -> Motion:
    """Return the same motion by the program, as often as there are runs."""
    mass, damping, stiffness = case.rig
    h, n = 1 / RATE_HZ / substeps, len(mass)
    row, k, c = case.element
    laws = laws_of([(case.law, 0)], [[np.array([PRELOAD, k, c, h, *case.constants])]] * runs)
    one = np.zeros((n, 1))
    one[0] = 1.0
    parts = (mass, damping, stiffness, row[None], one if case.given else one[:, :0])
    rigs = Rigs(*(np.repeat(part[None], runs, axis=0) for part in parts))
    steps = (SAMPLES - 1) * substeps
    impact = None
    if case.impact is not None:
        jump = np.zeros((runs, 2 * n))
        jump[:, n] = case.impact[1]
        impact = Impact(np.full(runs, case.impact[0] * substeps), jump)
    given = case.given(h, steps) if case.given else None
    clock = Clock(np.zeros(runs), h, steps, substeps)
    return propagate(rigs, laws, np.repeat(case.start()[None], runs, axis=0), clock, given, impact, tolerance)


def error(case: Case, found: Motion, true: Real) -> float:
    """Return the largest error of a displacement over the largest displacement."""
    return float(np.abs(found.states[0, :, : len(case.rig[0])] - true).max() / np.abs(true).max())


def _hertz(d: float, v: float, t: float) -> float:
    u = 1 + STIFFNESS * d / (1.5 * PRELOAD)
    return (PRELOAD * (u**1.5 - 1) if u > 0 else -PRELOAD) - STIFFNESS * d


def _lost(d: float, v: float, t: float) -> float:
    force = STIFFNESS * d + DAMPING * v
    return max(force, -PRELOAD) - force


SHARE, SLIP_N = 0.1 * STIFFNESS, 0.02


def _slider(d: float, v: float, t: float, s: Real) -> tuple[float, Real]:
    slips = abs(s[0]) >= SLIP_N and v * s[0] > 0
    return float(s[0]) - SHARE * d, np.array([0.0 if slips else SHARE * v])


RELAXING, TIME_S = 0.2 * STIFFNESS, 2e-4


def _relaxing(d: float, v: float, t: float, s: Real) -> tuple[float, Real]:
    return float(s[0]), np.array([RELAXING * v - s[0] / TIME_S])


MASS = 0.004  # on the lower mass
THREE = (
    np.array([0.107, 0.108, MASS]),
    np.array([[DAMPING, -DAMPING, 0], [-DAMPING, DAMPING + 0.5, -0.5], [0, -0.5, 0.5]]),
    np.array([[STIFFNESS + 4.6e5, -STIFFNESS, 0], [-STIFFNESS, STIFFNESS + 8.7e5, -4e5], [0, -4e5, 4e5]]),
)
_SAMPLED = 0.3 * np.sin(0.9 * np.arange(SAMPLES) + 0.02 * np.arange(SAMPLES) ** 1.5)


def _held(h: float, steps: int) -> Given:
    sub = round(1 / RATE_HZ / h)
    values = _SAMPLED[None, None]
    return Given(values, values, np.zeros(values.shape), sub)


def _linear(h: float, steps: int) -> Given:
    values = np.interp(h * np.arange(steps + 1) * RATE_HZ, np.arange(SAMPLES), _SAMPLED)[None, None]
    return Given(values[..., :-1], values[..., 1:], np.zeros((1, 1, steps)), 1)


def _tones(t: Real | float) -> Real:
    return 0.2 * np.sin(2 * np.pi * 700 * np.asarray(t)) + 0.1 * np.cos(2 * np.pi * 2500 * np.asarray(t))


def _band_limited(h: float, steps: int) -> Given:
    values = _tones(h * np.arange(steps + 1))[None, None]
    middle = _tones(h * (np.arange(steps) + 0.5))[None, None]
    start, end = values[..., :-1], values[..., 1:]
    return Given(start, end, 2 * (start + end) - 4 * middle, 1)


def cases() -> dict[str, Case]:
    """Return a case of every kind."""
    known = catalogue()
    hertz = known["hertz_stiffness"][0].law
    sliders = known["micro_slip"][0].law
    friction = (0.01, SPEED / 50)
    found = [
        Case("smooth law", hertz, (), no_inner(_hertz)),
        Case(
            "contact loss", known["contact_loss"][0].law, (), no_inner(_lost), speed=2.2 * SPEED,
            kinks=(lambda d, v, s: STIFFNESS * d + DAMPING * v + PRELOAD,),
        ),
        Case(
            "end stop", known["end_stop"][-1].law, (2e6, 1e-8), no_inner(lambda d, v, t: 2e6 * max(d - 1e-8, 0.0)),
            kinks=(lambda d, v, s: d - 1e-8,),
        ),
        Case(
            "dry friction", known["guide_friction"][0].law, friction,
            no_inner(lambda d, v, t: friction[0] * np.tanh(v / friction[1])), element=GUIDE,
        ),
        Case(
            "hysteresis", sliders, (SHARE, SLIP_N, 1.0), _slider, inner=1,
            kinks=(lambda d, v, s: v, lambda d, v, s: abs(s[0]) - SLIP_N),
        ),
        Case("rate law", known["relaxation"][-1].law, (RELAXING, TIME_S), _relaxing, inner=1),
        Case("added body", hertz, (), no_inner(_hertz), rig=THREE, element=(np.array([1.0, -1.0, 0.0]), *CONTACT[1:])),
        Case(
            "input held", hertz, (), no_inner(_hertz), given=_held, breaks=np.arange(SAMPLES) / RATE_HZ,
            inputs=lambda t: float(_SAMPLED[min(int(t * RATE_HZ + 1e-9), SAMPLES - 1)]),
        ),
        Case(
            "input linear", hertz, (), no_inner(_hertz), given=_linear, breaks=np.arange(SAMPLES) / RATE_HZ,
            inputs=lambda t: float(np.interp(t * RATE_HZ, np.arange(SAMPLES), _SAMPLED)),
        ),
        Case("input band-limited", hertz, (), no_inner(_hertz), given=_band_limited, inputs=lambda t: float(_tones(t))),
        Case("second impact", hertz, (), no_inner(_hertz), impact=(117, 0.4 * SPEED)),
    ]  # fmt: skip
    return {case.name: case for case in found}
