"""Every threshold of the selection, once: what it means, its unit, on which sessions it was chosen, who argues for it.

Step sizes of differences and the like are no thresholds; they stand beside the code that takes the step.
"""

from __future__ import annotations

from dataclasses import Field, dataclass, field, fields
from typing import Any

from analysis.mismatch.least_squares import Race

PRACTICE = "the 44 practice sessions"
SEALED = "blind validations with seeds 1 to 8"
RECORDED = "Silverbox and the bolted beam"
RECENT = "blind validation of described rigs with seed 808"
RUBBING = "pendulums with friction and forced masses with cubic springs, of an independent simulator"
UNTOUCHED = "102 rigs with nothing hidden, prove --rigs, seed 5150"
DRAWN = "blind validations of described rigs with seeds 505 and 606"
FRICTION = "simulated sessions as configured by default, with dry friction of 0.3, 1 and 5 mN"
AS_SHIPPED = "null sessions of the simulator as shipped, with taps that go wrong"

SHAKEN = "one session of prove --outside --unsealed 50611, seed 9, whose contact is shaken"
HARD_TAPS = "one session of prove, seed 2711, whose contact parts in the hardest taps"
NAMED = "practice sessions 1 to 6, and sessions with unlisted effects that were named otherwise"
PROMISED = "47 sessions of prove, seed 2611, and 17 with unlisted effects, seed 4122"
SEARCHED = "21 sessions of prove, seed 2711: two effects, outside the list, struck from it"
STRONG = "an independently simulated session with cubic springs as stiff at the peak as at rest"
BLIND = "23 rigs with nothing hidden, prove --rigs, seed 570083, and two with a motion that no input shows"
UNLISTED = "sessions with unlisted effects made while the families were built"


def _chosen(default: Any, meaning: str, unit: str, on: str, record: int) -> Any:
    """Declare a threshold: what it means, its unit, the data it was chosen on, the decision record that argues."""
    return field(default=default, metadata={"meaning": meaning, "unit": unit, "on": on, "record": record})


@dataclass(frozen=True, slots=True, kw_only=True)
class SelectionPolicy:
    """Thresholds by which mechanisms are tried, accepted and named; see `thresholds` for the reasons.

    Examples
    --------
    >>> SelectionPolicy(level=0.001).level
    0.001
    """

    # whether anything is missing
    level: float = _chosen(0.01, "p-value below which something is missing, or left over", "1", "convention", 10)
    held_out_share: float = _chosen(
        0.1, "share of this level that the errors on held-out blocks of a recording are tested at", "1", UNTOUCHED, 106
    )
    # candidates
    most_terms: int = _chosen(3, "mechanisms at work together", "mechanisms", "memory of the propagator", 10)
    few_terms: int = _chosen(2, "of them, before more than which a law is learned", "mechanisms", SEARCHED, 153)
    finalists: int = _chosen(5, "mechanisms of a step that are fitted to impacts", "mechanisms", PRACTICE, 10)
    most_finalists: int = _chosen(10, "the same where none of them explains", "mechanisms", FRICTION, 110)
    finalists_by_blocks: int = _chosen(16, "candidates that are fitted to a recording", "candidates", RECORDED, 50)
    promising_by_blocks: float = _chosen(
        0.02, "share of the best score's gain that earns a fit where the linear rig misses little", "1", DRAWN, 86
    )
    unlike_noise: float = _chosen(
        4.0, "mean square of what is missed, over what cannot be predicted of it, that is no noise", "1", RECENT, 87
    )
    polished: int = _chosen(3, "of them, fitted until converged", "candidates", RECORDED, 50)
    held_against_sweeps: int = _chosen(4, "of them, compared with steady responses", "candidates", RECORDED, 50)
    close: float = _chosen(0.25, "share of the best score's evidence that earns a full fit", "1", PRACTICE, 10)
    serious: float = _chosen(0.5, "share of the best evidence that a fit must be able to reach", "1", PRACTICE, 54)
    hopeful: float = _chosen(0.7, "share of the best evidence for further starts, or for its place", "1", PRACTICE, 54)
    other_start: float = _chosen(0.2, "share of the best screened evidence of a further start", "1", PRACTICE, 54)
    starts: int = _chosen(5, "starts of the fit of an added body", "starts", PRACTICE, 54)
    phase_locked_most: float = _chosen(
        1000.0,
        "gain beyond which a body phase-locked to the tap is fitted freely too",
        "chi-squared",
        SEALED,
        53,
    )
    # acceptance
    parameter_cost: float = _chosen(2.0, "least penalty per parameter (Akaike's)", "chi-squared", "theory", 52)
    first_gain: float = _chosen(6.0, "evidence of the first mechanism", "chi-squared", SEALED, 10)
    least_gain: float = _chosen(16.0, "evidence of a further mechanism", "chi-squared", SEALED, 10)
    least_share: float = _chosen(0.03, "of what is explained already, for a further mechanism", "1", SEALED, 40)
    most_of_the_rest: float = _chosen(0.8, "of what is left, that will do where it is too much", "1", SEALED, 40)
    certain_by_blocks: float = _chosen(
        25.0, "evidence of the choosing blocks' getting better that is no chance", "chi-squared", RECORDED, 83
    )
    chance: float = _chosen(0.05, "p-value of the choosing blocks' getting better", "1", RECORDED, 50)
    # impacts that show what no other one shows
    set_aside: float = _chosen(
        0.2, "share of the impacts that may be set aside (one always may)", "impacts", AS_SHIPPED, 112
    )
    hardest: float = _chosen(
        0.05, "probability below which odd taps are not the hardest of their loads by chance", "1", HARD_TAPS, 112
    )
    odd_share: float = _chosen(
        0.5, "share of what is left that impacts hold without which all is looked for again", "1", SHAKEN, 154
    )
    # what may be left over
    left_over: tuple[float, ...] = _chosen(
        (0.02, 0.005, 0.0), "share of all that was missed that one, two, three mechanisms may leave", "1", SEALED, 40
    )
    left_over_held_out: float = _chosen(
        0.1, "share of what the linear rig misses on held-out impacts that may be missed there still", "1", STRONG, 137
    )
    doubtful_over_noise: float = _chosen(
        1.3, "held-out errors of what is named, over noise, from which on more is looked for", "1", RUBBING, 144
    )
    far_over_noise: float = _chosen(
        5.0,
        "held-out errors of what is named, over noise, from which on all of them count as left",
        "1",
        RECORDED,
        141,
    )
    slow_over_noise: float = _chosen(
        2.0, "held-out errors over noise, from which on they must have the colour of a sensor's noise", "1", BLIND, 176
    )
    mostly_left: float = _chosen(
        0.5, "share of the linear rig's held-out mean square, far over noise, that no name may leave", "1", BLIND, 178
    )
    left_over_blocks: float = _chosen(
        0.05, "share of what the linear rig missed that a free force may still take away", "1", RECORDED, 50
    )
    unnamed: float = _chosen(
        8.0, "evidence by which something without a name must lead to be likelier", "chi-squared", SEALED, 56
    )
    learned_share: float = _chosen(
        0.001, "of what is named explains, by which a learned law must lead to replace it", "1", UNLISTED, 131
    )
    learned_simpler: float = _chosen(
        0.005, "share of a learned law's evidence that one with fewer parameters may lack", "1", RECORDED, 140
    )
    learned_promise: float = _chosen(
        0.05, "p-value of what laws promise beside what is named, from which on none is fitted", "1", PROMISED, 132
    )
    learned_near: float = _chosen(
        0.1, "of that lead, up to which a law that can lead no further is not learned", "1", NAMED, 133
    )
    # scatter between impacts
    scatter_share: float = _chosen(
        0.5,
        "share of what is left that constants of every impact take where scatter may be missing",
        "1",
        SEARCHED,
        153,
    )
    scatter_evidence: float = _chosen(30.0, "that per-impact constants must have", "chi-squared", SEALED, 57)
    # probabilities
    temperature: float = _chosen(
        2.0, "by which differences of chi-squared are divided: laws are never exactly right", "1", SEALED, 40
    )
    unlisted: float = _chosen(0.25, "odds of what is not listed over what is, before the data", "1", SEALED, 40)
    likeness: float = _chosen(
        400.0, "chi-squared up to which what is not listed looks like something listed", "chi-squared", SEALED, 40
    )
    strong_likeness: float = _chosen(0.02, "odds of what is not listed, however strong", "1", SEALED, 40)
    look_alike: float = _chosen(0.9, "cosine of signatures that these data cannot tell apart", "1", PRACTICE, 10)
    in_time: float = _chosen(
        4.0,
        "factor within which time is not preferred to amplitude in a single decay",
        "1",
        RECORDED,
        50,
    )
    unlisted_by_blocks: float = _chosen(
        -12.0, "evidence of what is not listed where blocks leave nothing over", "chi-squared", RECORDED, 50
    )
    told_apart: float = _chosen(
        -6.0, "evidence beside steady responses from which on an explanation is told apart", "chi-squared", RECORDED, 50
    )
    alike_losses: float = _chosen(2.0, "factor in mean square within which explanations are alike", "1", RECORDED, 50)
    equal_in_time: float = _chosen(
        0.1, "of what the linear rig missed, that a rival in time may leave to count as equal", "1", RECORDED, 50
    )
    counts_beside_time: float = _chosen(
        0.5,
        "of what stood before, below which amplitude counts beside time",
        "1",
        RECORDED,
        50,
    )
    missed: float = _chosen(
        0.5, "error over a channel's rms beyond which the rig as described is far off", "1", RECORDED, 50
    )
    predictable: float = _chosen(10.0, "error over its innovation rms, likewise", "1", RECORDED, 50)
    # compute budget
    budget: float = _chosen(700.0, "work of looking for one mechanism", "substeps a sample", PRACTICE, 58)
    usual_samples: int = _chosen(120_000, "samples whose budget a smaller session is given", "samples", PRACTICE, 58)
    # a competing fit ends early
    little: float = _chosen(5.0, "gain of a step below which a competing fit ends", "chi-squared", PRACTICE, 54)
    little_share: float = _chosen(3e-3, "the same, of its difference to the fit before", "1", PRACTICE, 54)
    beaten: float = _chosen(4.0, "last steps' gains that may still come", "steps", PRACTICE, 54)
    beaten_after: int = _chosen(5, "steps before that", "steps", PRACTICE, 54)
    as_expected: float = _chosen(0.5, "share of its expected gain that lets slopes be used again", "1", PRACTICE, 54)
    # strong effects
    strong: float = _chosen(3.0, "reduced chi-squared beyond which a fit is lost", "1", PRACTICE, 42)

    def may_be_left(self, terms: int) -> float:
        """Return the share of all that the linear rig missed that an explanation with so many mechanisms may leave.

        One law is never exactly right; several that still leave something are patches on what is not listed.
        """
        return self.left_over[min(max(terms, 1), len(self.left_over)) - 1]

    def race(self) -> Race:
        """Return when a competing fit ends."""
        return Race(
            self.little, self.little_share, self.beaten, self.beaten_after, self.as_expected,
        )  # fmt: skip


POLICY = SelectionPolicy()
"""What every command uses."""


def thresholds() -> tuple[Field[Any], ...]:
    """Return the fields of `SelectionPolicy`; ``metadata`` has meaning, unit, on (data) and record (decision)."""
    return fields(SelectionPolicy)
