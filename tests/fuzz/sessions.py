"""Sound session files to be damaged: as this program writes them, and as another program does, in the old layout."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from daq.records import CalibrationPoints, Impact, RigDescription, Session
from daq.session_file import write_session
from tests.fuzz.mutations import Content


def small_session(impacts: int = 2, samples: int = 64) -> Session:
    """A few impacts and two calibrations, as small as can be."""
    t = np.arange(samples)
    ring = np.exp(-t / 20) * np.sin(t)
    recorded = tuple(
        Impact(
            number=n,
            load_set=n,
            target_load_mn=300.0,
            load_before_mn=299.0,
            load_after_mn=301.0,
            time="2026-01-01T00:00:00.000Z",
            sample_rate_hz=25000.0,
            pretrigger=5,
            acceleration=np.vstack([ring, ring]),
            accepted=True,
            strain_mv=ring,
            extra={"a": 1.0},
        )
        for n in range(impacts)
    )
    points = CalibrationPoints(np.arange(4.0), np.arange(4.0), "2026-01-01T00:00:00Z")
    rig = RigDescription(0.1, 0.1, 5e5, 5e5, 25000.0, 10.0, 1, 1e4, 4, "butterworth", 49.0, 16)
    return Session("2026-01-01T00:00:00Z", rig, recorded, points, points, "N. N.", "s", "t", "x", True, "mesotap: {}")


def as_written_here(path: Path) -> bytes:
    """Bytes of a session file of this program."""
    write_session(path, small_session())
    return Content(path.read_bytes())


def in_the_old_layout(path: Path) -> bytes:
    """Bytes of a session file as h5py writes it by default, without checksums; one impact, for it is read twice."""
    write_session(path.with_name("new.h5"), small_session(impacts=1, samples=32))
    with h5py.File(path.with_name("new.h5")) as new, h5py.File(path, "w", libver="earliest") as old:
        for name, value in new.attrs.items():
            old.attrs[name] = value
        for name in new:
            new.copy(name, old)
    return Content(path.read_bytes())
