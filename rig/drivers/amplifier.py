"""Strain-gauge amplifier on Modbus: bridge voltage in mV, averaged over readings at a steady rate."""

from __future__ import annotations

import math

import numpy as np

from rig.drivers.driver import Driver
from rig.drivers.modbus import ModbusDevice
from rig.drivers.registers import (
    ONE_MAKER,
    PRESETS,
    Bridge,
    Register,
    RegisterMap,
    decode,
    fits,
    other_order,
    plausible,
    possible_signal,
    quantum_mv,
    signal_mv,
)
from rig.drivers.settings import Amplifier
from rig.drivers.transport import Transport
from rig.errors import DeviceError
from rig.interface import Clock, LoadCell
from rig.readings import LoadReading

DEVICE = "strain-gauge amplifier"
SMALLEST_COUNT = 2  # readings behind a mean: one alone does not show whether the gauge lives


class ModbusLoadCell(LoadCell, Driver):
    """The amplifier as a load cell.

    Parameters
    ----------
    transport
        Its port, not yet open.
    framing
        ``rtu`` or ``tcp``.
    settings
        Map, address, timing.
    clock
        Rig time.
    """

    def __init__(self, transport: Transport, framing: str, settings: Amplifier, clock: Clock) -> None:
        self.name = f"{DEVICE} on {transport.port}"
        self._transport = transport
        self._settings = settings
        self._clock = clock
        self._map: RegisterMap = settings.map()
        self.settling_s = settings.filter_settling_s()
        self._wire = ModbusDevice(transport, framing, settings.address, clock, settings.reply_timeout_s, settings.tries)
        self._bridge = Bridge(settings.cell_ratio_mv_per_v or math.nan, settings.cell_full_scale or math.nan)
        self._block = self._map.reading_block()

    def connect(self) -> str:
        """Open the port, and look whether the registers read like a bridge amplifier's.

        Raises
        ------
        DeviceError
            It is another device or model, the word order is the other one, or unit, ratio or full scale cannot be.
        """
        self._transport.open()
        known = [self._identity(), self._model(), self._unit(), self._ratio_and_full_scale(), self._rate()]
        self.round_trip_s = self._wire.reply_time.round_trip_s  # not known yet by a map that asks for little
        said = ", ".join(text for text in known if text)
        return f"{DEVICE} on {self._transport.port}: answers at address {self._settings.address}" + (
            f"; {said}" if said else ""
        )

    def close(self) -> None:
        """Close the port."""
        self._transport.close()

    def descriptor(self) -> int | None:
        """Return the descriptor of its open port, for whoever takes it over; None if it has none."""
        return self._transport.fileno()

    def read(self, duration_s: float = 0.1) -> LoadReading:
        """Average the bridge voltage of readings taken at ``readings_per_s`` (at least two) over ``duration_s``.

        A wire too slow for that rate gives fewer readings in the same time, and one where no time is given.

        Raises
        ------
        DeviceError
            The amplifier does not answer, or its status says that the reading is worth nothing.
        """
        rate = self._settings.readings_per_s
        self.round_trip_s = self._wire.reply_time.round_trip_s
        if duration_s == 0.0 and self.round_trip_s > 1 / rate:
            self.idle()  # which may take long: the operator may pause
            taken = self._clock.now()
            return LoadReading(taken, self._sample(), 0.0, 1, self._quantum_mv())
        start = self._clock.now()
        count = max(SMALLEST_COUNT, round(duration_s * rate))
        values: list[float] = []
        taken = start
        for i in range(count):
            due = start + (i + 1) / rate
            late = self._clock.now() - due
            if late > 1 / rate and (i < count - 1 or len(values) >= SMALLEST_COUNT):
                continue  # this turn is over; the next one is taken
            self.idle()
            self._clock.sleep(-late)
            taken = self._clock.now()  # before it is asked for: what is read is not older
            values.append(self._sample())
        while len(values) < SMALLEST_COUNT:
            taken = self._clock.now()
            values.append(self._sample())
        self._clock.sleep(start + max(duration_s, count / rate) - self._clock.now())
        samples = np.array(values)
        mean, spread = float(np.mean(samples)), float(np.std(samples, ddof=1))
        return LoadReading(taken, mean, spread, len(samples), self._quantum_mv())

    def _sample(self) -> float:
        """One bridge voltage, mV; NaN where the amplifier itself answers no number.

        A voltage that no bridge gives is an error: for a map without ratio and full scale it is the only sign of a
        wrong word order, and it shows before anything is moved, for the gauge is read first.
        """
        offset, count = self._block
        words = self._wire.read(self._map.table, offset, count)
        status = 0 if self._map.status is None else words[self._map.status - offset]
        for bit, meaning in self._map.troubles.items():
            if status >> bit & 1:
                raise self._error(meaning, "take the load off, then check the bridge's wiring and its range")
        first = self._map.signal.offset - offset
        signal = words[first : first + self._map.signal.words()]
        voltage = self._voltage_mv(signal, self._map.word_order)
        if not math.isfinite(voltage):
            return math.nan
        if not possible_signal(voltage, self._settings.excitation_v):
            raise self._impossible(voltage, self._voltage_mv(signal, other_order(self._map.word_order)))
        negative = self._map.negative_bit is not None and status >> self._map.negative_bit & 1
        return -voltage if negative else voltage

    def _quantum_mv(self) -> float:
        chosen = self._settings
        return chosen.division * quantum_mv(self._map, chosen.mv_per_count, chosen.excitation_v, self._bridge)

    def _voltage_mv(self, signal: list[int], word_order: str) -> float:
        value = decode(signal, self._map.signal.kind, word_order)
        return signal_mv(value, self._map, self._settings.mv_per_count, self._settings.excitation_v, self._bridge)

    def _impossible(self, voltage: float, otherwise: float) -> DeviceError:
        what = f"its signal reads {voltage:.4g} mV, which no bridge gives"
        if self._map.signal.words() > 1 and possible_signal(otherwise, self._settings.excitation_v):
            other = other_order(self._map.word_order)
            return self._error(
                f"{what}, but {otherwise:.4g} mV with the words the other way round",
                f"give its register map with word_order: {other} in rig.parts.load_cell.registers",
            )
        return self._error(what, "check the register map and mv_per_count in rig.parts.load_cell")

    # --- at connect -----------------------------------------------------------------------------------------

    def _identity(self) -> str:
        if self._map.identity is None:
            return ""
        number = self._word(self._map.identity)
        expected = self._settings.expected_id
        if expected is not None and number != expected:
            raise self._error(
                f"it says that it is number {number}, not the {expected} of rig.parts.load_cell.expected_id",
                "another device is plugged in here: exchange it, or correct the configuration",
            )
        firmware = "" if self._map.firmware is None else f", firmware {self._word(self._map.firmware)}"
        return f"id {number}{firmware}"

    def _model(self) -> str:
        """Refuse another model of the maker: nothing in its registers would be where it is looked for."""
        preset = self._settings.preset
        if preset not in ONE_MAKER or fits(self._map, self._word):
            return ""
        for other in ONE_MAKER:
            if other != preset and fits(PRESETS[other], self._word):
                raise self._error(
                    f"its registers read like those of a {other}, not of the {preset} that is configured",
                    f"give preset: {other} in rig.parts.load_cell, if that is what its label says",
                )
        return ""  # whichever register cannot be is named by the question that it belongs to

    def _unit(self) -> str:
        if self._map.unit is None:
            return ""
        code = self._word(self._map.unit)
        code = code >> 8 if self._map.unit_byte == "high" else code
        if code >= len(self._map.units):
            raise self._error(
                f"its unit reads {code}, which is none", "check that preset and address belong to this device"
            )
        return f"unit {self._map.units[code]}"

    def _ratio_and_full_scale(self) -> str:
        ratio, full_scale = self._map.ratio, self._map.full_scale
        if ratio is None or full_scale is None:
            return ""
        words = self._words(ratio), self._words(full_scale)
        order = self._map.word_order
        other = other_order(order)
        read = {
            way: (decode(words[0], ratio.kind, way), decode(words[1], full_scale.kind, way)) for way in (order, other)
        }
        if not plausible(*read[order]):
            if plausible(*read[other]):
                raise self._error(
                    f"cell ratio and full scale read {read[order][0]:.4g} and {read[order][1]:.4g}, but "
                    f"{read[other][0]:.4g} mV/V and {read[other][1]:.4g} with the words the other way round",
                    f"give its register map with word_order: {other} in rig.parts.load_cell.registers",
                )
            raise self._error(
                f"cell ratio and full scale read {read[order][0]:.4g} and {read[order][1]:.4g}, which no bridge has",
                "check that preset and address belong to this device, and that it was set up",
            )
        self._bridge = Bridge(*read[order])
        return f"{read[order][0]:g} mV/V at {read[order][1]:g}"

    def _rate(self) -> str:
        if self._map.adc_rate is None:
            return ""
        code = self._word(self._map.adc_rate)
        if code not in self._map.adc_rates_hz:
            raise self._error(
                f"its converter's rate reads {code}, which is none of {', '.join(map(str, self._map.adc_rates_hz))}",
                "check that preset and address belong to it",
            )
        rate = self._map.adc_rates_hz[code]
        if rate < self._settings.readings_per_s:
            raise self._error(
                f"its converter makes {rate:g} readings a second, fewer than the {self._settings.readings_per_s:g} "
                "asked for, so that readings would repeat and look frozen",
                "set a faster one in the amplifier, or lower rig.parts.load_cell.readings_per_s",
            )
        return f"{rate:g} readings/s"

    def _word(self, offset: int) -> int:
        return self._wire.read(self._map.table, offset, 1)[0]

    def _words(self, register: Register) -> list[int]:
        return self._wire.read(self._map.table, register.offset, register.words())

    def _error(self, what: str, check: str) -> DeviceError:
        return DeviceError(DEVICE, self._transport.port, what, check)
