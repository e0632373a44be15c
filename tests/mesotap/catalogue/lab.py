"""Sessions for tests of the catalogue: entries without files, and files with answers of stated numbers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from daq.records import CalibrationPoints, Impact, RigDescription, Session
from daq.session_file import write_session
from mesotap.catalogue.entry import Entry, Found, LoadEntry, MechanismEntry
from mesotap.catalogue.store import Kept

NOISE = 0.002
SLOPE, ZERO = 0.042, 0.35


def found(value: float) -> Found:
    return Found(value, 0.99 * value, 1.01 * value)


def load(number: int, load_mn: float, k_c: float, zeta: float = 0.01) -> LoadEntry:
    return LoadEntry(
        number,
        load_mn,
        8,
        found(load_mn),
        found(356.0),
        found(2000.0),
        found(1e-4),
        found(zeta),
        found(k_c),
        found(2.0),
    )


def entry(name: str, *loads: LoadEntry, state: str = "complete", mechanism: str = "", **more) -> Entry:
    named = (MechanismEntry(mechanism, 0.98, "the contact opens"),) if mechanism else ()
    return Entry(f"/lab/{name}", name, state, loads=loads, mechanisms=named, **{"sha256": name, **more})


def kept(*entries: Entry) -> list[Kept]:
    return [Kept("", one) for one in entries]


def session(specimen: str = "steel", created: str = "2026-03-01T10:00:00Z", seed: int = 1, **more) -> Session:
    noise = np.random.default_rng(seed)
    weights = np.array([0.0, 500.0, 1000.0])
    points = CalibrationPoints(weights, ZERO + SLOPE * weights, created)
    impact = Impact(
        **{"number": 0, "load_set": 0, "target_load_mn": 300.0, "load_before_mn": 300.0, "load_after_mn": 300.0},
        **{"time": created, "sample_rate_hz": 25000.0, "pretrigger": 2000, "accepted": True},
        acceleration=NOISE * noise.standard_normal((2, 3000)),
    )
    rig = RigDescription(0.107, 0.108, 538e3, 538e3, 25000.0)
    given = {"operator": "Ann", "specimen": specimen, "title": "dry", "software": "mesotap 0.1.0", "complete": True}
    return Session(created, rig, (impact,), pre=points, post=points, **{**given, **more})


def results(k_c: float = 5e6, load_mn: float = 300.0, zeta2: float = 0.01, **more) -> dict:
    def estimate(value: float) -> dict[str, float]:
        return {"value": value, "low": 0.99 * value, "high": 1.01 * value}

    one = {
        **{"load_set": 0, "target_load_mn": load_mn, "impacts_used": 8, "load_mn": estimate(load_mn)},
        **{"f1_hz": estimate(356.0), "f2_hz": estimate(1600.0), "zeta1": estimate(1e-4), "zeta2": estimate(zeta2)},
        **{"contact_stiffness_n_per_m": estimate(k_c), "contact_damping_n_s_per_m": None, "notes": []},
    }
    return {
        **{"format": "mesotap-results", "version": 1, "source": "session.h5", "method": "ml", "loads": [one]},
        **{"impacts": [], "notes": [], "calibration": {"drifted": False, "sensitivity_mv_per_mn": estimate(SLOPE)}},
        **more,
    }


def filed(folder: Path, recorded: Session | None = None, answer: dict | None = None) -> Path:
    """Make a session's folder with a session file and results."""
    folder.mkdir(parents=True)
    write_session(folder / "session.h5", recorded or session())
    (folder / "results.json").write_text(json.dumps(answer or results()))
    return folder
