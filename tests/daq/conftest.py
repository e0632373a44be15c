from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from daq.records import CalibrationPoints, Impact, RigDescription, Session


@pytest.fixture
def recordings() -> Path:
    """The folder of recordings that are no part of the project."""
    folder = Path(os.environ.get("MESOTAP_DATA") or Path(__file__).parents[2] / ".." / "shared" / "data")
    if not folder.is_dir():
        pytest.skip(f"no recordings at {folder}; set MESOTAP_DATA to the folder that holds them")
    return folder


@pytest.fixture
def impact() -> Impact:
    rng = np.random.default_rng(0)
    return Impact(
        number=3,
        load_set=1,
        target_load_mn=265.0,
        load_before_mn=264.5,
        load_after_mn=265.1,
        time="2026-02-03T04:05:06.789Z",
        sample_rate_hz=25000.0,
        pretrigger=50,
        acceleration=rng.normal(size=(2, 300)),
        accepted=False,
        reject_reason="too weak; noisy – µ",
        strain_mv=rng.normal(size=300),
        voltage_before_mv=11.1,
        voltage_after_mv=11.2,
        extra={"numbers": {"rotation": 0.01}, "list": [1, 2]},
    )


@pytest.fixture
def session(impact: Impact) -> Session:
    from dataclasses import replace

    return Session(
        created="2026-02-03T04:00:00Z",
        rig=RigDescription(0.107, 0.108, 5.4e5, 5.3e5, 25000.0, 10.0, 1, 1e4, 4, "butterworth", 49.0, 16),
        impacts=(replace(impact, number=0, accepted=True, reject_reason="", strain_mv=None), impact),
        pre=CalibrationPoints(np.array([0.0, 100, 200]), np.array([0.1, 4.3, 8.5]), "2026-02-03T03:00:00Z"),
        operator="N. N.",
        specimen="flat",
        title="Täst",
        software="mesotap",
        complete=True,
        config="rig: {}\n# µ\n",
        source="",
    )
