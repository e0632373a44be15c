"""What an effect is: where it acts, how strong it is, and how it alters a rig and its recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from mesotap.proof.rigs.description import GROUND, Element, Rig
from mesotap.proof.rigs.draw import Wants
from mesotap.proof.rigs.plant import Law, Plant
from mesotap.proof.rigs.trial import Altered, Trial, pieces_of

Array = NDArray[np.float64]
Rng = np.random.Generator


@dataclass(frozen=True, slots=True)
class Hidden:
    """An effect at a place, with a shape that was drawn; its strength is still open.

    Attributes
    ----------
    places
        Names under which an answer may say where it is: of elements with the same deformation, of a sensor or a body.
    component
        Class of the place.
    add
        Alters a rig by the effect at a strength.
    parameters
        True parameters at a strength, as `mesotap mechanisms` names them, where both mean the same.
    preload
        Element and its preload (N) at a strength, where it has to carry one.
    start, most
        A strength to begin with, and the largest that makes sense.
    jumps
        Whether its law has a jump; two of them are not integrated together.
    """

    id: str
    places: tuple[str, ...]
    component: str
    add: Callable[[Altered, float], Altered]
    parameters: Callable[[float], Mapping[str, float]] = field(default=lambda strength: {})
    preload: tuple[int, Callable[[float], float]] | None = None
    start: float = 0.01
    most: float = 1.0
    jumps: bool = False


@dataclass(frozen=True, slots=True)
class Effect:
    """An effect that can be concealed: what it needs, and how it is drawn into a trial; None where it does not fit."""

    id: str
    wants: Wants
    draw: Callable[[Trial, Rng], Hidden | None]


@dataclass(frozen=True, slots=True)
class Scale:
    """How far (m) and how fast (m/s) an element of the linear rig moves at most, and with what force (N)."""

    d: float
    v: float
    f: float


def scale_of(trial: Trial, i: int) -> Scale:
    """Return the scale of element ``i``."""
    rig = trial.rig
    shape, plant = rig.shape(rig.elements[i]), rig.plant(rig.true_values())
    pieces = pieces_of(plant, rig.rate)
    d = v = 0.0
    for record in trial.records:
        moved, _ = plant.motion(record.start, record.size * record.drive.steps(pieces), 1 / (rig.rate * pieces))
        d, v = max(d, float(np.max(np.abs(moved[0] @ shape)))), max(v, float(np.max(np.abs(moved[1] @ shape))))
    stiffness = rig.elements[i].stiffness
    stiffest = max(e.stiffness.true for e in rig.elements if e.stiffness)
    return Scale(d, v, d * (stiffness.true if stiffness else stiffest))


def span(trial: Trial) -> float:
    """Length of the first recording (s)."""
    return trial.records[0].count / trial.rig.rate


def together(rig: Rig, i: int) -> tuple[str, ...]:
    """Return the names of all elements between the same two bodies as element ``i``."""
    ends = {rig.elements[i].a, rig.elements[i].b}
    return tuple(e.name for e in rig.elements if {e.a, e.b} == ends)


def chosen(
    rig: Rig, sections: tuple[str, ...], rng: Rng, fits: Callable[[Element], bool] = lambda e: True
) -> int | None:
    """Return any of the elements in these sections that fit; None of none."""
    found = [i for i, e in enumerate(rig.elements) if e.section in sections and fits(e)]
    return int(rng.choice(found)) if found else None


def with_law(altered: Altered, law: Law) -> Altered:
    """Return it with a further law, whose shape may leave out later coordinates."""
    shape = np.zeros(altered.plant.masses.size)
    shape[: law.shape.size] = law.shape
    return replace(altered, plant=replace(altered.plant, laws=(*altered.plant.laws, replace(law, shape=shape))))


def with_recorder(altered: Altered, distort: Callable[[Array, int, int], Array]) -> Altered:
    """Return it with something that the recorder makes of the channels, known ``pieces`` times a sample, first."""
    before = altered.recorder
    return replace(altered, recorder=lambda fine, pieces, record: before(distort(fine, pieces, record), pieces, record))


def wider(shape: Array, plant: Plant) -> Array:
    """Return a shape with zeros for all coordinates of the plant and one more."""
    out = np.zeros(plant.masses.size + 1)
    out[: shape.size] = shape
    return out


def unit(bodies: int, i: int) -> Array:
    """Return the shape of an element from a body to the ground."""
    return np.eye(bodies)[i]


def grounded(e: Element) -> bool:
    """Whether an element stands on the ground."""
    return e.b == GROUND
