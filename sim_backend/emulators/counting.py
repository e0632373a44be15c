"""Inputs whose voltage says which sample it is, so that a lost, joined or altered one shows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.readings import Block
from rig.settings import Wiring
from sim_backend.clock import VirtualClock

TURNS = 60000
"""Numbers that a 16-bit converter tells apart, with room at both ends."""

STEP_BETWEEN_INPUTS = 1000
"""By how much one input's number is ahead of that of the one before it: swapped inputs show."""


class CountingSource:
    """Each input reads the number of the sample since time 0, as a code around the middle of its range."""

    def __init__(self, clock: VirtualClock, wiring: Wiring) -> None:
        self.inputs = wiring.inputs()
        self._clock = clock
        self._volts_per_code = np.array(wiring.ranges_v())[:, None] / 32768
        self._ahead = STEP_BETWEEN_INPUTS * np.arange(len(self.inputs))[:, None]
        self._rate_hz = 1.0
        self._started_s = 0.0
        self._taken = 0

    def begin(self, sample_rate_hz: float) -> None:
        """Be sampled from now on."""
        self._rate_hz, self._started_s, self._taken = sample_rate_hz, self._clock.now(), 0

    def take(self, samples: int) -> NDArray[np.float64]:
        """Return the next voltages, (inputs, samples), V."""
        number = round(self._started_s * self._rate_hz) + self._taken + np.arange(samples)
        self._taken += samples
        self._clock.sleep_until(self._started_s + self._taken / self._rate_hz)
        return ((number + self._ahead) % TURNS - TURNS // 2) * self._volts_per_code

    def end(self) -> None:
        """Be sampled no longer; the count goes on with time."""


def numbers(block: Block, wiring: Wiring) -> NDArray[np.int64]:
    """Return what the samples of a block say which ones they are, (inputs, n), modulo `TURNS`; -1 for none."""
    rows = [*block.acceleration, *(row for row in (block.strain_mv, block.force) if row is not None)]
    units = np.array(wiring.units_per_volt())[:, None] * np.array(wiring.ranges_v())[:, None] / 32768
    codes = np.array(rows) / units
    whole = np.round(codes)
    ahead = STEP_BETWEEN_INPUTS * np.arange(len(rows))[:, None]
    said = np.where(np.abs(codes - whole) < 1e-6, (whole + TURNS // 2 - ahead) % TURNS, -1)
    return said.astype(np.int64)
