"""A rig as described by somebody: an arrangement, what drives it, what its channels show, and what to hold out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from sim_backend.arrangement import Arrangement, Row, Sensor

Hold = Literal["band-limited", "first", "zero"]
"""What an input does between its samples: no content above half the rate, straight lines, or steps."""


@dataclass(frozen=True, slots=True)
class Drive:
    """A measured input.

    Attributes
    ----------
    channel
        Name, or number from 0, of its column in a recording.
    row
        Bodies it pushes; for an acceleration of the base, all that it shakes.
    base
        Whether it is the acceleration of the base, not a force.
    gain, offset
        Names of the constants: it is ``gain (u + offset)``.
    noise
        Its rms, in the channel's unit; None where the recordings are to tell.
    """

    name: str
    channel: str | int
    row: Row
    base: bool
    gain: str
    offset: str
    noise: float | None = None


@dataclass(frozen=True, slots=True)
class Seen:
    """A recorded channel: ``gain`` times what the sensor sees, plus ``offset``; ``unit`` of the recording.

    ``absolute`` is an acceleration that the base's is part of, as an accelerometer on a shaken rig shows it.
    """

    sensor: Sensor
    channel: str | int
    gain: str
    offset: str
    unit: str
    absolute: bool = False


@dataclass(frozen=True, slots=True)
class Stretch:
    """A stretch of time of a recording, s."""

    name: str
    from_s: float
    to_s: float


@dataclass(frozen=True, slots=True)
class SweepColumns:
    """Names, or numbers from 0, of the columns of steady responses, Hz, force, amplitude, rad; what they show."""

    frequency: str | int
    force: str | int
    amplitude: str | int
    phase: str | int
    sensor: Sensor


@dataclass(frozen=True, slots=True)
class DescribedRig:
    """Everything that a rig file says.

    Attributes
    ----------
    rate_hz, from_s, to_s
        Of the recordings; None where they say so themselves, or all of it is meant.
    band_hz
        Band to look at; for recordings without a measured input.
    held_out
        Stretches that take no part; without any, every fourth block is held out.
    components
        For each element the component of the contract that it stands for.
    length_unit, force_unit
        Units of the rig, in which parameters are reported.
    preload_n
        Of the contact that carries a load, where the recordings were made at one.
    parts
        Components of the contract that it has beside those of its elements.
    header
        Constants that the header of a session declares, and the header's names of them.
    """

    name: str
    arrangement: Arrangement
    drives: tuple[Drive, ...]
    seen: tuple[Seen, ...]
    hold: Hold
    rate_hz: float | None
    from_s: float | None
    to_s: float | None
    band_hz: tuple[float, float] | None
    held_out: tuple[Stretch, ...]
    sweeps: SweepColumns | None
    components: dict[str, str]
    length_unit: str
    force_unit: str
    preload_n: float = 0.0
    parts: tuple[str, ...] = ()
    header: Mapping[str, str] = field(default_factory=dict)
