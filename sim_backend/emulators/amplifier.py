"""Emulated strain-gauge amplifier: the simulated gauge behind the registers of a real one's map."""

from __future__ import annotations

from typing import Any

import numpy as np

from rig.drivers.registers import Register, RegisterMap, encode
from rig.drivers.settings import Amplifier
from sim_backend.emulators.modbus import ILLEGAL_ADDRESS, Refusal
from sim_backend.gauge import LARGEST_CODE, STEP_MV, SimulatedLoadCell

IDENTITY, FIRMWARE, UNIT_NEWTON = 14, 112, 5
RATIO_MV_PER_V, FULL_SCALE = 2.0, 10.0  # N
FULL_SCALE_BIT, NEGATIVE_BIT = 1, 7
REGISTERS = 0x2100  # that the device has


class EmulatedAmplifier:
    """Registers of an amplifier with the simulated gauge behind them; a reading is made when it is asked for.

    Attributes
    ----------
    fault
        None, ``"frozen"`` (the same reading again and again), ``"nan"`` (in maps with float32), or an exception code
        with which everything is answered.
    identity
        What it says that it is.
    """

    def __init__(self, gauge: SimulatedLoadCell, settings: Amplifier) -> None:
        self.fault: str | int | None = None
        self.identity = IDENTITY
        self._gauge = gauge
        self._settings = settings
        self._map: RegisterMap = settings.map()
        self._held = 0  # the code read last
        self._static = self._constants()

    def read(self, offset: int, count: int) -> list[int]:
        """Return registers; a reading of the gauge is made if they hold the signal."""
        if isinstance(self.fault, int):
            raise Refusal(self.fault)
        if offset + count > REGISTERS:
            raise Refusal(ILLEGAL_ADDRESS)
        words = dict(self._static)
        if self._map.identity is not None:
            words[self._map.identity] = self.identity
        signal = self._map.signal
        if offset <= signal.offset < offset + count:
            if self.fault != "frozen":
                self._held = self._gauge.sample_code()
            self._put(words, signal, self._signal(self._held))
            if self._map.status is not None:
                words[self._map.status] = self._status(self._held)
        return [words.get(i, 0) for i in range(offset, offset + count)]

    def checkpoint(self) -> dict[str, Any]:
        """Return its state as JSON types."""
        return {"held": self._held}

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the state of `checkpoint`."""
        self._held = state["held"]

    def _constants(self) -> dict[int, int]:
        words: dict[int, int] = {}
        rates = self._map.adc_rates_hz
        enough = [code for code, rate in rates.items() if rate >= self._settings.readings_per_s]
        for place, value in (
            (self._map.firmware, FIRMWARE),
            (self._map.unit, UNIT_NEWTON),
            (self._map.adc_rate, enough[-1] if enough else 0),
        ):
            if place is not None:
                words[place] = value
        for register, number in ((self._map.ratio, RATIO_MV_PER_V), (self._map.full_scale, FULL_SCALE)):
            if register is not None:
                self._put(words, register, number)
        return words

    def _put(self, words: dict[int, int], register: Register, value: float) -> None:
        for i, word in enumerate(encode(value, register.kind, self._map.word_order)):
            words[register.offset + i] = word

    def _signal(self, code: int) -> float:
        if self.fault == "nan" and self._map.signal.kind == "float32":
            return float("nan")
        voltage = code * STEP_MV
        if self._map.signal_is == "counts":
            value = voltage / self._settings.mv_per_count
        elif self._map.signal_is == "mv":
            value = voltage
        elif self._map.signal_is == "mv_per_v":
            value = voltage / self._settings.excitation_v
        else:
            value = voltage / (RATIO_MV_PER_V * self._settings.excitation_v) * FULL_SCALE
        if self._map.negative_bit is not None:
            value = abs(value)
        return float(np.float32(value)) if self._map.signal.kind == "float32" else value

    def _status(self, code: int) -> int:
        full = abs(code) >= LARGEST_CODE
        status = 1 << FULL_SCALE_BIT if full and FULL_SCALE_BIT in self._map.troubles else 0
        if self._map.negative_bit is not None and code < 0:
            status |= 1 << self._map.negative_bit
        return status
