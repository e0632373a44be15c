"""Pages about theory: a published gap weighed, and the paper's figures drawn again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup
from matplotlib.figure import Figure

from analysis.contact.gap import PublishedGap
from analysis.quoted import Quoted
from mesotap.answers.results_files import json_text
from mesotap.report import figures
from mesotap.report.report import Plate, environment, written

GAP_LABEL = "Stiffness against load with explanations, their errors at loads left out, and their probabilities"


def gap_report(folder: Path, gap: PublishedGap) -> Path:
    """Write ``report.html``, ``gap.json``, ``gap.pdf`` and ``gap.svg`` into a folder; return the page."""
    folder.mkdir(parents=True, exist_ok=True)
    figure = gap_figure(gap)
    figures.save(figure, folder / "gap.pdf")
    figures.save(figure, folder / "gap.svg")
    written(folder / "gap.json", json_text(gap.as_json()))
    plate = Plate(Markup(figures.inline_svg(figure, "gap", GAP_LABEL)))
    return written(folder / "report.html", environment().get_template("gap.html").render(gap=gap, plate=plate))


def gap_figure(gap: PublishedGap) -> Figure:
    """Draw a published gap and what may fill it."""
    return figures.weighing_figure(gap.load_mn, gap.stiffness_n_per_m, gap.weighed, gap.drawn, elsewhere=~gap.in_table)


def paper_page(folder: Path, drawn: Sequence[tuple[str, str, str, Figure]], quoted: Sequence[Quoted]) -> Path:
    """Write the paper's figures as SVG and PDF, ``quoted.json`` and the page that shows them.

    Parameters
    ----------
    folder
        Where to; made if it is not there.
    drawn
        File name, heading, caption and figure of each.
    quoted
        The numbers of the text beside those computed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    plates = []
    for name, heading, caption, figure in drawn:
        figures.save(figure, folder / f"{name}.svg")
        figures.save(figure, folder / f"{name}.pdf")
        plates.append((heading, caption, Markup(figures.inline_svg(figure, name, f"{heading}. {caption}"))))
    answer = {"format": "mesotap-quoted", "version": 1, "numbers": [q.as_json() for q in quoted]}
    written(folder / "quoted.json", json_text(answer))
    html = environment().get_template("figures.html").render(plates=plates, quoted=quoted)
    return written(folder / "figures.html", html)
