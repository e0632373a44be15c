"""Sessions held against the tester's shipped description, as `mesotap diagnose --listed-only` does it."""

from __future__ import annotations

from collections.abc import Sequence

from analysis.mismatch.answer import RecordingFile
from analysis.mismatch.diagnosis import Diagnosis, diagnose_sessions
from analysis.mismatch.ring_downs.fit import RingDowns
from analysis.mismatch.ring_downs.sessions import ring_downs
from daq.records import Session
from mesotap.configuration.declared import header_uncertainty
from mesotap.configuration.rig_files import tester_rig
from sim_backend.mechanisms.kinds import Mechanism


def problem_of(session: Session) -> RingDowns:
    return ring_downs([session], tester_rig(), header_uncertainty(session))


def diagnosed(session: Session, known: Sequence[Mechanism], files: Sequence[RecordingFile] = ()) -> Diagnosis:
    return diagnose_sessions([session], tester_rig(), header_uncertainty(session), known, recordings=files, learn=False)
