"""The page of a diagnosis: what was left out of Eq. 9, where, how sure, and what would settle it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from analysis.mismatch.contest import LEFT_LEVEL, LEVEL, Contest, Entry
from analysis.mismatch.corrected import contact_at_rest
from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.fit import Fit
from analysis.mismatch.maps import by_impact, held_out, map_by_frequency, map_by_time, spectrum
from analysis.mismatch.reconstruction import law_along, reconstruct, stitched, telling_impacts
from analysis.mismatch.varying import contact_by_amplitude, contact_in_time
from analysis.results import SessionResults
from calibration.estimate import Estimate
from mesotap.answers.adoption import LOAD_CELL
from mesotap.answers.results_files import json_text
from mesotap.report import figures
from mesotap.report.report import Plate, environment, figure_folder, written
from sim_backend.mechanisms.mechanism import Mechanism

LABELS = {
    "excess": "Residual power over noise against load and frequency, and load and time",
    "misfit": "Residual beyond noise of each impact against its order and its strength",
    "varying": "Contact stiffness and damping let free in windows of time and amplitude",
    "force": "Contact force against deflection, reconstructed and by the laws",
    "spectra": "Residual spectra before and after, over the noise",
    "held_out": "Residual of each held-out impact before and after",
    "amplitude": "Frequency change and damping ratio of the contact mode against its amplitude along the ring-down",
}
SURE = 1e-12  # p-values below are not worth their digits
UNSEEN = "ring-downs do not show it"


@dataclass(frozen=True, slots=True)
class Contender:
    """A mechanism's row in the contest's table; gains are chi-squared taken away, None where there is none."""

    id: str
    component: str
    summary: str
    screened: float | None
    p_value: float | None
    fitted: float | None
    evidence: float | None
    outcome: str
    named: bool


@dataclass(frozen=True, slots=True)
class Constant:
    """A constant of the rig as declared, and as fitted without and with what was left out."""

    name: str
    unit: str
    declared: Estimate
    before: float
    after: float | None


def write_diagnosis(
    folder: Path,
    found: Diagnosis,
    answer: Mapping[str, Any],
    known: Mapping[str, Mechanism],
    results: SessionResults | None = None,
    progress: Callable[[str], None] = lambda stage: None,
    *,
    pdf_figures: bool = True,
) -> Path:
    """Write ``diagnosis.html``, ``diagnosis.json`` and ``figures/diagnosis-*.pdf`` into a folder; return the page.

    Parameters
    ----------
    answer
        The diagnosis as programs read it.
    known
        Mechanisms that took part.
    results
        Of the session's linear analysis, for frequency and damping against amplitude; None to leave that out.
    pdf_figures
        Whether to write the figures for print, which takes about as long as the page.
    """
    folder.mkdir(parents=True, exist_ok=True)
    contest = found.contest
    progress("reconstructing the contact force")
    drawn = _figures(found, results)
    progress("drawing")
    if pdf_figures:
        for name, figure in drawn.items():
            figures.save(figure, figure_folder(folder) / f"diagnosis-{name}.pdf")
    written(folder / "diagnosis.json", json_text(dict(answer)))
    after = contest.best if contest.best.terms else None
    html = environment().get_template("diagnosis.html").render(
        found=found,
        answer=answer,
        verdict=verdict(found),
        plates={n: Plate(Markup(figures.inline_svg(f, f"diagnosis-{n}", LABELS[n]))) for n, f in drawn.items()},
        contenders=contenders(contest, known),
        steps=len([r for r in contest.rounds if r.accepted is not None]),
        constants=constants(contest),
        before=contact_at_rest(contest.baseline),
        after=None if after is None else contact_at_rest(after),
        left_over=left_over(contest),
        struck=[m for m in _all() if m not in known],
        impacts=len(contest.problem.recordings.records),
        loads_mn=[1e3 * p for p in contest.problem.recordings.loads_n],
        level_percent=round(100 * LEVEL),
        best_name=law_name(after),
        pdf_figures=pdf_figures,
        surely=lambda p: p_words(p).removeprefix("p = ").removeprefix("p "),
    )  # fmt: skip
    return written(folder / "diagnosis.html", html)


def _all() -> tuple[str, ...]:
    from sim_backend.mechanisms.mechanism import mechanisms

    return tuple(mechanisms())


def verdict(found: Diagnosis) -> str:
    """Say the answer in a sentence with the session's numbers."""
    records, loads = found.contest.problem.recordings.records, found.contest.problem.recordings.loads_n
    measured = f"{len(records)} impacts at {len(loads)} loads from {1e3 * min(loads):.0f} to {1e3 * max(loads):.0f} mN"
    chance = p_words(found.p_value)
    if found.verdict == "consistent":
        return f"Eq. 9 with its constants refitted explains all of {measured}: nothing is left beyond noise ({chance})."
    if found.verdict == "unexplained" or not found.mechanisms:
        return (
            f"Eq. 9 does not explain {measured} ({chance}), and nothing listed does: what is missing is not named, "
            "but located and drawn below."
        )
    if all(m.where == LOAD_CELL for m in found.mechanisms):
        return (
            f"Eq. 9 with its constants refitted explains all of {measured}, but the load cell drifted between its "
            f"calibrations ({chance}): the loads are in doubt."
        )
    names = " and ".join(m.id.replace("_", " ") for m in found.mechanisms)
    sure = min(m.probability for m in found.mechanisms)
    return f"Eq. 9 does not explain {measured} ({chance}); it leaves out {names}, with a probability of {sure:.2f}."


def p_words(p: float) -> str:
    """Write a p-value; one that is certainty anyway without its digits."""
    return f"p = {p:.2g}" if p > SURE else f"p < {SURE:g}"


def law_name(fit: Fit | None) -> str:
    """Name the mechanisms of a fit."""
    return "" if fit is None else " and ".join(t.mechanism.id.replace("_", " ") for t in fit.terms)


def left_over(contest: Contest) -> str:
    """Say what the best explanation there is does not explain."""
    explained = contest.baseline.objective - contest.best.objective
    if contest.p_value >= LEVEL:
        return "Nothing beyond noise."
    if contest.left_p_value >= LEFT_LEVEL:
        return (
            "Nothing beyond noise: tested against forces and channels of any shape, what is left has "
            f"{p_words(contest.left_p_value)}."
        )
    share = contest.left_over / max(explained + contest.left_over, 1e-300)
    return (
        f"Forces or channels of any shape would take away a further chi-squared of {contest.left_over:.0f}, "
        f"{100 * share:.2g} % of all misfit ({p_words(contest.left_p_value)})."
    )


def constants(contest: Contest) -> list[Constant]:
    """List the rig's declared constants with what the fits made of them."""
    before = dict(zip(contest.baseline.constants.names()[0], contest.baseline.constants.rig.tolist(), strict=True))
    after = dict(zip(contest.best.constants.names()[0], contest.best.constants.rig.tolist(), strict=True))
    return [
        Constant(
            p.name,
            p.unit,
            Estimate(p.value, p.uncertainty),
            before[p.name],
            after[p.name] if contest.best.terms else None,
        )
        for p in contest.problem.arrangement.parameters
        if p.name in before
    ]


def contenders(contest: Contest, known: Mapping[str, Mechanism]) -> list[Contender]:
    """Return a row for every mechanism that took part: those named first, then by what they took away."""
    named = {r.accepted.id: place for place, r in enumerate(contest.rounds, start=1) if r.accepted is not None}
    first = contest.rounds[0] if contest.rounds else None
    entries = {e.id: e for e in first.entries} if first is not None else {}
    best = first.entries[0] if first is not None and first.entries else None
    scores: dict[str, tuple[float, float]] = {}
    for score in first.screening.scores if first is not None else ():
        name = score.term.mechanism.id
        if name not in scores or score.gain > scores[name][0]:
            scores[name] = score.gain, score.p_value
    rows = []
    for name, mechanism in known.items():
        entry = entries.get(name)
        gain, p = scores.get(name, (None, None))
        fitted = entry.fit if entry is not None else None
        rows.append(
            Contender(
                name,
                mechanism.component,
                mechanism.summary,
                gain,
                p,
                None if fitted is None else contest.baseline.objective - fitted.objective,
                None if entry is None or fitted is None else entry.evidence,
                _outcome(name, entry, p, best, named, contest),
                name in named and contest.chosen is not None,
            )
        )
    return sorted(rows, key=lambda r: (not r.named, r.fitted is None, -(r.fitted or 0.0), -(r.screened or 0.0)))


def _outcome(
    name: str, entry: Entry | None, p: float | None, best: Entry | None, named: Mapping[str, int], contest: Contest
) -> str:
    if name in named:
        if contest.chosen is None:
            return "the best there is, but it leaves too much over to be named"
        return "named" if named[name] == 1 else f"named in step {named[name]}, beside what was named before"
    if p is None:
        return UNSEEN if contest.rounds else "not needed"
    if entry is not None and entry.fit is not None and best is not None:
        return f"full fit: {best.evidence - entry.evidence:.0f} less than {best.id.replace('_', ' ')}"
    if p > LEVEL:
        return f"nothing of it in the residual (p = {p:.2g})"
    if best is not None:
        return f"score test: far less than {best.id.replace('_', ' ')}; not fitted in full"
    return "not fitted in full"


def _figures(found: Diagnosis, results: SessionResults | None) -> dict[str, Figure]:
    contest = found.contest
    before = contest.baseline
    after = contest.best if contest.best.terms else None
    drawn = {
        "excess": figures.excess_figure(map_by_frequency(before), map_by_time(before)),
        "misfit": figures.misfit_figure(by_impact(before)),
        "varying": figures.varying_figure(contact_in_time(before), contact_by_amplitude(before)),
    }
    if results is not None and figures.shown_amplitudes(results):
        drawn["amplitude"] = figures.amplitude_figure(results)
    pictures = [_picture(before, after, number) for number in telling_impacts(before, contest.best)]
    drawn["force"] = figures.force_figure(pictures, law_name(after))
    drawn["spectra"] = figures.residual_spectra_figure(spectrum(before), None if after is None else spectrum(after))
    kept = held_out(contest)
    if kept is not None:
        drawn["held_out"] = figures.held_out_figure(kept)
    return drawn


def _picture(before: Fit, after: Fit | None, number: int) -> figures.ForcePicture:
    record = before.problem.recordings.records[number]
    stiffness = before.constants.at(record.group)["kc"]
    motion = stitched(reconstruct(before, number), stiffness)
    frequency = float(np.abs(before.modes[record.group].rig.poles).max()) / (2 * np.pi)
    augmented = None if after is None else law_along(after, record, motion)
    return figures.ForcePicture(motion, law_along(before, record, motion), augmented, stiffness, frequency)
