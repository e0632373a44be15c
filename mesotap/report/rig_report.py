"""The page of a diagnosis of a described rig."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from markupsafe import Markup

from analysis.mismatch.rigs.diagnosis import RigDiagnosis
from mesotap.answers.results_files import json_text
from mesotap.answers.rig_answers import candidates, verdict_of
from mesotap.report import figures
from mesotap.report.report import Plate, environment, written

LABEL = "Errors before and after against time and frequency, and the law that was left out"


def write_rig_report(d: RigDiagnosis, answer: dict[str, Any], folder: Path) -> Path:
    """Write ``report.html``, ``diagnosis.json`` and the figure as SVG and PDF into a folder; return the page."""
    folder.mkdir(parents=True, exist_ok=True)
    figure = figures.rig_figure(d)
    figures.save(figure, folder / "diagnosis.svg")
    figures.save(figure, folder / "diagnosis.pdf")
    written(folder / "diagnosis.json", json_text(answer))
    plate = Plate(Markup(figures.inline_svg(figure, "diagnosis", LABEL)))
    page = (
        environment()
        .get_template("rig.html")
        .render(d=d, plate=plate, verdict=verdict_of(d), steps=candidates(d), name=d.outcome.rig.name)
    )
    return written(folder / "report.html", page)
