"""Learned laws without a formula: a curve of the deflection or of the rate, or a damping that is one of the deflection.

What is learned are the curve's bends at points of the motion, which a law's force is in proportion to.
Of an element whose own stiffness (or damping) nobody knows, a curve has no slope (or no value) at rest: that is the
element's. Where it is declared, it is learned with the bends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from sim_backend.acting import Acting
from sim_backend.arrangement import Role
from sim_backend.learned import laws
from sim_backend.learned.forms import AT_DEFLECTION, AT_RATE, FORM, LEARNED, Form, Kind, LearnedForce
from sim_backend.mechanisms.kinds import Quantity, Real, Values

LOWEST, HIGHEST = "from_reference", "to_reference"
"""Ends of the motion, over the reference."""
CROWDED: Final = "crowded_at_rest"
"""Exponent of the distances from rest at which a curve may bend; of one they are equal."""
BEND: Final = "bend_"
"""How the names of a curve's bends begin."""
LARGEST: Final = "largest_force_n"
"""Force that a curve may well have, N: what it is learned beside is about as large."""
RANGE: Final = (-1e25, 1e25)  # of the parameters, N
STRAIGHT: Final = 10.0  # times that, which its slope or value at rest may well be
OF_DEFLECTION, OF_RATE, DAMPING, SLOPED = "curve_of_deflection", "curve_of_rate", "damping_curve", "_and_slope"
ROLES: Final[dict[Kind, tuple[Role, ...]]] = {
    "static": ("contact", "joint", "spring", "pendulum", "damper", "guide"),
    "rate": ("contact", "joint", "guide", "damper", "spring", "pendulum"),
}
POINTS: Final = (7, 13, 25)  # at which a curve may bend
CROWDS: Final = (1.0, 2.0)  # how they crowd about rest


@dataclass(frozen=True, slots=True)
class _Shape:
    """Whether it is a curve of the rate, and whether the force is that times the rate.

    ``own`` is the parameter that is its slope at rest, or its value where that is a damping; empty: it has none.
    """

    of_rate: bool
    times_rate: bool
    own: str = ""

    def numbers(self, values: Values, bends: Sequence[str]) -> list[float]:
        """Return what `sim_backend.learned.laws.curve` takes after the element's own."""
        bent = np.array([values[name] for name in bends])
        at = _points(values, bent.size)
        width = np.diff(at)
        if self.times_rate:  # the bends are slopes
            slope, second, third = bent, np.diff(bent) / width, np.zeros(width.size)
        else:
            slope = np.concatenate([[0.0], np.cumsum(width * (bent[1:] + bent[:-1]) / 2)])
            second, third = bent[:-1], np.diff(bent) / width
        middle = bent.size // 2  # at rest
        own = values[self.own] if self.own else 0.0
        if not self.times_rate:
            slope = slope - slope[middle] + own
        grown = width * (slope[:-1] + width * (second / 2 + width * third / 6))
        value = np.concatenate([[0.0], np.cumsum(grown)])
        value = value - value[middle] + (own if self.times_rate else 0.0)
        pieces = np.stack([value[:-1], slope[:-1], second, third], axis=1).ravel()
        shape = float(self.of_rate), float(self.times_rate)
        references = values[AT_DEFLECTION], values[AT_RATE]
        ends = float(value[-1]), float(slope[-1])
        return [*references, *shape, float(width.size), *at.tolist(), *pieces.tolist(), *ends]


def _points(values: Values, count: int) -> Real:
    """Return where a curve may bend, over the reference: the middle one is at rest, about which they may crowd."""
    even = np.linspace(-1.0, 1.0, count)
    at = np.abs(even) ** values[CROWDED]
    return np.asarray(np.where(even < 0, at * values[LOWEST], at * values[HIGHEST]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve(LearnedForce):
    """A curve as a force law; the force is in proportion to all its parameters together."""

    shape: _Shape

    @property
    def weights(self) -> tuple[str, ...]:
        """Its parameters."""
        return tuple(q.name for q in self.parameters)

    def spread(self, values: Values) -> dict[str, float]:
        """Return how large each of the parameters may well be: a force may turn round from one point to the next."""
        bends = [name for name in values if name.startswith(BEND)]
        apart = np.gradient(_points(values, len(bends)))
        turns = values[LARGEST] * apart ** (-1.0 if self.shape.times_rate else -2.0)
        own = {self.shape.own: STRAIGHT * values[LARGEST]} if self.shape.own else {}
        return own | dict(zip(bends, turns.tolist(), strict=True))


def is_curve(acting: Acting) -> bool:
    """Whether a law is a curve."""
    return isinstance(acting.mechanism, Curve)


def _curve(key: str, name: str, kind: Kind, shape: _Shape, points: int) -> Form:
    bends = tuple(f"{BEND}{i + 1}" for i in range(points))
    unit = "slope" if shape.times_rate else "second derivative"
    own = Quantity(shape.own, "N", *RANGE, "of the curve at rest, over the reference")
    form = Form(
        number=0, key=f"{key}{SLOPED if shape.own else ''}_{points}", name=name, kind=kind, symmetry="none",
        conservative=kind == "static",
        text=lambda values: "as its figure and table show", formula=False,
    )  # fmt: skip

    def made(preloaded: bool) -> Curve:
        return Curve(
            id=f"learned_{kind}", component="", summary=f"a law learned from recordings: {name}", source=LEARNED,
            parameters=(
                *((own,) if shape.own else ()),
                *(Quantity(bend, "N", *RANGE, f"{unit} of the curve there, over the reference") for bend in bends),
            ),
            strength=None, trials=lambda scale: (), statement=form.statement, law=laws.curve,
            constants=lambda values, rest: shape.numbers(values, bends), one_signed=False,
            fits=ROLES[kind], preloaded=preloaded, shape=shape,
        )  # fmt: skip

    return replace(form, mechanism=made(False), loaded=made(True))


def curve_forms(first: int) -> tuple[Form, ...]:
    """Return all curves; ``first``: the number of the first of them among the families."""
    kinds: tuple[tuple[str, str, Kind, bool, bool], ...] = (
        (OF_DEFLECTION, "a curve of the deflection", "static", False, False),
        (OF_RATE, "a curve of the rate", "rate", True, False),
        (DAMPING, "a damping that is a curve of the deflection", "rate", False, True),
    )
    found = [
        _curve(key, name, kind, _Shape(of_rate, times_rate, own), points)
        for own in ("", "at_rest")
        for key, name, kind, of_rate, times_rate in kinds
        for points in POINTS
    ]
    return tuple(replace(form, number=first + i) for i, form in enumerate(found))


def begin_values(
    form: Form, deflection: tuple[float, float], rate: tuple[float, float], force: float, crowded: float = 1.0
) -> dict[str, float]:
    """Return the values of a curve that is none yet.

    Parameters
    ----------
    deflection, rate
        Lowest and highest (m, m/s) that a motion shows.
    force
        Of the element that it is sought in, N.
    crowded
        See `CROWDED`.
    """
    reach, speed = (max(map(abs, ends)) or 1e-300 for ends in (deflection, rate))
    low, high = (x / speed for x in rate) if form.key.startswith(OF_RATE) else (x / reach for x in deflection)
    ends = {LOWEST: min(low, -0.01), HIGHEST: max(high, 0.01), LARGEST: force, CROWDED: crowded}
    none = {q.name: 0.0 for m in form.mechanisms[:1] for q in m.parameters}
    return {FORM: float(form.number), AT_DEFLECTION: reach, AT_RATE: speed, **ends, **none}
