"""Where results come from: the session, the rig and the configuration they rest on, and the software that made them."""

from __future__ import annotations

import datetime
import math
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from daq.records import Session
from mesotap import __version__
from mesotap.answers.recording_files import sha256_of
from mesotap.configuration.config import Config

LIBRARIES = ("numpy", "scipy", "numba", "h5py")
"""Libraries whose version may show in a number."""


def provenance(session: Session, config: Config, file: Path | None) -> dict[str, Any]:
    """Return the ``provenance`` of `mesotap-results`.

    Parameters
    ----------
    session
        What was analysed.
    config
        The configuration in force in the analysis.
    file
        The session file; None, or not there: its hash is None.
    """
    rig = session.rig
    return {
        "created": session.created,
        "operator": session.operator,
        "specimen": session.specimen,
        "title": session.title,
        "sha256": sha256_of(file) if file is not None and file.is_file() else None,
        "recorded_with": session.software,
        "analysed_with": _software(),
        "rig": {
            name: value if math.isfinite(value := float(getattr(rig, name))) else None
            for name in ("m1_kg", "m2_kg", "k1_n_per_m", "k2_n_per_m", "tube_added_kg")
        },
        "configuration": config.model_dump(mode="json"),
    }


def recording_provenance(file: Path, config: Config, created: str | None = None) -> dict[str, Any]:
    """Return the ``provenance`` of `mesotap-modes`.

    Parameters
    ----------
    file
        The recording.
    config
        The configuration in force in the analysis.
    created
        When it was recorded, where that is known.
    """
    there = file.is_file()
    changed = datetime.datetime.fromtimestamp(file.stat().st_mtime, datetime.UTC) if there else None
    return {
        "created": created or None,
        "file_changed": None if changed is None else changed.isoformat(timespec="seconds").replace("+00:00", "Z"),
        "sha256": sha256_of(file) if there else None,
        "analysed_with": _software(),
        "configuration": config.model_dump(mode="json"),
    }


def _software() -> dict[str, str | None]:
    return {
        "mesotap": __version__,
        "python": platform.python_version(),
        **{name: _version(name) for name in LIBRARIES},
    }


def _version(library: str) -> str | None:
    try:
        return version(library)
    except PackageNotFoundError:
        return None
