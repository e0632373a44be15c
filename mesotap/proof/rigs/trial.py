"""What is recorded: a rig, its recordings and the noise; and how something concealed alters it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mesotap.proof.rigs.description import Key, Rig
from mesotap.proof.rigs.drives import Drive
from mesotap.proof.rigs.noise import Noise
from mesotap.proof.rigs.plant import NO_KICK, Plant
from mesotap.proof.rigs.stepping import Kick

Array = NDArray[np.float64]
STEPS_A_PERIOD = 96
"""Of the fastest mode. Twice as many change a recording by less than a hundredth of its noise."""
MOST_PIECES = 64


@dataclass(frozen=True, slots=True)
class Record:
    """One recording: displacements and velocities of the bodies at its beginning, and its input times ``size``."""

    start: Array
    drive: Drive
    size: float

    @property
    def count(self) -> int:
        """Number of samples."""
        return self.drive.count


@dataclass(frozen=True, slots=True)
class Trial:
    """A rig, its recordings, and the noise of each sensor."""

    rig: Rig
    records: tuple[Record, ...]
    noises: tuple[Noise, ...] = ()


def as_it_is(x: Array) -> Array:
    """Return the input as it is."""
    return x


def sampled(fine: Array, pieces: int, record: int) -> Array:
    """Return every sample of channels that are known ``pieces`` times as often."""
    return fine[::pieces]


@dataclass(frozen=True, slots=True)
class Altered:
    """A rig with something concealed.

    Attributes
    ----------
    plant
        True masses, springs and laws.
    force
        What an exciter makes of its input.
    recorder
        What the recorder makes of channels that are known ``pieces`` times a sample, in recording number so and so.
    kick
        Sample, and jump of displacements and velocities as a share of those at the beginning of each recording.
    knock
        Number of a recording, sample, and jump of displacements (m) and velocities (m/s) in that one alone.
    sees
        Sensors' weights where there are more coordinates than bodies, by sensor.
    """

    plant: Plant
    force: Callable[[Array], Array] = as_it_is
    recorder: Callable[[Array, int, int], Array] = sampled
    kick: tuple[int, Array] | None = None
    knock: tuple[int, int, Array] | None = None
    sees: Mapping[int, Array] = field(default_factory=dict)


def pieces_of(plant: Plant, rate: float) -> int:
    """Return how many steps a sample takes."""
    poles = plant.poles()
    swinging = np.abs(poles[np.abs(poles.imag) > 1e-9 * np.abs(poles)])
    fastest = float(np.max(swinging, initial=0.0)) / (2 * math.pi)
    return min(max(1, math.ceil(STEPS_A_PERIOD * fastest / rate)), MOST_PIECES)


def recorded(trial: Trial, altered: Altered, refined: int = 1) -> list[Array]:
    """Return the channels of each recording (samples, sensors), without noise.

    ``refined`` divides the steps further, to see whether they are short enough.
    """
    rig = trial.rig
    pieces = pieces_of(altered.plant, rig.rate) * refined
    values = rig.true_values()
    out = []
    for number, record in enumerate(trial.records):
        u = altered.force(record.size * record.drive.steps(pieces))
        kick = NO_KICK if altered.kick is None else Kick(altered.kick[0] * pieces, altered.kick[1] * _size(record))
        if altered.knock is not None and altered.knock[0] == number:
            kick = Kick(altered.knock[1] * pieces, altered.knock[2])
        motion, _ = altered.plant.motion(record.start, u, 1.0 / (rig.rate * pieces), kick)
        fine = rig.channels(motion, values)
        for i, weights in altered.sees.items():
            sensor = rig.sensors[i]
            fine[:, i] = values["gain", i] * (motion[sensor.shows] @ weights) + values["offset", i]
        out.append(altered.recorder(fine, pieces, number))
    return out


def _size(record: Record) -> float:
    """Largest velocity at the beginning."""
    return float(np.max(np.abs(record.start[record.start.size // 2 :])))


def simulated(trial: Trial, values: Mapping[Key, float], starts: list[Array]) -> list[Array]:
    """Return the channels that the linear rig with given constants and beginnings would record."""
    rig = trial.rig
    plant = rig.plant(values)
    pieces = pieces_of(rig.plant(rig.true_values()), rig.rate)
    return [
        rig.channels(_moved(plant, rig, record, values, start, pieces), values)
        for record, start in zip(trial.records, starts, strict=True)
    ]


def _moved(
    plant: Plant, rig: Rig, record: Record, values: Mapping[Key, float], start: Array, pieces: int
) -> Array:  # fmt: skip
    u = record.size * record.drive.steps(pieces)
    if rig.input:
        channel = u / rig.input.gain.true - rig.input.offset.true
        u = values["input gain", 0] * (channel + values["input offset", 0])
    else:
        pieces, u = 1, np.zeros((record.count - 1, 3))
    motion, _ = plant.motion(start, u, 1.0 / (rig.rate * pieces))
    return motion[:, ::pieces]
