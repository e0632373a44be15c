"""What blocks of a recording have to say of a selection."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.mismatch.account import UNLISTED, Account, Otherwise, Weights, far_off, odds_of_unlisted, relative
from analysis.mismatch.answer import AtAmplitude, FitSummary, FittedRig, Interval, Location, Named, NextExperiment
from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.blocks import held_out_rms, mean_of, together, untold_words
from analysis.mismatch.recordings.constants import constant_intervals
from analysis.mismatch.recordings.decay import along_words, decay_of
from analysis.mismatch.recordings.determined import left_open_beside
from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.held_out import beyond_noise, channel_errors
from analysis.mismatch.recordings.impact_size import said_of, struck
from analysis.mismatch.recordings.impact_size import together as size_of
from analysis.mismatch.recordings.judge import BlockJudge
from analysis.mismatch.recordings.next_experiment import next_experiment
from analysis.mismatch.recordings.other_constants import other_values
from analysis.mismatch.recordings.otherwise import (
    constant_that_explains,
    contact_turned_round,
    hold_that_explains,
)
from analysis.mismatch.recordings.ranking import lead_of, with_time
from analysis.mismatch.recordings.reasons import decided, elsewhere, not_tried, reason, with_what_else
from analysis.mismatch.recordings.recorded import CHOOSE
from analysis.mismatch.recordings.residual_band import residual_band
from analysis.mismatch.recordings.start_check import far_off_words
from analysis.mismatch.recordings.tones import loudest_tone
from analysis.mismatch.remainder import frequency_words
from analysis.mismatch.rig_description import DescribedRig
from analysis.mismatch.score_test import Screening
from analysis.mismatch.selection import Candidate, SelectionStep
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import AddedBody, ForceLaw, SecondImpact

SEEN = 0.1  # of the largest gain of a channel, from which on a channel shows what is missing


@dataclass(frozen=True, slots=True)
class BlockAccount(Account[SimulatedFit]):
    """See `Account`."""

    @property
    def judge(self) -> BlockJudge:
        """What judged."""
        judge = self.selection.judge
        if not isinstance(judge, BlockJudge):
            raise TypeError("recordings are judged by a BlockJudge")
        return judge

    @property
    def described(self) -> DescribedRig:
        """The rig as described."""
        return self.judge.problem.rig

    def loudest_tone(self, fitted: SimulatedFit) -> tuple[float, float, str]:
        """See `loudest_tone`."""
        return loudest_tone(fitted)

    @property
    def settled(self) -> bool:
        """Whether steady responses tell amplitude from time."""
        return self.judge.steady is not None

    @property
    def rival(self) -> Candidate[SimulatedFit] | None:
        """The best explanation by time, where amplitude and time go together in one decay."""
        return None if self.settled else self.judge.rival_in_time(self.selection.steps)

    @property
    def far_off(self) -> bool:
        """Whether the rig as described is far from the one recorded.

        A rig that is far from the one recorded hardly moves where the recording does. What it misses is then the
        motion, which an autoregression takes away as it takes away noise, and the score tests see nothing.
        """
        return self.selection.chosen is None and (self.selection.best.far_off() or bool(self.worse_than_zero))

    @property
    def worse_than_zero(self) -> str:
        """Say so, with what to leave free."""
        return self.judge.finals.worse_than_zero(self.selection.baseline, self.selection.best)

    @property
    def decay(self) -> tuple[AtAmplitude, ...]:
        """Frequency and damping against amplitude, of a free decay of one body."""
        problem = self.judge.problem
        if not problem.one_decay or len(problem.arrangement.bodies) != 1:
            return ()
        return decay_of(problem.recordings[0], problem.recordings[0].outputs[0])

    def unit(self, unit: str) -> str:
        """Return a unit of N and m in the rig's own units."""
        rig = self.described
        if (rig.length_unit, rig.force_unit) == ("m", "N"):
            return unit
        length, force = (f"({u})" if "/" in u else u for u in (rig.length_unit, rig.force_unit))
        return re.sub(r"\bN\b", force, re.sub(r"\bm(?=\d|\b)", length, unit))

    def element(self, term: Term, name: str) -> str | None:
        """Return the rig's own name of the channel or body."""
        struck = isinstance(term.mechanism, SecondImpact)
        return self.described.arrangement.bodies[term.place[0]] if struck else name

    def read_off(self, fitted: SimulatedFit, term: Term) -> tuple[float, float, str] | None:
        """Return value, standard error and unit of tones and second impacts, which are each recording's own."""
        if isinstance(term.mechanism, SecondImpact):
            return *size_of(struck(fitted, term.mechanism, term.place[0])), term.mechanism.parameters[0].unit
        return super(BlockAccount, self).read_off(fitted, term)

    def parameters(self, fitted: SimulatedFit, number: int) -> tuple[Term, dict[str, Interval]]:
        """Return a term of a fit, and its parameters; those of an added body that no channel determines are open."""
        term, found = super(BlockAccount, self).parameters(fitted, number)
        if not isinstance(term.mechanism, AddedBody):
            return term, found
        left = left_open_beside(self.described, fitted.arrangement)
        scaled = {q.name: 2 * term.values[q.name] for q in term.mechanism.parameters if q.name in left}
        for more in term.mechanism.derived:
            if not math.isclose(more.value(term.values), more.value({**term.values, **scaled}), rel_tol=SEEN):
                left.add(more.name)
        return term, {k: replace(v, low=0.0, high=math.inf) if k in left else v for k, v in found.items()}

    def weights(self, number: int) -> Weights:
        """Return how likely the candidates of a step are, and what is not listed."""
        selection = self.selection
        step = selection.accepted[number] if selection.accepted else selection.steps[0]
        if step.accepted is None:
            return Weights({}, 1.0)
        evidence = self._evidence(step, number)
        of = relative(evidence, self.judge.problem.policy.temperature)
        said = self._remark(step, number) + elsewhere(self.judge, step)
        return Weights(of, sum(of.values()), self._alike(step, evidence, number), said)

    def _evidence(self, step: SelectionStep[SimulatedFit], number: int) -> dict[str, float]:
        """Return twice the logarithm of how likely each candidate of a step is, over the accepted one."""
        accepted, policy = step.accepted, self.judge.problem.policy
        if accepted is None:
            return {}
        found = self._by_amplitude(step, accepted)
        rival = self.rival
        if rival is not None and accepted.id != rival.id and number == 0:
            losses = (f.by_block(CHOOSE) for f in (self.selection.best, self.selection.steps[0].before))
            whole, base = map(mean_of, losses)
            # one decay cannot say which of two that predict it alike: they are as likely as each other, unless one of
            # them is as far from what the other leaves as errors may be from noise
            far = min(policy.equal_in_time * base, policy.far_over_noise**2 * whole)
            other, alike = mean_of(rival.losses), max(policy.in_time * whole, far)
            found[rival.id] = 0.0 if other < alike else -len(rival.losses) * math.log(other / whole)
        if not self.settled and self.judge.problem.one_decay and with_time(accepted.mechanism):
            before = policy.counts_beside_time * mean_of(step.before.by_block(CHOOSE))
            for c in step.candidates:
                if c.fit is not None and not with_time(c.mechanism) and mean_of(c.losses) < before:
                    found.setdefault(c.id, c.evidence - accepted.evidence)
            found[accepted.id] = 0.0
        share = self.selection.left.share / policy.left_over_blocks
        gain = math.inf if accepted.fit is None else self.judge.gained(step.before, accepted.fit, 0)
        odds = odds_of_unlisted(policy, gain, accepted.mechanism)
        unlisted = max(policy.unlisted_by_blocks, 2 * policy.temperature * math.log(odds))
        return found | {UNLISTED: unlisted * (1 - min(share, 1.0))}

    def _by_amplitude(self, step: SelectionStep[SimulatedFit], accepted: Candidate[SimulatedFit]) -> dict[str, float]:
        """Return the evidence of each candidate over the accepted one, with that of steady responses where they are."""
        own_steady = step.steady.get(step.candidates.index(accepted), 0.0)
        found: dict[str, float] = {}
        by_itself = self.judge.problem.one_decay and not isinstance(accepted.mechanism, SecondImpact)
        for i, c in enumerate(step.candidates):
            if c.fit is None or (by_itself and with_time(c.mechanism)):
                continue  # time is weighed by itself
            if step.steady and i not in step.steady:  # too far behind to be held against the steady responses
                continue
            lead = lead_of(c, accepted, self.judge.problem.policy.learned_simpler)
            found[c.id] = max(lead + step.steady.get(i, 0.0) - own_steady, found.get(c.id, -math.inf))
        return found

    def _alike(self, step: SelectionStep[SimulatedFit], evidence: dict[str, float], number: int) -> tuple[str, ...]:
        """Return what these recordings cannot tell from the accepted candidate."""
        accepted, rival = step.accepted, self.rival
        if accepted is None:
            return ()
        policy = self.judge.problem.policy
        most = policy.alike_losses * mean_of(accepted.losses)
        found = {
            c.id for c in step.candidates
            if c.fit is not None and c.id != accepted.id and mean_of(c.losses) < most
            and evidence.get(c.id, -math.inf) > policy.temperature * policy.told_apart
        }  # fmt: skip
        if rival is not None and accepted.id != rival.id and number == 0 and self._as_well(accepted, rival):
            found.add(rival.id)
        return tuple(sorted(found))

    def _remark(self, step: SelectionStep[SimulatedFit], number: int) -> str:
        """Say whether amplitude is told from time, and when a second impact fell."""
        rival, accepted = self.rival, step.accepted
        if accepted is not None and isinstance(accepted.mechanism, SecondImpact):
            impact, body = accepted.mechanism, accepted.score.term.place[0]
            found = struck(self.selection.best, impact, body)
            return said_of(found, impact, self.described.arrangement.bodies[body], self.unit("N s"))
        if accepted is None or number or not self.judge.problem.one_decay:
            return ""
        if rival is not None and accepted.id != rival.id:
            name, as_well = rival.id.replace("_", " "), self._as_well(accepted, rival)
            other = f"that change with time in another way than {name} could be the cause as well"
            tells = f"that change with time ({name}) predict the recording as well" if as_well else other
            return (
                f" In one decay amplitude and time go together: a stiffness and damping {tells}, and only impacts of "
                "different strength or a steady excitation at several levels can part the two."
            )
        if self.settled and not with_time(accepted.mechanism):
            return (
                " One decay cannot part amplitude from time; the steady responses can: they change with amplitude at "
                "steady levels, so that amplitude is the cause."
            )
        return ""

    def _as_well(self, accepted: Candidate[SimulatedFit], rival: Candidate[SimulatedFit]) -> bool:
        """Whether a change with time predicts the choosing blocks nearly as well as what is named."""
        return mean_of(rival.losses) < self.judge.problem.policy.in_time * mean_of(accepted.losses)

    def held_out_rms(self, fitted: SimulatedFit) -> float:
        """Return the error on held-out blocks, in the recordings' unit."""
        return together(fitted, held_out_rms(fitted)[0])

    def beyond_held_out(self, fitted: SimulatedFit) -> str:
        """Say in which held-out block a final fit's errors are furthest beyond noise, or that they do not tell."""
        beyond = beyond_noise(self.judge.finals.errors(fitted), self.judge.problem)
        return beyond or ("" if fitted is not self.selection.chosen else untold_words(self.selection.baseline, fitted))

    def summary(self, chosen: SimulatedFit | None) -> FitSummary:
        """Return how well held-out blocks are predicted."""
        recordings, judge, best = self.judge.problem.recordings, self.judge, self.selection.best
        before, named, pieces = held_out_rms(self.selection.baseline)
        after, named_after = (None, {}) if chosen is None else held_out_rms(chosen)[:2]
        channels = channel_errors(best, self.judge.finals.errors(best), before, after)

        def one(rms: Real | None) -> float | None:
            return None if rms is None else together(best, rms)

        noise = together(best, np.array([c.noise_rms for c in channels]))
        segments = sum(np.unique(r.block).size for r in recordings)
        steady = None
        if judge.steady is not None:
            steady = (judge.steady.held_rms, None if chosen is None else judge.with_terms(chosen.terms).held_rms)
        stretches = {name: (together(best, rms), one(named_after.get(name))) for name, rms in named.items()}
        return FitSummary(
            self.described.seen[0].unit, noise, together(best, before), one(after), pieces,
            max(int(segments), pieces), len(recordings), stretches, steady, channels,
        )  # fmt: skip

    def described_otherwise(self) -> Otherwise[SimulatedFit] | None:
        """Return the rig with inputs held or a constant or a contact described otherwise, where it leaves nothing."""
        linear, judge = self.selection.baseline, self.judge
        if id(linear) not in judge.described:  # it is asked before laws are learned, and for the answer
            found = None if self.far_off else hold_that_explains(linear, judge.screen, judge.on_progress)
            found = found or contact_turned_round(linear, judge.known, judge.on_progress)
            found = found or constant_that_explains(linear, judge.screen, judge.on_progress)
            judge.described[id(linear)] = linear, found
        return judge.described[id(linear)][1]

    def location(self, named: Sequence[Named], otherwise: Otherwise[SimulatedFit] | None = None) -> Location:
        """Return where most of the linear rig's residual lies."""
        base, best, rig = self.selection.baseline, self.selection.best, self.described
        time, frequency = residual_band(base)
        shares = np.sum(base.off(0)[0] ** 2, axis=1) - np.sum(best.off(0)[0] ** 2, axis=1)
        seen = [s.sensor.name for s in rig.seen]
        channels = tuple(n for n, s in zip(seen, shares, strict=False) if s > SEEN * shares.max())
        if named:
            element, component = named[0].element, named[0].where
            all_of_it = self.selection.left.p_value >= self.judge.problem.policy.level
            what = f"what is named explains {'all of it beyond noise' if all_of_it else 'a part of it'}"
        else:
            element, component = self._suspected(self.selection.screening)
            what = "nothing listed explains it" + not_tried(self.judge, element)
            if otherwise is not None:
                what = f"nothing of it is left once the rig file {otherwise.said}"
                if otherwise.element is not None:
                    element, component = otherwise.element.name, otherwise.element.component
            elif self.far_off:
                what = far_off_words(self.judge.problem)
        why = f"The residual of the linear rig lies from {frequency[0]:.4g} to {frequency[1]:.4g} Hz, and {what}."
        why += along_words(self.decay, self.described.seen[0].unit)
        return Location(component, element, channels or (seen[0],), time, frequency, (), why)

    def _suspected(self, screening: Screening) -> tuple[str, str]:
        """Return the element, and its component, whose best listed law would take away most."""
        laws = (s.term for s in screening.scores if isinstance(s.term.mechanism, ForceLaw))
        elements = self.judge.problem.arrangement.elements
        element = elements[next((t.place[0] for t in laws), 0)]
        return element.name, element.component

    def left_at(self, model: SimulatedFit, screening: Screening) -> Location:
        """Return where most of a model's residual lies."""
        time, frequency = residual_band(model)
        element, component = self._suspected(screening)
        return Location(
            component, element, (self.described.seen[0].sensor.name,), time, frequency, (),
            f"What is left lies {frequency_words(frequency)}; of all listed mechanisms, one in {element} would take "
            "away most of it.",
        )  # fmt: skip

    def compared(self, candidate: Candidate[SimulatedFit], best: Candidate[SimulatedFit]) -> str:
        """Say in a sentence how a rival compares with the best candidate."""
        if not candidate.losses or not best.losses:
            return (
                f"Its score test promises {candidate.score.gain:.4g} in chi-squared, that of "
                f"{best.id.replace('_', ' ')} {best.score.gain:.4g}; it was not fitted in full, which can gain more."
            )
        ratio = math.sqrt(mean_of(candidate.losses) / max(mean_of(best.losses), 1e-300))
        times = "as large as" if f"{ratio:.3g}" == "1" else f"{ratio:.3g} times"
        said = f"Its error on the blocks that choose is {times} that of {with_what_else(candidate, best)}"
        despite = reason(self.judge, self.selection.steps[0], self.selection.best, candidate) if ratio < 1 else ""
        return f"{said}; {despite}." if despite else f"{said}."

    def despite_its_error(self, candidate: Candidate[SimulatedFit], best: Candidate[SimulatedFit]) -> str:
        """Say why a candidate whose held-out error is smaller is not the one that is named."""
        said = "Its held-out error is smaller all the same; what is held out takes no part in choosing"
        if mean_of(candidate.losses) < mean_of(best.losses):
            return f"{said}."
        return f"{said}: {decided(self.judge, self.selection.steps[0], self.selection.best, candidate)}."

    def next_experiment(self, named: Sequence[Named]) -> NextExperiment | None:
        """Return what would part the best explanations, or tell what is left over; nothing of a wrong description."""
        if self.far_off:
            return None
        weights = self.weights(0) if self.selection.steps else Weights({}, 1.0)
        return next_experiment(self.selection, self.judge, [m.id for m in named], self.rival, weights)

    def fitted(self) -> FittedRig | None:
        """Return the rig as fitted."""
        units = {p.name: p.unit for p in self.judge.problem.arrangement.parameters}
        offsets = {s.offset: s.unit for s in self.described.seen}
        best, values = self.selection.best, self.selection.best.values
        left = left_open_beside(self.described, best.arrangement)
        found = constant_intervals(best) | dict.fromkeys(left, (-math.inf, math.inf))
        known = {
            k: Interval(v, *found.get(k, (v, v)), offsets.get(k) or self.unit(units[k]))
            for k, v in values.items()
            if k in units
        }
        told = any(isinstance(t.mechanism, ForceLaw | AddedBody) for t in best.terms)  # may show which rig it is
        also = () if told or self.far_off else tuple(other_values(self.described, values))
        return FittedRig(known, off=far_off(values, self.described.arrangement.parameters), also=also)
