"""The practice sessions, whose answers are known; tests that read them are marked ``data``."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from daq.records import Session
from daq.session_file import read_session

DATA = Path(os.environ.get("MESOTAP_DATA", Path(__file__).parents[3] / "shared" / "data")) / "concealed-practice"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"no practice sessions at {DATA}")


def practice(case: str) -> Session:
    return read_session(DATA / f"{case}.h5")


def truth(case: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((DATA / "truth.json").read_text())[case]
    return found
