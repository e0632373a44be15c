"""Fits of strong effects: to parts of the segments first, to the whole from there.

From their beginnings on, `lengthened`, if the linear rig's constants are near enough for a few periods. Where an effect
is so strong that they are not, the end of every segment, where the rig is nearly linear, still gives them, `continued`:
from there the segments are made longer step by step; the state at each earlier beginning comes from running the
rig with its force law backward in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.mismatch.account import far_off
from analysis.mismatch.parameters import Term
from analysis.mismatch.problem import Constants
from analysis.mismatch.ring_downs.added_response import AddedResponse
from analysis.mismatch.ring_downs.fit import AT_THE_MINIMUM, Start, Stop, fit
from analysis.mismatch.ring_downs.linear import linear_rig
from analysis.mismatch.ring_downs.modes import Sensitivity
from analysis.mismatch.ring_downs.problem import RingDownFit, RingDowns
from sim_backend.arrays import Complex
from sim_backend.modal_response import step_weights

LATE_S = (4e-3, 8e-3, 16e-3, 32e-3)  # after the tap: beginnings that are tried for a linear start
SHARE = 0.75  # of the time after the tap that the next longer segments begin at
LEAST_STEP_S = 1e-3
FEW_ITERATIONS, ON_THE_WAY = 6, 5.0  # steps, and the gain in chi-squared of one that is the last, until all is fitted
SHORT_S = 8e-3  # of late segments: so short that a wrong constant causes no cycle skipping
SCAN = np.linspace(-0.08, 0.08, 41)  # relative changes of a load's stiffness that are tried
LEAST_SAMPLES = 300
FIRST_S = 6e-3  # after the pulse; longest for which the fits of simulated rough contacts tapped hard do not skip cycles
LONGER = 2.0  # factor from one part of the segments that is fitted to the next
SHORTER = (1.0, 1 / 2, 1 / 3)  # of `FIRST_S`: parts from which amplitudes are found where those of longer ones are lost
LOST = 100.0  # reduced chi-squared of the next longer part; where forces are fine enough, laws nearly right reach 10
_ON_THE_WAY = Stop(FEW_ITERATIONS, gain=ON_THE_WAY, known=False)


def beginnings(problem: RingDowns, seconds: float) -> RingDowns:
    """Return the same problem with so much of the beginning of every segment alone."""
    samples = round(seconds * problem.experiment.sample_rate_hz)
    return problem.with_segments(
        [replace(s, y=s.y[:, :samples], raw=s.raw[:, :samples]) for s in problem.experiment.segments]
    )


def linear_at_first(problem: RingDowns, begin: RingDownFit) -> RingDownFit:
    """Return the linear rig fitted to the first milliseconds, its masses and loads as declared.

    What a fit to whole segments makes of them stands in for a strong effect, and so may what it makes of the rest.

    Parameters
    ----------
    begin
        A fit of the linear rig to the same loads.
    """
    short, start = beginnings(problem, FIRST_S), Start(kept=problem.arrangement.force_scales)
    begins = declared_scales(begin), declared_constants(problem, begin)
    fits = [fit(short, begin=one, start=start, stop=_ON_THE_WAY) for one in begins]
    return min(fits, key=lambda one: one.objective)


def declared_constants(problem: RingDowns, begin: RingDownFit) -> RingDownFit:
    """Return a fit with masses and loads as declared, and the constants of each load that a problem starts with."""
    declared = declared_scales(begin)
    return replace(declared, constants=replace(declared.constants, load=problem.start.copy()))


def declared_scales(begin: RingDownFit) -> RingDownFit:
    """Return a fit with the rig's masses as declared and loads as measured, all else as it is."""
    rig = begin.problem.arrangement
    declared = {p.name: p.value for p in rig.parameters if p.name in rig.force_scales}
    values = [declared.get(n, v) for n, v in zip(begin.constants.names()[0], begin.constants.rig, strict=True)]
    return replace(begin, constants=replace(begin.constants, rig=np.array(values)))


def scales_kept(fitted: RingDownFit) -> RingDownFit | None:
    """Return the fit that keeps masses as declared and loads as measured; None where none of them is moved far.

    What moves them may be a law that is not quite right. Then what the frequencies say with the masses as declared is
    right.
    """
    rig = fitted.problem.arrangement
    known = dict(zip(fitted.constants.names()[0], fitted.constants.rig, strict=True))
    if not far_off(known, [p for p in rig.parameters if p.name in rig.force_scales]):
        return None
    start = Start(amplitudes=fitted.amplitudes if fitted.nonlinear else (), kept=rig.force_scales)
    return fit(fitted.problem, fitted.terms, declared_scales(fitted), start)


def each_alone(problem: RingDowns, terms: Sequence[Term], begin: RingDownFit) -> list[Complex]:
    """Return the amplitudes of each segment with constants and laws held: (p,) complex.

    Far from these a fit to several periods is lost; so it is tried from fewer, too. The terms may have bodies that the
    fit to begin with has not.
    """
    added = AddedResponse(problem, terms, begin.substeps)
    known = dict(zip(begin.constants.names()[0], begin.constants.rig, strict=True))
    rig = np.array([known.get(p.name, p.value) for p in added.rig_parameters])
    constants = Constants(added.arrangement, rig, begin.constants.load)
    held = replace(begin, terms=added.terms, arrangement=added.arrangement, constants=constants)
    return [_alone(problem.only([i]), held) for i in range(len(problem.experiment.segments))]


def _alone(problem: RingDowns, held: RingDownFit) -> Complex:
    """Return the amplitudes of the one segment of a problem."""
    seconds = problem.samples / problem.experiment.sample_rate_hz
    fits: list[RingDownFit] = []
    for share in SHORTER:
        found = fit(beginnings(problem, share * seconds), start=Start(held=held), stop=_ON_THE_WAY)
        if share < 1:
            found = fit(problem, start=Start(held=held, amplitudes=found.amplitudes), stop=_ON_THE_WAY)
        fits.append(found)
        if found.reduced_chi_squared < problem.policy.strong:
            break
    return min(fits, key=lambda one: one.objective).amplitudes[0]


def lengthened(
    problem: RingDowns, terms: Sequence[Term], begin: RingDownFit, stop: Stop = AT_THE_MINIMUM
) -> RingDownFit:
    """Fit the rig with force laws to ever longer beginnings of the segments, at last to the whole.

    A constant that is a little off is out of phase at the end of a segment, where a fit to the whole is lost; it is not
    within the first periods. Masses and the scale of the loads stay until the last fit: recordings of the motion alone
    hardly tell them, and far from where they were declared there is no quick way back.

    Parameters
    ----------
    begin
        A fit with the constants to start from, of any segments.
    stop
        When the fit to the whole ends; where it competes, extra forces are computed in coarser steps as long as these
        will do: motion that bends the rig's springs as much as it deflects them leaves them behind after some periods.
    """
    whole = max(r.y.shape[1] for r in problem.experiment.segments) / problem.experiment.sample_rate_hz
    amplitudes = each_alone(beginnings(problem, FIRST_S), terms, begin)
    seconds, current, start = FIRST_S, begin, Start(kept=problem.arrangement.force_scales, amplitudes=amplitudes)
    coarse = stop.competing
    while LONGER * seconds < whole:
        part, on_the_way = beginnings(problem, seconds), replace(_ON_THE_WAY, competing=coarse)
        found = fit(part, terms, current, start, on_the_way)
        if coarse and _lost(found, current):
            coarse, found = False, fit(part, terms, current, start, replace(on_the_way, competing=False))
        current, terms, seconds = found, found.terms, LONGER * seconds
        start = replace(start, amplitudes=current.amplitudes)
    start = replace(start, kept=())
    found = fit(problem, terms, current, start, replace(stop, competing=coarse))
    if coarse and _lost(found, current):
        found = fit(problem, terms, current, start, replace(stop, competing=False))
    return found


def lengthened_held(problem: RingDowns, held: RingDownFit) -> RingDownFit:
    """Return the fit of what belongs to each impact alone, the rest as in another fit, from the beginning on."""
    whole = max(r.y.shape[1] for r in problem.experiment.segments) / problem.experiment.sample_rate_hz
    amplitudes: Sequence[Complex] = each_alone(beginnings(problem, FIRST_S), held.terms, held)
    seconds = LONGER * FIRST_S
    while seconds < whole:
        start = Start(held=held, amplitudes=amplitudes)
        amplitudes = fit(beginnings(problem, seconds), start=start, stop=_ON_THE_WAY).amplitudes
        seconds *= LONGER
    return fit(problem, start=Start(held=held, amplitudes=amplitudes))


def _lost(longer: RingDownFit, shorter: RingDownFit) -> bool:
    """Whether a fit to a longer part of the segments lost what explained the shorter."""
    return shorter.reduced_chi_squared < shorter.problem.policy.strong and longer.reduced_chi_squared > LOST


def continued(
    problem: RingDowns, terms: Sequence[Term], begin: RingDownFit, held: RingDownFit | None = None
) -> RingDownFit | None:
    """Fit the rig with force laws by making segments longer.

    Parameters
    ----------
    begin
        Any fit of the linear rig to the same segments.
    held
        A fit whose constants and laws are kept: only what belongs to each impact is fitted.

    Returns
    -------
    RingDownFit or None
        None where the late part gives no start, or where it cannot be gone on from.
    """
    rate, policy = problem.experiment.sample_rate_hz, problem.policy
    shortest = min(r.y.shape[1] for r in problem.experiment.segments)
    linear = None if held is None else replace(held, terms=())
    late, skipped = None, 0
    for since in LATE_S:
        if shortest - round(since * rate) < LEAST_SAMPLES:
            break
        skipped = round(since * rate)
        later = problem.cropped(skipped)
        late = _late(later, begin) if linear is None else fit(later, start=Start(held=linear))
        if late.reduced_chi_squared < policy.strong:
            break
    if late is None:
        return None
    current = fit(late.problem, terms, late, Start(held=held), _ON_THE_WAY)
    while skipped > 0 and current.reduced_chi_squared < policy.strong:
        step = max(round((1 - SHARE) * skipped), round(LEAST_STEP_S * rate))
        nearer = max(skipped - step, 0)
        amplitudes = [earlier(current, i, skipped - nearer) for i in range(len(current.amplitudes))]
        skipped = nearer
        longer = problem.cropped(skipped)
        stop = _ON_THE_WAY if skipped else AT_THE_MINIMUM
        current = fit(longer, current.terms, current, Start(held=held, amplitudes=amplitudes), stop)
    return current if skipped == 0 else None


def _late(problem: RingDowns, begin: RingDownFit) -> RingDownFit:
    """Fit the linear rig to segments that begin late, each load's stiffness found by a scan of their first part."""
    short = beginnings(problem, SHORT_S)
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


def _left(problem: RingDowns, constants: Constants, group: int) -> float:
    """Sum of squares that the linear rig with these constants leaves at a load."""
    experiment = problem.experiment
    rig = linear_rig(
        problem.arrangement, constants.at(group), problem.analog, experiment.noise, experiment.sample_rate_hz
    )
    none = np.zeros((0, *rig.gains.shape), np.complex128)
    s = Sensitivity(rig, none[:, 0], none, none[:, 0])
    nuisance, total = problem.nuisance(), 0.0
    for segment in experiment.segments:
        if segment.group == group:
            q, _ = nuisance.basis(s, segment)
            y = segment.y.ravel()
            total += float(y @ y - np.sum((q.T @ y) ** 2))
    return total


def earlier(fitted: RingDownFit, number: int, samples: int) -> Complex:
    """Return (p,) modal amplitudes so many samples before a segment, by running the rig backward."""
    segment = fitted.problem.experiment.segments[number]
    to, amplitudes = fitted.responses[segment.group], fitted.amplitudes[number]
    motion, used, h = fitted.added().forces(fitted.run(number), -samples)
    rate = fitted.problem.experiment.sample_rate_hz
    lead = np.exp(-to.rig.poles * segment.run_up / rate)
    w = step_weights(to.rig.poles, h)
    b = amplitudes * lead
    grown = np.power(w[0][:, None], np.arange(motion.forces.shape[2] - 2, -1, -1)[None])
    b = b * w[0] ** (motion.forces.shape[2] - 1)
    for row, bend, element in zip(motion.forces[0], motion.bends[0], used, strict=True):
        pushes = w[1][:, None] * row[:-1] + w[2][:, None] * row[1:] + w[3][:, None] * bend
        b = b + to.drive[element] * np.sum(grown * pushes, axis=1)
    return np.asarray(b / lead, np.complex128)
