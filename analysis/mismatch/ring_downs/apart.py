"""Impacts that show what no other impact shows.

A property of the rig shows in more than one impact. What a single one shows, such as the turning of a mass that was
tapped off its middle, is a peculiarity of that tap: it says nothing about the rig and must not be named as its physics.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.stats import chi2

from analysis.mismatch.account import group_labels
from analysis.mismatch.answer import SetAside
from analysis.mismatch.chi_squared import evidence, p_of
from analysis.mismatch.evidence.excess import WINDOWS_S, rotated
from analysis.mismatch.intervals import through_zero
from analysis.mismatch.problem import ComputeBudget
from analysis.mismatch.remainder import frequency_words
from analysis.mismatch.ring_downs.candidates import screened_evidence
from analysis.mismatch.ring_downs.problem import RingDownFit, RingDowns
from analysis.mismatch.score_test import Screening
from analysis.mismatch.selection import Candidate
from sim_backend.arrays import Real

EARLY_S = 4e-3  # of a segment, in which what sets an impact apart is measured
BAND = 0.1  # of the frequency of its largest line: what lies closer belongs to the line


def borne_out(before: RingDownFit, candidate: Candidate[RingDownFit]) -> bool:
    """Whether more than one impact speaks for a candidate, and what is estimated of it is not nothing.

    Asked of mechanisms with numbers of their own in every impact, such as the ringing of a body: these take up whatever
    is there in a single impact without saying anything of the others. A law without such numbers predicts all impacts,
    and that others do not show it is part of its prediction.
    """
    fitted, n = candidate.fit, len(before.segments)
    if fitted is None or not candidate.own or n < 2:
        return True
    if through_zero(fitted, len(fitted.terms) - 1):
        return False  # what was gained is the ringing of single impacts, not what the rig would do to them
    gained = gains(before, fitted)
    others = float(gained.sum() - gained.max()) - candidate.score.choice * (n - 1) / n
    policy, parameters = before.problem.policy, len(candidate.mechanism.parameters)
    own = round(candidate.own * (n - 1) / n)
    return evidence(others, own, parameters, policy.parameter_cost) > policy.first_gain


def gains(before: RingDownFit, after: RingDownFit) -> Real:
    """Return (segments,) the chi-squared that the better fit takes away in each impact."""
    return np.array(
        [float(np.vdot(a, a) - np.vdot(b, b)) for a, b in zip(before.residuals, after.residuals, strict=True)]
    )


def apart(fitted: RingDownFit) -> tuple[int, ...]:
    """Return the segments that leave more than noise, where these are few; none where they are not.

    Each is tested in windows after the tap, in mean and difference of the channels; all tests of all impacts count.
    """
    p = np.array([_p_value(r, fitted) for r in fitted.residuals])
    policy = fitted.problem.policy
    found = tuple(int(i) for i in np.flatnonzero(p < policy.level / p.size))
    return found if len(found) <= max(1, math.floor(policy.set_aside * p.size)) else ()


def _p_value(residual: Real, fitted: RingDownFit) -> float:
    """Return the p-value of an impact's residual under the noise."""
    experiment = fitted.problem.experiment
    power = rotated(residual) ** 2 / (1 + experiment.level_error)
    edges = [round(s * experiment.sample_rate_hz) for s in WINDOWS_S]
    windows = [power[:, a:b] for a, b in pairwise(edges) if a < power.shape[1]]
    tails = [float(chi2.sf(row.sum(), row.size)) for window in windows for row in window]
    return p_of(min(tails), len(tails))


def share_of(fitted: RingDownFit, odd: Sequence[int]) -> float:
    """Return the share of all that a fit leaves beyond noise that these segments hold."""
    excess = np.array([float(np.vdot(r, r)) - r.size for r in fitted.residuals])
    return float(excess[list(odd)].sum() / max(excess.sum(), 1e-300))


def no_law_explains(fitted: RingDownFit, screening: Screening, odd: Sequence[int]) -> bool:
    """Whether no mechanism without numbers of its own in every impact is near to what some impacts show."""
    excess = sum(float(np.vdot(r, r)) - r.size for r in (fitted.residuals[i] for i in odd))
    scores = [(screened_evidence(s), s.own_numbers) for s in screening.scores]
    most = max([excess, *(e for e, _ in scores)])
    return all(own or e <= fitted.problem.policy.close * most for e, own in scores)


def follow_strength(fitted: RingDownFit, odd: Sequence[int]) -> bool:
    """Whether some impacts are stronger than all others, so that what they show may be what the rig does then."""
    peak = np.array([float(np.abs(s.raw).max()) for s in fitted.segments])
    others = np.delete(peak, list(odd))
    return bool(np.any(peak[list(odd)] > others.max()))


def hardest_of_their_loads(fitted: RingDownFit, odd: Sequence[int]) -> bool:
    """Whether these segments are the strongest of their loads, each, oftener than by chance.

    What shows in the hardest taps at several loads, and in no others, is what the rig does when it is tapped so hard.
    """
    group = np.array([s.preload_n for s in fitted.segments])  # where constants scatter, each impact is a group
    peak = np.array([float(np.abs(s.raw).max()) for s in fitted.segments])
    chance = 1.0
    for load in set(group[list(odd)].tolist()):
        at = np.flatnonzero(group == load)
        own = {int(i) for i in at if int(i) in odd}
        if set(at[np.argsort(-peak[at])[: len(own)]].tolist()) != own:
            return False
        chance /= math.comb(at.size, len(own))
    return chance < fitted.problem.policy.hardest


def without(problem: RingDowns, names: Collection[str]) -> RingDowns | None:
    """Return a problem without these impacts; None where a load would have none left."""
    segments = problem.experiment.segments
    kept = [i for i, s in enumerate(segments) if s.name not in names]
    if {segments[i].group for i in kept} != {s.group for s in segments}:
        return None
    return replace(problem.only(kept), budget=ComputeBudget())


def set_aside(fitted: RingDownFit, odd: Sequence[int]) -> tuple[SetAside, ...]:
    """Say of each of these segments what it shows that the fit, and all other impacts, do not."""
    labels = {load: label for label, load in group_labels(fitted.problem.experiment.loads_n).items()}
    return tuple(_said(fitted, i, labels[fitted.segments[i].preload_n]) for i in odd)


def _said(fitted: RingDownFit, number: int, label: str) -> SetAside:
    segment, experiment = fitted.segments[number], fitted.problem.experiment
    deviation = np.array([m.deviation for m in experiment.noise])[:, None]
    early = (fitted.residuals[number] * deviation)[:, : round(EARLY_S * experiment.sample_rate_hz)]
    rows = rotated(early)
    which = int(np.argmax(np.sum(rows**2, axis=1)))
    size, where = math.sqrt(float(np.mean(early**2))), frequency_words(_line(rows[which], experiment.sample_rate_hz))
    which_tap = f"Tap {segment.order + 1} (at {label})"
    if len(early) == 2 and which == 1:
        sensors = " and ".join(s.name for s in fitted.problem.arrangement.sensors)
        turned = float(np.std(segment.raw[0, : early.shape[1]] - segment.raw[1, : early.shape[1]]))
        what = (
            f"{which_tap} was off centre: {sensors} differ {where} by {turned:.2g} m/s2 (rms of the first "
            f"{1e3 * EARLY_S:.0f} ms), the mass turned, and after no other tap it did."
        )
    else:
        what = (
            f"{which_tap} shows {size:.2g} m/s2 (rms of the first {1e3 * EARLY_S:.0f} ms) {where} that no other does."
        )
    if follow_strength(fitted, [number]):
        what += " It is the strongest tap as well: another as strong would tell whether the rig does that."
    return SetAside(segment.name, label, what)


def _line(row: Real, sample_rate_hz: float) -> tuple[float, float]:
    """Return the band (Hz) of the largest line of a row (n,)."""
    size = 8 * row.size
    power = np.abs(np.fft.rfft(row * np.hanning(row.size), size)) ** 2
    middle = float(np.argmax(power)) * sample_rate_hz / size
    return middle * (1 - BAND / 2), middle * (1 + BAND / 2)
