"""What the program knows of a mechanism: its name, parameters, places and effect, for five kinds of physics.

`ForceLaw`           a further force in an element, from its deformation, rate and history
`AddedBody`          more bodies, springs or dampers; the rig stays linear
`ChannelDistortion`  what a sensor chain makes of the channels, or an exciter of an input
`Tones`              steady tones in every channel, with an amplitude and phase of their own in each record
`SecondImpact`       an impact that nothing measured shows, with a delay of its own in every record

A *place* is where in a rig a mechanism acts, as numbers in its arrangement (`sim_backend.mechanisms.places.Place`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim_backend.arrangement import Arrangement, Element, Role
from sim_backend.force_law import LAW
from sim_backend.mechanisms.places import Place, fitting_elements

Real = NDArray[np.float64]
Values = Mapping[str, float]

law = njit(LAW, cache=True)
"""Compiles a force law: see `sim_backend.force_law.LAW`."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A parameter of a mechanism.

    Attributes
    ----------
    low, high
        Range in which it is admissible; a fit does not leave it.
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

    preload: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0

    @classmethod
    def of(cls, element: Element, constants: Values, preload: float) -> AtRest:
        """Return it for a rig with these constants at a preload (N) as it was measured."""
        scale = constants[element.load_scale] if element.load_scale else 1.0
        return cls(
            scale * preload if element.preload else 0.0,
            constants[element.stiffness] if element.stiffness else 0.0,
            constants[element.damping] if element.damping else 0.0,
        )


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
    body_kg
        Mass of the body that the first sensor sees, kg; zero where it is not known.
    shown_hz
        Highest frequency that the channels show well.
    """

    deformation: float
    rate: float
    static: float
    force: float
    frequency_hz: tuple[float, float]
    duration_s: float = 1.0
    body_kg: float = 0.0
    shown_hz: float = math.inf

    @property
    def mass(self) -> float:
        """Mass that moves, kg: of the body, or else what the force would need to move it as it does."""
        return self.body_kg or self.force * self.deformation / self.rate**2


@dataclass(frozen=True, slots=True)
class Derived:
    """A quantity that follows from the parameters' values; ``positive`` where it is known to a factor."""

    name: str
    unit: str
    value: Callable[[Values], float]
    positive: bool = False
    meaning: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mechanism:
    """One piece of physics that the linear rig leaves out: what all kinds share.

    Attributes
    ----------
    id, component
        Names of the contract. Several mechanisms of one id are variants of one family: at most one fits a place.
    parameters
        Those that are fitted.
    strength
        The parameter that is zero where the mechanism is absent; None where there is no such thing: the mechanism is
        there or not.
    trials
        From the scale of the motion to values worth screening, the strength so small that its effect is
        proportional to it. Values that are no parameters stay fixed.
    statement
        A sentence about the fitted mechanism, from its values and the name of the element or channel.
    one_signed
        Whether only a positive strength makes sense.
    derived
        What is reported beside the parameters.
    hidden
        Why a free decay does not show it by itself, and what experiment would; it can be simulated and is not sought in
        free decays. Empty: it is sought.
    same_as
        Ids of mechanisms of the same equations, as far as the tester's channels show: it is told as indistinguishable
        from these, and is not sought beside them.
    limited
        What has an upper limit where no parameter is the strength: proportional to the size of the effect.
    """

    id: str
    component: str
    summary: str
    source: str
    parameters: tuple[Quantity, ...]
    strength: str | None
    trials: Callable[[Scale], Sequence[dict[str, float]]]
    statement: Callable[[Values, str], str]
    one_signed: bool = True
    derived: tuple[Derived, ...] = ()
    limited: Derived | None = None
    hidden: str = ""
    same_as: tuple[str, ...] = ()

    def places(self, rig: Arrangement) -> list[Place]:
        """Return where in a rig it can act."""
        return [()]

    def named(self, rig: Arrangement, place: Place) -> str:
        """Return the name of the element or channel in a place, as `statement` takes it."""
        return "rig"


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceLaw(Mechanism):
    """A further force in every element of its place.

    Attributes
    ----------
    law
        Compiled by `law`.
    constants
        The law's parameters after the first four, from the values and the element at rest.
    fits
        Roles of the elements that it can act in, likeliest first.
    preloaded
        Whether the element must carry the preload (True) or must not (False).
    last
        Whether the law must be the last one in its element (it limits what the others make).
    with_time
        Whether it makes the rig change with time, not with amplitude.
    jumps
        Whether its force jumps, so that slopes along a recording are taken over a distance and not at a point.
    rounding
        The fixed value that rounds the jump off: the smaller it is, the more abrupt. It is numerics, not physics.
    carried
        Name of the value, N, that is the force left of the motion before the first moment, zero where it is not given:
        each recording has its own. Empty where no one number says what was before.
    stiffness_exponent
        What ``d ln k_c / d ln P`` has to be where this is the contact's law, and its tolerance.
    """

    law: Any
    fits: tuple[Role, ...]
    constants: Callable[[Values, AtRest], Sequence[float]] = lambda values, rest: ()
    preloaded: bool | None = None
    last: bool = False
    with_time: bool = False
    jumps: bool = False
    rounding: str = ""
    carried: str = ""
    stiffness_exponent: tuple[float, float] | None = None

    def packed(self, values: Values, rest: AtRest, h: float) -> Real:
        """Return the compiled law's parameters for an element at rest and a step of h, s."""
        return np.array([rest.preload, rest.stiffness, rest.damping, h, *self.constants(values, rest)], np.float64)

    def places(self, rig: Arrangement) -> list[Place]:
        """Return one element for each distinct deformation; elements that are alike share a place."""
        return fitting_elements(rig, self.fits, self.preloaded)

    def named(self, rig: Arrangement, place: Place) -> str:
        """Return the name of the element, or of the group of equal elements."""
        return element_name(rig, place)


@dataclass(frozen=True, slots=True, kw_only=True)
class AddedBody(Mechanism):
    """More bodies, springs or dampers. Its parameters are constants of the extended rig by the same names.

    Attributes
    ----------
    extend
        Returns the rig with it, for values and a place. Elements, bodies and sensors keep their numbers.
    at
        Places in a rig: element(s), or a body.
    body
        The constants that are the added body's mass, stiffness and damping; None where no body is added.
    phase_locked
        Whether the added body is set going by the rig alone, so that its phase is that of the rig's modes.
    on_body
        Whether the place is the number of a body, not of an element.
    on_sensor
        Whether the place ends with the number of a channel, by which it is called.
    shaken
        Whether an acceleration of the base shakes the added body as it does the rig's own.
    """

    extend: Callable[[Arrangement, Values, Place], Arrangement]
    at: Callable[[Arrangement], Sequence[Place]]
    body: tuple[str, str, str] | None = None
    phase_locked: bool = False
    on_body: bool = False
    on_sensor: bool = False
    shaken: bool = True

    def places(self, rig: Arrangement) -> list[Place]:
        """Return what ``at`` says."""
        return list(self.at(rig))

    def named(self, rig: Arrangement, place: Place) -> str:
        """Return the name of the body, channel or element."""
        if self.on_sensor:
            return _channel_name(rig.sensors[place[-1]].name)
        return rig.bodies[place[0]] if self.on_body else element_name(rig, place)


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelDistortion(Mechanism):
    """What a sensor chain makes of channels, or an exciter of an input.

    Attributes
    ----------
    distort
        From the rows (k, n) of the channels in its place, the values and the sampling rate in Hz to (k, n). Among the
        values is ``peak``, the largest magnitude in the recordings; of recordings of a described rig also ``lowest``
        and ``highest``, the extremes of their values about zero, and ``thinned``, the recorder's samples for each one.
    at
        Places in a rig: channels, or an input.
    of
        What is distorted. The load cell is not a part of a recorded ring-down: calibrations show what it does.
    forgets
        Rate (1/s) at which what was before the first sample is forgotten; None where nothing is remembered.
    """

    distort: Callable[[Real, Values, float], Real]
    at: Callable[[Arrangement], Sequence[Place]]
    of: Literal["sensor", "input", "load cell"] = "sensor"
    forgets: Callable[[Values], float] | None = None

    def places(self, rig: Arrangement) -> list[Place]:
        """Return what ``at`` says."""
        return list(self.at(rig))

    def named(self, rig: Arrangement, place: Place) -> str:
        """Return the name of the channels or the input."""
        if self.of != "sensor":
            return self.of if self.of == "load cell" else f"input {place[0] + 1}"
        return " and ".join(_channel_name(rig.sensors[i].name) for i in place)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tones(Mechanism):
    """Steady tones in every channel; the first parameter is the amplitude of the loudest.

    Attributes
    ----------
    lines
        Frequencies, Hz.
    """

    lines: Callable[[Values], Sequence[float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class SecondImpact(Mechanism):
    """An impact that nothing measured shows; the first parameter is its size.

    Attributes
    ----------
    driven
        Whether it strikes a rig whose inputs are measured, with an impulse in N s; else one in a free decay, with a
        share of the first impact.
    """

    driven: bool = False

    def places(self, rig: Arrangement) -> list[Place]:
        """Return the whole rig, if its inputs are measured, or are not, as it asks."""
        return [()] if bool(rig.inputs) == self.driven else []


def element_name(rig: Arrangement, place: Place) -> str:
    """Return the name of an element, or of the group of equal elements."""
    first = rig.elements[place[0]]
    return first.alike if len(place) > 1 and first.alike is not None else first.name


def _channel_name(name: str) -> str:
    return name if name.startswith(("sensor ", "channel ")) else f"channel {name}"


def geometric(low: float, high: float, count: int) -> list[float]:
    """Return ``count`` values evenly spaced in their logarithm."""
    return [float(v) for v in np.geomspace(low, high, count)]
