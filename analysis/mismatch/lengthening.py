"""Fits of strong effects: from the late part of the records, where the rig is nearly linear, to the whole.

Where an effect is so strong that the linear rig's constants are no start for it, the end of every record still gives
them. From there the records are made longer step by step; the state at each earlier beginning comes from running the
rig with its force law backward in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.baseline import Constants, Nuisance, Sensitivity
from analysis.mismatch.fit import MOST_ITERATIONS, Fit, extra_forces, fit
from analysis.mismatch.linear import linear_rig
from analysis.mismatch.problem import Problem, Term
from sim_backend.modal_march import step_weights

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

LATE_S = (4e-3, 8e-3, 16e-3, 32e-3)  # after the tap: beginnings that are tried for a linear start
NEARLY_LINEAR = 1.3  # misfit up to which the linear rig is a start
STRONG = 3.0  # misfit beyond which a fit is lost
SHARE = 0.75  # of the time after the tap that the next longer records begin at
LEAST_STEP_S = 1e-3
FEW_ITERATIONS = 6
SHORT_S = 8e-3  # of late records: so short that a wrong constant does not lose count of the oscillations
SCAN = np.linspace(-0.08, 0.08, 41)  # relative changes of a load's stiffness that are tried
LEAST_SAMPLES = 300


def lengthened(problem: Problem, terms: Sequence[Term], begin: Fit, held: Fit | None = None) -> Fit | None:
    """Fit the rig with force laws by making records longer.

    Parameters
    ----------
    begin
        Any fit of the linear rig to the same records.
    held
        A fit whose constants and laws are kept: only what belongs to each impact is fitted.

    Returns
    -------
    Fit or None
        None where the late part gives no start, or where it cannot be gone on from.
    """
    rate = problem.recordings.sample_rate_hz
    shortest = min(r.y.shape[1] for r in problem.recordings.records)
    linear = None if held is None else replace(held, terms=())
    late, skipped = None, 0
    for since in LATE_S:
        if shortest - round(since * rate) < LEAST_SAMPLES:
            break
        skipped = round(since * rate)
        later = problem.later(skipped)
        late = _late(later, begin) if linear is None else fit(later, held=linear)
        if misfit(late) < NEARLY_LINEAR:
            break
    if late is None:
        return None
    current = fit(late.problem, terms, begin=late, held=held, most_iterations=FEW_ITERATIONS)
    while skipped > 0 and misfit(current) < STRONG:
        step = max(round((1 - SHARE) * skipped), round(LEAST_STEP_S * rate))
        nearer = max(skipped - step, 0)
        amplitudes = [earlier(current, i, skipped - nearer) for i in range(len(current.amplitudes))]
        skipped = nearer
        longer = problem.later(skipped)
        most = FEW_ITERATIONS if skipped else MOST_ITERATIONS
        current = fit(longer, current.terms, current, held, most_iterations=most, amplitudes=amplitudes)
    return current if skipped == 0 else None


def misfit(fitted: Fit) -> float:
    """Return the sum of squares of a sample: 1 where nothing but noise is left."""
    return fitted.chi_squared / sum(r.size for r in fitted.residuals)


def _late(problem: Problem, begin: Fit) -> Fit:
    """Fit the linear rig to records that begin late, each load's stiffness found by a scan of their first part."""
    samples = round(SHORT_S * problem.recordings.sample_rate_hz)
    records = tuple(replace(r, y=r.y[:, :samples], raw=r.raw[:, :samples]) for r in problem.recordings.records)
    short = replace(problem, recordings=replace(problem.recordings, records=records))
    load = begin.constants.load.copy()
    for group in range(len(load)):
        left = []
        for change in SCAN:
            tried = load.copy()
            tried[group, 0] *= 1 + change
            left.append(_left(short, Constants(problem.arrangement, begin.constants.rig, tried), group))
        load[group, 0] *= 1 + SCAN[int(np.argmin(left))]
    constants = replace(begin.constants, load=load)
    first = fit(short, begin=replace(begin, constants=constants))
    return fit(problem, begin=first)


def _left(problem: Problem, constants: Constants, group: int) -> float:
    """Sum of squares that the linear rig with these constants leaves at a load."""
    recordings = problem.recordings
    rig = linear_rig(
        problem.arrangement, constants.at(group), problem.analog, recordings.noise, recordings.sample_rate_hz
    )
    none = np.zeros((0, *rig.gains.shape), np.complex128)
    s = Sensitivity(rig, none[:, 0], none, none[:, 0])
    nuisance, total = Nuisance(recordings, problem.slow), 0.0
    for record in recordings.records:
        if record.group == group:
            q, _ = nuisance.basis(s, record)
            y = record.y.ravel()
            total += float(y @ y - np.sum((q.T @ y) ** 2))
    return total


def earlier(fitted: Fit, number: int, samples: int) -> Complex:
    """Return (p,) modal amplitudes so many samples before a record, by running the rig backward."""
    record = fitted.problem.recordings.records[number]
    to, amplitudes = fitted.responses[record.group], fitted.amplitudes[number]
    forces, used, h = extra_forces(fitted, number, -samples)
    rate = fitted.problem.recordings.sample_rate_hz
    lead = np.exp(-to.rig.poles * record.run_up / rate)
    w = step_weights(to.rig.poles, h)
    b = amplitudes * lead
    grown = np.power(w[0][:, None], np.arange(forces.shape[1] - 2, -1, -1)[None])
    b = b * w[0] ** (forces.shape[1] - 1)
    for row, element in zip(forces, used, strict=True):
        bend = np.append(0.0, np.diff(row, 2))
        pushes = w[1][:, None] * row[:-1] + w[2][:, None] * row[1:] + w[3][:, None] * bend
        b = b + to.drive[element] * np.sum(grown * pushes, axis=1)
    return np.asarray(b / lead, np.complex128)
