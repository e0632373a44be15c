"""Recordings whose numbers are probably not what they seem: what is usual, what else they may be."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.rig_description import DescribedRig
from daq.bounds import COUNTS
from daq.exchange import Recording
from daq.exchange.units import to_si
from daq.records import Session
from mesotap.configuration.usual import LOAD as LOADS
from mesotap.configuration.usual import MASS, STIFFNESS, Usual
from sim_backend.arrangement import LOAD

SLOWEST: Final = 1000.0  # Hz, of a sampling rate below which no contact resonance of the tester is seen
BEYOND_FULL_SCALE: Final = 3.0
"""Times the full scale of /rig, the smaller of two channels, that no record reaches: accelerometers of a pair differ by
less, and a unit that is mistaken for another by more (g by 9.8, mm/s2 by 1000)."""
NAMED: Final = 5  # channels with the same remark that are listed

ACCELERATION: Final = Usual(1e-4, 1e6, "m/s2", (("g", 9.80665), ("mm/s2", 1e-3), ("um/s2", 1e-6), ("nm/s2", 1e-9)))
OF_UNIT: Final = {
    "m/s2": ACCELERATION,
    "m/s": Usual(1e-8, 1e3, "m/s", (("mm/s", 1e-3), ("um/s", 1e-6), ("nm/s", 1e-9))),
    "m": Usual(1e-12, 10.0, "m", (("mm", 1e-3), ("um", 1e-6), ("nm", 1e-9), ("pm", 1e-12))),
    "V": Usual(1e-7, 1e3, "V", (("mV", 1e-3), ("uV", 1e-6), ("steps of a 16-bit converter of 10 V", 20 / 2**16))),
    "N": Usual(1e-6, 1e7, "N", (("mN", 1e-3), ("uN", 1e-6), ("kN", 1e3))),
}
"""Usual largest magnitudes of a channel: from the noise of good sensors to what testing machines reach."""
OF_THE_RIG: Final = {"m1_kg": MASS, "m2_kg": MASS, "k1_n_per_m": STIFFNESS, "k2_n_per_m": STIFFNESS}
LEAST_OF_SCALE: Final = 1e-3  # of its full scale, that a tap reaches which is seen at all
SAID_OF_SESSIONS: Final = ("rig.masses.m", "rig.springs.k", "rig.wiring.sample_rate_hz", "mesotap.load_plan_mn")
"""Keys of a configuration whose values a session file has too."""
ANY_UNIT: Final = Usual(1e-12, 1e12, "of its unit")
PREFIXES: Final = {"k": 1e3, "m": 1e-3, "u": 1e-6, "µ": 1e-6, "n": 1e-9}


def recording_remarks(recording: Recording, rate: bool = True) -> list[str]:
    """Return in sentences what is unusual about a recording by another program.

    Parameters
    ----------
    rate
        Whether a low sampling rate is told: not where a description says how fast the rig is.
    """
    units = recording.units or (recording.unit,) * len(recording.names)
    said = channel_remarks(recording.names, units, [recording.data])
    if rate and recording.rate_hz < SLOWEST:
        said.append(slow(recording.rate_hz))
    return [f"{recording.source}: {one}" for one in said]


def session_remarks(session: Session) -> list[str]:
    """Return in sentences, with the session's name, what is unusual about its accelerations, loads and declared rig."""
    return [f"{session.source}: {one}" for one in unusual_in(session)]


def analysis_remarks(session: Session, configured: Sequence[str]) -> tuple[str, ...]:
    """Return what is unusual about a session that is analysed, and about the configuration that it is analysed with.

    Parameters
    ----------
    configured
        What is unusual about the configuration; what the session says by itself is not said twice.
    """
    others = [one for one in configured if not one.removeprefix("the largest of ").startswith(SAID_OF_SESSIONS)]
    return (*unusual_in(session), *others)


def unusual_in(session: Session) -> list[str]:
    """Return `session_remarks` without the session's name."""
    taps = [i.acceleration for i in session.impacts]
    said = channel_remarks(("A", "B"), ("m/s2", "m/s2"), taps) if taps else []
    rates = {i.sample_rate_hz for i in session.impacts} if session.rig.is_tester else set()
    said += [slow(rate, session.rig.lowpass_hz) for rate in sorted(rates) if rate < SLOWEST]
    if session.rig.is_tester:
        declared = {key: getattr(session.rig, key) for key in OF_THE_RIG}
        said += [OF_THE_RIG[key].remark(f"{key} of /rig", value) for key, value in declared.items()]
        loads = [abs(i.target_load_mn) for i in session.impacts if math.isfinite(i.target_load_mn)]
        said.append(LOADS.remark("the largest target_load_mn", max(loads, default=0.0)))
        said.append(_beyond_full_scale(session))
    return [one for one in said if one]


def _beyond_full_scale(session: Session) -> str:
    """Say that accelerations are larger than the recorder can hold, as declared; empty where they are not."""
    full_scale, largest = session.rig.full_scale_m_s2, 0.0
    for impact in session.impacts:
        largest = max(largest, float(np.abs(impact.acceleration).max()))
    if not largest > BEYOND_FULL_SCALE * full_scale:
        return ""
    meant = [
        f"{unit} ({largest * of:g} m/s2)"
        for unit, of in ACCELERATION.others
        if largest * of <= full_scale and largest * of >= LEAST_OF_SCALE * full_scale
    ]
    other = f"they may be {' or '.join(meant)}, or " if meant else ""
    return (
        f"accelerations reach {largest:g} m/s2, {largest / full_scale:.3g} times the full scale of "
        f"{full_scale:g} m/s2 that /rig declares: {other}full_scale_m_s2 or a sensitivity is wrong"
    )


def refused_records(session: Session) -> list[str]:
    """Return a sentence for each record of a session's file that could not be read and is left out."""
    return [f"{session.source}: {one}" for one in session.refused]


def slow(rate_hz: float, lowpass_hz: float = math.nan) -> str:
    """Say what a low sampling rate cannot show, what else it may be, and what rate a filter needs."""
    needed = f"; its low-pass of {lowpass_hz:g} Hz needs at least {2 * lowpass_hz:g} Hz" if lowpass_hz > 0 else ""
    return (
        f"is sampled at {rate_hz:g} Hz and shows nothing above {rate_hz / 2:g} Hz; contact resonances of the tester "
        f"lie at 1 to 10 kHz, usual rates are 5 kHz to 5 MHz: if {rate_hz:g} kHz is meant, give {1e3 * rate_hz:g} Hz; "
        f"it may also be another quantity, such as the step in us{needed}"
    )


def rig_remarks(rig: DescribedRig, recording: Recording) -> list[str]:
    """Return in sentences which modes of a rig, as declared, a recording is sampled too slowly to show."""
    a = rig.arrangement
    values = {p.name: p.value for p in a.parameters if p.scope != LOAD}
    wanted = [*a.masses, *(e.stiffness for e in a.elements if e.stiffness is not None)]
    if any(not values.get(name, math.nan) > 0 for name in wanted):
        return []
    modes = a.undamped_hz({k: 0.0 if math.isnan(v) else v for k, v in values.items()})
    beyond = sorted(float(f) for f in modes if f > recording.rate_hz / 2)
    if not beyond:
        return []
    listed = ", ".join(f"{f:.4g}" for f in beyond[:NAMED])
    return [
        f"{recording.source}: is sampled at {recording.rate_hz:g} Hz and shows nothing above {recording.rate_hz / 2:g} "
        f"Hz, but {rig.name} as described has modes at {listed} Hz: if {recording.rate_hz:g} kHz is meant, give "
        f"'recording: {{rate_hz: {1e3 * recording.rate_hz:g}}}'; else check masses (kg) and stiffnesses (N/m)"
    ]


def channel_remarks(names: Sequence[str], units: Sequence[str], taps: Iterable[NDArray[np.float64]]) -> list[str]:
    """Return what is unusual about channels: their size, and whether they ever change.

    Parameters
    ----------
    taps
        Arrays (c, n) that belong together; what is told is true of all of them.
    """
    low, high = np.full(len(names), math.inf), np.full(len(names), -math.inf)
    changes = np.zeros(len(names), np.bool_)
    for data in taps:
        low, high = np.minimum(low, data.min(axis=1)), np.maximum(high, data.max(axis=1))
        changes |= np.ptp(data, axis=1) > 0
    zero = [n for n, a, b in zip(names, low, high, strict=True) if a == b == 0]
    still = [n for n, c in zip(names, changes, strict=True) if not c and n not in zero]
    said = []
    if zero:
        said.append(f"{_channels(zero)} zero throughout: not connected, muted, or not recorded at all")
    if still:
        said.append(
            f"{_channels(still)} constant: not connected, stuck at the end of its range, or a column of set values"
        )
    for name, unit, largest in zip(names, units, np.maximum(np.abs(low), np.abs(high)), strict=True):
        if name not in zero and (remark := size_remark(name, unit, float(largest))):
            said.append(remark)
    return said


def size_remark(name: str, unit: str, largest: float) -> str:
    """Return what a channel's largest magnitude may mean if it is unusual; else nothing.

    Examples
    --------
    >>> size_remark("acc", "m/s2", 3.0)
    ''
    >>> size_remark("acc", "m/s2", 4e7)
    'channel acc reaches 4e+07 m/s2; usual is 0.0001 to 1e+06 m/s2: they may be mm/s2 (40000 m/s2) or um/s2 (40 m/s2)'
    """
    usual, factor = _usual(unit)
    value = factor * largest
    if usual.least <= value <= usual.most:
        return ""
    others = [f"{u} ({value * of:g} {usual.unit})" for u, of in usual.others if usual.least <= value * of <= usual.most]
    shown = unit or "of its unit"
    if others:
        meant = f"they may be {' or '.join(others[:2])}"
    elif value > usual.most:
        meant = COUNTS
    else:
        meant = "they may be scaled twice, or the noise of a channel that is not connected"
    return (
        f"channel {name} reaches {largest:g} {shown}; usual is {usual.least / factor:g} to {usual.most / factor:g} "
        f"{shown}: {meant}"
    )


def _usual(unit: str) -> tuple[Usual, float]:
    """Return what is usual of a unit, and what one of it is in the unit of that."""
    plain, factor = to_si(unit)
    if plain in OF_UNIT:
        return OF_UNIT[plain], factor
    if plain[:1] in PREFIXES and plain[1:] in OF_UNIT:
        return OF_UNIT[plain[1:]], PREFIXES[plain[0]]
    return ANY_UNIT, 1.0


def _channels(names: Sequence[str]) -> str:
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return f"channel {names[0]} is" if len(names) == 1 else f"channels {', '.join(names[:NAMED])}{more} are"
