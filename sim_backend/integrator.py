"""Ring-down of the tester with any contact law: compiled adaptive integration of Eq. 9 and the analog filter.

Dormand and Prince's explicit pair of order 8 with error estimates of order 5 and 3 (Hairer, Norsett, Wanner,
Solving Ordinary Differential Equations I, Sec. II.10), coefficients from `scipy.integrate.DOP853`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from scipy.integrate import DOP853

from rig.errors import RigError
from sim_backend.contact_laws import ContactLaw, dynamic_force, margin
from sim_backend.pulses import COS, END, LINEAR, OFFSET, OMEGA, SIN, START, Pulse
from sim_backend.ring_down import RingDown
from sim_backend.state_space import StateSpace
from sim_backend.two_mass import TwoMass

STAGES = 12
A = np.ascontiguousarray(DOP853.A[:STAGES, :STAGES], dtype=np.float64)
B = np.ascontiguousarray(DOP853.B, dtype=np.float64)
C = np.ascontiguousarray(DOP853.C[:STAGES], dtype=np.float64)
E3 = np.ascontiguousarray(DOP853.E3, dtype=np.float64)
E5 = np.ascontiguousarray(DOP853.E5, dtype=np.float64)

TOLERANCE = 1e-12  # error of one step, relative to the largest value so far; see `ring_down`
FLOOR = 1e-2  # share of the expected peak below which errors count as absolute
LARGEST_GROWTH, SMALLEST_GROWTH, SAFETY = 6.0, 0.2, 0.9
STEP_EXPONENT = -1 / 8
MOST_STEPS_PER_SAMPLE = 2000
BODY = 4  # x1, x2, v1, v2; the filter's states follow

DONE, STUCK = 0, 1


def ring_down(
    tester: TwoMass,
    law: ContactLaw,
    pulse: Pulse,
    onset_s: float,
    samples: int,
    sample_rate_hz: float,
    analog: StateSpace | None = None,
    tolerance: float = TOLERANCE,
) -> RingDown:
    """Return the response of Eq. 9, with ``law`` in the place of k_c, to a pulse on the upper mass, from rest.

    Steps end on every sample and every knot of the pulse, and where the surfaces part or meet, so the error control
    always sees a smooth right-hand side. With the default tolerance accelerations, displacements and forces are
    within 1e-8 of their peak over thousands of samples (the tests compare each law, parting or not, with scipy's
    DOP853 at rtol 1e-13 and located events).

    Parameters
    ----------
    tester
        Eq. 9; its ``kc`` and ``cc`` are stiffness and damping at the preload.
    law
        Force law about its preload.
    pulse, onset_s, samples, sample_rate_hz, analog
        As in `sim_backend.ring_down.ring_down_linear`.
    tolerance
        Error allowed in each step, relative to the largest value so far.
    """
    if analog is None:
        analog = StateSpace(np.zeros((0, 0)), np.zeros(0), np.zeros((1, 0)), np.ones(1))
    bodies = np.array([tester.m1, tester.m2, tester.k1, tester.k2, tester.c1, tester.c2])
    knots = pulse.knots + onset_s
    active = [pulse.active(t - onset_s) for t in (knots[:-1] + knots[1:]) / 2]
    first_active = np.cumsum([0, *map(len, active)])
    segments = pulse.segments.copy()
    segments[:, [START, END]] += onset_s

    speed = float(np.max(np.abs(pulse(pulse.knots[:-1] + np.diff(pulse.knots) / 2)))) * pulse.duration_s / tester.m1
    omega = math.sqrt((tester.kc + tester.k1) / tester.m1)
    scale = np.empty(BODY + len(analog.b))
    scale[:2], scale[2:BODY], scale[BODY:] = speed / omega, speed, speed * omega

    outputs, status = _integrate(
        bodies,
        law.number,
        law.parameters(tester.kc, tester.cc),
        segments,
        knots,
        np.concatenate([*active, np.zeros(0)]).astype(np.int64),
        first_active.astype(np.int64),
        np.ascontiguousarray(analog.a),
        np.ascontiguousarray(analog.b),
        np.ascontiguousarray(analog.c[0]),
        float(analog.d[0]),
        FLOOR * scale,
        samples,
        sample_rate_hz,
        tolerance,
    )
    if status != DONE:
        raise RigError(
            "The simulated tap could not be computed: the contact is too stiff for a blow this hard. "
            "Lower sim_backend.pulse.peak_force_ratio or choose another contact law."
        )
    return RingDown(sample_rate_hz, *outputs)


@njit(cache=True)
def _derivative(t, y, out, bodies, law, contact, touching, segments, active, fa, fb):  # type: ignore[no-untyped-def]
    """Write dy/dt of Eq. 9 and of the filter into ``out``."""
    force = 0.0
    for i in active:
        tau = t - segments[i, START]
        phase = segments[i, OMEGA] * tau
        force += segments[i, OFFSET] + segments[i, LINEAR] * tau
        if phase != 0.0 or segments[i, COS] != 0.0:
            force += segments[i, SIN] * math.sin(phase) + segments[i, COS] * math.cos(phase)
    m1, m2, k1, k2, c1, c2 = bodies
    contact_force = dynamic_force(law, contact, touching, y[0] - y[1], y[2] - y[3])
    out[0], out[1] = y[2], y[3]
    out[2] = (force - contact_force - k1 * y[0] - c1 * y[2]) / m1
    acceleration = (contact_force - k2 * y[1] - c2 * y[3]) / m2
    out[3] = acceleration
    for i in range(len(fb)):
        total = fb[i] * acceleration
        for j in range(len(fb)):
            total += fa[i, j] * y[BODY + j]
        out[BODY + i] = total


@njit(cache=True)
def _step(t, h, y, slopes, work, new, bodies, law, contact, touching, segments, active, fa, fb):  # type: ignore[no-untyped-def]
    """Step from (t, y), whose derivative is ``slopes[0]``; the end goes into ``new`` and ``slopes[STAGES]``."""
    n = len(y)
    for s in range(1, STAGES):
        for i in range(n):
            total = 0.0
            for j in range(s):
                if A[s, j] != 0.0:
                    total += A[s, j] * slopes[j, i]
            work[i] = y[i] + h * total
        _derivative(t + C[s] * h, work, slopes[s], bodies, law, contact, touching, segments, active, fa, fb)
    for i in range(n):
        total = 0.0
        for j in range(STAGES):
            total += B[j] * slopes[j, i]
        new[i] = y[i] + h * total
    _derivative(t + h, new, slopes[STAGES], bodies, law, contact, touching, segments, active, fa, fb)


@njit(cache=True)
def _error(h, slopes, scale):  # type: ignore[no-untyped-def]
    """Return the step's error over the allowed one: the combination of both estimates by Hairer et al."""
    n = len(scale)
    fifth, third = 0.0, 0.0
    for i in range(n):
        e5, e3 = 0.0, 0.0
        for j in range(STAGES + 1):
            e5 += E5[j] * slopes[j, i]
            e3 += E3[j] * slopes[j, i]
        fifth += (e5 / scale[i]) ** 2
        third += (e3 / scale[i]) ** 2
    below = fifth + 0.01 * third
    if below == 0.0:
        return 0.0
    return abs(h) * fifth / math.sqrt(below * n)


@njit(cache=True)
def _margin_of(y, slope, law, contact, touching):  # type: ignore[no-untyped-def]
    return margin(law, contact, touching, y[0] - y[1], y[2] - y[3], slope[2] - slope[3])


@njit(cache=True)
def _dip(h, g0, rate0, g1, rate1):  # type: ignore[no-untyped-def]
    """Return where in (0, h) the cubic through two margins and their rates has a minimum below zero; else h."""
    if not (rate0 < 0.0 < rate1):
        return h
    # derivative of the Hermite cubic on s in [0, 1]: q0 + q1 s + q2 s^2
    q0, q3 = h * rate0, h * rate1
    q1 = 6 * (g1 - g0) - 4 * q0 - 2 * q3
    q2 = 3 * (q0 + q3) - 6 * (g1 - g0)
    root = q1 * q1 - 4 * q2 * q0
    if root < 0.0:
        return h
    # q0 < 0 and the derivative ends positive: the rising root
    s = -2 * q0 / (q1 + math.sqrt(root)) if q1 + math.sqrt(root) > 0.0 else 1.0
    if not 0.0 < s < 1.0:
        return h
    if g0 + s * (q0 + s * (q1 / 2 + s * q2 / 3)) < 0.0:
        return s * h
    return h


@njit(cache=True)
def _integrate(  # type: ignore[no-untyped-def]
    bodies, law, contact, segments, knots, all_active, first_active, fa, fb, fc, fd, floor, samples, rate_hz, tolerance
):
    """Return outputs (5, samples) in the order of `RingDown`, and DONE or STUCK."""
    n = BODY + len(fb)
    outputs = np.zeros((5, samples))
    y, new, work = np.zeros(n), np.zeros(n), np.zeros(n)
    slopes = np.zeros((STAGES + 1, n))
    peak = floor.copy()
    scale = np.empty(n)
    touching = True

    sample = max(0, math.ceil(knots[0] * rate_hz))
    knot = 1
    t = knots[0]
    h = 0.25 / rate_hz
    active = all_active[first_active[0] : first_active[1]]
    _derivative(t, y, slopes[0], bodies, law, contact, touching, segments, active, fa, fb)
    budget = MOST_STEPS_PER_SAMPLE * (samples + len(knots))
    switched_at = -math.inf

    while sample < samples:
        if sample / rate_hz <= t:
            contact_force = dynamic_force(law, contact, touching, y[0] - y[1], y[2] - y[3])
            filtered = fd * slopes[0, 3]
            for i in range(len(fb)):
                filtered += fc[i] * y[BODY + i]
            outputs[0, sample] = filtered
            outputs[1, sample] = y[1]
            outputs[2, sample] = contact_force
            outputs[3, sample] = y[0] - y[1]
            outputs[4, sample] = y[2] - y[3]
            sample += 1
            continue
        if knot < len(knots) and knots[knot] <= t:
            last = first_active[min(knot + 1, len(knots) - 1)]
            active = all_active[first_active[knot] : last]
            knot += 1
            _derivative(t, y, slopes[0], bodies, law, contact, touching, segments, active, fa, fb)
            continue

        end = sample / rate_hz
        if knot < len(knots):
            end = min(end, knots[knot])
        clipped = t + 1.0000001 * h >= end
        step = end - t if clipped else h
        # displacements share one scale, and so do velocities and filter states
        scale[0] = scale[1] = tolerance * max(peak[0], peak[1])
        scale[2] = scale[3] = tolerance * max(peak[2], peak[3])
        for i in range(BODY, n):
            scale[i] = tolerance * peak[i]

        g0, rate0 = _margin_of(y, slopes[0], law, contact, touching)
        while True:
            budget -= 1
            if budget < 0:
                return outputs, STUCK
            _step(t, step, y, slopes, work, new, bodies, law, contact, touching, segments, active, fa, fb)
            error = _error(step, slopes, scale)
            if error < 1.0:
                growth = LARGEST_GROWTH if error == 0.0 else min(LARGEST_GROWTH, SAFETY * error**STEP_EXPONENT)
                h = max(h, step * growth) if clipped else step * growth
                break
            shrink = max(SMALLEST_GROWTH, SAFETY * error**STEP_EXPONENT) if math.isfinite(error) else SMALLEST_GROWTH
            step *= shrink
            h = step
            clipped = False

        g1, rate1 = _margin_of(new, slopes[STAGES], law, contact, touching)
        if g1 >= 0.0 and g0 > 0.0:
            dip = _dip(step, g0, rate0, g1, rate1)
            if dip < step:
                step, clipped = dip, False
                _step(t, step, y, slopes, work, new, bodies, law, contact, touching, segments, active, fa, fb)
                g1, rate1 = _margin_of(new, slopes[STAGES], law, contact, touching)
        if g1 < 0.0:
            clipped = False
            if g0 <= 0.0:
                # already on the wrong side: change at once, unless that has just been done at this very instant
                if switched_at < t:
                    touching = not touching
                    switched_at = t
                    _derivative(t, y, slopes[0], bodies, law, contact, touching, segments, active, fa, fb)
                    continue
            else:
                # false position (Illinois) for the instant, kept on the far side of it
                low, high, g_low, g_high = 0.0, step, g0, g1
                side = 0
                for _ in range(60):
                    if high - low <= 1e-13 * high or high - low < 1e-17:
                        break
                    step = low + (high - low) * g_low / (g_low - g_high)
                    if not low < step < high:
                        step = 0.5 * (low + high)
                    _step(t, step, y, slopes, work, new, bodies, law, contact, touching, segments, active, fa, fb)
                    g = _margin_of(new, slopes[STAGES], law, contact, touching)[0]
                    if g < 0.0:
                        high, g_high = step, g
                        if side == 1:
                            g_low *= 0.5
                        side = 1
                        if -g < 1e-13 * contact[0]:
                            break
                    else:
                        low, g_low = step, max(g, 1e-300)
                        if side == -1:
                            g_high *= 0.5
                        side = -1
                step = high
                _step(t, step, y, slopes, work, new, bodies, law, contact, touching, segments, active, fa, fb)
                touching = not touching
                switched_at = t + step
                _derivative(t + step, new, slopes[STAGES], bodies, law, contact, touching, segments, active, fa, fb)

        t = end if clipped else t + step
        for i in range(n):
            y[i] = new[i]
            slopes[0, i] = slopes[STAGES, i]
            peak[i] = max(peak[i], abs(y[i]))
    return outputs, DONE
