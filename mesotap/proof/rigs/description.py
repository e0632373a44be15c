"""A described rig: its true constants, what is declared of them, and the YAML that says so (docs/rigs.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesotap.proof.rigs.plant import Branch, Plant

Array = NDArray[np.float64]
Key = tuple[str, int]
"""What a constant is: ``mass``, ``stiffness``, ``damping``, ``gain``, ``offset``, ``input gain``, ``input offset``."""
GROUND = -1
QUANTITIES = ("displacement", "velocity", "acceleration")
UNITS = ("m", "m/s", "m/s2")


@dataclass(frozen=True, slots=True)
class Constant:
    """A true value, and what is declared: nothing (None), or a value with its standard error, 0 of a known one."""

    true: float
    declared: float | None = None
    uncertainty: float = 0.0

    @property
    def free(self) -> bool:
        """Whether a fit may change it."""
        return self.declared is None or self.uncertainty > 0

    @property
    def told(self) -> Any:
        """Return what the YAML says."""
        if self.declared is None:
            return "unknown"
        if self.uncertainty > 0:
            return {"value": float(self.declared), "uncertainty": float(self.uncertainty)}
        return float(self.declared)


def known(value: float) -> Constant:
    """Return a constant that is declared as it is."""
    return Constant(value, value)


@dataclass(frozen=True, slots=True)
class Element:
    """What connects body ``a`` with body ``b`` or `GROUND`; ``section`` of the YAML, without its plural s."""

    name: str
    section: str
    a: int
    b: int
    stiffness: Constant | None
    damping: Constant | None
    preload: float | None = None


@dataclass(frozen=True, slots=True)
class Sensor:
    """A column: ``weights`` (bodies,) of what it shows, ``shows`` counts derivatives."""

    channel: str
    weights: tuple[float, ...]
    shows: int
    gain: Constant
    offset: Constant


@dataclass(frozen=True, slots=True)
class Input:
    """A measured force on ``body``, or the acceleration of the base where that is `GROUND`."""

    channel: str
    body: int
    gain: Constant
    offset: Constant
    hold: str


@dataclass(frozen=True, slots=True)
class Rig:
    """A rig without anything concealed, sampled at ``rate`` (Hz)."""

    name: str
    masses: tuple[Constant, ...]
    elements: tuple[Element, ...]
    sensors: tuple[Sensor, ...]
    input: Input | None
    rate: float

    def body(self, i: int) -> str:
        """Return the name of a body."""
        return "ground" if i == GROUND else f"body {i + 1}"

    def shape(self, element: Element) -> Array:
        """Return what makes the deformation of an element from displacements: that of ``a`` less that of ``b``."""
        shape = np.zeros(len(self.masses))
        shape[element.a] = 1.0
        if element.b != GROUND:
            shape[element.b] = -1.0
        return shape

    def constants(self) -> dict[Key, Constant]:
        """Return all constants that the description has."""
        found: dict[Key, Constant] = {("mass", i): m for i, m in enumerate(self.masses)}
        for i, e in enumerate(self.elements):
            found |= {("stiffness", i): e.stiffness} if e.stiffness else {}
            found |= {("damping", i): e.damping} if e.damping else {}
        for i, s in enumerate(self.sensors):
            found |= {("gain", i): s.gain, ("offset", i): s.offset}
        if self.input:
            found |= {("input gain", 0): self.input.gain, ("input offset", 0): self.input.offset}
        return found

    def true_values(self) -> dict[Key, float]:
        """Return the true value of every constant."""
        return {key: constant.true for key, constant in self.constants().items()}

    def plant(self, values: Mapping[Key, float]) -> Plant:
        """Return the linear rig with given constants; its input is the force or acceleration itself."""
        masses = np.array([values["mass", i] for i in range(len(self.masses))])
        branches = tuple(
            Branch(self.shape(e), values.get(("stiffness", i), 0.0), values.get(("damping", i), 0.0))
            for i, e in enumerate(self.elements)
        )
        drive = np.zeros(masses.size)
        if self.input and self.input.body == GROUND:
            drive = -masses
        elif self.input:
            drive[self.input.body] = 1.0
        return Plant(masses, branches, drive)

    def channels(self, motion: Array, values: Mapping[Key, float]) -> Array:
        """Return what the sensors show, (samples, sensors), of the motion (3, samples, bodies or more)."""
        return np.stack(
            [
                values["gain", i] * (motion[s.shows][:, : len(s.weights)] @ np.array(s.weights)) + values["offset", i]
                for i, s in enumerate(self.sensors)
            ],
            axis=1,
        )

    def described(self) -> dict[str, Any]:
        """Return what the YAML says."""
        told: dict[str, Any] = {
            "name": self.name,
            "bodies": {self.body(i): m.told for i, m in enumerate(self.masses)},
        }
        for e in self.elements:
            line: dict[str, Any] = {"name": e.name, "between": [self.body(e.a), self.body(e.b)]}
            line |= {"stiffness": e.stiffness.told} if e.stiffness else {}
            line |= {"damping": e.damping.told if e.damping else "none"}
            line |= {"preload": float(e.preload)} if e.preload is not None else {}
            told.setdefault(f"{e.section}s", []).append(line)
        if self.input:
            where = (
                {"base_acceleration": True} if self.input.body == GROUND else {"force_on": self.body(self.input.body)}
            )
            gain, offset = self.input.gain.told, self.input.offset.told
            told["inputs"] = [{"channel": self.input.channel, **where, "gain": gain, "offset": offset}]
            told["recording"] = {"hold": self.input.hold}
        told["sensors"] = [self._sensor(s) for s in self.sensors]
        return told

    def _sensor(self, s: Sensor) -> dict[str, Any]:
        seen = {self.body(i): float(w) for i, w in enumerate(s.weights) if w}
        of: Any = next(iter(seen)) if list(seen.values()) == [1.0] else seen
        return {
            "channel": s.channel,
            "of": of,
            "shows": QUANTITIES[s.shows],
            "gain": s.gain.told,
            "offset": s.offset.told,
            "unit": UNITS[s.shows],
        }
