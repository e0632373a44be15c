"""What the parts of a rig report: small frozen records of arrays and numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class LoadReading:
    """One reading of the strain-gauge amplifier, the mean of several samples.

    Attributes
    ----------
    time_s
        Rig time of the last sample, s.
    voltage_mv
        Mean bridge voltage, mV.
    spread_mv
        Standard deviation of the samples, mV. Exactly zero over several samples means a frozen gauge:
        a living one is noisy, unless its amplifier rounds that away.
    samples
        Number of samples behind the mean.
    quantum_mv
        Smallest step of a voltage that the amplifier itself rounds and filters, mV: below it a living gauge may stand
        still. 0 for one that shows its noise.
    """

    time_s: float
    voltage_mv: float
    spread_mv: float
    samples: int
    quantum_mv: float = 0.0


@dataclass(frozen=True, slots=True)
class StageReading:
    """Where the stage is. Positions grow towards contact; NaN where a hand-turned stage has no encoder."""

    time_s: float
    position_um: float
    locked: bool


@dataclass(frozen=True, slots=True)
class Block:
    """A stretch of the continuous stream of samples, already in physical units.

    Attributes
    ----------
    first_sample
        Index of the first sample since the stream began; a gap against the block before is a loss.
    acceleration
        (2, n) accelerations A and B of the lower mass, m/s2, positive like x2 of Eq. 9.
    strain_mv
        (n,) strain-gauge voltage, mV, or None where the recorder does not sample it.
    force
        (n,) force of an instrumented hammer, N, a push positive, or None without one.
    """

    first_sample: int
    acceleration: NDArray[np.float64]
    strain_mv: NDArray[np.float64] | None = None
    force: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True)
class GaugeScale:
    """Straight line between bridge voltage and load: ``voltage = offset + sensitivity * load``.

    Attributes
    ----------
    sensitivity_mv_per_mn
        mV per mN (0.042 in Sec. 3.2 of the paper).
    offset_mv
        Voltage at zero load, mV.
    """

    sensitivity_mv_per_mn: float
    offset_mv: float = 0.0

    def load_mn(self, voltage_mv: float) -> float:
        """Load in mN that stands behind a bridge voltage in mV."""
        return (voltage_mv - self.offset_mv) / self.sensitivity_mv_per_mn

    def voltage_mv(self, load_mn: float) -> float:
        """Bridge voltage in mV that a load in mN gives."""
        return self.offset_mv + self.sensitivity_mv_per_mn * load_mn
