"""The page of a diagnosis of any rig: the answer first, then what is behind it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from markupsafe import Markup
from matplotlib.figure import Figure

from analysis.mismatch.answer import Answer
from daq.records import Session
from mesotap.answers.diagnosis_text import (
    left_over,
    linear_rig,
    next_words,
    no_rival,
    probability_words,
    rival_probability,
    rivals_are,
    told_parameters,
    verdict_sentence,
    what_was_recorded,
)
from mesotap.answers.results_files import json_text
from mesotap.report import figures
from mesotap.report.report import environment, figure_folder, is_simulated, written

K_C: Final = Markup("<i>k</i><sub>c</sub>")
ZETA_2: Final = Markup("<i>ζ</i><sub>2</sub>")
C_C: Final = Markup("<i>c</i><sub>c</sub>")


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure: its name in the page, what a screen reader says of it, and its caption in HTML."""

    name: str
    figure: Figure
    label: str
    caption: str | Markup


@dataclass(frozen=True, slots=True)
class Table:
    """A table of texts; ``text`` are the columns that hold words, not numbers."""

    caption: str | Markup
    headings: tuple[str | Markup, ...]
    rows: tuple[tuple[str | Markup, ...], ...]
    text: tuple[int, ...] = (0,)


@dataclass(frozen=True, slots=True)
class Evidence:
    """What is behind an answer, as the page shows it; what an experiment does not have is left empty.

    Attributes
    ----------
    where, what, gained
        Where the recordings hold more than the linear rig, what force is missing, and how much better they are
        predicted with what was left out.
    candidates, constants
        The selection of mechanisms, and what the fits made of the rig's constants.
    considered
        Where no mechanism had to be fitted, a sentence that says so instead of a table.
    laws, law_pictures
        What is known of learned laws, and their curves.
    excluded
        Mechanisms that did not take part.
    meanings
        What a parameter is in words, by the ids of its mechanism and its own; of others the page shows the id.
    method
        How the recordings were fitted, a sentence or two.
    """

    where: tuple[Picture, ...]
    what: tuple[Picture, ...]
    gained: tuple[Picture, ...]
    candidates: tuple[Table, ...]
    constants: tuple[Table, ...]
    excluded: tuple[str, ...]
    method: str | Markup
    considered: str = ""
    laws: tuple[Table, ...] = ()
    law_pictures: tuple[Picture, ...] = ()
    meanings: Mapping[tuple[str, str], str] = field(default_factory=dict)

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All figures, in the order of the page."""
        return (*self.law_pictures, *self.where, *self.what, *self.gained)


def write_page(
    folder: Path,
    answer: Answer,
    evidence: Evidence,
    content: Mapping[str, Any],
    sessions: Sequence[Session] = (),
    *,
    pdf_figures: bool = True,
    on_progress: Callable[[str], None] = lambda step: None,
) -> Path:
    """Write ``diagnosis.html``, ``diagnosis.json`` and ``figures/diagnosis-*.pdf`` into a folder; return the page.

    Parameters
    ----------
    content
        The answer as programs read it, with remarks on what is unusual in the files.
    sessions
        What was diagnosed, if it was recorded by this program: specimen, operator and date stand at the head.
    pdf_figures
        Whether to write the figures for print, which takes about as long as the page.
    on_progress
        Is told each step, such as "figure 3 of 6".
    """
    folder.mkdir(parents=True, exist_ok=True)
    drawn = {}
    for number, p in enumerate(evidence.pictures, start=1):
        on_progress(f"figure {number} of {len(evidence.pictures)}")
        if pdf_figures:
            figures.save(p.figure, figure_folder(folder) / f"diagnosis-{p.name}.pdf")
        drawn[p.name] = figures.inline_svg(p.figure, f"diagnosis-{p.name}", p.label)
    written(folder / "diagnosis.json", json_text(dict(content)))
    html = environment().get_template("diagnosis.html").render(
        told_parameters=told_parameters,
        answer=answer,
        evidence=evidence,
        files=" + ".join(Path(r.file).name for r in answer.recordings),
        sessions=sessions,
        remarks=content.get("remarks", ()),
        simulated=any(is_simulated(session) for session in sessions),
        verdict=verdict_sentence(answer),
        recorded=what_was_recorded(answer),
        linear=linear_rig(answer),
        probability_words=probability_words,
        svg={name: Markup(svg) for name, svg in drawn.items()},
        held_out=_held_out(answer),
        next_words=next_words,
        no_rival=no_rival,
        left_over=left_over(answer),
        rivals_are=rivals_are(answer),
        rival_probability=rival_probability(answer),
        pdf_figures=pdf_figures,
    )  # fmt: skip
    return written(folder / "diagnosis.html", html)


def _held_out(answer: Answer) -> list[tuple[str, float, float | None, float | None, str]]:
    """Return what was held out, its error before and after, the noise, and the unit."""
    fit = answer.fit
    segments = f"{fit.heldout_segments} of {fit.segments} segments"
    rows = [(segments, fit.heldout_rms_before, fit.heldout_rms_after, float(fit.noise_rms) or None, fit.unit)]
    for c in fit.channels if len(fit.channels) > 1 else ():
        what = f"channel {c.channel}: what cannot be predicted is {c.heldout_over_noise:.3g} times as large as noise"
        rows.append((what, c.heldout_rms_before, c.heldout_rms_after, c.noise_rms, c.unit))
    rows += [(name, before, after, None, fit.unit) for name, (before, after) in fit.stretches.items()]
    if fit.steady_error is not None:
        before, after = fit.steady_error
        rows.append(("steady responses, force", 100 * before, None if after is None else 100 * after, None, "%"))
    return rows
