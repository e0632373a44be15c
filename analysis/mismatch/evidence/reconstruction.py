"""The contact's force against its deflection, without a law: what the bodies' equations leave for it.

The lower mass gives the force, ``m2 a2 + k2 x2``, and the upper one's equation its own motion. Nothing is assumed of
the force but that it is no rougher than the segments can show: what it is beyond ``k_c d + c_c d'`` is a random process
large enough not to be held back by it, and bodies, declared filter and process together are smoothed by Kalman's and
Rauch's equations. The force is noisy then, but not drawn towards any law.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import expm
from scipy.optimize import least_squares

from analysis.mismatch.ring_downs.experiment import Segment
from analysis.mismatch.ring_downs.problem import RingDownFit
from sim_backend.acting import laws_in
from sim_backend.arrangement import DERIVATIVES, Arrangement
from sim_backend.arrays import Real
from sim_backend.force_law import MEMORY
from sim_backend.mechanisms.kinds import AtRest
from sim_backend.state_space import StateSpace

VISIBLE = 10.0  # at least, power of the extra force allowed for over the noise's at twice the contact's frequency
SIZES = (1.0, 3.0, 10.0, 30.0, 100.0)  # of the extra force over that which is just visible; likelihood chooses
UNKNOWN = 1e2  # spread of what is not known at the start, in units of the motion
SETTLING = 4  # samples at its beginning for which a segment does not yet show the force
QUIET = 0.05  # of the first swing: smaller ones are no longer stitched
CURVE_KNOTS = 9  # odd, so that one is at rest
REACH = 0.3  # by which the curve is longer than the swings at either end
SLOW_S = 8e-4  # between the knots of the slow deflection
SHIFT = 0.05  # of the largest deflection: prior standard deviation of its shift
SMOOTH = 1e-4  # weight against bends of the curve that the swings do not show
STITCHES = 20  # most iterations
CHOOSING = 600  # samples by which the size of the extra force is chosen
FORCE_STATES = 2  # of the extra force: itself and its rate


@dataclass(frozen=True, slots=True)
class Reconstruction:
    """Contact force of one impact from the end of its pulse on; each array (n,).

    Attributes
    ----------
    time_s
        After the tap.
    deflection, rate
        Approach of the bodies about static equilibrium, m, and its rate, m/s.
    force
        Dynamic contact force, N; the total is this plus the preload.
    error
        Standard error of the force, N.
    """

    name: str
    preload_n: float
    time_s: Real
    deflection: Real
    rate: Real
    force: Real
    error: Real


@dataclass(frozen=True, slots=True)
class _System:
    """State from sample to sample: ``z' = step z + noise``, ``y = row z + noise``; the last states are the force's.

    ``spread`` is the covariance of the noise in the first step, ``fading`` its ratio from a step to the next.
    """

    step: Real
    spread: Real
    fading: float
    row: Real
    start: Real
    noise: float
    deflection: Real
    rate: Real
    force: Real


def reconstruct(fit: RingDownFit, number: int, rig_of: RingDownFit | None = None) -> Reconstruction:
    """Return the contact force of a segment of a fit, whatever its law.

    Masses and springs are fitted, not declared, ones: the upper mass is close to resonance with the system mode, and
    springs that miss its frequency by a thousandth would move it by as much again. The fit gives ``k_c`` and ``c_c``,
    the line about which the force is sought, and the size of the motion. Channels are averaged.

    Parameters
    ----------
    rig_of
        Fit that gives masses and springs, such as that of the law that was found: a fit of the wrong law bends them.
        The same fit by default.
    """
    segment = fit.problem.experiment.segments[number]
    rate = fit.problem.experiment.sample_rate_hz
    place = next(i for i, e in enumerate(fit.arrangement.elements) if e.role == "contact")
    fitted = fit.constants.at(segment.group)
    sound = fit if rig_of is None else rig_of
    values = fitted | dict(zip(sound.constants.names()[0], sound.constants.rig.tolist(), strict=True))
    rig = fit.modes[segment.group].rig
    seen = fit.arrangement.vector(fit.arrangement.elements[place].row, values) @ rig.shapes
    deformation = float(np.sum(rig.weight * np.abs(seen * fit.amplitudes[number])))
    noise = math.sqrt(float(np.mean([m.deviation**2 for m in fit.problem.experiment.noise])) / len(segment.raw))
    y = segment.raw.mean(axis=0)
    pole = complex(rig.poles[int(np.argmax(np.abs(seen * fit.amplitudes[number])))])
    visible = _visible_force(fit.arrangement, values, place, noise, abs(pole), rate) / (values["kc"] * deformation)
    contact = _Contact(fit.arrangement, values, place, fit.problem.analog, rate, deformation, pole)
    systems = [_system(contact, size * visible, noise) for size in SIZES]
    system = max(systems, key=lambda one: _filtered(one, y[:CHOOSING])[0])
    means, spreads = _smoothed(system, y)
    variance = np.einsum("i,nij,j->n", system.force, spreads, system.force)
    clear = slice(SETTLING, None)
    return Reconstruction(
        segment.name,
        segment.preload_n,
        (segment.start_s + np.arange(y.size) / rate)[clear],
        (means @ system.deflection)[clear],
        (means @ system.rate)[clear],
        (means @ system.force)[clear],
        np.sqrt(np.maximum(variance, 0.0))[clear],
    )


def _visible_force(
    rig: Arrangement, values: Mapping[str, float], place: int, noise: float, frequency: float, sample_rate_hz: float
) -> float:
    """Size, N, from which on the extra force stands clear of the noise at twice the contact's frequency (rad/s)."""
    contact = rig.vector(rig.elements[place].row, values)
    mass = np.array([values[m] for m in rig.masses])
    answer = np.mean(
        [
            abs(float(rig.vector(s.row, values) @ (contact / mass))) * (2 * frequency) ** (DERIVATIVES[s.quantity] - 2)
            for s in rig.sensors
        ]
    )
    # density of Matern's process there over that of white noise: 4 w^3 / (w^2 + (2 w)^2)^2 = 4 / 25 w
    return noise / float(answer) * math.sqrt(VISIBLE * 25 * frequency / (4 * sample_rate_hz))


def stitched(motion: Reconstruction, stiffness: float) -> Reconstruction:
    """Return the motion with the slow part of its deflection put back.

    Accelerometers do not show how the mean deflection shifts under a law that is not linear. It is chosen so that
    swings of all sizes lie on one curve of force against deflection (beside a force proportional to its rate), and
    that it vanishes when the swings have died away.

    Parameters
    ----------
    stiffness
        Of the contact, N/m: the scale of the curve.
    """
    size = np.maximum.accumulate(np.abs(motion.deflection)[::-1])[::-1]
    used = int(np.count_nonzero(size > QUIET * size[0]))
    t, d, v = motion.time_s[:used] - motion.time_s[0], motion.deflection[:used], motion.rate[:used]
    force = motion.force[:used] / stiffness / size[0]
    small = float(np.median(motion.error[:used])) / stiffness / size[0] / SHIFT
    reach = float(np.abs(d).max())
    knots = np.linspace(-1.0 - REACH, 1.0 + REACH, CURVE_KNOTS)
    middle = CURVE_KNOTS // 2
    times = np.append(np.arange(0.0, t[-1], SLOW_S), t[-1])
    slow = np.stack([np.interp(t, times, row) for row in np.eye(times.size)[:-1]], axis=1)  # zero at the end

    def parts(x: Real) -> tuple[CubicSpline, float, Real]:
        return (
            CubicSpline(knots, np.insert(x[: CURVE_KNOTS - 1], middle, 0.0)),
            float(x[CURVE_KNOTS - 1]),
            x[CURVE_KNOTS:],
        )

    def off(x: Real) -> Real:
        curve, damping, shift = parts(x)
        bent = curve(knots, 2) * SMOOTH
        return np.concatenate(
            [curve(d / reach + slow @ shift) + damping * v / np.abs(v).max() - force, small * shift, bent]
        )

    start = np.concatenate([np.delete(knots, middle) * reach / size[0], np.zeros(1 + slow.shape[1])])
    shift = least_squares(off, start, method="trf", max_nfev=STITCHES).x[CURVE_KNOTS:]
    moved = motion.deflection.copy()
    moved[:used] += reach * (slow @ shift)
    return replace(motion, deflection=moved)


def law_along(fit: RingDownFit, segment: Segment, motion: Reconstruction) -> Real:
    """Return (n,) the contact force, N, that a fit's laws have along a given motion."""
    place = next(i for i, e in enumerate(fit.arrangement.elements) if e.role == "contact")
    element, values = fit.arrangement.elements[place], fit.constants.at(segment.group)
    h = float(motion.time_s[1] - motion.time_s[0])
    force: Real = values["kc"] * motion.deflection + values["cc"] * motion.rate
    rest = AtRest.of(element, values, segment.preload_n)
    for i, mechanism, at in laws_in(fit.terms):
        if at != place:
            continue
        p = mechanism.packed(fit.terms[i].values, rest, h)
        before, after = np.zeros(MEMORY), np.zeros(MEMORY)
        out = np.empty_like(force)
        for n, (f, d, v) in enumerate(zip(force, motion.deflection, motion.rate, strict=True)):
            out[n] = mechanism.law(f, d, v, float(motion.time_s[0]) + n * h, p, before, after)
            before[:] = after
        force = out
    return force


@dataclass(frozen=True, slots=True)
class _Contact:
    """A contact in its rig: constants, element, declared filter, rate (Hz), deformation (m), pole (1/s)."""

    rig: Arrangement
    values: Mapping[str, float]
    place: int
    analog: StateSpace
    sample_rate_hz: float
    deformation: float
    pole: complex


def _system(contact: _Contact, size: float, noise: float) -> _System:
    """Join bodies, filter and extra force, which reaches up to the pole's frequency and dies away with it."""
    rig, values, place, analog = contact.rig, contact.values, contact.place, contact.analog
    sample_rate_hz, deformation = contact.sample_rate_hz, contact.deformation
    frequency, decay = abs(contact.pole), -contact.pole.real
    mass, damping, stiffness = rig.matrices(values)
    n, m = len(mass), len(analog.b)
    at_filter, at_force = 2 * n, 2 * n + m
    total = at_force + FORCE_STATES
    row_of_contact = rig.vector(rig.elements[place].row, values)
    motion = np.zeros((3, n, total))  # displacement, velocity, acceleration of each body in the states
    motion[0, :, :n] = np.eye(n)
    motion[1, :, n : 2 * n] = np.eye(n)
    motion[2, :, :n] = -stiffness / mass[:, None]
    motion[2, :, n : 2 * n] = -damping / mass[:, None]
    motion[2, :, at_force] = -row_of_contact / mass
    sensors = [(rig.vector(s.row, values), DERIVATIVES[s.quantity]) for s in rig.sensors]
    seen = np.mean([row @ motion[order] for row, order in sensors], axis=0)
    a = np.zeros((total, total))
    a[:n], a[n : 2 * n] = motion[1], motion[2]
    if m:
        a[at_filter:at_force] = np.outer(analog.b, seen)
        a[at_filter:at_force, at_filter:at_force] += analog.a
    # exp(-decay t) times Matern's process of order 3/2: f'' = -2 w f' - w^2 f + white noise
    a[at_force, at_force : at_force + 2] = -decay, 1.0
    a[at_force + 1, at_force:] = -(frequency**2), -2 * frequency - decay
    row = analog.d[0] * seen
    row[at_filter:at_force] += analog.c[0]
    force = values["kc"] * deformation * size
    speed = deformation * frequency
    unit = np.concatenate(
        [np.full(n, deformation), np.full(n, speed), np.full(m, speed * frequency), [force, force * frequency]]
    )
    scaled = a * unit / unit[:, None]
    white = np.zeros((total, total))
    white[-1, -1] = 4 * frequency  # unit variance of the scaled force
    step, spread = sampled(scaled, white, 1 / sample_rate_hz)
    start = np.diag(np.concatenate([np.full(at_force, UNKNOWN**2), np.ones(FORCE_STATES)]))
    approach, closing = (row_of_contact @ motion[order] * unit for order in (0, 1))
    extra = np.zeros(total)
    extra[at_force] = force
    return _System(
        step, spread, math.exp(-2 * decay / sample_rate_hz), row * unit, start, noise, approach, closing,
        values["kc"] * approach + values["cc"] * closing + extra,
    )  # fmt: skip


def sampled(a: Real, white: Real, h: float) -> tuple[Real, Real]:
    """Transition over a step and covariance of what white noise adds in it (Van Loan)."""
    n = len(a)
    both = np.zeros((2 * n, 2 * n))
    both[:n, :n], both[:n, n:], both[n:, n:] = -a, white, a.T
    grown = expm(both * h)
    step = grown[n:, n:].T
    spread = step @ grown[:n, n:]
    return step, (spread + spread.T) / 2


def _filtered(system: _System, y: Real) -> tuple[float, Real, Real, Real, Real]:
    """Log likelihood; means (n, states) and covariances (n, states, states) before each sample and with it."""
    count, states = y.size, len(system.row)
    ahead, ahead_spread = np.empty((count, states)), np.empty((count, states, states))
    mean, spread = np.empty_like(ahead), np.empty_like(ahead_spread)
    z, p = np.zeros(states), system.start
    likelihood, fresh = 0.0, system.spread
    identity = np.eye(states)
    for i in range(count):
        ahead[i], ahead_spread[i] = z, p
        across = p @ system.row
        variance = float(system.row @ across) + system.noise**2
        off = float(y[i] - system.row @ z)
        likelihood -= 0.5 * (off**2 / variance + math.log(variance))
        gain = across / variance
        kept = identity - np.outer(gain, system.row)
        z = z + gain * off
        p = kept @ p @ kept.T + system.noise**2 * np.outer(gain, gain)
        mean[i], spread[i] = z, p
        z, p = system.step @ z, system.step @ p @ system.step.T + fresh
        fresh = fresh * system.fading
    return likelihood, ahead, ahead_spread, mean, spread


def _smoothed(system: _System, y: Real) -> tuple[Real, Real]:
    """Means (n, states) and covariances (n, states, states) given all samples."""
    _, ahead, ahead_spread, mean, spread = _filtered(system, y)
    for i in range(y.size - 2, -1, -1):
        back = np.linalg.lstsq(ahead_spread[i + 1], system.step @ spread[i], rcond=1e-14)[0].T
        mean[i] = mean[i] + back @ (mean[i + 1] - ahead[i + 1])
        spread[i] = spread[i] + back @ (spread[i + 1] - ahead_spread[i + 1]) @ back.T
    return mean, spread


def telling_impacts(before: RingDownFit, after: RingDownFit) -> tuple[int, ...]:
    """Return the strongest and a weak segment of the load at which the better fit takes away most per impact."""
    segments = before.problem.experiment.segments
    gains: dict[float, list[float]] = {}
    for segment, r, s in zip(segments, before.residuals, after.residuals, strict=True):
        gains.setdefault(segment.preload_n, []).append(float(np.vdot(r, r) - np.vdot(s, s)))
    load = max(gains, key=lambda n: float(np.mean(gains[n])))
    return _extremes([i for i, r in enumerate(segments) if r.preload_n == load], segments)


def _extremes(numbers: Sequence[int], segments: Sequence[Segment]) -> tuple[int, ...]:
    ranked = sorted(numbers, key=lambda i: -float(np.abs(segments[i].raw).max()))
    return tuple(dict.fromkeys((ranked[0], ranked[-1])))
