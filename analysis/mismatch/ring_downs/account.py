"""What impacts have to say of a selection."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.account import (
    Account,
    Otherwise,
    Weights,
    element_of_component,
    far_off,
    group_labels,
    odds_of_unlisted,
    relative,
)
from analysis.mismatch.answer import (
    FitSummary,
    FittedRig,
    Interval,
    Location,
    Named,
    NextExperiment,
)
from analysis.mismatch.chi_squared import odds_of_nothing
from analysis.mismatch.evidence.excess import excess_by_frequency, excess_by_time
from analysis.mismatch.intervals import NORMAL_95
from analysis.mismatch.parameters import Term, lines_of
from analysis.mismatch.remainder import SEEN, count_words, frequency_words, spread_of
from analysis.mismatch.ring_downs.candidates import stiffness_evidence, with_stiffness
from analysis.mismatch.ring_downs.corrected import contact_at_rest
from analysis.mismatch.ring_downs.judge import ImpactJudge
from analysis.mismatch.ring_downs.problem import RingDownFit
from analysis.mismatch.rivals import LIKELY
from analysis.mismatch.score_test import Screening
from analysis.mismatch.selection import Candidate, SelectionStep, name_of
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import AddedBody

STRONGER_TAP = 1.5  # over the strongest so far, for the next experiment
MOST_FORCE_RATIO = 0.9  # of the preload: beyond, the surfaces would part
OF_A_GROUP = 0.1  # of the largest excess of a load, from which on a load counts as one that shows something
CERTAIN = 700.0  # largest logarithm of odds: beyond, they are no number
RIVALRY = 0.02  # of the accepted one's weight, from which on a candidate is a rival


@dataclass(frozen=True, slots=True)
class ImpactAccount(Account[RingDownFit]):
    """See `Account`; ``measured`` are the errors of fits on held-out impacts that were computed already."""

    measured: dict[int, tuple[RingDownFit, tuple[float, int]]] = field(default_factory=dict, compare=False, repr=False)

    @property
    def judge(self) -> ImpactJudge:
        """What judged."""
        judge = self.selection.judge
        if not isinstance(judge, ImpactJudge):
            raise TypeError("impacts are judged by an ImpactJudge")
        return judge

    @property
    def groups(self) -> Mapping[str, float]:
        """Load (N) of each group by its label."""
        return group_labels(self.judge.problem.experiment.loads_n)

    def weights(self, number: int) -> Weights:
        """Return how likely the candidates of a step are, what is not listed and nothing at all among them."""
        selection = self.selection
        step = selection.accepted[number] if selection.accepted else selection.steps[0]
        strength = {
            c.id: c.evidence + stiffness_evidence(c.mechanism, c.fit) for c in reversed(step.candidates) if c.fit
        }
        of = relative(strength, self.judge.problem.policy.temperature)
        if step.accepted is None:
            return Weights(of, max(sum(of.values()), 1.0))
        own = of[step.accepted.id]
        something_else = own * self._odds_of_something_else(step)
        total = (sum(of.values()) + something_else) * (1 + odds_of_nothing(selection.p_value))
        rivals = [k for k in of if k != step.accepted.id and of[k] > RIVALRY * own]
        return Weights(of, total, self._looking_alike(step, step.accepted.id, rivals))

    def _odds_of_something_else(self, step: SelectionStep[RingDownFit]) -> float:
        """Return how likely it is that what is not listed is at work, over that the mechanism accepted in a step is."""
        policy, left = self.judge.problem.policy, self.selection.left
        if step.accepted is None or step.accepted.fit is None:
            return 1.0
        gain = step.before.objective - step.accepted.fit.objective
        odds = odds_of_unlisted(policy, gain, step.accepted.mechanism)
        odds += math.exp(min((left.unnamed - policy.unnamed) / 2, CERTAIN))
        if left.p_value < policy.level and left.chi_squared > 0:
            share = left.share / max(policy.may_be_left(len(self.selection.best.terms)), 1e-300)
            odds = min(odds, 1.0) ** (1 - min(share, 1.0))
        return float(odds)

    def _looking_alike(self, step: SelectionStep[RingDownFit], chosen: str, rivals: Sequence[str]) -> tuple[str, ...]:
        """Rivals that these data cannot tell apart: alike in signature, or never compared."""
        labels, cosines = step.screening.labels, np.abs(step.screening.cosines)
        found = []
        for rival in rivals:
            mine = [i for i, k in enumerate(labels) if k == chosen]
            theirs = [i for i, k in enumerate(labels) if k == rival]
            alike = self.judge.problem.policy.look_alike
            if not mine or not theirs or cosines[np.ix_(mine, theirs)].max() > alike:
                found.append(rival)
        return tuple(found)

    def loudest_tone(self, fitted: RingDownFit) -> tuple[float, float, str]:
        """Return amplitude (over all segments and channels) and standard error of the loudest tone.

        What noise alone would show as a tone is taken off. The loudest is the one that stands out most of its noise: a
        tone at a mode's frequency can hardly be told from the mode.
        """
        experiment, lines = fitted.problem.experiment, lines_of(fitted.terms)
        nuisance, first = fitted.problem.nuisance(fitted.terms), fitted.problem.slow.size
        poles = 2j * np.pi * np.array(lines)
        gains = np.array([np.abs(m.gain(poles, experiment.sample_rate_hz)) for m in experiment.noise])
        square, noise = [], []
        for segment, coefficients in zip(experiment.segments, fitted.coefficients, strict=True):
            modes, own = fitted.modes[segment.group], slice(first, first + len(lines))
            _, r = nuisance.basis(modes, segment)
            variance = np.sum(np.linalg.pinv(r) ** 2, axis=1)  # (q,) of the coefficients
            found, known = (np.array(nuisance.rung(modes, c))[:, own] for c in (coefficients, variance))
            noise.append((known.real - known.imag) / gains**2)
            square.append(np.abs(found) ** 2 / gains**2 - noise[-1])
        by_line, of_noise = (np.array(rows).transpose(2, 0, 1).reshape(len(lines), -1) for rows in (square, noise))
        loudest = by_line[int(np.argmax(by_line.mean(axis=1) / of_noise.mean(axis=1)))]
        amplitude = math.sqrt(max(float(loudest.mean()), 0.0))
        error = float(loudest.std(ddof=1)) / math.sqrt(loudest.size)
        return amplitude, error / (2 * amplitude) if amplitude > 0 else math.sqrt(error), "m/s2"

    def held_out_rms(self, fitted: RingDownFit) -> float:
        """Return the rms of the residual on held-out impacts, m/s2."""
        return self._held_out(fitted)[0]

    def _held_out(self, fitted: RingDownFit) -> tuple[float, int]:
        if id(fitted) not in self.measured:
            self.measured[id(fitted)] = fitted, self.judge.held_out_rms(fitted)
        return self.measured[id(fitted)][1]

    def summary(self, chosen: RingDownFit | None) -> FitSummary:
        """Return how well held-out impacts are predicted."""
        experiment = self.judge.problem.experiment
        before, held = self._held_out(self.selection.baseline)
        after = self.held_out_rms(chosen) if chosen is not None and held else None
        return FitSummary(
            "m/s2", experiment.noise_rms, before, after, held, len(experiment.segments), len(set(experiment.loads_n))
        )

    def location(self, named: Sequence[Named], otherwise: Otherwise[RingDownFit] | None = None) -> Location:
        """Read off the residual of the linear rig where it is more than noise."""
        base, best, rig = self.selection.baseline, self.selection.best, self.judge.problem.arrangement
        rate = self.judge.problem.experiment.sample_rate_hz
        bins, windows = excess_by_frequency(base), excess_by_time(base)
        frequency = _range(bins.edges, np.any(bins.sure, axis=0), (0.0, rate / 2))
        time = _range(windows.edges, np.any(windows.sure, axis=0), (0.0, float(windows.edges[-1])))
        share = _gain_by_channel(base, best)
        difference = len(share) == 2 and share[1] > 2 * share[0]
        gain = np.array([float(np.vdot(r, r) - np.vdot(s, s)) for r, s in zip(base.residuals, best.residuals,
                                                                             strict=True)])  # fmt: skip
        component = named[0].where if named else self._suspected(difference, self.selection.steps[0].screening)
        free = "changes of a channel explain" if component == "sensor chain" else "forces of any shape in it explain"
        what = "what is named explains" if named else free
        return Location(
            component,
            named[0].element if named else element_of_component(rig, component),
            self._channels(difference),
            self._times(time),
            frequency,
            self._showing(gain),
            f"The residual of {self.judge.problem.linear} is more than noise from {frequency[0]:.0f} to "
            f"{frequency[1]:.0f} Hz, and {what} most of it.",
        )

    def left_at(self, model: RingDownFit, screening: Screening) -> Location:
        """Read off where the residual of a model is more than noise; the component's forces fit it best."""
        bins, windows = excess_by_frequency(model), excess_by_time(model)
        frequency = spread_of(bins.edges, bins.power, bins.sure)
        beyond = np.maximum(bins.power - 1, 0.0).sum(axis=1)
        difference = len(beyond) == 2 and beyond[1] > 2 * beyond[0]
        if screening.unexplained < SEEN:
            likest = min(screening.scores, key=lambda s: s.p_value).term.mechanism
            component = likest.component
            best = f"no force or channel of any shape fits it; of what is listed, {name_of(likest)} fits it best."
        else:
            component = self._suspected(difference, screening)
            best = f"of forces of any shape, those in the component {component} would take away most of it."
        excess = np.array([float(np.vdot(r, r)) - r.size for r in model.residuals])
        return Location(
            component,
            element_of_component(self.judge.problem.arrangement, component),
            self._channels(difference),
            self._times(spread_of(windows.edges, windows.power, windows.sure)),
            frequency,
            self._showing(excess),
            f"What is left is more than noise {frequency_words(frequency)}; {best}",
        )

    def _suspected(self, difference: bool, screening: Screening) -> str:
        by = screening.free.by_component
        return "sensor chain" if difference else max(by, key=lambda k: by[k])

    def _channels(self, difference: bool) -> tuple[str, ...]:
        names = tuple(s.name for s in self.judge.problem.arrangement.sensors)
        return ("-".join(names),) if difference else names

    def _times(self, window: tuple[float, float]) -> tuple[float, float]:
        segments, rate = self.selection.baseline.segments, self.judge.problem.experiment.sample_rate_hz
        begin = float(np.mean([s.start_s for s in segments]))
        end = max(s.start_s + s.y.shape[1] / rate for s in segments)
        return begin + window[0], min(begin + window[1], end)

    def _showing(self, excess: Real) -> tuple[str, ...]:
        """Return the loads that show most of what each segment (n,) of the training shows."""
        loads = self.judge.problem.experiment.loads_n
        by_load = np.zeros(len(loads))
        for segment, value in zip(self.selection.baseline.segments, excess, strict=True):
            by_load[segment.group] += value
        all_of_them = by_load.max() <= 0
        shown = {v for v, e in zip(loads, by_load, strict=True) if all_of_them or e >= OF_A_GROUP * by_load.max()}
        return tuple(label for label, load in self.groups.items() if load in shown)

    def compared(self, candidate: Candidate[RingDownFit], best: Candidate[RingDownFit]) -> str:
        """Say in a sentence how a rival compares with the best candidate.

        A fit that cannot reach the best any more is given up early, which the fit does not tell: to the end it would
        have at least this evidence.
        """
        what, own, first = best.id.replace("_", " "), with_stiffness(candidate), with_stiffness(best)
        if candidate.fit is None:
            return (
                f"Its score test promises an evidence of {count_words(own)} in units of chi-squared, where {what} has "
                f"{count_words(first)}; it was not fitted, which can gain more."
            )
        reached = f"an evidence of at least {count_words(own)}" if own > 0 else "no evidence"
        said = f"Fitted, it has {reached} in units of chi-squared, where {what} has {count_words(first)}."
        against = candidate.evidence - own
        if against > 0.05 * max(first - own, 1.0):
            counts = f" That counts {count_words(against)} against it"
            said += f"{counts}, as k_c does not grow with the load as it would make it."
        return said

    def despite_its_error(self, candidate: Candidate[RingDownFit], best: Candidate[RingDownFit]) -> str:
        """Say why a candidate whose held-out error is smaller is not the one that is named."""
        return (
            "Its held-out error is smaller all the same: held-out impacts take no part in choosing a first mechanism, "
            "the evidence of the impacts that were fitted decides."
        )

    def next_experiment(self, named: Sequence[Named]) -> NextExperiment | None:
        """Return the load at which the two best explanations differ most per impact, with a stronger tap.

        None where nothing else is likely.
        """
        steps = self.selection.steps
        fits = [(c.id, c.fit) for c in steps[0].candidates if c.fit is not None] if steps else []
        if not fits:
            return None
        (first, a), *others = fits
        if named:
            weights = self.weights(0)
            others = [(k, f) for k, f in others if weights.of.get(k, 0.0) > LIKELY * weights.total]
        if not others:
            return None
        second, b = next(((k, f) for k, f in others if k != first), others[0])
        loads = self.judge.problem.experiment.loads_n
        between, count = np.zeros(len(loads)), np.zeros(len(loads))
        for segment, r, s in zip(self.selection.baseline.segments, a.residuals, b.residuals, strict=True):
            between[segment.group] += float(np.sum((r - s) ** 2))
            count[segment.group] += 1
        group = int(np.argmax(between / np.maximum(count, 1)))
        own = np.array([s.group == group for s in self.selection.baseline.segments])
        strongest = np.max(self.selection.baseline.force_ratios()[own])  # NaN without a preload
        ratio = float(np.fmin(STRONGER_TAP * strongest, MOST_FORCE_RATIO))
        apart = float(f"{math.sqrt(between[group] / count[group]):.3g}")
        return NextExperiment(
            loads[group],
            ratio,
            (first, second),
            f"At {1e3 * loads[group]:.0f} mN the two differ most: by {apart:g} "
            "standard deviations an impact at the taps made; a stronger one parts them further.",
            ("load", "tap"),
        )

    def element(self, term: Term, name: str) -> str | None:
        """Return the body that carries what a term adds to it."""
        mechanism = term.mechanism
        return name if isinstance(mechanism, AddedBody) and mechanism.on_body else None

    def fitted(self) -> FittedRig | None:
        """Return the rig as fitted with what was left out."""
        chosen = self.selection.chosen
        if chosen is None:
            return None
        values = dict(zip(chosen.constants.names()[0], chosen.constants.rig.tolist(), strict=True))
        reach = dict(zip(values, NORMAL_95 * np.sqrt(np.maximum(np.diag(chosen.covariance), 0.0)), strict=False))
        declared = [p for p in self.judge.problem.arrangement.parameters if p.name in values]
        constants = {
            p.name: Interval(values[p.name], values[p.name] - reach[p.name], values[p.name] + reach[p.name], p.unit)
            for p in declared
        }
        contact = contact_at_rest(chosen) if self.judge.problem.is_tester else ()
        return FittedRig(constants, contact, far_off(values, declared))


def _range(edges: Real, sure: NDArray[np.bool_], fallback: tuple[float, float]) -> tuple[float, float]:
    at = np.flatnonzero(sure)
    return (float(edges[at[0]]), float(edges[at[-1] + 1])) if at.size else fallback


def _gain_by_channel(before: RingDownFit, after: RingDownFit) -> Real:
    """Sum of squares that the better fit takes away in mean and difference of two channels."""
    if len(before.residuals[0]) != 2:
        return np.zeros(1)
    out = np.zeros(2)
    for a, b in zip(before.residuals, after.residuals, strict=True):
        for i, sign in enumerate((1.0, -1.0)):
            out[i] += float(np.sum((a[0] + sign * a[1]) ** 2) - np.sum((b[0] + sign * b[1]) ** 2))
    return out
