"""What a test session consists of: calibrations, impacts, and the rig that made them. Arrays and numbers only."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.hardware_log import Repetition
from rig.tube import OwnMode

if TYPE_CHECKING:
    import pandas
    import xarray


@dataclass(frozen=True, slots=True)
class RigDescription:
    """The rig as `/rig` of the session file holds it; NaN (or an empty family) where unknown.

    The last three say what of the tube springs is in the masses, and are 0 where nothing of them was declared:
    ``tube_added_kg`` is in m1_kg and m2_kg each, ``tube_mode_kg`` and ``tube_mode_hz`` are their own mode
    (`rig.tube.OwnMode`), which adds to both as the frequency grows.
    """

    m1_kg: float = math.nan
    m2_kg: float = math.nan
    k1_n_per_m: float = math.nan
    k2_n_per_m: float = math.nan
    sample_rate_hz: float = math.nan
    highpass_hz: float = math.nan
    highpass_order: int = 0
    lowpass_hz: float = math.nan
    lowpass_order: int = 0
    filter_family: str = "none"
    full_scale_m_s2: float = math.nan
    bits: int = 0
    tube_added_kg: float = 0.0
    tube_mode_kg: float = 0.0
    tube_mode_hz: float = 0.0

    @property
    def tube_mode(self) -> OwnMode | None:
        """Own mode of the tube springs, None where none is declared."""
        return OwnMode(self.tube_mode_kg, self.tube_mode_hz) if self.tube_mode_kg and self.tube_mode_hz else None

    @property
    def is_tester(self) -> bool:
        """Whether masses and springs of Eq. 9 are known."""
        return all(map(math.isfinite, (self.m1_kg, self.m2_kg, self.k1_n_per_m, self.k2_n_per_m)))


@dataclass(frozen=True, slots=True)
class CalibrationPoints:
    """Dead-weight calibration: ``load_mn`` (n,) against ``voltage_mv`` (n,), and when (ISO 8601 UTC).

    ``quantum_mv`` is the step of a gauge that rounds its voltages, known where they were just read; it is not kept.
    ``elapsed_s`` (n,) are the times of the readings since the first, s; None where nobody noted them.
    """

    load_mn: NDArray[np.float64]
    voltage_mv: NDArray[np.float64]
    time: str
    quantum_mv: float = 0.0
    elapsed_s: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True)
class ZeroReading:
    """Bridge voltage without a load between the calibrations, mV, and when (ISO 8601 UTC)."""

    voltage_mv: float
    time: str


@dataclass(frozen=True, slots=True)
class Impact:
    """One tap as recorded, accepted or not.

    Attributes
    ----------
    number
        From 0 in time order; the name of its group in the session file, five digits.
    load_set, target_load_mn
        Which step of the load plan, and its load.
    load_before_mn, load_after_mn
        Load by the calibration in force at the time, just before and after the tap; NaN if unknown.
    voltage_before_mv, voltage_after_mv
        The bridge voltages behind them; NaN if unknown.
    time
        ISO 8601 UTC of the trigger.
    sample_rate_hz, pretrigger
        Sampling rate, and the number of samples before the trigger.
    acceleration
        (2, n) accelerations A and B, m/s2.
    strain_mv
        (n,) bridge voltage, or None.
    accepted, reject_reason
        The verdict; a reason if rejected.
    extra
        More that is worth keeping beside (JSON types), such as the numbers behind the verdict.
    force
        (n,) force of an instrumented hammer on the upper mass, N, a push positive; None without one.
    channels
        For a recording that is not a tester's: all its channels, (c, n), with ``channel_names``; else None.
    """

    number: int
    load_set: int
    target_load_mn: float
    load_before_mn: float
    load_after_mn: float
    time: str
    sample_rate_hz: float
    pretrigger: int
    acceleration: NDArray[np.float64]
    accepted: bool
    reject_reason: str = ""
    strain_mv: NDArray[np.float64] | None = None
    voltage_before_mv: float = math.nan
    voltage_after_mv: float = math.nan
    extra: dict[str, Any] = field(default_factory=dict)
    channels: NDArray[np.float64] | None = None
    channel_names: tuple[str, ...] = ()
    force: NDArray[np.float64] | None = None

    @property
    def name(self) -> str:
        """Name of the group in the session file."""
        return f"{self.number:05d}"


@dataclass(frozen=True, slots=True)
class Session:
    """A whole test session, as a session file holds it."""

    created: str
    rig: RigDescription
    impacts: tuple[Impact, ...]
    pre: CalibrationPoints | None = None
    post: CalibrationPoints | None = None
    operator: str = ""
    specimen: str = ""
    title: str = ""
    software: str = ""
    complete: bool = False
    config: str = ""
    source: str = ""
    hardware: tuple[Repetition, ...] | None = None
    """What had to be repeated to get the recording; None where nobody kept count."""
    zeros: tuple[ZeroReading, ...] = ()
    """Readings of the gauge while the surfaces were apart, between the calibrations."""
    refused: tuple[str, ...] = ()
    """What is wrong with each record of the file that could not be read and is left out; not kept in a file."""

    def load_sets(self) -> list[int]:
        """Numbers of the load sets in the session, ascending."""
        return sorted({impact.load_set for impact in self.impacts})

    def accepted(self, load_set: int) -> list[Impact]:
        """Return the accepted impacts of one load set, in time order."""
        return [s for s in self.impacts if s.load_set == load_set and s.accepted]

    def to_pandas(self) -> pandas.DataFrame:
        """Return a table with a row for each impact; see `daq.frames.impact_table`."""
        from daq.frames import impact_table

        return impact_table(self)

    def to_xarray(self) -> xarray.Dataset:
        """Return all records as one labelled array; see `daq.frames.record_array`."""
        from daq.frames import record_array

        return record_array(self)
