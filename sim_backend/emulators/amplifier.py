"""Emulated strain-gauge amplifiers: the simulated gauge behind the registers of those sold, or of one described.

Tables and their sources are in `amplifier_tables`; nothing is taken from the driver of this project.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rig import Clock
from sim_backend.emulators import amplifier_tables as tables
from sim_backend.emulators.amplifier_tables import TABLES, Live, Table, words_of
from sim_backend.emulators.modbus import ILLEGAL_ADDRESS, ILLEGAL_VALUE, Refusal
from sim_backend.gauge import LARGEST_CODE, STEP_MV, SimulatedLoadCell

ON_TIME = 1e-6  # share of a conversion by which one asked for at its very moment may seem early


@dataclass(frozen=True, slots=True)
class AmplifierModel:
    """Which amplifier, with which cell.

    Attributes
    ----------
    device
        Its name in `TABLES`; empty for one whose table is given.
    table
        That table.
    realistic
        Whether it converts at its own rate, filters, and has the bounds of its display; else every request finds a
        fresh conversion, unfiltered, and a session is equal to the simulated one.
    ratio_mv_per_v, full_scale
        Of the cell, mV/V and N.
    excitation_v
        Of the bridge.
    mv_per_count
        What a count or a division is worth where the device tells whole numbers.
    """

    device: str = "ze-sg3"
    table: Table | None = None
    realistic: bool = False
    ratio_mv_per_v: float = 2.0
    full_scale: float = 10.0
    excitation_v: float = 5.0
    mv_per_count: float = STEP_MV

    def registers(self) -> Table:
        """Return the table of its registers."""
        return TABLES[self.device] if self.table is None else self.table


class EmulatedAmplifier:
    """Registers of an amplifier with the simulated gauge behind them.

    Attributes
    ----------
    fault
        None, ``"frozen"`` (the same reading again and again), ``"nan"`` (in registers with float32), or an exception
        code with which everything is answered.
    identity
        What it says that it is.
    rate_code
        How often it converts, as its table has it.
    functions
        Modbus functions that read its registers.
    """

    def __init__(self, gauge: SimulatedLoadCell, model: AmplifierModel, clock: Clock) -> None:
        self.fault: str | int | None = None
        self.identity = tables.IDENTITY
        self._gauge = gauge
        self._clock = clock
        self._model = model
        self._table = table = model.registers()
        self.functions = table.functions
        self.rate_code = table.rate_code
        self._held = 0  # the last conversion
        self._filtered_mv = 0.0
        self._converted_s = -math.inf
        self._static = dict(table.constants)
        for offset, value in ((table.ratio, model.ratio_mv_per_v), (table.full_scale, model.full_scale)):
            if offset is not None:
                self._put(self._static, Live(offset, "", "float32"), value)

    @property
    def conversions_per_s(self) -> float:
        """How often the readings change, Hz; 0 if whenever they are asked for."""
        return self._table.rates_hz.get(self.rate_code, 0.0) if self._model.realistic else 0.0

    def read(self, offset: int, count: int) -> list[int]:
        """Return registers; `Refusal` as the device would."""
        if isinstance(self.fault, int):
            raise Refusal(self.fault)
        if count > self._table.largest_read:
            raise Refusal(ILLEGAL_VALUE)
        if offset + count > self._table.size:
            raise Refusal(ILLEGAL_ADDRESS)
        words = dict(self._static)
        for place, number in ((self._table.identity, self.identity), (self._table.rate, self.rate_code)):
            if place is not None:
                words[place] = number
        asked = [item for item in self._table.live if offset <= item.offset < offset + count]
        if any(item.content in tables.SIGNALS for item in asked):
            self._convert()
        for item in asked:
            self._put(words, item, self._value(item))
        return [words.get(i, 0) for i in range(offset, offset + count)]

    def load_changed(self) -> None:
        """Convert, as the load has just changed: a converter with a rate of its own does not wait to be asked."""
        if self.conversions_per_s and self.fault != "frozen":
            self._convert()
            self._held = self._gauge.sample_code()

    def checkpoint(self) -> dict[str, Any]:
        """Return its state as JSON types."""
        converted_s = None if math.isinf(self._converted_s) else self._converted_s
        return {"held": self._held, "filtered_mv": self._filtered_mv, "converted_s": converted_s}

    def restore(self, state: dict[str, Any]) -> None:
        """Take up the state of `checkpoint`."""
        self._held, self._filtered_mv = state["held"], state["filtered_mv"]
        self._converted_s = -math.inf if state["converted_s"] is None else state["converted_s"]

    # --- the converter ----------------------------------------------------------------------------------------

    def _convert(self) -> None:
        """Have the conversion that is due by now; at its own rate, it may still be the one told before."""
        if self.fault == "frozen":
            return
        rate = self.conversions_per_s
        if not rate:
            self._held = self._gauge.sample_code()
            self._filtered_mv = self._held * STEP_MV
            return
        # what was converted between two requests is not drawn: until the load changed, it was as the one before
        tick_s = math.floor(self._clock.now() * rate + ON_TIME) / rate
        if tick_s <= self._converted_s:
            return
        missed_s, before = max(tick_s - 1 / rate - self._converted_s, 0.0), self._held
        self._held = self._gauge.sample_code()
        if math.isinf(missed_s):
            before = self._held  # switched on long ago
        for seconds, held in ((missed_s, before), (1 / rate, self._held)):
            kept = math.exp(-seconds / self._table.response_s) if self._table.response_s else 0.0
            self._filtered_mv = kept * self._filtered_mv + (1 - kept) * held * STEP_MV
        self._converted_s = tick_s

    # --- what the registers say ------------------------------------------------------------------------------

    def _put(self, words: dict[int, int], item: Live, value: float) -> None:
        for i, word in enumerate(words_of(value, item.kind, self._table.word_order)):
            words[item.offset + i] = word

    def _value(self, item: Live) -> float:
        value = self._signed(item)
        told_apart = self._table.negative_bit is not None and item.content != tables.STATUS
        return abs(value) if told_apart else value

    def _signed(self, item: Live) -> float:
        laumas = self._table.status == "laumas"
        if item.content == tables.STATUS:
            return self._laumas_status() if laumas else self._seneca_status()
        if self.fault == "nan" and item.kind == "float32":
            return math.nan
        if item.content == tables.RAW:
            return self._held * STEP_MV / self._model.mv_per_count
        if item.content == tables.FILTERED:
            return self._filtered_mv / self._model.mv_per_count
        if item.content == tables.TARE:
            return 0.0
        if laumas:
            return abs(self._divisions())
        values = {tables.MV: self._filtered_mv, tables.MV_PER_V: self._filtered_mv / self._model.excitation_v}
        value = values.get(item.content, self._weight())
        return float(np.float32(value)) if item.kind == "float32" else value

    def _weight(self) -> float:
        """Return the load as the device reckons it from the cell's data, N."""
        model = self._model
        return self._filtered_mv / (model.ratio_mv_per_v * model.excitation_v) * model.full_scale

    def _divisions(self) -> int:
        return round(self._filtered_mv / self._model.mv_per_count)

    def _seneca_status(self) -> int:
        weight = self._weight()
        full = abs(self._held) >= LARGEST_CODE or (self._model.realistic and abs(weight) > self._model.full_scale)
        sign = tables.NET_BELOW_ZERO if self._table.negative_bit is None else 1 << self._table.negative_bit
        return tables.FULL_SCALE_REACHED * full | sign * (weight < 0)

    def _laumas_status(self) -> int:
        divisions = self._divisions()
        status = tables.CELL_ERROR * (abs(self._held) >= LARGEST_CODE)
        status |= (tables.GROSS_NEGATIVE | tables.NET_NEGATIVE) * (divisions < 0)
        if self._model.realistic:
            too_long = abs(divisions) > tables.LARGEST_SHOWN
            status |= (tables.GROSS_TOO_LONG | tables.NET_TOO_LONG) * too_long
            status |= tables.OVER_110_PERCENT * (self._weight() > 1.1 * self._model.full_scale)
            status |= tables.AT_ZERO * (divisions == 0)
        return status
