"""Mechanisms in the tester, as the fits take them."""

from __future__ import annotations

from collections.abc import Mapping

from analysis.mismatch.problem import Term
from sim_backend.adopted import ANY_RIG
from sim_backend.mechanisms.catalogue import catalogue
from sim_backend.mechanisms.kinds import Mechanism


def listed(name: str) -> Mechanism:
    """Return the tester's variant of a mechanism."""
    return catalogue()[name][0]


def at_work(name: str, values: Mapping[str, float] | None = None) -> Term:
    """Return a mechanism in its first place in the tester."""
    one = listed(name)
    return Term(one, values or {}, one.places(ANY_RIG)[0])
