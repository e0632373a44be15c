"""A session analysed with all that its configuration declares."""

from __future__ import annotations

from typing import TYPE_CHECKING

from analysis.session import OnProgress, analyse_session

if TYPE_CHECKING:
    from analysis.results import SessionResults
    from daq.records import Session
    from mesotap.configuration.config import Config


def analysed_as_configured(session: Session, config: Config, on_progress: OnProgress | None = None) -> SessionResults:
    """Analyse the accepted impacts of a session; nothing that a configuration declares is left out.

    Raises
    ------
    AnalysisError
        As `analysis.session.analyse_session` does.
    """
    rig = config.rig
    return analyse_session(
        session, config.analysis, config.calibration, rig.masses, rig.springs, on_progress, wiring=rig.wiring
    )
