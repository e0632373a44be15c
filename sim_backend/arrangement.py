"""What a rig is made of: bodies, elements between them, sensors on them, and what is known of its constants.

Eq. 9 is the built-in arrangement (`tester`): two bodies, two tube springs, one contact, two accelerometers on the lower
body. Any other rig is a few lines more; the mechanisms act on the elements of whichever it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from sim_backend.arrays import Real

Row = tuple[tuple[str, float | str], ...]
"""Bodies with their coefficients, a number or the name of a constant: a deformation, or what a sensor sees."""
Role = Literal["contact", "spring", "guide", "joint", "body", "damper", "pendulum"]
Quantity = Literal["acceleration", "velocity", "displacement"]
DERIVATIVES: Final[Mapping[Quantity, int]] = {"displacement": 0, "velocity": 1, "acceleration": 2}
LOAD: Final = "load"  # scope of a constant that has a value of its own at each load


@dataclass(frozen=True, slots=True)
class Parameter:
    """A constant of the rig.

    Attributes
    ----------
    value
        As declared; a starting value where it is free.
    uncertainty
        Standard error of the declared value; infinite where nothing is known.
    scope
        ``"rig"``: one value; ``"load"``: one at each load.
    positive
        Whether it is fitted as its logarithm.
    """

    name: str
    unit: str
    value: float
    uncertainty: float = math.inf
    scope: Literal["rig", "load"] = "rig"
    positive: bool = False


@dataclass(frozen=True, slots=True)
class Element:
    """Spring and damper that work on a deformation, or a place where only extra forces act.

    A positive force pushes against a positive deformation. For a contact the deformation is the approach.

    Attributes
    ----------
    alike
        Name of the group of equal elements that it belongs to, if any: a mechanism acts alike in all of them.
    preload
        Whether it is the contact that carries the load.
    load_scale
        Name of the constant by which the load has to be multiplied, if it is known to within an uncertainty only.
    """

    name: str
    role: Role
    component: str
    row: Row
    stiffness: str | None = None
    damping: str | None = None
    alike: str | None = None
    preload: bool = False
    load_scale: str | None = None


@dataclass(frozen=True, slots=True)
class Sensor:
    """What a channel records.

    Attributes
    ----------
    strained
        Names of an element and of a constant: the channel also shows the element's force times the constant.
    """

    name: str
    row: Row
    quantity: Quantity = "acceleration"
    strained: tuple[str, str] | None = None


@dataclass(frozen=True, slots=True)
class Arrangement:
    """Bodies (each with the name of its mass), elements, sensors and constants of a rig.

    ``tapped`` is the body that taps act on, ``inputs`` how many inputs are measured.
    """

    bodies: tuple[str, ...]
    masses: tuple[str, ...]
    elements: tuple[Element, ...]
    sensors: tuple[Sensor, ...]
    parameters: tuple[Parameter, ...]
    tapped: str
    inputs: int = 0

    def element(self, name: str) -> Element:
        """Return the element of this name."""
        return next(e for e in self.elements if e.name == name)

    @property
    def force_scales(self) -> tuple[str, ...]:
        """Names of the constants that say how large forces are: the masses, and the scale of the load."""
        return *self.masses, *(e.load_scale for e in self.elements if e.load_scale is not None)

    def vector(self, row: Row, values: Mapping[str, float] | Mapping[str, Real]) -> Real:
        """Return (..., n) the coefficients of a row in the order of the bodies, for values of any one shape."""
        shape = np.asarray(next(iter(values.values()))).shape
        out = np.zeros((*shape, len(self.bodies)))
        for body, coefficient in row:
            out[..., self.bodies.index(body)] = values[coefficient] if isinstance(coefficient, str) else coefficient
        return out

    def strain(self, sensor: Sensor, values: Mapping[str, float] | Mapping[str, Real]) -> tuple[Real, Real]:
        """Return (..., n) what a channel shows of displacements and of velocities by the strain of its base."""
        if sensor.strained is None:
            nothing = np.zeros_like(self.vector((), values))
            return nothing, nothing
        name, share = sensor.strained
        element = self.element(name)
        row = np.asarray(values[share])[..., None] * self.vector(element.row, values)
        constants = [np.zeros(()) if c is None else np.asarray(values[c]) for c in (element.stiffness, element.damping)]
        return constants[0][..., None] * row, constants[1][..., None] * row

    def matrices(self, values: Mapping[str, float] | Mapping[str, Real]) -> tuple[Real, Real, Real]:
        """Return masses (..., n), damping and stiffness (..., n, n) for these constants, values of any one shape."""
        mass = np.stack([np.asarray(values[m], np.float64) for m in self.masses], axis=-1)
        damping, stiffness = np.zeros((*mass.shape, mass.shape[-1])), np.zeros((*mass.shape, mass.shape[-1]))
        for element in self.elements:
            row = self.vector(element.row, values)
            outer = row[..., :, None] * row[..., None, :]
            if element.stiffness is not None:
                stiffness += np.asarray(values[element.stiffness])[..., None, None] * outer
            if element.damping is not None:
                damping += np.asarray(values[element.damping])[..., None, None] * outer
        return mass, damping, stiffness

    def undamped_hz(self, values: Mapping[str, float]) -> Real:
        """Return (n,) the frequencies of the undamped modes, in Hz and no order; 0 of a motion that nothing holds."""
        mass, _, stiffness = self.matrices(values)
        return np.asarray(np.sqrt(np.abs(np.linalg.eigvals(stiffness / mass[:, None]))) / (2 * np.pi), np.float64)

    def declared(self) -> dict[str, float]:
        """All constants as declared."""
        return {p.name: p.value for p in self.parameters}

    def extended(
        self,
        bodies: Mapping[str, str] | None = None,
        elements: tuple[Element, ...] = (),
        parameters: tuple[Parameter, ...] = (),
        changed: Mapping[str, Element] | None = None,
        sensors: tuple[Sensor, ...] | None = None,
    ) -> Arrangement:
        """Return a rig with more bodies (name: mass), elements and constants, and with some elements changed."""
        changed = changed or {}
        bodies = bodies or {}
        return replace(
            self,
            bodies=(*self.bodies, *bodies),
            masses=(*self.masses, *bodies.values()),
            elements=(*(changed.get(e.name, e) for e in self.elements), *elements),
            sensors=self.sensors if sensors is None else sensors,
            parameters=(*self.parameters, *parameters),
        )


UPPER, LOWER, SPRINGS = "upper mass", "lower mass", "tube springs"


def tester(
    m1: float,
    m2: float,
    k1: float,
    k2: float,
    kc: float,
    cc: float,
    *,
    mass_uncertainty: float,
    spring_uncertainty: float,
) -> Arrangement:
    """Return Eq. 9: masses (kg), tube springs and contact (N/m, N s/m), relative standard errors of the declared."""
    return Arrangement(
        bodies=(UPPER, LOWER),
        masses=("m1", "m2"),
        elements=(
            Element("upper tube spring", "spring", SPRINGS, ((UPPER, 1.0),), "k1", alike=SPRINGS),
            Element("lower tube spring", "spring", SPRINGS, ((LOWER, 1.0),), "k2", alike=SPRINGS),
            Element("contact", "contact", "contact", ((UPPER, 1.0), (LOWER, -1.0)), "kc", "cc", preload=True),
            Element("guide", "guide", "upper mass", ((UPPER, 1.0),)),
        ),
        sensors=(Sensor("A", ((LOWER, 1.0),)), Sensor("B", ((LOWER, 1.0),))),
        parameters=(
            Parameter("m1", "kg", m1, m1 * mass_uncertainty),
            Parameter("m2", "kg", m2, m2 * mass_uncertainty),
            Parameter("k1", "N/m", k1, k1 * spring_uncertainty),
            Parameter("k2", "N/m", k2, k2 * spring_uncertainty),
            Parameter("kc", "N/m", kc, scope=LOAD),
            Parameter("cc", "N s/m", cc, scope=LOAD),
        ),
        tapped=UPPER,
    )
