"""Register tables of strain-gauge amplifiers as sold, from the makers' manuals.

Sources
-------
A
    Seneca Z-SG, User Manual MI002636, pages 17, 18 and 20; the others were not seen.
B
    Seneca Z-SG2, User Manual MI-005370-EN rev. 1.0.0.2, pages 38, 42 and 52; the others were not seen.
E
    Seneca ZE-SG3, MI00617-4-EN, by two public programs that quote its table.
F
    Seneca ZC-SG, User Manual, page 20: codes of the converter of the Z-SG's age.
L
    Laumas LCB, Modbus pages 3 and 45; Laumas TLU, manual page 30; Laumas TLB4, protocols manual rev. 1.03, as quoted.

docs/emulators.md tells for each register what a page confirms and what is taken from elsewhere or assumed.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field

UNIT_NEWTON = 5  # of the Seneca's list (B p. 42)
FULL_SCALE_REACHED, NET_BELOW_ZERO, STABLE = 1 << 1, 1 << 2, 1 << 4  # status of the Seneca (B p. 52)
READ_HOLDING, READ_INPUT = 3, 4
LARGEST_READ = 125  # registers, of the protocol

# what a register holds of the reading
NET, GROSS, TARE, STATUS = "net", "gross", "tare", "status"
INTEGER_NET, INTEGER_GROSS, RAW, FILTERED = "integer net", "integer gross", "raw", "filtered"
MV, MV_PER_V = "mv", "mv_per_v"  # of devices that a configuration describes
SIGNALS = (NET, GROSS, INTEGER_NET, INTEGER_GROSS, RAW, FILTERED, MV, MV_PER_V)


@dataclass(frozen=True, slots=True)
class Live:
    """Registers that follow the signal.

    Attributes
    ----------
    offset
        Of the first, counted from 0.
    content
        Which number.
    kind
        ``float32``, ``int32``, ``uint32``, ``int16`` or ``uint16``.
    """

    offset: int
    content: str
    kind: str


@dataclass(frozen=True, slots=True)
class Table:
    """What an amplifier keeps in its registers.

    Attributes
    ----------
    size
        Registers that there are; what is asked beyond is refused with exception 2. No page says what the holes are
        filled with: zeros are assumed.
    constants
        By offset.
    live
        Registers that follow the signal.
    ratio, full_scale
        Offsets of float32 with the cell's sensitivity, mV/V, and capacity; None where the page was not seen.
    identity
        Offset of the machine's number.
    status
        Whose bits: ``seneca`` or ``laumas``.
    functions
        Modbus functions that read.
    largest_read
        Registers in one request; more is refused with exception 3.
    rates_hz
        Conversions a second, by the code in ``rate``.
    rate, rate_code
        Offset of that code, and its value as delivered.
    response_s
        Time constant of its filter as delivered.
    word_order
        ``high_first`` or ``low_first``.
    negative_bit
        Of the status, where a described device tells magnitudes and the sign apart.
    """

    size: int
    constants: Mapping[int, int]
    live: tuple[Live, ...]
    ratio: int | None = None
    full_scale: int | None = None
    identity: int | None = 0
    status: str = "seneca"
    functions: tuple[int, ...] = (READ_HOLDING,)
    largest_read: int = LARGEST_READ
    rates_hz: Mapping[int, float] = field(default_factory=dict)
    rate: int | None = None
    rate_code: int = 0
    response_s: float = 0.0
    word_order: str = "high_first"
    negative_bit: int | None = None


IDENTITY = 14
"""Machine number. No page that was seen tells one: this stands in for all of them."""

FIRMWARE = 112
"""Firmware revision, likewise."""

SENECA_WEIGHTS = (
    Live(63, NET, "float32"),  # A p. 17; E
    Live(65, GROSS, "float32"),  # E
    Live(67, TARE, "float32"),  # E
    Live(69, INTEGER_NET, "int32"),  # E
    Live(71, INTEGER_GROSS, "int32"),  # E
    Live(73, TARE, "int32"),  # E
    Live(77, STATUS, "uint16"),  # B p. 52; E
)
ZE_SG3_RATES = {0: 960.0, 1: 300.0, 2: 150.0, 3: 100.0, 4: 60.0, 5: 12.0, 6: 4.7}  # E
Z_SG_RATES = {27: 151.71, 55: 74.46, 82: 49.95, 109: 37.59, 155: 50.57, 183: 24.82, 210: 16.65, 237: 12.53}  # F p. 20
NEWTON, ONE_THOUSANDTH = 4, 15  # Laumas: unit in the high byte of register 13, division in the low one; assumed

TABLES = {
    # E: unit 2, unipolar 3, ratio 13, full scale 15, conversions 33 (34 by one of the two programs), noise filter 42
    # (3: 30 ms by one, 100 ms by the other), resolution 43 (2: all 24 bits), raw and filtered conversion 91 and 93
    "ze-sg3": Table(
        size=128,
        constants={1: FIRMWARE, 2: UNIT_NEWTON, 3: 0, 42: 3, 43: 2},
        live=(*SENECA_WEIGHTS, Live(91, RAW, "int32"), Live(93, FILTERED, "int32")),
        ratio=13,
        full_scale=15,
        rates_hz=ZE_SG3_RATES,
        rate=33,
        rate_code=3,
        response_s=0.030,
    ),
    # A p. 20: 51 threshold 5000, 53 delta weight 1, 55 delta time 1, 57 resolution, 58 conversions, 0x0052 as sold;
    # p. 18: reads by functions 3 and 4. The pages with unit, cell ratio, full scale and filter were not seen
    "z-sg": Table(
        size=80,
        constants={1: FIRMWARE, 51: 0x459C, 52: 0x4000, 53: 0x3F80, 54: 0, 55: 1, 57: 0},
        live=SENECA_WEIGHTS,
        functions=(READ_HOLDING, READ_INPUT),
        rates_hz=Z_SG_RATES,
        rate=58,
        rate_code=0x52,
    ),
    # B p. 42: unit in the high byte of 2, 0 for bipolar in the low one, station and parity in 3; function 3
    "z-sg2": Table(
        size=128,
        constants={1: FIRMWARE, 2: UNIT_NEWTON << 8, 3: 1 << 8},
        live=SENECA_WEIGHTS,
        rates_hz={0: 100.0},
        response_s=0.030,
    ),
    # L: positive whole numbers without a decimal point, signs and errors in 6, units and divisions in 13; functions 3
    # and 16; 32 registers a request
    "tlb": Table(
        size=64,
        constants={0: FIRMWARE, 2: 2024, 3: 1, 4: 1, 13: NEWTON << 8 | ONE_THOUSANDTH},
        live=(Live(6, STATUS, "uint16"), Live(7, GROSS, "uint32"), Live(9, NET, "uint32")),
        identity=1,
        status="laumas",
        largest_read=32,
        rates_hz={0: 12.5},
        response_s=0.85,
    ),
}

# status of the Laumas (L, LCB page 3)
CELL_ERROR, CONVERTER_ERROR, NINE_DIVISIONS_OVER, OVER_110_PERCENT = 1 << 0, 1 << 1, 1 << 2, 1 << 3
GROSS_TOO_LONG, NET_TOO_LONG, GROSS_NEGATIVE, NET_NEGATIVE = 1 << 4, 1 << 5, 1 << 7, 1 << 8
WEIGHT_STABLE, AT_ZERO = 1 << 11, 1 << 12
LARGEST_SHOWN = 999999

FORMATS = {"float32": ">f", "int32": ">i", "uint32": ">I", "int16": ">h", "uint16": ">H"}
BOUNDS = {
    "int32": (-(2**31), 2**31 - 1),
    "uint32": (0, 2**32 - 1),
    "int16": (-(2**15), 2**15 - 1),
    "uint16": (0, 65535),
}


def words_of(value: float, kind: str, word_order: str = "high_first") -> list[int]:
    """Return a number as registers; whole ones are rounded and stay within their bounds."""
    if kind in BOUNDS:
        low, high = BOUNDS[kind]
        value = min(max(round(value), low), high)
    words = [word for (word,) in struct.iter_unpack(">H", struct.pack(FORMATS[kind], value))]
    return words if word_order == "high_first" else words[::-1]
