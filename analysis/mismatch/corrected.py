"""Contact stiffness and damping of a fit at each load: of the linear part, so at zero amplitude."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.fit import Fit, fit
from analysis.mismatch.lengthening import STRONG, lengthened, misfit
from analysis.mismatch.problem import Term
from analysis.mismatch.screen import screen
from calibration.estimate import Estimate
from sim_backend.two_mass import TwoMass

Real = NDArray[np.float64]


STEP = 1e-6  # relative, of the differences of the damping ratio
BODY = ("m1", "m2", "k1", "k2")
CONTACT = ("kc", "cc")


@dataclass(frozen=True, slots=True)
class ContactAtRest:
    """Contact at one load in the limit of no motion.

    k_c (N/m), c_c (N s/m), and zeta_c: the damping ratio that they give the contact mode of Eq. 9.
    """

    load_n: float
    stiffness: Estimate
    damping: Estimate
    damping_ratio: Estimate


def contact_at_rest(found: Fit) -> tuple[ContactAtRest, ...]:
    """Return the contact at every load of a fit, in the order of its loads.

    Standard errors are those of the joint fit: what belongs to each impact, the declared constants and the
    mechanisms' parameters are left free in them. The errors of the loads themselves are not.
    """
    rig_names, load_names = found.constants.names()
    answers = []
    for group, load in enumerate(found.problem.recordings.loads_n):
        first = len(rig_names) + group * len(load_names)
        where = [rig_names.index(n) for n in BODY] + [first + load_names.index(n) for n in CONTACT]
        covariance = found.covariance[np.ix_(where, where)]
        values = found.constants.at(group)
        x = np.array([values[n] for n in (*BODY, *CONTACT)])
        slopes = np.array([_slope(x, i) for i in range(x.size)])
        answers.append(
            ContactAtRest(
                load,
                Estimate(float(x[-2]), _error(covariance[-2, -2])),
                Estimate(float(x[-1]), _error(covariance[-1, -1])),
                Estimate(_damping_ratio(x), _error(float(slopes @ covariance @ slopes))),
            )
        )
    return tuple(answers)


def _damping_ratio(x: Real) -> float:
    return TwoMass(*x.tolist()).modes()[3]


def _slope(x: Real, i: int) -> float:
    up, down = x.copy(), x.copy()
    step = STEP * (abs(x[i]) or 1.0)
    up[i] += step
    down[i] -= step
    return (_damping_ratio(up) - _damping_ratio(down)) / (2 * step)


def augmented(plain: Fit, terms: Sequence[Term]) -> Fit:
    """Fit Eq. 9 with given mechanisms to the impacts of a plain fit, their parameters free within their ranges."""
    blows = [t.mechanism for t in terms if t.mechanism.blow]
    delays = next((s.delays for s in screen(plain, blows).scores if s.delays), ()) if blows else ()
    found = fit(plain.problem, terms, begin=plain, delays=delays)
    if found.only_laws and misfit(found) > STRONG:
        found = lengthened(plain.problem, found.terms, plain) or found
    return found


def _error(variance: float) -> float:
    return math.sqrt(max(variance, 0.0))
