"""What the catalogue holds of a session: its names, how it stands, and what its answers say, load by load."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

COMPLETE, UNFINISHED = "complete", "unfinished"
DAMAGED, FOREIGN, MOVED, GONE = "damaged", "other format", "moved", "gone"
STATES = (COMPLETE, UNFINISHED, DAMAGED, FOREIGN, MOVED, GONE)
VERDICTS = ("consistent", "missing_physics", "new_physics", "unexplained")
"""Of a diagnosis; see `analysis.mismatch.answer`."""

UNREADABLE = (DAMAGED, FOREIGN, MOVED, GONE)
"""States of a session of which nothing can be said but why."""


@dataclass(frozen=True, slots=True)
class Found:
    """A number with the ends of its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class LoadEntry:
    """One load of a session, as its results say; None where they do not.

    Loads in mN, frequencies in Hz, stiffness in N/m, damping in N s/m; damping ratios as they are.
    """

    load_set: int
    target_load_mn: float | None
    impacts_used: int
    load_mn: Found | None
    f1_hz: Found | None
    f2_hz: Found | None
    zeta1: Found | None
    zeta2: Found | None
    contact_stiffness_n_per_m: Found | None
    contact_damping_n_s_per_m: Found | None


@dataclass(frozen=True, slots=True)
class MechanismEntry:
    """A mechanism that a diagnosis names."""

    id: str
    probability: float
    statement: str


@dataclass(frozen=True, slots=True)
class Entry:
    """A session in the catalogue.

    Attributes
    ----------
    path
        Of the session's folder, or of a session file that lies by itself; absolute.
    state, reason
        One of the states above; why, where it is not ``complete``, and which records cannot be read.
    stands, goes_on
        Where a session's folder stands by its journal, and where it goes on when it is resumed.
    format
        Of the file or folder, with its version.
    sha256
        Of the session file, or of header and journal of a session that has none yet.
    answer, diagnosis
        Files beside the session that the numbers and the verdict were taken from; empty without one.
    k1_n_per_m, k2_n_per_m
        Tube springs by the results (measured through the system mode, or declared), else by the session's header.
    slope_mv_per_mn, zero_mv
        Of the strain gauge midway between its calibrations.
    noise_m_s2
        Of the accelerometers before a tap, RMS, the median of the accepted taps.
    notes
        What was there and could not be used.
    """

    path: str
    name: str
    state: str
    reason: str = ""
    stands: str = ""
    goes_on: str = ""
    created: str = ""
    operator: str = ""
    specimen: str = ""
    title: str = ""
    software: str = ""
    format: str = ""
    sha256: str = ""
    simulated: bool = False
    taps: int = 0
    accepted: int = 0
    answer: str = ""
    diagnosis: str = ""
    verdict: str = ""
    drifted: bool | None = None
    k1_n_per_m: float | None = None
    k2_n_per_m: float | None = None
    slope_mv_per_mn: float | None = None
    zero_mv: float | None = None
    f1_hz: float | None = None
    noise_m_s2: float | None = None
    notes: tuple[str, ...] = ()
    mechanisms: tuple[MechanismEntry, ...] = ()
    loads: tuple[LoadEntry, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return everything as JSON types."""
        own = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("notes", "mechanisms", "loads")}
        return {
            **own,
            "notes": list(self.notes),
            "mechanisms": [asdict(m) for m in self.mechanisms],
            "loads": [_load_json(load) for load in self.loads],
        }


def entry_from(kept: dict[str, Any]) -> Entry:
    """Return the entry that `Entry.as_json` made."""
    loads = tuple(_load_from(load) for load in kept["loads"])
    mechanisms = tuple(MechanismEntry(**m) for m in kept["mechanisms"])
    return Entry(**{**kept, "notes": tuple(kept["notes"]), "mechanisms": mechanisms, "loads": loads})


def _load_from(kept: dict[str, Any]) -> LoadEntry:
    made: dict[str, Any] = {k: Found(**v) if isinstance(v, dict) else v for k, v in kept.items()}
    return LoadEntry(**made)


def _load_json(load: LoadEntry) -> dict[str, Any]:
    made = {}
    for name in LoadEntry.__slots__:
        value = getattr(load, name)
        made[name] = {"value": value.value, "low": value.low, "high": value.high} if isinstance(value, Found) else value
    return made
