"""What a learned law is: symmetry, exponents, whether it conserves energy, formulas, its curve with a band.

A formula is held against a force of any shape in the same element, which is fitted for that; several are offered where
the recordings do not part them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.mismatch.account import Account
from analysis.mismatch.answer import Formula, Interval, Law, LawKind, LawTable
from analysis.mismatch.free_form import RATE, STATIC, free_law
from analysis.mismatch.intervals import NORMAL_95, intervals
from analysis.mismatch.parameters import Term
from analysis.mismatch.problem import Fit
from analysis.mismatch.recordings.constants import constants_covariance
from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.score_test import Score
from sim_backend.arrays import Real
from sim_backend.force_law import MEMORY
from sim_backend.learned.curves import DAMPING
from sim_backend.learned.families import form_of
from sim_backend.learned.forms import AT_LOAD, FORM, IN_DEFLECTION, IN_LOAD, IN_RATE, TIME, Form, held
from sim_backend.mechanisms.kinds import AtRest, ForceLaw

SIMPLE = (0.0, 1.0, 2.0, 3.0, 0.5, 1.5, 2.5, 4.0, 5.0, 1 / 3, 2 / 3, 4 / 3, 0.25, 0.75)
"""Exponents that a formula is written with where they are within the interval, the first of them first."""
NOTHING_LOST = -1.0  # logarithm of a Bayes factor: less than this is no loss
OTHERS, PROMISING = 4, 0.1  # further families that a formula is looked for in, those with this share of the score
POINTS, ACROSS, FEW = 41, 21, 5  # of a curve, of a surface in each direction, of one that is in proportion to it
STEP = 1e-4  # of differences
AT_THE_END = 1e-3  # of a parameter's value, within which it is at the end of its range
LETS_GO = "letting_go"  # the family of what acts for a while
AT_THE_TAP_S = 5e-3  # what ends before belongs to the excitation, on the body that is tapped
FREE = {"static": STATIC, "rate": RATE}
EXPONENTS = {"deflection": IN_DEFLECTION, "rate": IN_RATE, "load": IN_LOAD}


@dataclass(frozen=True, slots=True)
class _Read:
    """A fitted law: the term, its number in the fit, what it gains, and its parameters with intervals."""

    fitted: Fit
    number: int
    gained: float
    parameters: Mapping[str, Interval]

    @property
    def term(self) -> Term:
        return self.fitted.terms[self.number]

    @property
    def form(self) -> Form:
        return form_of(self.term.values)

    @property
    def pinned(self) -> bool:
        """Whether a parameter is at the end of its range, where the family is another one."""
        at = [(float(self.term.values[q.name]), q) for q in self.term.mechanism.parameters]
        return any(min(abs(value - q.low), abs(value - q.high)) <= AT_THE_END * abs(value) for value, q in at)


def law_of(account: Account[Any], fitted: Any, number: int, parameters: Mapping[str, Interval]) -> Law:
    """Return what is known of a learned law.

    Parameters
    ----------
    fitted, number
        The chosen fit and the law's place among its terms.
    parameters
        With their intervals.
    """
    selection = account.selection
    before = selection.accepted[number].before
    own = _Read(fitted, number, _gained(account, before, fitted, number), parameters)
    others = [own]
    if number == len(fitted.terms) - 1:
        others += _others(account, before, own)
        others += [simple for r in others if (simple := _simple(account, before, r)) is not None]
    free = _free(account, before, own) if own.form.formula else own
    against = own.gained if free is None else free.gained
    as_good = [r for r in others if r.form.formula and (r.gained - against) / 2 >= NOTHING_LOST and not r.pinned]
    offered = sorted(as_good, key=lambda r: -r.gained)
    best = offered[0] if offered else own
    formulas = _different([_formula(account, r, (r.gained - against) / 2) for r in offered])
    valid = _valid(account, fitted, own)
    return Law(
        kind=_kind(best, selection.problem.arrangement.tapped, selection.problem.arrangement.elements),
        symmetry=best.form.symmetry,
        conservative=best.form.conservative,
        exponents=_exponents(best, others),
        formulas=formulas,
        valid=valid,
        table=_table(best, valid, None if offered or free is own else free),
        curve="" if own.form.formula else own.form.key,
    )


def _different(formulas: Sequence[Formula]) -> tuple[Formula, ...]:
    """Return the first of those that read alike."""
    return tuple(f for i, f in enumerate(formulas) if f.text not in [other.text for other in formulas[:i]])


def _formula(account: Account[Any], read: _Read, evidence: float) -> Formula:
    values = {k: float(v) for k, v in read.term.values.items() if k != FORM}
    return Formula(account.unit(read.form.text(values)), read.parameters, evidence, read.form.key, values)


def _gained(account: Account[Any], before: Any, fitted: Any, number: int) -> float:
    judge = account.selection.judge
    return judge.gained(before, fitted, sum(len(t.mechanism.parameters) for t in fitted.terms[number:]))


def _kind(own: _Read, tapped: str, elements: Sequence[Any]) -> LawKind:
    """Return the kind; what acts on the tapped body until shortly after the tap belongs to the excitation."""
    if own.form.key != LETS_GO or own.term.values[TIME] > AT_THE_TAP_S:
        return own.form.kind
    row = elements[own.term.place[0]].row
    return "input" if [body for body, _ in row] == [tapped] else "time"


def _refitted(account: Account[Any], before: Any, term: Term) -> _Read | None:
    """Fit a term beside what stood before; None where it cannot be fitted."""
    judge = account.selection.judge
    with suppress(ValueError, ArithmeticError, np.linalg.LinAlgError):
        fitted = judge.fitted_alone(before, [Score(term, 0.0, 1, 1.0, 0.0)])
        if fitted is not None:
            return _read_to_the_end(account, before, fitted)
    return None


def _read_to_the_end(account: Account[Any], before: Any, fitted: Any) -> _Read:
    """Return the fit once no step gains anything, read."""
    fitted = account.selection.judge.to_the_end(fitted)
    number = len(fitted.terms) - 1
    return _Read(fitted, number, _gained(account, before, fitted, number), intervals(fitted, number))


def _simple(account: Account[Any], before: Any, own: _Read) -> _Read | None:
    """Return the law with its exponents at simple numbers within their intervals; None where none is within."""
    simple: dict[str, float] = {}
    for name in EXPONENTS.values():
        known = own.parameters.get(name)
        if known is not None:
            within = [x for x in SIMPLE if known.low <= x <= known.high]
            simple |= {name: within[0]} if within else {}
    if not simple:
        return None
    return _refitted(account, before, replace(own.term, mechanism=held(own.term.mechanism, list(simple)),
                                              values={**own.term.values, **simple}))  # fmt: skip


def _others(account: Account[Any], before: Any, own: _Read) -> list[_Read]:
    """Return fits of the other families of the same kind in the same place whose scores are not far behind."""
    step = account.selection.accepted[own.number]
    if isinstance(own.fitted, SimulatedFit):  # all that comes near was fitted
        alike = [c for c in step.candidates if c.fit is not None and c.fit.terms[-1].place == own.term.place]
        alike = [c for c in alike if FORM in c.score.term.values and c.score.term.key != own.term.key]
        return _worth_reading(account, before, own, [c.fit for c in alike if c.id == own.term.mechanism.id])
    best: dict[float, Score] = {}
    for score in step.screening.scores:
        same = (score.term.mechanism.id, score.term.place) == (own.term.mechanism.id, own.term.place)
        if same and FORM in score.term.values:
            form = score.term.values[FORM]
            best[form] = max(best.get(form, score), score, key=lambda s: s.gain)
    mine = best.pop(own.term.values[FORM], None)
    least = PROMISING * (mine.gain if mine is not None else 0.0)
    ranked = sorted((s for s in best.values() if s.gain > least), key=lambda s: -s.gain)[:OTHERS]
    fits = []
    for score in ranked:
        with suppress(ValueError, ArithmeticError, np.linalg.LinAlgError):
            fits.append(account.selection.judge.fitted_alone(before, [score]))
    return _worth_reading(account, before, own, [fitted for fitted in fits if fitted is not None])


def _worth_reading(account: Account[Any], before: Any, own: _Read, others: Sequence[Any]) -> list[_Read]:
    """Return which of several fits explain nearly as much as a law, and of a law that is no power the nearest one."""
    fits = [(_gained(account, before, fitted, own.number), fitted) for fitted in others]
    wanted = [fitted for gained, fitted in fits if gained > account.selection.problem.policy.hopeful * own.gained]
    powers = [] if own.form.exponents else [f for f in fits if f[0] > 0 and form_of(f[1].terms[-1].values).exponents]
    if powers:  # of a law that is no power the exponents of the nearest one are told
        nearest = max(powers, key=lambda one: one[0])[1]
        wanted += [] if any(f is nearest for f in wanted) else [nearest]
    found = []
    for fitted in wanted:
        with suppress(ValueError, ArithmeticError, np.linalg.LinAlgError):
            found.append(_read_to_the_end(account, before, fitted))
    return found


def _free(account: Account[Any], before: Any, own: _Read) -> _Read | None:
    """Return the fit of a force of any shape in the same place; None for a kind that has none."""
    names = FREE.get(own.form.kind)
    if names is None:
        return None
    problem = account.selection.judge.training
    scale = problem.scale_of(before, own.term.place[0])
    return _refitted(account, before, free_law(own.term, problem.arrangement, scale, names))


def _exponents(best: _Read, others: Sequence[_Read]) -> dict[str, Interval | None]:
    """Return the exponents of the law, or of the power law that is nearest to it, from the fit where they are free."""
    powers = sorted((r for r in others if r.form.exponents), key=lambda r: -r.gained)
    nearest = best if best.form.exponents or not powers else powers[0]
    own = {*nearest.form.exponents.values()}
    free = next((r for r in others if r.form is nearest.form and own & {*r.parameters}), nearest)
    found: dict[str, Interval | None] = {}
    for name, parameter in EXPONENTS.items():
        known = free.parameters.get(parameter)
        fixed = nearest.term.values.get(parameter, 0.0)
        found[name] = known or (Interval(fixed, fixed, fixed, "1") if fixed else None)
    return found


def _valid(account: Account[Any], fitted: Any, own: _Read) -> dict[str, tuple[float, float]]:
    """Return the ranges that the recordings cover."""
    groups = account.groups.values()
    valid = {"load_mn": (1e3 * min(groups), 1e3 * max(groups))} if groups else {}
    if not isinstance(own.term.mechanism, ForceLaw):
        return valid
    deflection, rate = account.selection.judge.training.reach_of(fitted, own.term.place[0])
    return {"deflection": (-deflection, deflection), "rate": (-rate, rate), **valid}


def _table(best: _Read, valid: Mapping[str, tuple[float, float]], better: _Read | None) -> LawTable | None:
    """Return the law as a curve over what the recordings cover, or a surface, with a band.

    At the load that is nearest to its reference. Where a force of any shape does ``better`` than every formula, the
    band is as much wider as that differs from the law by more than an offset and a spring's or damper's share: these
    a force of any shape trades with the rig's own.
    """
    mechanism, kind = best.term.mechanism, best.form.kind
    if not isinstance(mechanism, ForceLaw) or kind not in FREE:
        return None
    deflection, rate = valid["deflection"][1], valid["rate"][1]
    curve = best.form.key.startswith(DAMPING)
    surface = kind == "rate" and (curve or IN_DEFLECTION in best.form.exponents.values())
    counts = (POINTS, FEW) if curve else (ACROSS, ACROSS) if surface else (POINTS, POINTS)
    along = {"deflection_m": _both_ways(deflection, counts[0]), "rate_m_per_s": _both_ways(rate, counts[1])}
    one = "deflection_m" if kind == "static" else "rate_m_per_s"
    axes = along if surface else {one: along[one]}
    grid = np.meshgrid(*axes.values(), indexing="ij")
    at = dict(zip(axes, grid, strict=True))
    d, v = (np.asarray(at.get(name, np.zeros_like(grid[0]))).ravel() for name in along)
    group = _group(best.fitted, best.term)
    rest = _rest(best.fitted, best.term, group)
    middle = _forces(best.term, rest, d, v)
    slopes = np.zeros((len(best.fitted.term_covariances[best.number]), d.size))
    for slope, q in zip(slopes, [q for q in mechanism.parameters if q.name in best.term.values], strict=True):
        value = best.term.values[q.name]
        step = STEP * (1.0 if q.log else max(abs(value), STEP))
        moved = value * math.exp(step) if q.log else value + step
        slope[:] = (_forces(best.term.moved({q.name: moved}), rest, d, v) - middle) / step
    by_law = _deviation(slopes, best.fitted.term_covariances[best.number])
    reach = NORMAL_95 * (by_law + _by_constants(best, group, d, v, middle))  # as if they went fully together
    if better is not None and not surface:
        other = _forces(better.term, _rest(better.fitted, better.term, group), d, v) - middle
        line = np.polynomial.Polynomial.fit(d if kind == "static" else v, other, 1)
        reach = reach + np.abs(other - line(d if kind == "static" else v))
    low, high, force = (x.reshape(grid[0].shape) for x in (middle - reach, middle + reach, middle))
    return LawTable(axes, force, low, high)


def force_on(fitted: Any, term: Term, learned: Term, axes: Mapping[str, Real]) -> Real:
    """Return the force (N) of a term without a memory on the grid of a learned law, at the same load."""
    if not isinstance(term.mechanism, ForceLaw):
        raise TypeError(f"{term.mechanism.id} is no force law")
    rest = _rest(fitted, term, _group(fitted, learned))
    grid = np.meshgrid(*axes.values(), indexing="ij")
    at = dict(zip(axes, grid, strict=True))
    d, v = (np.asarray(at.get(name, np.zeros_like(grid[0]))).ravel() for name in ("deflection_m", "rate_m_per_s"))
    return _forces(term, rest, d, v).reshape(grid[0].shape)


def _both_ways(reach: float, count: int) -> Real:
    return np.linspace(-reach, reach, count)


def _group(fitted: Any, learned: Term) -> int:
    """Return the number of the load that is nearest to a law's reference."""
    return int(np.argmin([abs(load - learned.values.get(AT_LOAD, 0.0)) for load in _loads(fitted)]))


def _loads(fitted: Any) -> Sequence[float]:
    """Return the loads, N; in recordings of a described rig there is one, its preload."""
    experiment = getattr(fitted.problem, "experiment", None)
    return (fitted.problem.rig.preload_n,) if experiment is None else experiment.loads_n


def _rest(fitted: Any, term: Term, group: int, moved: Mapping[str, float] | None = None) -> AtRest:
    """Return a term's element at a load, with some constants moved."""
    values = fitted.constants.at(group) | (moved or {})
    return AtRest.of(fitted.arrangement.elements[term.place[0]], values, _loads(fitted)[group])


def _forces(term: Term, rest: AtRest, d: Real, v: Real) -> Real:
    """Return (n,) the force of a law without a memory beside the element's own."""
    mechanism = term.mechanism
    assert isinstance(mechanism, ForceLaw)  # noqa: S101
    p, memory = mechanism.packed(term.values, rest, 1.0), np.zeros(MEMORY)
    base = rest.stiffness * d + rest.damping * v
    force = [mechanism.law(b, x, y, 0.0, p, memory, memory) - b for b, x, y in zip(base, d, v, strict=True)]
    return np.array(force)


def _by_constants(read: _Read, group: int, d: Real, v: Real, middle: Real) -> Real:
    """Return (n,) the standard deviation of a law's force by that of the rig's constants at a load.

    Zero without a load: only what is pressed together has a law of which its stiffness is a part.
    """
    fitted = read.fitted
    if not _rest(fitted, read.term, group).preload:
        return np.zeros(d.size)
    names, spread = _spread_of_constants(fitted, group)
    values = fitted.constants.at(group)
    slopes = np.zeros((len(names), d.size))
    for slope, name in zip(slopes, names, strict=True):
        step = STEP * abs(values[name])
        if step > 0:
            moved = _rest(fitted, read.term, group, {name: values[name] + step})
            slope[:] = (_forces(read.term, moved, d, v) - middle) / step
    own = np.any(slopes != 0, axis=1)  # what else there is may not be determined
    return _deviation(slopes[own], spread[np.ix_(own, own)])


def _spread_of_constants(fitted: Any, group: int) -> tuple[Sequence[str], Real]:
    """Return the names of the rig's constants at a load and the (k, k) covariance of their values."""
    if isinstance(fitted, SimulatedFit):
        return constants_covariance(fitted)
    rig, each = fitted.constants.names()
    places = [*range(len(rig)), *(len(rig) + group * len(each) + i for i in range(len(each)))]
    return [*rig, *each], fitted.covariance[np.ix_(places, places)]


def _deviation(slopes: Real, covariance: Real) -> Real:
    """Return (n,) the standard deviation of n values with slopes (k, n) by what has a covariance (k, k)."""
    variance: Real = np.einsum("in,ij,jn->n", slopes, covariance, slopes)
    return np.sqrt(np.maximum(variance, 0.0))
