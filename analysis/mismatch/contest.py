"""The contest: which mechanisms, if any, made the recordings what they are.

Screened by score tests on some of the impacts (the others are held out), the best confirmed by full fits, further ones
added one by one as long as impacts that took no part get better. What is then left over is tested once more against
forces of any shape: where much is left, nothing listed is right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln
from scipy.stats import chi2

from analysis.mismatch.coordinates import believable
from analysis.mismatch.fit import Fit, fit, relieved_of_laws
from analysis.mismatch.lengthening import STRONG, lengthened, misfit
from analysis.mismatch.problem import Problem, Term
from analysis.mismatch.screen import Score, Screening, screen
from sim_backend.mechanisms.mechanism import Mechanism

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

LEVEL = 0.01  # of the test whether anything is missing
HELD_OUT_EVERY = 4  # every fourth impact is held out
MOST_TERMS = 3
FINALISTS = 5  # mechanisms that are fitted in full
CLOSE = 0.25  # share of the best score's gain that earns a full fit
LEAST_COST = 2.0  # of a free number, chi-squared: Akaike's
COMPETING_ITERATIONS = 12  # of a fit while fits compete; the one that wins goes on
SERIOUS = 0.5  # share of the best evidence that another mechanism must be able to reach to be fitted on
STARTS = 5  # of the fit of an added body
EXPLAINED = 1.01  # misfit below which nothing much is left
HOPEFUL, HOPEFUL_LOST = 0.7, 0.3  # share of the best evidence that earns further starts; where nothing explains much
OTHER_START = 0.2  # share of the best screened evidence that a further start must have
STANDING_IN = 20.0  # chi-squared that departures from the declared constants cost when they stand in for something
FIRST_GAIN = 6.0  # evidence that the first mechanism must have, where the joint test says that there is one
LEAST_GAIN = 16.0  # evidence that a further mechanism must have
LEAST_SHARE = 0.03  # of what is explained already, likewise
MOST_OF_THE_REST = 0.8  # of what is left, that will do where it is too much
LEFT_OVER = (0.02, 0.005, 0.0)  # share of all misfit that one, two, three mechanisms may leave over
LEFT_LEVEL = 1e-3  # p-value below which what is left over counts
TEMPERATURE = 2.0  # by which differences of chi-squared are divided: laws are never exactly right
HELD_OUT_EVIDENCE = 4.0  # that a further mechanism must have in the impacts that took no part
FAR_OFF, FAR_OFF_LEAST = 0.1, 100.0  # share of all misfit, and chi-squared, left over by a fit that is not gone on with
UNNAMED = 8.0  # evidence by which something without a name must lead to be likelier than what is named
CONTRADICTED = 25.0  # chi-squared of k_c(P) against a force law from which on it is out
BEYOND_DOUBT = 200.0  # evidence in the fitted impacts, from which on the others need only not lose by it
NEARLY_AS_GOOD = 0.7  # share of the best first evidence with which another first mechanism is tried as well
WORSE = 1.05  # misfit of held-out impacts over that of the others from which on a better start is looked for
UNTIE = 1000.0  # chi-squared from which on a tie between an added body's ringing and the tap may be too strict
MOST_EFFORT = 700.0  # of a sample, after which nothing further is looked for
USUAL_SAMPLES = 120_000  # a session with fewer is given the effort of one with so many
LOOK_ALIKE = 0.9  # cosine of two signatures


@dataclass(frozen=True, slots=True)
class Entry:
    """A mechanism in the contest: fitted in full (with those already accepted), or only screened (``fit`` None).

    ``evidence`` is the chi-squared it takes away less what its free numbers take away by chance; ``own`` of these are
    free in the records, all together.
    """

    score: Score
    fit: Fit | None
    evidence: float
    own: int = 0

    @property
    def id(self) -> str:
        """Name of the mechanism."""
        return self.score.term.mechanism.id


@dataclass(frozen=True, slots=True)
class Round:
    """One step of the contest: what stood before it, all entries (best first), and what was accepted."""

    before: Fit
    screening: Screening
    entries: tuple[Entry, ...]
    accepted: Entry | None


@dataclass(frozen=True, slots=True)
class Contest:
    """Outcome.

    Attributes
    ----------
    p_value
        That Eq. 9 with its constants refitted made the recordings.
    chosen
        The accepted mechanisms' fit to the impacts not held out; None where Eq. 9 will do or nothing explains.
    best
        The best fit there is, even if it does not explain enough.
    left_over, left_p_value
        Chi-squared beyond chance that the best fit leaves, and its p-value.
    unnamed
        Evidence of the best single force or channel that has no name, less that of all mechanisms accepted.
    """

    problem: Problem
    training: tuple[int, ...]
    held_out: tuple[int, ...]
    baseline: Fit
    rounds: tuple[Round, ...]
    p_value: float
    chosen: Fit | None
    best: Fit
    left_over: float
    left_p_value: float
    unnamed: float


def split(problem: Problem) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return records for fitting and held-out ones: every fourth, but never all of a load nor the strongest of all."""
    records = problem.recordings.records
    fitted = [0] * len(problem.recordings.loads_n)
    strongest = max(range(len(records)), key=lambda i: float(np.abs(records[i].raw).max()), default=0)
    training: list[int] = []
    held: list[int] = []
    for i, record in enumerate(records):
        if i % HELD_OUT_EVERY == HELD_OUT_EVERY - 1 and fitted[record.group] and i != strongest:
            held.append(i)
        else:
            training.append(i)
            fitted[record.group] += 1
    return tuple(training), tuple(held)


@dataclass(frozen=True, slots=True)
class Begun:
    """The linear rig fitted to the impacts that are not held out, and all scores against what it leaves."""

    problem: Problem
    training: tuple[int, ...]
    held_out: tuple[int, ...]
    baseline: Fit
    screening: Screening

    @property
    def p_value(self) -> float:
        """That the linear rig made the recordings."""
        return self.screening.p_value

    def worn_out(self, contests: float) -> bool:
        """Whether the effort that so many contests about these recordings are worth has been spent on them."""
        return self.problem.effort.spent > contests * MOST_EFFORT * max(self.problem.samples, USUAL_SAMPLES)


def begin_contest(
    problem: Problem, known: Sequence[Mechanism], progress: Callable[[str], None] = lambda stage: None
) -> Begun:
    """Fit the linear rig and screen all mechanisms."""
    training, held = split(problem)
    progress("fitting the linear rig")
    baseline = fit(problem.only(training))
    progress("screening")
    return Begun(problem, training, held, baseline, screen(baseline, known))


def run_contest(
    begun: Begun,
    known: Sequence[Mechanism],
    progress: Callable[[str], None] = lambda stage: None,
    contests: float = 1.0,
) -> Contest:
    """Find the mechanisms that the recordings hold beyond the linear rig.

    Where what seemed best at first leads to no explanation, what was nearly as good is tried in its place; nothing
    further is looked for when all is spent that so many ``contests`` about these recordings are worth.
    """
    if begun.p_value >= LEVEL:
        return _outcome(begun, begun.baseline, begun.screening, ())

    def worn_out() -> bool:
        return begun.worn_out(contests)

    entries = _full_fits(begun.baseline, begun.screening, known, progress, worn_out)
    found = _path(begun, entries, known, progress, worn_out)
    if found.chosen is None and len(entries) > 1 and not worn_out():
        first, second = entries[:2]
        if second.fit is not None and second.evidence > NEARLY_AS_GOOD * first.evidence:
            progress(f"again, with {name_of(second.score)} first")
            again = _path(begun, entries[1:], known, progress, worn_out)
            found = found if again.chosen is None else again
    return found


def _path(
    begun: Begun,
    entries: tuple[Entry, ...],
    known: Sequence[Mechanism],
    progress: Callable[[str], None],
    worn_out: Callable[[], bool],
) -> Contest:
    """Take the best entry, then what is best beside it, as long as that pays."""
    baseline = current = begun.baseline
    screening = begun.screening
    rounds: list[Round] = []
    explained, ended = 0.0, True
    while len(current.terms) < MOST_TERMS and not (rounds and worn_out()):
        if rounds:
            entries = _full_fits(current, screening, known, progress, worn_out)
        best = entries[0] if entries else None
        least = _least_gain(current, screening, explained) if rounds else FIRST_GAIN
        enough = best is not None and best.fit is not None and best.evidence > least
        if enough and rounds:
            enough = _better_held_out(begun.problem, begun.held_out, current, best)  # type: ignore[arg-type]
        rounds.append(Round(current, screening, entries, best if enough else None))
        if not enough:
            break
        current = best.fit  # type: ignore[union-attr, assignment]
        ended = not _far_off(begun, current)
        if ended:
            progress("fitting to the end")
            current = _to_the_end(current)
        gained = baseline.objective - current.objective - explained
        explained += gained
        progress("looking at what is left")
        screening = screen(current, known)
        if screening.p_value < LEFT_LEVEL and len(current.terms) > 1:
            progress("looking for the earlier ones again")
            again = _looked_for_again(begun, current)
            if again is not current:
                current, explained = again, baseline.objective - again.objective
                ended = not _far_off(begun, current)
                screening = screen(current, known)
        if screening.p_value > LEFT_LEVEL:
            break
        if screening.unexplained > (MOST_TERMS - len(current.terms)) * gained:
            break  # even if every further one gained as much
    lean, kept = _without_idle_ones(current, rounds) if _nearly_enough(begun, screening) else (current, rounds)
    if lean is not current:
        current, rounds, screening, ended = lean, kept, screen(lean, known), True
    found = _outcome(begun, current, screening, tuple(rounds))
    if found.chosen is not None and not ended:
        current = _to_the_end(current)
        found = _outcome(begun, current, screen(current, known), tuple(rounds))
    return found


def _least_gain(current: Fit, screening: Screening, explained: float) -> float:
    """Return the evidence that a further mechanism must have.

    A share of what is explained already, as laws are never exactly right; but where so much is left that this would be
    no explanation, what takes up most of it is enough.
    """
    left = screening.unexplained
    share = LEAST_SHARE * explained
    if left > may_be_left(len(current.terms)) * (explained + left):
        share = min(share, MOST_OF_THE_REST * left)
    return max(LEAST_GAIN, share)


def _without_idle_ones(fitted: Fit, rounds: list[Round]) -> tuple[Fit, list[Round]]:
    """Leave out earlier mechanisms that gain little beside the later ones: alone they only stood in for these."""
    kept = list(rounds)
    for place in reversed([i for i, r in enumerate(rounds) if r.accepted is not None][:-1]):
        entry = kept[place].accepted
        at = sum(r.accepted is not None for r in kept[:place])
        others = fitted.terms[:at] + fitted.terms[at + 1 :]
        with suppress(ValueError, np.linalg.LinAlgError):
            without = _to_the_end(_competing(fitted.problem, others, fitted, ()))
            gain = without.objective - fitted.objective
            if evidence(gain, entry.own, len(entry.score.term.mechanism.parameters)) < LEAST_GAIN:  # type: ignore[union-attr]
                fitted, kept[place] = without, replace(kept[place], accepted=None)
    return fitted, kept


def _far_off(begun: Begun, fitted: Fit) -> bool:
    """Whether so much is left of what forces of any shape would explain that going on would not be enough."""
    all_of_it = begun.screening.unexplained
    left = all_of_it - (begun.baseline.objective - fitted.objective)
    return left > max(FAR_OFF * all_of_it, FAR_OFF_LEAST)


def _nearly_enough(begun: Begun, screening: Screening) -> bool:
    """Whether so little is left, twice what one mechanism may leave over, that leaving one out could matter."""
    return screening.p_value > LEFT_LEVEL or screening.unexplained < 2 * may_be_left(1) * begun.screening.unexplained


def _outcome(begun: Begun, best: Fit, screening: Screening, rounds: tuple[Round, ...]) -> Contest:
    """Return a contest that ends here: explained, or patched together."""
    left = screening.unexplained if begun.p_value < LEVEL else 0.0
    explained = begun.baseline.objective - best.objective
    patched = screening.p_value < LEFT_LEVEL and left > may_be_left(len(best.terms)) * (explained + left)
    unnamed = _lead_of_the_unnamed(begun, best, rounds)
    chosen = best if best.terms and not patched and unnamed < UNNAMED else None
    return Contest(
        begun.problem, begun.training, begun.held_out, begun.baseline, rounds, begun.p_value, chosen, best, left,
        screening.p_value, unnamed,
    )  # fmt: skip


def _lead_of_the_unnamed(begun: Begun, best: Fit, rounds: Sequence[Round]) -> float:
    """Return by how much a single force or channel without a name has more evidence than all that is named together."""
    free = begun.screening.free.best_alone
    named = begun.baseline.objective - best.objective
    for place, (entry, before) in enumerate((r.accepted, r.before) for r in rounds if r.accepted is not None):
        gain = before.objective - entry.fit.objective  # type: ignore[union-attr]
        named -= gain - entry.evidence + (LEAST_GAIN if place else 0.0)
    return evidence(free, 0, 1) - named


def may_be_left(terms: int) -> float:
    """Return the share of all misfit that an explanation with so many mechanisms may leave over.

    One law is never exactly right; several that still leave something are patches on what is not listed.
    """
    return LEFT_OVER[min(terms, len(LEFT_OVER)) - 1]


def _full_fits(
    current: Fit,
    screening: Screening,
    known: Sequence[Mechanism],
    progress: Callable[[str], None],
    worn_out: Callable[[], bool],
) -> tuple[Entry, ...]:
    """Fit the best screened mechanisms in full, each with those already accepted."""
    present = {t.mechanism.id for t in current.terms}
    tried: dict[str, list[Score]] = {}
    for score in sorted(screening.scores, key=lambda s: -screened_gain(s)):
        if score.term.mechanism.id not in present and screened_gain(score) > 0:
            tried.setdefault(score.term.mechanism.id, []).append(score)
    ranked = [scores[0] for scores in tried.values()]
    entries, explained, best = [], False, 0.0
    fitted: set[str] = set()
    for place, score in enumerate(ranked):
        close = screened_gain(score) > CLOSE * screened_gain(ranked[0])
        certain = score.p_value < LEVEL / max(len(ranked), 1)
        promising = certain and (close or screened_gain(score) > best)  # more than what has been fitted so far gained
        if place >= FINALISTS or (place and (not promising or worn_out())):
            entries.append(Entry(score, None, screened_gain(score)))
            continue
        progress(f"fitting {name_of(score)}")
        fitted.add(score.term.mechanism.id)
        begun = [(started(s), current) for s in _variants(tried[score.term.mechanism.id])]
        found = _entry(current, score, begun, explained, current.objective - SERIOUS * best)
        best = max(best, found.evidence)
        explained = explained or (found.fit is not None and misfit(found.fit) < STRONG)
        entries.append(found)
    first = max((e.evidence for e in entries if e.fit is not None), default=0.0)
    lost = all(misfit(e.fit) > EXPLAINED for e in entries if e.fit is not None)
    for i, entry in enumerate(entries):
        hopeful = entry.fit is None or entry.evidence > (HOPEFUL_LOST if lost else HOPEFUL) * first
        if entry.id in fitted and entry.score.term.mechanism.body is not None and hopeful and not worn_out():
            progress(f"fitting {name_of(entry.score)} from elsewhere")
            elsewhere = _elsewhere(current, tried[entry.id])
            again = _entry(current, entry.score, elsewhere, explained, current.objective - entry.evidence)
            entries[i] = max(entry, again, key=lambda e: e.evidence)
    entries.sort(key=lambda e: (e.fit is None, -(e.evidence + stiffness_evidence(e.score.term.mechanism, e.fit))))
    return tuple(entries)


def _variants(scores: Sequence[Score]) -> list[Score]:
    """Return the best score with each set of fixed values in a mechanism, where it is not far behind the first."""
    best: dict[frozenset[tuple[str, float]], Score] = {}
    for score in scores:
        fitted = {q.name for q in score.term.mechanism.parameters}
        best.setdefault(frozenset((k, v) for k, v in score.term.values.items() if k not in fitted), score)
    return [s for s in best.values() if s is scores[0] or screened_gain(s) > HOPEFUL * screened_gain(scores[0])]


def _entry(
    current: Fit, score: Score, begun: Sequence[tuple[Term, Fit | None]], explained: bool, to_beat: float
) -> Entry:
    """Return the best of the full fits of a mechanism that begin at these values and rigs."""
    fitted = _best(current.problem, current.terms, begun, score.delays, to_beat)
    if fitted is None or not _rings(fitted) or stiffness_evidence(score.term.mechanism, fitted) < -CONTRADICTED:
        return Entry(score, None, 0.0)
    if fitted.only_laws and not explained and misfit(fitted) > STRONG:
        fitted = lengthened(current.problem, fitted.terms, current) or fitted
    gain = current.objective - fitted.objective - score.choice
    own, parameters = own_numbers(score), len(score.term.mechanism.parameters)
    entry = Entry(score, fitted, evidence(gain, own, parameters), own)
    if score.term.mechanism.tied and current.objective - fitted.objective > UNTIE:
        entry = max(entry, _untied(current, fitted, score), key=lambda e: e.evidence)
    return entry


def _best(
    problem: Problem,
    others: tuple[Term, ...],
    begun: Sequence[tuple[Term, Fit | None]],
    delays: Sequence[float] = (),
    to_beat: float = math.inf,
) -> Fit | None:
    """Fit a term beside others from some values and rigs, for a few steps each; go on with the best."""
    fits = []
    for term, begin in begun:
        with suppress(ValueError, np.linalg.LinAlgError):  # it cannot be joined with what is there already
            fits.append(_competing(problem, (*others, term), begin, delays, to_beat))
    best = min(fits, key=lambda f: (not _rings(f), f.objective), default=None)
    if best is None or any(t.nonlinear for t in best.terms) or best.objective > to_beat:
        return best
    return fit(problem, best.terms, begin=best, competing=True)


def _rings(fitted: Fit) -> bool:
    """Whether the bodies that were added are believable ones."""
    return all(believable(t, fitted.constants.at(0)) for t in fitted.terms)


def _competing(
    problem: Problem,
    terms: Sequence[Term],
    begin: Fit | None,
    delays: Sequence[float],
    to_beat: float = math.inf,
) -> Fit:
    """Fit a model so well that it can be compared with others.

    Beside laws it is begun with the amplitudes that these left, unless a body changes the modes.
    """
    amplitudes: tuple[Complex, ...] = ()
    if begin is not None and any(t.nonlinear for t in begin.terms) and len(terms) > len(begin.terms):
        bodies = [sum(t.mechanism.extend is not None for t in some) for some in (terms, begin.terms)]
        amplitudes = begin.amplitudes if bodies[0] == bodies[1] else ()
    return fit(problem, terms, begin, None, delays, COMPETING_ITERATIONS, amplitudes, competing=True, to_beat=to_beat)


def _to_the_end(fitted: Fit) -> Fit:
    """Go on with a fit until no step gains anything."""
    if any(t.nonlinear for t in fitted.terms):  # while it competed it was computed in coarser steps
        return fit(fitted.problem, fitted.terms, fitted, amplitudes=fitted.amplitudes)
    found = fit(fitted.problem, fitted.terms, fitted)
    return found if found.objective < fitted.objective else fitted


def _looked_for_again(begun: Begun, fitted: Fit) -> Fit:
    """Begin each earlier mechanism anew beside the later ones: alone it may have gone far to stand in for them."""
    for i, term in enumerate(fitted.terms[:-1]):
        if term.mechanism.lines is not None:
            continue
        others = fitted.terms[:i] + fitted.terms[i + 1 :]
        with suppress(ValueError, np.linalg.LinAlgError):
            without = _competing(fitted.problem, others, fitted, ())
            score = max(screen(without, [term.mechanism]).scores, key=screened_gain)
            terms = (*others[:i], started(score), *others[i:])
            found = _competing(fitted.problem, terms, without, score.delays)
            if found.objective < fitted.objective - LEAST_GAIN and _rings(found):
                ended = found if _far_off(begun, found) else _to_the_end(found)
                fitted = min(ended, fitted, key=lambda f: f.objective)
    return fitted


def _elsewhere(current: Fit, scores: Sequence[Score]) -> list[tuple[Term, Fit | None]]:
    """Return where else the fit of an added body, which has more than one minimum, is begun.

    At its next best screened values, and from the rig as declared where that went far to stand in for it. Beside laws,
    at the best of the fits that leave what these add to the records as it is.
    """
    least = OTHER_START * screened_gain(scores[0])
    rigs = (current, None) if current.penalty > STANDING_IN else (current,)
    begun = [(started(s), rig) for s in scores[:STARTS] if screened_gain(s) > least for rig in rigs]
    if not any(t.nonlinear for t in current.terms):
        return begun[1:]
    relieved = relieved_of_laws(current)
    linear = tuple(t for t in current.terms if not t.nonlinear)
    best = _best(relieved, linear, begun)
    return [] if best is None else [(best.terms[-1], best)]


def _untied(current: Fit, tied: Fit, score: Score) -> Entry:
    """Return the fit in which an added body rings in every record as it will: its tie to the tap is only nearly so."""
    last = tied.terms[-1]
    term = replace(last, mechanism=replace(last.mechanism, tied=False))
    fitted = _competing(current.problem, (*tied.terms[:-1], term), current, score.delays)
    own = 2 * len(current.problem.recordings.records)
    gain = current.objective - fitted.objective - score.choice
    return Entry(score, fitted, evidence(gain, own, len(last.mechanism.parameters)), own)


def name_of(score: Score) -> str:
    """What progress calls a mechanism."""
    return score.term.mechanism.id.replace("_", " ")


def evidence(gain: float, own: int, parameters: int = 0) -> float:
    """Return the chi-squared on two degrees of freedom that is as unlikely by chance as this gain.

    Parameters
    ----------
    own
        Numbers that are free in every record, all records together.
    parameters
        Further free numbers: each costs the logarithm of the gain, by which the data have narrowed it down.
    """
    cost = parameters * max(LEAST_COST, math.log(max(gain, 1.0)))
    return (gain if gain <= 0 else -2 * log_tail(gain, max(own, 2))) - cost


def log_tail(gain: float, dof: int) -> float:
    """Return the logarithm of the tail of chi-squared, far out too."""
    a, x = dof / 2, gain / 2
    if x < a + 300:
        return float(chi2.logsf(gain, dof))
    return float(-x + a * math.log(x) - math.log(x + 1 - a) - gammaln(a))


def own_numbers(score: Score) -> int:
    """Numbers of a mechanism that are free in every record."""
    return score.dof if score.dof > 1 else 0


def screened_gain(score: Score) -> float:
    """Evidence of a score."""
    return evidence(score.gain, own_numbers(score))


def started(score: Score) -> Term:
    """Return the screened term with the strength that the score test found."""
    term, strength = score.term, score.term.mechanism.strength
    values = dict(term.values)
    if term.mechanism.blow or term.mechanism.lines is not None:
        return term
    if strength is not None:
        factor = score.strength if score.strength != 0 else 1.0
        quantities = {q.name: q for q in term.mechanism.parameters}
        value = values[strength] * factor
        if quantities[strength].log:
            value = abs(value)
        scaled = [strength] if not term.mechanism.tied and term.mechanism.extend is None else None
        if scaled is None and quantities[strength].log:
            # a body of this strength: mass, stiffness and damping grow together
            factor = abs(factor)
            values = {k: v * factor if k in quantities else v for k, v in values.items()}
        else:
            values[strength] = value
        for name, q in quantities.items():
            values[name] = min(max(values[name], q.low), q.high)
    elif term.mechanism.tied:
        factor = max(abs(score.strength), 1e-6)
        values = {k: v / factor for k, v in values.items()}
    return replace(term, values=values)


def stiffness_evidence(mechanism: Mechanism, fitted: Fit | None) -> float:
    """Chi-squared by which k_c(P) speaks against a force law of the contact: its exponent must be the law's."""
    exponent = stiffness_exponent(fitted) if fitted is not None else None
    if mechanism.stiffness_exponent is None or exponent is None:
        return 0.0
    expected, tolerance = mechanism.stiffness_exponent
    return -(((exponent[0] - expected) / math.hypot(tolerance, exponent[1])) ** 2)


def stiffness_exponent(fitted: Fit) -> tuple[float, float] | None:
    """Return d ln k_c / d ln P over the loads and its standard error; None with less than three loads."""
    loads = np.log(np.array(fitted.problem.recordings.loads_n))
    names = fitted.constants.names()[1]
    if "kc" not in names or loads.size < 3 or np.ptp(loads) < 0.1:
        return None
    y = np.log(fitted.constants.load[:, names.index("kc")])
    x = loads - loads.mean()
    slope = float(x @ y / (x @ x))
    scatter = y - y.mean() - slope * x
    return slope, math.sqrt(float(scatter @ scatter) / (loads.size - 2) / float(x @ x))


def held_out_fit(problem: Problem, held: Sequence[int], fitted: Fit) -> Fit:
    """Return the fit to held-out impacts: only what belongs to each impact is fitted on them."""
    kept = problem.only(held)
    delays: Sequence[float] = blow_delays(kept, fitted) if any(t.mechanism.blow for t in fitted.terms) else ()
    found = fit(kept, held=fitted, delays=delays)
    if found.only_laws and misfit(fitted) < STRONG and misfit(found) > WORSE * misfit(fitted):
        again = lengthened(kept, fitted.terms, fitted, held=fitted)
        found = again if again is not None and again.chi_squared < found.chi_squared else found
    return found


def held_out_rms(problem: Problem, held: Sequence[int], fitted: Fit) -> float:
    """Return the rms of the residual on held-out impacts, m/s2."""
    outer = held_out_fit(problem, held, fitted)
    deviations = np.array([m.deviation for m in problem.recordings.noise])
    total = sum(float(np.sum((r * deviations[:, None]) ** 2)) for r in outer.residuals)
    return math.sqrt(total / sum(r.size for r in outer.residuals))


def blow_delays(problem: Problem, fitted: Fit) -> tuple[float, ...]:
    """Return when the second blow fell in records that took no part in the fit."""
    others = tuple(t for t in fitted.terms if not t.mechanism.blow)
    blows = [t.mechanism for t in fitted.terms if t.mechanism.blow]
    plain = fit(problem, held=replace(fitted, terms=others))
    return next(s.delays for s in screen(plain, blows).scores if s.term.mechanism.blow)


def _better_held_out(problem: Problem, held: Sequence[int], before: Fit, added: Entry) -> bool:
    """Whether held-out impacts gain more than the added mechanism's own numbers in them would by chance.

    Where it is beyond doubt in the others it need only not be contradicted: few and weak taps may show nothing of it.
    """
    if added.fit is None or not held:
        return False
    gain = held_out_fit(problem, held, before).chi_squared - held_out_fit(problem, held, added.fit).chi_squared
    own = added.own * len(held) // len(before.problem.recordings.records)
    return gain > 0 and (evidence(gain, own) > HELD_OUT_EVIDENCE or added.evidence > BEYOND_DOUBT)
