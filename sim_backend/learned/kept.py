"""A learned law as a mechanism of one's own: screened, named, simulated like those of the catalogue.

A file that `mesotap learn` writes calls `kept_law`; nothing else is needed of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from sim_backend.arrangement import Role
from sim_backend.learned.families import form_named
from sim_backend.learned.forms import AT_DEFLECTION, AT_RATE, FORCE, IN_DEFLECTION, IN_RATE, SMALL
from sim_backend.mechanisms.kinds import ForceLaw, Mechanism, Quantity, Scale

Range = tuple[float, float]


def kept_law(
    name: str,
    family: str,
    *,
    acts_in: Role | None,
    preloaded: bool,
    component: str,
    values: Mapping[str, float],
    free: Mapping[str, Range],
    learned_from: Mapping[str, str],
) -> Mechanism:
    """Return the mechanism of a learned law.

    Parameters
    ----------
    name
        Its id among the mechanisms.
    family
        Key of the family in `sim_backend.learned.families`.
    acts_in, preloaded
        Role of the element that it was learned in, and whether that carries the load; None for a channel or a body.
    component
        Of the contract.
    values
        All numbers of the law, in SI units.
    free
        Those that a fit may change, with their ranges; the others stay.
    learned_from
        SHA-256 of each file it was learned from, by name.

    Raises
    ------
    KeyError
        There is no such family, or a number is missing.

    Examples
    --------
    >>> law = kept_law(
    ...     "my_law", "odd_power", acts_in="spring", preloaded=False, component="tube springs",
    ...     values={"force_n": 1e-3, "deflection_exponent": 3.0, "rate_exponent": 0.0,
    ...             "reference_deflection_m": 1e-6, "reference_rate_m_per_s": 1e-3, "reference_load_n": 1.0},
    ...     free={"force_n": (0.0, 1.0)}, learned_from={"session.h5": "0" * 64})
    >>> law.id, [q.name for q in law.parameters]
    ('my_law', ['force_n'])
    """  # fmt: skip
    form = form_named(family)
    base = form.loaded if preloaded else form.mechanism
    if base is None:
        raise KeyError(f"the family {family!r} has no law under load")
    quantities = tuple(_within(q, free[q.name]) for q in base.parameters if q.name in free)
    fixed = {k: float(v) for k, v in values.items()}  # without `FORM`: it is a mechanism by its own name
    strength = base.strength
    if strength is not None and strength not in free:
        raise KeyError(f"{strength!r} is not among the numbers that are free")

    def trials(scale: Scale) -> list[dict[str, float]]:
        if strength is None:
            return [fixed]
        small = SMALL * scale.force / _grown(fixed, scale) if strength == FORCE else min(SMALL, 0.1 * fixed[strength])
        return [{**fixed, strength: small if fixed[strength] >= 0 else -abs(small)}]

    changes: dict[str, Any] = {
        "id": name,
        "component": component,
        "summary": f"learned: {form.name}",
        "source": "learned from " + ", ".join(learned_from),
        "parameters": quantities,
        "trials": trials,
        "statement": lambda own, where: (
            f"In the {where} acts the learned law {name}: {form.text(own) if form.formula else form.name}."
        ),
        "one_signed": strength is None or free[strength][0] >= 0,
    }
    if isinstance(base, ForceLaw) and acts_in is not None:
        changes["fits"] = (acts_in,)
    return replace(base, **changes)


def _within(q: Quantity, reach: Range) -> Quantity:
    """Return a parameter with the range that a kept law lets it have."""
    return replace(q, low=max(q.low, min(reach)), high=min(q.high, max(reach)))


def _grown(values: Mapping[str, float], scale: Scale) -> float:
    """Return by what factor a power law is larger at the scale's motion than at its references."""
    n, m = values.get(IN_DEFLECTION, 0.0), values.get(IN_RATE, 0.0)
    return float((scale.deformation / values[AT_DEFLECTION]) ** n * (scale.rate / values[AT_RATE]) ** m)
