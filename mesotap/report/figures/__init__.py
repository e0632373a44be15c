"""Figures for the report and for print: functions that return matplotlib figures, without global state."""

from __future__ import annotations

from mesotap.report.figures._amplitude import (
    FEWEST_POINTS,
    amplitude_figure,
    mode_amplitude_figure,
    shown_amplitudes,
    shown_modes,
)
from mesotap.report.figures._calibration import calibration_figure
from mesotap.report.figures._contact import (
    DRIFT_FOOTNOTE,
    DRIFT_MARK,
    damping_figure,
    published_figure,
    stiffness_figure,
)
from mesotap.report.figures._diagnosis import (
    ForcePicture,
    excess_by_impact_figure,
    excess_figure,
    force_figure,
    held_out_figure,
    residual_spectra_figure,
    varying_figure,
)
from mesotap.report.figures._files import inline_svg, save
from mesotap.report.figures._frequency_response import cross_check_figure, response_figure, shown_responses
from mesotap.report.figures._impacts import impacts_figure
from mesotap.report.figures._law import Overlay, law_figure
from mesotap.report.figures._overview import overview_figure, seen_intervals
from mesotap.report.figures._paper import paper_figure_3, paper_figure_7_8, paper_figure_9
from mesotap.report.figures._recording import Recording, modes_figure
from mesotap.report.figures._rig import rig_figure
from mesotap.report.figures._stabilisation import stabilisation_figure
from mesotap.report.figures._tap import record_figure, shown_spectra, spectra_figure
from mesotap.report.figures._weighing import short_name, weighing_figure

__all__ = [
    "DRIFT_FOOTNOTE",
    "DRIFT_MARK",
    "FEWEST_POINTS",
    "ForcePicture",
    "Overlay",
    "Recording",
    "amplitude_figure",
    "calibration_figure",
    "cross_check_figure",
    "damping_figure",
    "excess_by_impact_figure",
    "excess_figure",
    "force_figure",
    "held_out_figure",
    "impacts_figure",
    "inline_svg",
    "law_figure",
    "mode_amplitude_figure",
    "modes_figure",
    "overview_figure",
    "paper_figure_3",
    "paper_figure_7_8",
    "paper_figure_9",
    "published_figure",
    "record_figure",
    "residual_spectra_figure",
    "response_figure",
    "rig_figure",
    "save",
    "seen_intervals",
    "short_name",
    "shown_amplitudes",
    "shown_modes",
    "shown_responses",
    "shown_spectra",
    "spectra_figure",
    "stabilisation_figure",
    "stiffness_figure",
    "varying_figure",
    "weighing_figure",
]
