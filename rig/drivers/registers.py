"""Register maps of strain-gauge amplifiers as data: where each quantity stands, and how it is written.

Offsets are zero-based. What the presets say is from the makers' manuals and from public drivers, named beside each;
where those are thin or contradict themselves (the word order of the Seneca), what was read is held against what a
bridge can be when the device connects. docs/hardware.md lists what could not be verified.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from rig.errors import DeviceError, NoAnswer
from rig.section import Positive, Section

Offset = Annotated[int, Field(ge=0, le=65534)]
Kind = Literal["uint16", "int16", "int32", "uint32", "float32"]
WORDS: dict[str, int] = {"uint16": 1, "int16": 1, "int32": 2, "uint32": 2, "float32": 2}
FORMATS = {"int32": ">i", "uint32": ">I", "float32": ">f"}
LARGEST_BLOCK = 120  # registers that one request may ask for (Modbus allows 125)

LONGEST_SETTLING_S = 5.0  # a load that nobody sees for longer is no load under watch

RATIOS_MV_PER_V = (0.05, 50.0)  # sensitivities that bridges have
FULL_SCALES = (1e-6, 1e7)  # of any load cell in any unit
SMALLEST_SIGNAL_MV = 1e-9  # but for zero: below it is a float32 whose words are the wrong way round


class Register(Section):
    """One quantity: the offset of its first register, and its type."""

    offset: Offset
    kind: Kind

    def words(self) -> int:
        """Return how many registers it takes."""
        return WORDS[self.kind]


class Mark(Section):
    """A register whose two bytes lie within these bounds in every device of the model, and hardly in another."""

    offset: Offset
    high: tuple[int, int] = (0, 255)
    low: tuple[int, int] = (0, 255)

    def fits(self, word: int) -> bool:
        """Whether the register can read so."""
        return self.high[0] <= word >> 8 <= self.high[1] and self.low[0] <= word & 0xFF <= self.low[1]


class RegisterMap(Section):
    """Where an amplifier keeps what the driver needs.

    ``signal_is`` says what the signal register holds: ``counts`` of the converter (times ``mv_per_count``), ``mv``,
    ``mv_per_v`` (times ``excitation_v``), or ``load`` (over the full scale, times ratio and ``excitation_v``).
    ``quantum`` is the smallest step of a signal that the amplifier itself rounds (of a load: as a share of the full
    scale); such a signal may stand still while the gauge lives. ``troubles`` are the status bits that make a reading
    worthless, with a sentence each; ``negative_bit`` is the one that holds the sign of an unsigned signal. The rates
    are given by their code, or as a list from code 0 on. ``marks`` tell the model from others of its maker.
    ``settling_s`` is the time in which its filter, as delivered, has followed a step but for a third.
    """

    table: Literal["holding", "input"] = "holding"
    word_order: Literal["high_first", "low_first"] = "high_first"
    signal: Register
    signal_is: Literal["counts", "mv", "mv_per_v", "load"] = "counts"
    status: Offset | None = None
    troubles: dict[Annotated[int, Field(ge=0, le=15)], str] = Field(default_factory=dict)
    negative_bit: Annotated[int, Field(ge=0, le=15)] | None = None
    identity: Offset | None = None
    firmware: Offset | None = None
    marks: tuple[Mark, ...] = ()
    quantum: Positive | None = None
    unit: Offset | None = None
    unit_byte: Literal["low", "high"] = "low"
    units: tuple[str, ...] = ()
    ratio: Register | None = None
    full_scale: Register | None = None
    adc_rate: Offset | None = None
    adc_rates_hz: dict[int, float] = Field(default_factory=dict)
    settling_s: Annotated[float, Field(ge=0, le=LONGEST_SETTLING_S)] = 0.0

    @field_validator("adc_rates_hz", mode="before")
    @classmethod
    def _by_code(cls, rates: Any) -> Any:
        return dict(enumerate(rates)) if isinstance(rates, list | tuple) else rates

    @model_validator(mode="after")
    def _whole(self) -> RegisterMap:
        if (self.ratio is None) != (self.full_scale is None):
            raise ValueError("ratio and full_scale are of use only together")
        if (self.troubles or self.negative_bit is not None) and self.status is None:
            raise ValueError("troubles and negative_bit are bits of the register status, which is not given")
        if self.reading_block()[1] > LARGEST_BLOCK:
            raise ValueError(f"signal and status are more than {LARGEST_BLOCK} registers apart: one request cannot")
        return self

    def reading_block(self) -> tuple[int, int]:
        """Return offset and number of the registers that one reading takes: signal and status in one request."""
        low, high = self.signal.offset, self.signal.offset + self.signal.words()
        if self.status is not None:
            low, high = min(low, self.status), max(high, self.status + 1)
        return low, high - low


SENECA_UNITS = ("kg", "g", "t", "lb", "l", "N", "bar", "atm", "other")  # Z-SG2 manual MI-005370 p. 42; ZE-SG3 scripts
SENECA_NET, SENECA_GROSS = 63, 65  # float32; net: Z-SG manual MI002636 p. 17, both: ZE-SG3 scripts
SENECA_STATUS = 77  # Z-SG2 manual p. 52; ZE-SG3 scripts
FULL_SCALE_REACHED = {1: "its full scale is reached"}  # Z-SG2 manual p. 52
POINTS_30000 = 1 / 30000  # of its full scale: what its weight can be rounded to, manuals of Z-SG and ZC-SG, p. 20

# two independent public drivers of it, both by its manual MI00617: H. Rahman's ZESG3 class, and the constants of the
# "ZE-SG3 Torque Acquisition"; they differ in the place of the rate (33 and 34: 34 is half of a float32 in the former)
SENECA_ZE_SG3 = RegisterMap(
    signal=Register(offset=93, kind="int32"),  # filtered; 91 is not
    signal_is="counts",
    status=SENECA_STATUS,
    troubles=FULL_SCALE_REACHED,
    identity=0,
    firmware=1,
    marks=(Mark(offset=2, high=(0, 0), low=(0, 8)), Mark(offset=3, high=(0, 0), low=(0, 1))),  # unit; unipolar
    unit=2,
    units=SENECA_UNITS,
    ratio=Register(offset=13, kind="float32"),
    full_scale=Register(offset=15, kind="float32"),
    adc_rate=33,
    adc_rates_hz={0: 960.0, 1: 300.0, 2: 150.0, 3: 100.0, 4: 60.0, 5: 12.0, 6: 4.7},
)
# no raw signal is known of these two: their gross weight is the signal, for a tare does not shift it
SENECA_Z_SG = RegisterMap(
    signal=Register(offset=SENECA_GROSS, kind="float32"),
    signal_is="load",
    quantum=POINTS_30000,
    identity=0,
    firmware=1,
    adc_rate=58,  # manual MI002636 p. 20, default 0x0052
    adc_rates_hz={  # codes of the ZC-SG, manual p. 20, where 82 (0x52) is the default too
        27: 151.71,
        55: 74.46,
        82: 49.95,
        109: 37.59,
        155: 50.57,
        183: 24.82,
        210: 16.65,
        237: 12.53,
    },
)
SENECA_Z_SG2 = RegisterMap(
    signal=Register(offset=SENECA_GROSS, kind="float32"),
    signal_is="load",
    quantum=POINTS_30000,
    status=SENECA_STATUS,
    troubles=FULL_SCALE_REACHED,
    identity=0,
    firmware=1,
    # manual MI-005370 p. 42: unit and unipolar; Modbus station and parity
    marks=(Mark(offset=2, high=(0, 8), low=(0, 1)), Mark(offset=3, high=(1, 247), low=(0, 2))),
    unit=2,
    unit_byte="high",
    units=SENECA_UNITS,
)
# offsets 0 to 9: LAUMAS TLU manual p. 30, TLB4 protocols manual. Weights are magnitudes, their signs stand in the
# status; no raw signal: a weight of whole divisions is the signal
LAUMAS = RegisterMap(
    signal=Register(offset=7, kind="uint32"),
    signal_is="counts",
    quantum=1.0,
    settling_s=0.85,  # 12.5 conversions a second, filtered: not confirmed by a page
    status=6,
    troubles={
        0: "it reports a load-cell error",
        1: "it reports a failure of its converter",
        2: "the load is past its largest weight",
        3: "the load is past 110 % of its full scale",
        4: "the load is past what it can show",
    },
    negative_bit=7,
    identity=1,
    firmware=0,
)
PRESETS: dict[str, RegisterMap] = {
    "seneca-z-sg": SENECA_Z_SG,
    "seneca-z-sg2": SENECA_Z_SG2,
    "seneca-ze-sg3": SENECA_ZE_SG3,
    "laumas-tlb": LAUMAS,
}
ONE_MAKER = ("seneca-z-sg", "seneca-z-sg2", "seneca-ze-sg3")
"""Presets that are easily taken for each other."""


@dataclass(frozen=True, slots=True)
class Bridge:
    """What the amplifier was set to, as far as its map says."""

    ratio_mv_per_v: float = math.nan
    full_scale: float = math.nan


def fits(settings_map: RegisterMap, word: Callable[[int], int]) -> bool:
    """Whether a device reads like those of this map, as far as the map tells them from others.

    ``word`` returns the register at an offset; a device that has no such register does not.

    Raises
    ------
    NoAnswer
        It does not answer at all.
    """
    try:
        return _fits(settings_map, word)
    except NoAnswer:
        raise
    except DeviceError:
        return False


def _fits(settings_map: RegisterMap, word: Callable[[int], int]) -> bool:
    if settings_map.adc_rate is not None and word(settings_map.adc_rate) not in settings_map.adc_rates_hz:
        return False
    return all(mark.fits(word(mark.offset)) for mark in settings_map.marks)


def decode(words: Sequence[int], kind: Kind, word_order: str) -> float:
    """Return the number that registers hold.

    Parameters
    ----------
    words
        As many 16-bit registers as the kind takes.
    kind
        Type of the number.
    word_order
        ``high_first`` or ``low_first``; of no meaning for one register.

    Raises
    ------
    ValueError
        If there are too few or too many registers, or one is no 16-bit number.
    """
    if len(words) != WORDS[kind] or not all(0 <= word <= 0xFFFF for word in words):
        raise ValueError(f"{list(words)} are not the registers of a {kind}")
    if kind == "uint16":
        return words[0]
    if kind == "int16":
        return words[0] - 0x10000 if words[0] & 0x8000 else words[0]
    high, low = (words[0], words[1]) if word_order == "high_first" else (words[1], words[0])
    value: float = struct.unpack(FORMATS[kind], struct.pack(">HH", high, low))[0]
    return value


def encode(value: float, kind: Kind, word_order: str) -> tuple[int, ...]:
    """Return the registers of a number; the inverse of `decode`, integers rounded to the nearest."""
    if kind in ("uint16", "int16"):
        return (round(value) & 0xFFFF,)
    number = value if kind == "float32" else round(value)
    high, low = struct.unpack(">HH", struct.pack(FORMATS[kind], number))
    return (high, low) if word_order == "high_first" else (low, high)


def plausible(ratio_mv_per_v: float, full_scale: float) -> bool:
    """Whether a bridge can have this ratio, mV/V, and this full scale, in any unit."""
    return RATIOS_MV_PER_V[0] <= ratio_mv_per_v <= RATIOS_MV_PER_V[1] and FULL_SCALES[0] <= full_scale <= FULL_SCALES[1]


def possible_signal(voltage_mv: float, excitation_v: float) -> bool:
    """Whether a bridge can give this voltage, mV: none gives more than its largest ratio times its supply."""
    size = abs(voltage_mv)
    return size <= RATIOS_MV_PER_V[1] * excitation_v and (size == 0.0 or size >= SMALLEST_SIGNAL_MV)


def other_order(word_order: str) -> str:
    """Return the word order that is not this one."""
    return "low_first" if word_order == "high_first" else "high_first"


def signal_mv(value: float, settings_map: RegisterMap, mv_per_count: float, excitation_v: float, cell: Bridge) -> float:
    """Return the bridge voltage, mV, behind a number of the signal register; NaN stays NaN."""
    if settings_map.signal_is == "counts":
        return value * mv_per_count
    if settings_map.signal_is == "mv":
        return value
    if settings_map.signal_is == "mv_per_v":
        return value * excitation_v
    return value / cell.full_scale * cell.ratio_mv_per_v * excitation_v


def quantum_mv(settings_map: RegisterMap, mv_per_count: float, excitation_v: float, cell: Bridge) -> float:
    """Return the smallest step of a signal that the amplifier rounds, mV; 0 where it does not."""
    if settings_map.quantum is None:
        return 0.0
    step = settings_map.quantum * (cell.full_scale if settings_map.signal_is == "load" else 1.0)
    return abs(signal_mv(step, settings_map, mv_per_count, excitation_v, cell))
