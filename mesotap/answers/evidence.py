"""What is behind an answer, whatever the experiment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.recordings.account import BlockAccount
from analysis.mismatch.recordings.judge import BlockJudge
from analysis.results import SessionResults
from mesotap.answers.diagnosis_page import Evidence
from mesotap.answers.impact_evidence import evidence_of_impacts
from mesotap.answers.law_evidence import evidence_of_laws
from mesotap.answers.recording_evidence import evidence_of_recordings
from sim_backend.mechanisms.kinds import Mechanism


def evidence_of(
    found: Diagnosis, known: Mapping[str, tuple[Mechanism, ...]], results: SessionResults | None = None
) -> Evidence:
    """Return figures and tables of a diagnosis.

    Parameters
    ----------
    known
        Mechanisms that took part, by id.
    results
        Of a session's linear analysis, for frequency and damping against amplitude.
    """
    if isinstance(found.selection.judge, BlockJudge):
        behind = evidence_of_recordings(BlockAccount(found.selection), known)
    else:
        behind = evidence_of_impacts(found.selection, known, results)
    pictures, tables = evidence_of_laws(found)
    variants = [m for family in known.values() for m in reversed(family)]
    meanings = {(m.id, q.name): q.meaning for m in variants for q in m.parameters}
    meanings |= {(m.id, q.name): q.meaning for m in variants for q in m.derived}
    return replace(behind, laws=tables, law_pictures=pictures, meanings=meanings)
