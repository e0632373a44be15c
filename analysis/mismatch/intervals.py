"""95 % intervals of a mechanism's parameters: from the curvature, and from the profile where the curvature misleads."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from analysis.mismatch.answer import Interval
from analysis.mismatch.problem import Fit
from analysis.mismatch.ring_downs.fit import Start, fit, without_added
from analysis.mismatch.ring_downs.problem import RingDownFit
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import AddedBody, Derived, Quantity

NORMAL_95 = 1.959964
STEP = 1e-4  # of differences, in the coordinates of the fit
UNSURE = 0.25  # standard error of a logarithm from which on the curvature misleads
FURTHEST = math.log(1e3)  # to which a profile is followed from the estimate, in the logarithm
ENOUGH = 0.15  # accuracy of the root of chi-squared at an end of an interval
MOST_TRIES = 14
WRONG = 3.0  # times the 95 % point: further out a fit may have begun too far away and ended in a wrong minimum,
SHORTEST_STRIDE = math.log(1.1)  # unless it began as close as that
PULSE_S = 9e-5  # rms length of a tap's pulse (half a sine of 0.4 ms)
STRIDE, LONGEST_STRIDE = math.log(1.6), math.log(4.0)  # of the first step along a profile, of any


def intervals(fitted: Fit, number: int, left: float = 0.0) -> dict[str, Interval]:
    """Return the intervals of the parameters of a fit's term, and of what follows from them.

    ``left`` is the chi-squared beyond noise that the fit leaves. What made it may have moved the parameters by as much:
    errors are wider by its root.

    Added bodies that the data hold only loosely get theirs from the profile: where chi-squared has risen to its 95 %
    point with the first parameter held and all else, but for what force laws add to the segments, fitted again.
    """
    term = fitted.terms[number]
    quantities = [q for q in term.mechanism.parameters if q.name in term.values]
    covariance = fitted.term_covariances[number]
    ringing = isinstance(term.mechanism, AddedBody) and term.mechanism.body is not None
    if isinstance(fitted, RingDownFit) and (term.phase_locked or (ringing and fitted.modes[0].phase_locked)):
        covariance = covariance + _unknown_pulse(fitted)
    covariance = covariance * (1 + math.sqrt(left) / NORMAL_95) ** 2
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    found = {}
    for q, error in zip(quantities, errors, strict=True):
        value, reach = float(term.values[q.name]), NORMAL_95 * float(error)
        spread = math.exp(min(reach, 50.0))
        low, high = (value / spread, value * spread) if q.log else (value - reach, value + reach)
        if not error > 0:
            low, high = q.low, q.high  # the data do not hold it at all
        found[q.name] = Interval(value, max(low, q.low), min(high, q.high), q.unit)
    reached: list[dict[str, float]] = []
    loose = isinstance(term.mechanism, AddedBody) and quantities and quantities[0].log and errors[0] > UNSURE
    if loose and isinstance(fitted, RingDownFit):
        linear, place = _relieved(fitted, number)
        lower, lowest, least = _end(linear, place, quantities[0], -1.0, linear.objective)
        upper, _, most = _end(linear, place, quantities[0], 1.0, lowest)
        ends, reached = [lower, upper], [least, most]
        found |= {q.name: _between(found[q.name].value, ends, q) for q in quantities}
    for more in term.mechanism.derived:
        places = [dict(term.values), *({**term.values, **place} for place in reached)]
        own = [_derived(more, place, quantities, covariance) for place in places]
        found[more.name] = replace(own[0], low=min(i.low for i in own), high=max(i.high for i in own))
    return found


def through_zero(fitted: Fit, number: int) -> bool:
    """Whether the 95 % interval of a strength of either sign contains zero, so that not even its sign is known.

    A strength that cannot be negative ends at zero by nature: that it may be small does not mean that it may be absent.
    False where the error is not known.
    """
    term = fitted.terms[number]
    quantities = [q for q in term.mechanism.parameters if q.name in term.values]
    at = next((i for i, q in enumerate(quantities) if q.name == term.mechanism.strength), None)
    if at is None or quantities[at].log or not quantities[at].low < 0 < quantities[at].high:
        return False
    error = math.sqrt(max(float(fitted.term_covariances[number][at, at]), 0.0))
    return 0 < abs(float(term.values[quantities[at].name])) <= NORMAL_95 * error


def _unknown_pulse(fitted: RingDownFit) -> float:
    """Return the variance of the logarithm of a phase-locked body's mass, stiffness and damping due to the tap's pulse.

    The ringing of such a body is computed from a tap that is over at once, or from that of one at nearly its frequency.
    A pulse of rms length ``T`` sets a mode at ``omega`` going by ``(omega T)^2 / 2`` less, and all three grow together
    with what is missing.
    """
    at = fitted.modes[0]
    own, reference = (np.abs(at.rig.poles[list(j)]) for j in (at.phase_locked, at.rings_with))
    apart = np.abs(own**2 - reference**2).min()
    return float((apart * PULSE_S**2 / 2) ** 2)


def _relieved(fitted: RingDownFit, number: int) -> tuple[RingDownFit, int]:
    """Return the fit of all that is linear to what force laws leave of the segments, and the place of a term in it."""
    if not fitted.nonlinear:
        return fitted, number
    linear = [t for t in fitted.terms if not t.nonlinear]
    return fit(without_added(fitted), linear, fitted), linear.index(fitted.terms[number])


def _derived(more: Derived, values: dict[str, float], quantities: list[Quantity], covariance: Real) -> Interval:
    """Return the interval of what follows from parameters, by its slopes."""
    middle = more.value(values)
    slopes = []
    for q in quantities:
        moved = values[q.name] * math.exp(STEP) if q.log else values[q.name] + STEP * (abs(values[q.name]) or 1.0)
        step = STEP if q.log else moved - values[q.name]
        slopes.append((more.value(values | {q.name: moved}) - middle) / step)
    reach = NORMAL_95 * math.sqrt(max(float(np.array(slopes) @ covariance @ np.array(slopes)), 0.0))
    if not more.positive:
        return Interval(middle, middle - reach, middle + reach, more.unit)
    spread = math.exp(min(reach / middle, 50.0))
    return Interval(middle, middle / spread, middle * spread, more.unit)


def _between(value: float, ends: list[dict[str, float] | None], q: Quantity) -> Interval:
    """Return a parameter's interval from the fits at the ends of the profile; where there is no end, its whole range.

    The parameters of an added body go together, so that its first one is followed for all of them.
    """
    reached = sorted(end[q.name] if end else limit for end, limit in zip(ends, (q.low, q.high), strict=True))
    return Interval(value, max(min(reached[0], value), q.low), min(max(reached[1], value), q.high), q.unit)


def _end(
    fitted: RingDownFit, number: int, along: Quantity, direction: float, lowest: float
) -> tuple[dict[str, float] | None, float, dict[str, float]]:
    """Follow the profile in a direction, each fit started from the last one that is still inside.

    Return the parameters where it has risen enough (None where it does not within reach), the lowest objective met, and
    the parameters at the furthest place that is not outside.
    """

    def here(at: Fit) -> dict[str, float]:
        return {k: float(v) for k, v in at.terms[number].values.items()}

    near, rose, reach, far = 0.0, math.sqrt(max(fitted.objective - lowest, 0.0)), STRIDE, math.inf
    before, inside, end, longest = None, fitted, None, LONGEST_STRIDE
    for _ in range(MOST_TRIES):
        if reach > FURTHEST:
            break
        moved = _fixed_at(inside, number, along, math.exp(direction * (reach - near)), before)
        root = math.inf
        if moved is not None:
            lowest = min(lowest, moved.objective)
            root = math.sqrt(max(moved.objective - lowest, 0.0))
            end = here(moved)
        if moved is not None and abs(root - NORMAL_95) < ENOUGH:
            return end, lowest, here(moved)
        if root < NORMAL_95:
            near, rose, before, inside = reach, root, inside, moved or inside
        elif moved is None or root < WRONG * NORMAL_95 or reach - near < SHORTEST_STRIDE:
            far = reach
        else:
            longest = (reach - near) / 2
        if math.isfinite(far):
            share = (NORMAL_95 - rose) / (root - rose) if math.isfinite(root) and root > NORMAL_95 else 0.5
            reach = near + min(max(share, 0.2), 0.8) * (far - near)
        else:
            reach = near + min(max(STRIDE, near), longest)
    return (end if math.isfinite(far) else None), lowest, here(inside)


def _fixed_at(
    fitted: RingDownFit, number: int, along: Quantity, factor: float, before: RingDownFit | None
) -> RingDownFit | None:
    """Return the fit with a parameter of an added body held at a multiple of its value, and all scaled at the start.

    The other constants begin where they lead on from the fit ``before``, as far as the parameter has come since then.
    """
    term = fitted.terms[number]
    scaled = {q.name: term.values[q.name] * factor for q in term.mechanism.parameters if q.log}
    inside = min(max(scaled[along.name], along.low), along.high)
    if inside != scaled[along.name]:
        return None
    rig, load = fitted.constants.rig, fitted.constants.load
    if before is not None:
        here, there = float(term.values[along.name]), float(before.terms[number].values[along.name])
        on = (inside - here) / (here - there)
        rig, load = rig + on * (rig - before.constants.rig), load + on * (load - before.constants.load)
    names = fitted.constants.names()[0]
    rig = np.array([scaled.get(n, v) for n, v in zip(names, rig, strict=True)])
    begin = replace(fitted, constants=replace(fitted.constants, rig=rig, load=load))
    terms = [replace(t, values={**t.values, **scaled}) if i == number else t for i, t in enumerate(fitted.terms)]
    try:
        return fit(fitted.problem, terms, begin, Start(kept=(along.name,)))
    except (ValueError, np.linalg.LinAlgError):
        return None
