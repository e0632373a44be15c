"""A rig described in YAML: bodies, what is between them, inputs and sensors, for `mesotap diagnose --rig`."""

from __future__ import annotations

import math
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, ValidationError, field_validator, model_validator

from analysis.mismatch.rig_description import DescribedRig, Drive, Hold, Seen, Stretch, SweepColumns
from daq.errors import one_line
from daq.exchange.units import is_known_unit, kind_of_motion
from mesotap.configuration.config import ConfigError, text_of
from mesotap.configuration.rig_connections import unconnected, unconnected_words
from mesotap.configuration.rig_faults import deepest, place_named
from mesotap.configuration.yaml_text import NOT_YAML, line_of, not_yaml, parsed, sentence
from rig.section import Section, of_a_size
from sim_backend.arrangement import LOAD, Arrangement, Element, Parameter, Role, Row, Sensor

GROUND = "ground"
TESTER_FILE = "two-mass-tester.yaml"
SMALLEST, LARGEST = 1e-20, 1e20
"""Magnitudes between which numbers of a rig have to lie, in whatever unit: fits square and multiply several of them."""
Finite = Annotated[float, Field(allow_inf_nan=False), of_a_size(SMALLEST, LARGEST)]
Positive = Annotated[Finite, Field(gt=0)]
NonNegative = Annotated[Finite, Field(ge=0)]
Component = Literal[
    "contact", "upper mass", "lower mass", "tube springs", "frame", "impactor", "sensor chain", "load cell",
    "spring", "joint", "slide", "body", "input", "sensor",
]  # fmt: skip


class Known(Section):
    """A constant known to within a standard error; ``symbol`` is the name under which it is told."""

    value: Finite
    uncertainty: Positive
    symbol: str | None = None


class FromHeader(Section):
    """A constant that the header of the session file declares."""

    header: Literal["m1_kg", "m2_kg", "k1_n_per_m", "k2_n_per_m"]
    symbol: str | None = None


class AtEachLoad(Section):
    """A constant that nobody knows, with a value of its own at each load."""

    per: Literal["load"]
    symbol: str | None = None


Constant = Finite | Known | FromHeader | AtEachLoad | Literal["unknown"]
KINDS: dict[str, type[Section]] = {"header": FromHeader, "per": AtEachLoad, "value": Known}
"""Sections that a constant may be, by a key that only it has."""


def _value(said: Constant) -> float:
    """Return the value of a constant, NaN for one that nobody knows, or that is not known yet."""
    if said == "unknown" or isinstance(said, FromHeader | AtEachLoad):
        return math.nan
    return said.value if isinstance(said, Known) else float(said)


def _not_zero(gain: Constant) -> Constant:
    if _value(gain) == 0:
        raise ValueError("with a gain of 0 a channel shows nothing; leave it out, or say 'unknown'")
    return gain


def _known(unit: str) -> str:
    if not is_known_unit(unit):
        raise ValueError(f"{unit!r:.40} is no known unit; units are such as m, um, m/s2, g, N, V, mV or counts")
    return unit


Unit = Annotated[str, AfterValidator(_known)]
Gain = Annotated[Constant, AfterValidator(_not_zero)]
Channel = Annotated[int, Field(ge=0)] | Annotated[str, Field(min_length=1)]
Quantity = Literal["displacement", "velocity", "acceleration"]


class Between(Section):
    """What is between two bodies, or between one and the ground (``between: [mass, ground]``)."""

    name: str | None = None
    between: tuple[str, str]
    stiffness: Constant | None = None
    damping: Constant | Literal["none"] | None = None
    component: Component | None = None
    alike: str | None = None

    @field_validator("stiffness")
    @classmethod
    def _pulls_back(cls, said: Constant | None) -> Constant | None:
        if said is not None and _value(said) <= 0:
            raise ValueError(f"{_value(said):g} holds nothing: a stiffness must be above 0, or 'unknown'")
        return said

    @field_validator("damping")
    @classmethod
    def _takes_away(cls, said: Constant | Literal["none"] | None) -> Constant | Literal["none"] | None:
        if said is not None and said != "none" and _value(said) < 0:
            raise ValueError(f"{_value(said):g} would drive the rig: a damping must not be below 0")
        return said


class Pressed(Between):
    """A contact; ``preload`` is what presses it together, N, or ``load``: what the session says at each load."""

    preload: Positive | Literal["load"] | None = None


class Input(Section):
    """A measured input: a force on a body, or the acceleration of the base that all stand on."""

    channel: Channel
    force_on: str | None = None
    base_acceleration: bool = False
    gain: Gain = 1.0
    offset: Constant = "unknown"
    noise: NonNegative | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Input:
        if (self.force_on is None) == (not self.base_acceleration):
            raise ValueError("say either 'force_on: <body>' or 'base_acceleration: true'")
        return self


class Sees(Section):
    """A sensor on a body, or on a sum of bodies (``of: {a: 1, b: -1}`` is their distance)."""

    channel: Channel
    of: str | dict[str, Finite]
    shows: Quantity
    gain: Gain = 1.0
    offset: Constant = "unknown"
    unit: Unit = ""
    name: str | None = None
    absolute: bool = False

    @model_validator(mode="after")
    def _absolute_is_an_acceleration(self) -> Sees:
        if self.absolute and self.shows != "acceleration":
            raise ValueError(f"only an acceleration can be absolute, and channel {self.channel} shows {self.shows}")
        return self

    @model_validator(mode="after")
    def _unit_is_of_the_quantity(self) -> Sees:
        kind = kind_of_motion(self.unit)
        if kind not in ("", self.shows):
            raise ValueError(
                f"channel {self.channel} shows {self.shows}, but its unit {self.unit} is one of {kind}; "
                f"write 'shows: {kind}', or another unit"
            )
        return self

    @field_validator("of")
    @classmethod
    def _moves(cls, of: str | dict[str, float]) -> str | dict[str, float]:
        if not isinstance(of, str) and not any(of.values()):
            raise ValueError("no body has a share in what it shows; give at least one that is not 0")
        return of


class Span(Section):
    """A stretch of a recording."""

    name: str
    from_s: Finite
    to_s: float = math.inf

    @model_validator(mode="after")
    def _forward(self) -> Span:
        if not self.to_s > self.from_s:
            raise ValueError(f"to_s ({self.to_s:g}) must lie after from_s ({self.from_s:g})")
        return self


class Taken(Section):
    """What is to be known of the recordings, and which part of them is meant."""

    rate_hz: Positive | None = None
    from_s: NonNegative | None = None
    to_s: Positive | None = None
    band_hz: tuple[NonNegative, NonNegative] | None = None
    hold: Hold = "band-limited"
    held_out: tuple[Span, ...] = ()

    @model_validator(mode="after")
    def _band_is_a_range(self) -> Taken:
        if self.band_hz is not None and not 0 < self.band_hz[0] < self.band_hz[1] < math.inf:
            raise ValueError("band_hz needs two rising frequencies above 0")
        if self.from_s is not None and self.to_s is not None and self.from_s >= self.to_s:
            raise ValueError(f"to_s ({self.to_s:g}) must lie after from_s ({self.from_s:g})")
        return self


class Units(Section):
    """Units of the rig, in which its parameters are told."""

    length: Unit = "m"
    force: Unit = "N"


class Sweeps(Section):
    """Columns of steady responses; the sensor must be one body's."""

    frequency: Channel
    force: Channel
    amplitude: Channel
    phase: Channel
    of: str
    shows: Quantity


class RigFile(Section):
    """The whole of a rig file."""

    name: str = "rig"
    bodies: dict[str, Constant] = Field(min_length=1)
    springs: tuple[Between, ...] = ()
    dampers: tuple[Between, ...] = ()
    joints: tuple[Between, ...] = ()
    contacts: tuple[Pressed, ...] = ()
    slides: tuple[Between, ...] = ()
    pendulums: tuple[Between, ...] = ()
    inputs: tuple[Input, ...] = ()
    sensors: tuple[Sees, ...] = Field(min_length=1)
    recording: Taken = Taken()
    units: Units = Units()
    sweeps: Sweeps | None = None
    tapped: str | None = None
    parts: tuple[Component, ...] = ()

    @model_validator(mode="after")
    def _names_are_bodies(self) -> RigFile:
        if GROUND in self.bodies:
            raise ValueError(f"{GROUND} is what does not move: no body can have this name")
        for kind in ELEMENTS:
            for i, e in enumerate(getattr(self, kind)):
                for end in e.between:
                    self._check(f"{kind}.{i}", end, ground=True)
                if e.between[0] == e.between[1]:
                    raise ValueError(f"{kind}.{i} is between {e.between[0]} and itself")
        for i, u in enumerate(self.inputs):
            if u.force_on is not None:
                self._check(f"inputs.{i}", u.force_on)
        for i, s in enumerate(self.sensors):
            for body in (s.of,) if isinstance(s.of, str) else s.of:
                self._check(f"sensors.{i}", body)
        if self.sweeps is not None:
            self._check("sweeps", self.sweeps.of)
        if self.tapped is not None:
            self._check("tapped", self.tapped)
        return self

    @model_validator(mode="after")
    def _base_is_known(self) -> RigFile:
        for i, s in enumerate(self.sensors):
            if not s.absolute:
                continue
            base = [u for u in self.inputs if u.base_acceleration]
            if not base:
                raise ValueError(f"sensors.{i} is absolute, and no input is a base_acceleration; leave 'absolute' out")
            if "unknown" in [s.gain, *(u.gain for u in base)]:
                raise ValueError(
                    f"sensors.{i} is absolute: what the base adds to it is subtracted, so its gain and the base's "
                    "have to be known"
                )
            if not isinstance(s.of, str):
                raise ValueError(f"sensors.{i} is absolute and shows a sum of bodies; name one body")
        return self

    @model_validator(mode="after")
    def _symbols_differ(self) -> RigFile:
        elements = [e for kind in ELEMENTS for e in getattr(self, kind)]
        channels: tuple[Input | Sees, ...] = (*self.inputs, *self.sensors)
        said = [*self.bodies.values(), *(c for e in elements for c in (e.stiffness, e.damping))]
        said += [c for channel in channels for c in (channel.gain, channel.offset)]
        symbols = [c.symbol for c in said if isinstance(c, Known | FromHeader | AtEachLoad) and c.symbol is not None]
        twice = next((s for s in symbols if symbols.count(s) > 1), None)
        if twice is not None:
            raise ValueError(f"the symbol {twice!r} stands for two constants; give each one of its own")
        if len({c.preload for c in self.contacts if c.preload is not None}) > 1:
            raise ValueError("contacts are pressed together by different preloads; one is all that can be declared")
        return self

    @model_validator(mode="after")
    def _can_be_fitted(self) -> RigFile:
        if all(m == "unknown" for m in self.bodies.values()):
            raise ValueError("at least one body's mass has to be given: recordings tell only ratios (1 will do)")
        for body, m in self.bodies.items():
            if not _value(m) > 0 and not math.isnan(_value(m)):
                raise ValueError(f"bodies.{body}: a mass must be above 0")
        if self.inputs and self.recording.band_hz is not None:
            raise ValueError("recording.band_hz is for recordings without a measured input")
        if not any(getattr(self, kind) for kind in ELEMENTS):
            raise ValueError(f"nothing holds the bodies: give at least one of {', '.join(ELEMENTS)}")
        told = {body for kind in ELEMENTS for e in getattr(self, kind) for body in e.between}
        told |= {u.force_on for u in self.inputs} | {self.tapped}
        told |= {body for s in self.sensors for body in ((s.of,) if isinstance(s.of, str) else s.of)}
        for body in self.bodies:
            if body not in told:
                raise ValueError(f"bodies.{body}: nothing holds, pushes or shows it; connect it or leave it out")
        apart = unconnected(list(self.bodies), [e.between for k in ELEMENTS for e in getattr(self, k)], GROUND)
        if apart:
            raise ValueError(unconnected_words(apart))
        return self

    def _check(self, where: str, body: str, ground: bool = False) -> None:
        if body not in self.bodies and not (ground and body == GROUND):
            raise ValueError(f"{where} names {body!r}, which is not a body; bodies are {', '.join(self.bodies)}")


ELEMENTS: dict[str, tuple[Role, Component, bool, bool]] = {
    "springs": ("spring", "spring", True, False),
    "dampers": ("damper", "joint", False, True),
    "joints": ("joint", "joint", True, True),
    "contacts": ("contact", "contact", True, True),
    "slides": ("guide", "slide", False, True),
    "pendulums": ("pendulum", "joint", True, True),
}
"""Role, component of the contract, and whether stiffness and damping are there (unknown) where nothing is said."""


def load_rig(path: Path) -> DescribedRig:
    """Read a rig file.

    Raises
    ------
    ConfigError
        A line for each fault: file, line, key, what is allowed.
    """
    return parse_rig(text_of(path, "a rig file"), str(path))


def parse_rig(text: str, name: str = "rig.yaml") -> DescribedRig:
    """Validate the text of a rig file; see `load_rig`."""
    name = one_line(name)
    try:
        node, content = parsed(text)
    except NOT_YAML as error:
        raise ConfigError(not_yaml(name, error)) from error
    if not isinstance(content, dict):
        raise ConfigError(f"{name}: is not a rig: sections such as 'bodies:' and 'sensors:' are expected at the top")
    try:
        return described(RigFile.model_validate(content))
    except ValidationError as error:
        lines = []
        for fault in deepest(error, content, KINDS):
            line = line_of(node, fault["loc"] or place_named(fault["msg"], content))
            where = f"{name}, line {line}" if line else name
            lines.append(f"{where}: {sentence(fault, RigFile)}")
        raise ConfigError("\n".join(dict.fromkeys(lines))) from error


def described(file: RigFile) -> DescribedRig:
    """Return the rig that a file describes."""
    parameters: list[Parameter] = []

    header: dict[str, str] = {}

    def constant(name: str, unit: str, said: Constant, positive: bool = False) -> str:
        name = getattr(said, "symbol", None) or name
        if said == "unknown":
            start = math.nan if unit else 0.0
            parameters.append(Parameter(name, unit, start, math.inf, positive=positive))
        elif isinstance(said, FromHeader):
            header[name] = said.header
            parameters.append(Parameter(name, unit, math.nan, 0.0, positive=positive))
        elif isinstance(said, AtEachLoad):
            parameters.append(Parameter(name, unit, 1.0, scope=LOAD))
        elif isinstance(said, Known):
            parameters.append(Parameter(name, unit, said.value, said.uncertainty, positive=positive))
        else:
            parameters.append(Parameter(name, unit, float(said), 0.0, positive=positive))
        return name

    masses = tuple(constant(f"mass of {body}", "kg", m, True) for body, m in file.bodies.items())
    elements, components = [], {}
    for kind, (role, component, stiff, damped) in ELEMENTS.items():
        for i, e in enumerate(getattr(file, kind)):
            single = len(getattr(file, kind)) == 1
            name = e.name or (kind[:-1] if single else f"{kind[:-1]} {i + 1}")
            while name in components:
                name += "'"
            row: Row = tuple((body, sign) for body, sign in zip(e.between, (1.0, -1.0), strict=True) if body != GROUND)
            k: Constant | None = e.stiffness if e.stiffness is not None else ("unknown" if stiff else None)
            c: Constant | None = e.damping if e.damping is not None else ("unknown" if damped else None)
            c = None if e.damping == "none" else c
            preload = getattr(e, "preload", None)
            elements.append(
                Element(
                    name,
                    role,
                    e.component or component,
                    row,
                    None if k is None else constant(f"stiffness of {name}", "N/m", k, k == "unknown" or _above(k)),
                    None if c is None else constant(f"damping of {name}", "N s/m", c),
                    e.alike,
                    preload is not None,
                )
            )
            components[name] = e.component or component
    drives = []
    for i, u in enumerate(file.inputs):
        of: Row = ((u.force_on, 1.0),) if u.force_on is not None else tuple((body, 1.0) for body in file.bodies)
        gain = constant(f"gain of input {i + 1}", "1", u.gain)
        offset = constant(f"offset of input {i + 1}", "", u.offset)
        drives.append(Drive(f"input {i + 1}", u.channel, of, u.base_acceleration, gain, offset, u.noise))
    seen = []
    banded = file.recording.band_hz is not None
    for i, s in enumerate(file.sensors):
        row = ((s.of, 1.0),) if isinstance(s.of, str) else tuple(s.of.items())
        gain = constant(f"gain of sensor {i + 1}", "1", s.gain)
        offset = constant(f"offset of sensor {i + 1}", "", 0.0 if banded else s.offset)
        name = s.name or (s.channel if isinstance(s.channel, str) else f"sensor {i + 1}")
        seen.append(Seen(Sensor(name, row, s.shows), s.channel, gain, offset, s.unit, s.absolute))
    sweeps = None
    if file.sweeps is not None:
        q = file.sweeps
        sensor = Sensor("steady response", ((q.of, 1.0),), q.shows)
        sweeps = SweepColumns(q.frequency, q.force, q.amplitude, q.phase, sensor)
    arrangement = Arrangement(
        tuple(file.bodies), masses, tuple(elements), tuple(s.sensor for s in seen), tuple(parameters),
        file.tapped or next(iter(file.bodies)), len(file.inputs),
    )  # fmt: skip
    r = file.recording
    return DescribedRig(
        file.name, arrangement, tuple(drives), tuple(seen), r.hold, r.rate_hz, r.from_s, r.to_s, r.band_hz,
        tuple(Stretch(s.name, s.from_s, s.to_s) for s in r.held_out), sweeps, components,
        file.units.length, file.units.force, _preload(file), file.parts, header,
    )  # fmt: skip


def _preload(file: RigFile) -> float:
    """Return the preload that is declared, N; zero where none is, or where each session tells it."""
    return next((float(c.preload) for c in file.contacts if isinstance(c.preload, float | int)), 0.0)


def tester_rig() -> DescribedRig:
    """Return the two-mass tester of Eq. 9, as the program ships its description."""
    text = files("mesotap.configuration").joinpath(TESTER_FILE).read_text(encoding="utf-8")
    return parse_rig(text, TESTER_FILE)


def _above(said: Constant) -> bool:
    return _value(said) > 0
