"""A session analysed with all that its configuration declares."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from analysis.session import OnProgress, analyse_session
from mesotap.configuration.usual import unusual
from mesotap.configuration.usual_recordings import analysis_remarks

if TYPE_CHECKING:
    from analysis.results import SessionResults
    from daq.records import Session
    from mesotap.configuration.config import Config


def analysed_as_configured(session: Session, config: Config, on_progress: OnProgress | None = None) -> SessionResults:
    """Analyse the accepted impacts of a session; nothing that a configuration declares is left out.

    What is unusual about either, such as a mass in grams, is among the ``remarks`` of the results.

    Raises
    ------
    AnalysisError
        As `analysis.session.analyse_session` does.
    """
    rig = config.rig
    results = analyse_session(
        session, config.analysis, config.calibration, rig.masses, rig.springs, on_progress, wiring=rig.wiring
    )
    return replace(results, remarks=analysis_remarks(session, unusual(config.model_dump(mode="json"))))
