"""Recordings made elsewhere: CSV, MAT (5 and 7.3) and universal files, and how they become a session."""

from __future__ import annotations

from daq.exchange.importing import as_session, import_recording
from daq.exchange.recording import Recording

__all__ = ["Recording", "as_session", "import_recording"]
