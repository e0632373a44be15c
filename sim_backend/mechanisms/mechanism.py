"""What the program knows of a mechanism: its name, place, parameters, force law and what to say of it."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim_backend.arrangement import Arrangement, Role
from sim_backend.modal_march import LAW

Real = NDArray[np.float64]
Values = Mapping[str, float]

law = njit(LAW, cache=True)
"""Compiles a force law: see `sim_backend.modal_march.LAW`."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A parameter of a mechanism.

    Attributes
    ----------
    low, high
        Range in which it is believable; a fit does not leave it.
    log
        Whether it is fitted as its logarithm (a positive quantity known to an order of magnitude).
    """

    name: str
    unit: str
    low: float
    high: float
    meaning: str
    log: bool = False


@dataclass(frozen=True, slots=True)
class AtRest:
    """What a law may know of the element it acts in, at one load: preload (N), stiffness (N/m), damping (N s/m)."""

    preload: float
    stiffness: float
    damping: float


@dataclass(frozen=True, slots=True)
class Scale:
    """How large an element's motion is in the recordings, and what it is measured by.

    Attributes
    ----------
    deformation, rate
        Typical amplitudes after a tap, m and m/s.
    static
        Preload over stiffness, m; zero without a preload.
    force
        Typical amplitude of the element's force, N.
    frequency_hz
        Lowest and highest mode of the rig.
    duration_s
        Length of the recording.
    """

    deformation: float
    rate: float
    static: float
    force: float
    frequency_hz: tuple[float, float]
    duration_s: float = 1.0


@dataclass(frozen=True, slots=True)
class Derived:
    """A quantity that follows from the parameters' values; ``positive`` where it is known to a factor."""

    name: str
    unit: str
    value: Callable[[Values], float]
    positive: bool = False


@dataclass(frozen=True, slots=True)
class Mechanism:
    """One piece of physics that the linear rig leaves out. It does one of five things; one that does none cannot be
    seen in ring-downs.

    ``law``: an extra force in every element of the role ``acts``;
    ``extend``: more bodies, springs and dampers (the rig stays linear);
    ``distort``: what a sensor chain makes of the channels;
    ``lines``: steady tones, Hz, each with an amplitude and phase of its own in every record;
    ``blow``: a further blow, with a delay of its own in every record.

    Attributes
    ----------
    id, component
        Names of the contract.
    parameters
        Those that are fitted.
    strength
        The parameter that is zero where the mechanism is absent; None where there is no such thing: the mechanism is
        there or not.
    trials
        From the scale of the motion to values worth screening, the strength so small that its effect is
        proportional to it. Values that are no parameters stay fixed.
    shape
        A law without memory as a function of whole arrays (deformation, rate, time, values): for score tests only.
    constants
        The law's parameters after the first four, from the values and the element at rest.
    body
        Of one that adds a body on a spring and a damper: the parameters that are its mass, stiffness and damping.
    one_signed
        Whether only a positive strength makes sense.
    last
        Whether the law must be the last one in its element (it limits what the others make).
    derived
        What is reported beside the parameters.
    statement
        A sentence about the fitted mechanism, from its values.
    stiffness_exponent
        What ``d ln k_c / d ln P`` has to be where this is the contact's law, and its tolerance.
    fits
        Roles of the elements it may be at work in on a rig other than the tester, likeliest first. There, ``{element}``
        in the statement stands for the element's name.
    drives
        Whether ``distort`` is of the inputs, not of the channels.
    with_time
        Whether it makes the rig change with time, not with amplitude.
    """

    id: str
    component: str
    summary: str
    source: str
    parameters: tuple[Quantity, ...]
    strength: str | None
    trials: Callable[[Scale], Sequence[dict[str, float]]]
    statement: Callable[[Values], str]
    acts: Role = "contact"
    law: Any = None
    constants: Callable[[Values, AtRest], Sequence[float]] = lambda values, rest: ()
    shape: Callable[[Real, Real, Real, Values], Real] | None = None
    extend: Callable[[Arrangement, Values], Arrangement] | None = None
    distort: Callable[[Real, Values, float], Real] | None = None
    lines: Callable[[Values], Sequence[float]] | None = None
    body: tuple[str, str, str] | None = None
    blow: bool = False
    tied: bool = False
    one_signed: bool = True
    last: bool = False
    stiffness_exponent: tuple[float, float] | None = None
    derived: tuple[Derived, ...] = ()
    fits: tuple[Role, ...] = ()
    drives: bool = False
    with_time: bool = False


@cache
def mechanisms() -> dict[str, Mechanism]:
    """Return all mechanisms by id, in the order of their files' names."""
    import sim_backend.mechanisms as package

    return _within(package)


@cache
def element_mechanisms() -> dict[str, Mechanism]:
    """Return by id what may be at work in an element or channel of any rig, with parameters in units of that rig."""
    import sim_backend.mechanisms.elements as package

    return _within(package)


def _within(package: ModuleType) -> dict[str, Mechanism]:
    found = {}
    for module in sorted(m.name for m in pkgutil.iter_modules(package.__path__)):
        mechanism = getattr(importlib.import_module(f"{package.__name__}.{module}"), "MECHANISM", None)
        if mechanism is not None:
            found[mechanism.id] = mechanism
    return found


def geometric(low: float, high: float, count: int) -> list[float]:
    """Return ``count`` values evenly spaced in their logarithm."""
    return [float(v) for v in np.geomspace(low, high, count)]
