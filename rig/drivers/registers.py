"""Register maps of strain-gauge amplifiers as data: where each quantity stands, and how it is written.

Offsets are zero-based. The presets come from the makers' manuals; where a manual is thin or contradicts itself (the
word order of the Seneca), what was read is held against what a bridge can be when the device connects.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, model_validator

from rig.section import Section

Offset = Annotated[int, Field(ge=0, le=65534)]
Kind = Literal["uint16", "int16", "int32", "uint32", "float32"]
WORDS: dict[str, int] = {"uint16": 1, "int16": 1, "int32": 2, "uint32": 2, "float32": 2}
FORMATS = {"int32": ">i", "uint32": ">I", "float32": ">f"}
LARGEST_BLOCK = 120  # registers that one request may ask for (Modbus allows 125)

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


class RegisterMap(Section):
    """Where an amplifier keeps what the driver needs.

    ``signal_is`` says what the signal register holds: ``counts`` of the converter (times ``mv_per_count``), ``mv``,
    ``mv_per_v`` (times ``excitation_v``), or ``load`` (over the full scale, times ratio and ``excitation_v``).
    ``troubles`` are the status bits that make a reading worthless, with a sentence each; ``negative_bit`` is the one
    that holds the sign of an unsigned signal.
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
    unit: Offset | None = None
    units: tuple[str, ...] = ()
    ratio: Register | None = None
    full_scale: Register | None = None
    adc_rate: Offset | None = None
    adc_rates_hz: tuple[float, ...] = ()

    @model_validator(mode="after")
    def _whole(self) -> RegisterMap:
        if self.signal_is == "load" and (self.ratio is None or self.full_scale is None):
            raise ValueError("a signal that is a load needs the registers ratio and full_scale")
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


SENECA = RegisterMap(
    signal=Register(offset=93, kind="int32"),
    signal_is="counts",
    status=77,
    troubles={1: "its full scale is reached"},
    identity=0,
    firmware=1,
    unit=2,
    units=("kg", "g", "t", "lb", "l", "N", "bar", "atm", "other"),
    ratio=Register(offset=13, kind="float32"),
    full_scale=Register(offset=15, kind="float32"),
    adc_rate=33,
    adc_rates_hz=(960.0, 300.0, 150.0, 100.0, 60.0, 12.0, 4.7),
)
# weights are magnitudes, their signs stand in the status; no raw signal: a weight of whole divisions is the signal
LAUMAS = RegisterMap(
    signal=Register(offset=7, kind="uint32"),
    signal_is="counts",
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
PRESETS: dict[str, RegisterMap] = {"seneca-z-sg": SENECA, "seneca-ze-sg3": SENECA, "laumas-tlb": LAUMAS}


@dataclass(frozen=True, slots=True)
class Bridge:
    """What the amplifier was set to, as far as its map says."""

    ratio_mv_per_v: float = math.nan
    full_scale: float = math.nan


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
