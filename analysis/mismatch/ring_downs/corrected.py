"""Contact stiffness and damping of a fit at each load: of the linear part, so at zero amplitude."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.mismatch.answer import ContactAtRest
from analysis.mismatch.intervals import NORMAL_95
from analysis.mismatch.parameters import Term
from analysis.mismatch.ring_downs.continuation import continued, lengthened, linear_at_first, scales_kept
from analysis.mismatch.ring_downs.fit import Start, fit
from analysis.mismatch.ring_downs.problem import RingDownFit
from analysis.mismatch.score_test import screen
from analysis.stiffness import contact_from_pole, pole
from calibration.estimate import Estimate
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import ForceLaw, SecondImpact
from sim_backend.two_mass import TwoMass

STEP = 1e-6  # relative, of the differences of the damping ratio
BODY = ("m1", "m2", "k1", "k2")
CONTACT = ("kc", "cc")


def contact_at_rest(found: RingDownFit) -> tuple[ContactAtRest, ...]:
    """Return the contact at every load of a fit, in the order of its loads.

    Standard errors are those of the joint fit: what belongs to each impact, the declared constants and the
    mechanisms' parameters are left free in them. Where impacts have a contact of their own, a load has their mean, and
    their scatter counts. The errors of the loads themselves are not included.

    Where a fit moved a mass or the scale of the loads far, 95 % intervals reach to the ends of those that masses and
    loads as declared give: which of both is right the recordings do not say.
    """
    loads = found.problem.groups_by_load
    each = tuple(_at_rest(found, groups) for groups in loads)
    kept = scales_kept(found)
    return (
        each
        if kept is None
        else tuple(_reaching(one, _by_masses(kept, groups)) for one, groups in zip(each, loads, strict=True))
    )


def _reaching(one: ContactAtRest, other: ContactAtRest) -> ContactAtRest:
    """Return a contact whose 95 % intervals contain another one's, too."""
    return ContactAtRest(
        one.load_n,
        _containing(one.stiffness, other.stiffness),
        _containing(one.damping, other.damping),
        _containing(one.damping_ratio, other.damping_ratio),
    )


def _containing(own: Estimate, other: Estimate) -> Estimate:
    farthest = abs(other.value - own.value) / NORMAL_95 + other.standard_error
    return replace(own, standard_error=max(own.standard_error, farthest))


def _by_masses(kept: RingDownFit, groups: Sequence[int]) -> ContactAtRest:
    """Return the contact of a fit that keeps the masses, with what their declared errors leave it: its poles are known.

    Both tube springs grow with the masses, as the system resonance asks for. The damping ratio is a pole's own.
    """
    own = _at_rest(kept, groups)
    values = kept.constants.at(groups[0]) | {"kc": own.stiffness.value, "cc": own.damping.value}
    m1, m2, k1, k2, kc, cc = (values[n] for n in (*BODY, *CONTACT))
    _, _, f2, zeta2 = TwoMass(m1, m2, k1, k2, kc, cc).modes()
    errors = {p.name: p.uncertainty for p in kept.arrangement.parameters}
    changes = []
    for more1, more2 in ((errors["m1"], 0.0), (0.0, errors["m2"])):
        heavier = 1 + (more1 + more2) / (m1 + m2)
        other = contact_from_pole(pole(f2, zeta2), m1 + more1, m2 + more2, heavier * k1, heavier * k2)
        changes.append((other[0] - kc, other[1] - cc))
    stiffer, lossier = np.hypot(*np.array(changes)).tolist()
    return replace(
        own,
        stiffness=replace(own.stiffness, standard_error=math.hypot(own.stiffness.standard_error, stiffer)),
        damping=replace(own.damping, standard_error=math.hypot(own.damping.standard_error, lossier)),
    )


def _at_rest(found: RingDownFit, groups: Sequence[int]) -> ContactAtRest:
    """Return the mean contact of groups of the same load."""
    rig_names, load_names = found.constants.names()
    slopes = np.zeros((3, len(found.covariance)))  # of k_c, c_c and zeta_c, by the constants of the rig and the groups
    each = np.empty((len(groups), 3))
    for place, group in enumerate(groups):
        first = len(rig_names) + group * len(load_names)
        where = [rig_names.index(n) for n in BODY] + [first + load_names.index(n) for n in CONTACT]
        values = found.constants.at(group)
        x = np.array([values[n] for n in (*BODY, *CONTACT)])
        each[place] = x[-2], x[-1], _damping_ratio(x)
        slopes[0, where[-2]] += 1 / len(groups)
        slopes[1, where[-1]] += 1 / len(groups)
        slopes[2, where] += np.array([_slope(x, i) for i in range(x.size)]) / len(groups)
    variance = np.einsum("qi,ij,qj->q", slopes, found.covariance, slopes)
    if len(groups) > 1:
        variance += each.var(axis=0, ddof=1) / len(groups)
    load = found.problem.experiment.loads_n[groups[0]]
    return ContactAtRest(
        load, *(Estimate(float(v), _error(s)) for v, s in zip(each.mean(axis=0), variance, strict=True))
    )


def _damping_ratio(x: Real) -> float:
    return TwoMass(*x.tolist()).modes()[3]


def _slope(x: Real, i: int) -> float:
    up, down = x.copy(), x.copy()
    step = STEP * (abs(x[i]) or 1.0)
    up[i] += step
    down[i] -= step
    return (_damping_ratio(up) - _damping_ratio(down)) / (2 * step)


def augmented(plain: RingDownFit, terms: Sequence[Term]) -> RingDownFit:
    """Fit Eq. 9 with given mechanisms to the impacts of a plain fit, their parameters free within their ranges."""
    second_impacts = [t.mechanism for t in terms if isinstance(t.mechanism, SecondImpact)]
    delays = (
        next((s.delays for s in screen(plain.problem, plain, second_impacts).scores if s.delays), ())
        if second_impacts
        else ()
    )
    laws = all(isinstance(t.mechanism, ForceLaw) for t in terms)
    if laws and plain.reduced_chi_squared > plain.problem.policy.strong:
        found = lengthened(plain.problem, terms, linear_at_first(plain.problem, plain))
    else:
        found = fit(plain.problem, terms, plain, Start(delays=delays))
    if found.only_laws and found.reduced_chi_squared > plain.problem.policy.strong:
        found = continued(plain.problem, found.terms, plain) or found
    return found


def _error(variance: float) -> float:
    return math.sqrt(max(variance, 0.0))
