"""Impacts that took no part in a fit: what it predicts of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from analysis.mismatch.ring_downs.continuation import continued, lengthened_held
from analysis.mismatch.ring_downs.fit import Start, Stop, fit
from analysis.mismatch.ring_downs.problem import RingDownFit, RingDowns
from analysis.mismatch.score_test import screen
from sim_backend.mechanisms.kinds import SecondImpact

HELD_OUT_EVERY = 4  # every fourth impact is held out


def split(problem: RingDowns) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return segments for fitting and held-out ones: every fourth, but never all of a load nor the strongest of all."""
    segments = problem.experiment.segments
    others = Counter(segment.group for segment in segments)
    strongest = _strongest(problem)
    held: list[int] = []
    for i, segment in enumerate(segments):
        if i % HELD_OUT_EVERY == HELD_OUT_EVERY - 1 and others[segment.group] > 1 and i != strongest:
            others[segment.group] -= 1
            held.append(i)
    return tuple(i for i in range(len(segments)) if i not in held), tuple(held)


def held_out_fit(kept: RingDowns, fitted: RingDownFit) -> RingDownFit:
    """Return the fit to held-out impacts: only what belongs to each of them is fitted."""
    policy, good = kept.policy, fitted.reduced_chi_squared
    again = any(isinstance(t.mechanism, SecondImpact) for t in fitted.terms)
    found = fit(kept, start=Start(held=fitted, delays=second_impact_delays(kept, fitted) if again else ()))
    for begun in (lengthened_held, _continued):
        if found.only_laws and good < policy.strong and found.reduced_chi_squared > policy.strong:
            with suppress(np.linalg.LinAlgError):  # it may run away on the way
                other = begun(kept, fitted)
                found = other if other is not None and other.chi_squared < found.chi_squared else found
    return found


def _continued(kept: RingDowns, fitted: RingDownFit) -> RingDownFit | None:
    return continued(kept, fitted.terms, fitted, held=fitted)


def held_out_afterwards(fitted: RingDownFit) -> RingDownFit | None:
    """Return the fit to impacts of which none was held out, as each has constants of its own; None of a single one.

    What the impacts have in common is fitted to the others again. Held out is every fourth whatever its load, or else
    one, but never the strongest.
    """
    problem, count = fitted.problem, len(fitted.segments)
    strongest = _strongest(problem)
    held = [i for i in range(HELD_OUT_EVERY - 1, count, HELD_OUT_EVERY) if i != strongest]
    held = held or [i for i in range(count) if i != strongest][-1:]
    if not held:
        return None
    training = [i for i in range(count) if i not in held]
    own = problem if problem.scattered else problem.per_impact_constants()
    load = fitted.constants.load[[fitted.segments[i].group for i in training]]
    amplitudes = tuple(fitted.amplitudes[i] for i in training)
    begin = replace(
        fitted,
        constants=replace(fitted.constants, load=load),
        segments=tuple(fitted.segments[i] for i in training),
        amplitudes=amplitudes,
    )
    start = Start(amplitudes=amplitudes if fitted.nonlinear else ())
    others = fit(_impacts(own, training), fitted.terms, begin, start, Stop(known=False))
    return held_out_fit(_impacts(own, held), others)


def second_impact_delays(problem: RingDowns, fitted: RingDownFit) -> tuple[float, ...]:
    """Return when the second impact fell in segments that took no part in the fit."""
    second = [t.mechanism for t in fitted.terms if isinstance(t.mechanism, SecondImpact)]
    others = tuple(t for t in fitted.terms if not isinstance(t.mechanism, SecondImpact))
    plain = fit(problem, start=Start(held=replace(fitted, terms=others)))
    return next(s.delays for s in screen(problem, plain, second).scores if s.delays)


def _strongest(problem: RingDowns) -> int:
    segments = problem.experiment.segments
    return max(range(len(segments)), key=lambda i: float(np.abs(segments[i].raw).max()), default=0)


def _impacts(problem: RingDowns, kept: Sequence[int]) -> RingDowns:
    """Return a problem with constants of its own for every impact, with these impacts alone."""
    segments = tuple(replace(problem.experiment.segments[k], group=i) for i, k in enumerate(kept))
    experiment = replace(problem.experiment, segments=segments, loads_n=tuple(s.preload_n for s in segments))
    return replace(problem, experiment=experiment, start=problem.start[list(kept)])
