"""The report of a session: one self-contained page with tables, figures and verdicts, and the numbers beside it."""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from analysis.contact.theory import TheoryCurve, plasticity
from analysis.contact.theory import theory as theory_curves
from analysis.frequency_response.estimators import FrequencyResponse
from analysis.published import Published
from analysis.results import ImpactResult, LoadResult, RecordingModes, SessionResults
from analysis.settings import FlatContact, SphereContact
from calibration.estimate import LEVEL
from daq.durable import write_error, write_whole
from daq.errors import UnwrittenError
from daq.hits import LEFT_OUT
from daq.records import Impact, Session
from mesotap.answers.assurance import with_beside
from mesotap.answers.budgets import shown_budgets, shown_load
from mesotap.answers.comparison import N_PER_MN, Ratio, count_inside, recovered_against, spectral_check, theory_ratios
from mesotap.answers.explanations import SHOWN, chance, explain, known
from mesotap.answers.frequency_response import response_json, response_said, said_of
from mesotap.answers.results_files import (
    budgets_csv,
    impacts_csv,
    json_text,
    loads_csv,
    modes_json,
    results_json,
)
from mesotap.answers.rounding import UNKNOWN, significant, with_ends, with_uncertainty
from mesotap.answers.shapes import shown_shape
from mesotap.answers.summary import summary
from mesotap.answers.trust import trusted, what_next
from mesotap.report import figures
from mesotap.report.figures import Recording
from mesotap.report.typesetting import parameter, prose, unit

if TYPE_CHECKING:
    from mesotap.answers.assurance import Beside
from mesotap.answers.correction import Correction

__all__ = [
    "Plate",
    "environment",
    "is_simulated",
    "published_report",
    "recording_report",
    "results_json",
    "with_uncertainty",
    "write_report",
    "written",
]

FIGURE_FOLDER, OVERVIEW = "figures", "overview"
OF_TRUST = ("trust", "reasons")  # templates of what is said of trust, on the first screen and beneath it
SIMULATED = "(simulated rig)"  # in the software that a session file names


def is_simulated(session: Session) -> bool:
    """Return whether a session's taps come from the simulated rig."""
    return SIMULATED in session.software


@dataclass(frozen=True, slots=True)
class Plate:
    """One figure of the page."""

    svg: Markup
    wide: bool = True


@dataclass(frozen=True, slots=True)
class Taps:
    """How many taps one load took."""

    load: LoadResult
    made: int
    accepted: int
    reasons: str
    left_out: int = 0

    @property
    def rejected(self) -> int:
        """Taps that were not sound."""
        return self.made - self.accepted - self.left_out


def write_report(
    folder: Path,
    session: Session,
    results: SessionResults,
    theory: Sequence[TheoryCurve],
    truth: Sequence[Mapping[str, Any]] | None = None,
    *,
    contact: SphereContact | FlatContact | None = None,
    correction: Correction | None = None,
    origin: Mapping[str, Any] | None = None,
    pdf_figures: bool = True,
    on_progress: Callable[[str], None] = lambda step: None,
) -> Path:
    """Write ``report.html`` and beside it ``results.json``, ``results.csv``, ``impacts.csv``, ``budgets.csv`` and
    ``figures/*.pdf``.

    Parameters
    ----------
    folder
        Where to; made if it is not there.
    session, results
        The session and what its analysis answered.
    theory
        Curves of contact stiffness against preload to hold beside the measurement.
    truth
        What a simulated rig was set to, a mapping per load set; None for a real one.
    contact
        Surfaces for which explanations of stiffness and damping are weighed, and ``explanations.json`` written.
    correction
        The contact corrected for what a diagnosis found, if one was given.
    origin
        The ``provenance`` of the results, which ``results.json`` is to hold.
    pdf_figures
        Whether to write ``figures/*.pdf``, which takes longer than all the rest.
    on_progress
        Is told each step, such as "figure 3 of 9".

    Returns
    -------
    Path
        The report.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if pdf_figures:
        figure_folder(folder)
    on_progress("weighing what may explain the measurement")
    drawn = _session_figures(session, results, theory)
    explained = None if contact is None else explain(results, contact, session.rig)
    if explained is not None:
        drawn["explanations"] = figures.weighing_figure(
            explained.load_mn, explained.stiffness_n_per_m, explained.stiffness, half_width=explained.half_width_n_per_m
        )
        written(folder / "explanations.json", json_text(explained.as_json()))
    drift = results.calibration is not None and results.calibration.drifted
    plates = {}
    for number, (name, figure) in enumerate(drawn.items(), start=1):
        on_progress(f"figure {number} of {len(drawn)}")
        if pdf_figures and name != OVERVIEW:  # "stiffness" says more
            figures.save(figure, figure_folder(folder) / f"{name}.pdf")
        plates[name] = Plate(Markup(figures.inline_svg(figure, name, _label(name, drift))))
    on_progress("tables and page")
    answer = results_json(results)
    if origin is not None:
        answer["provenance"] = dict(origin)
    if correction is not None:
        from mesotap.answers.correction import with_correction  # compiles force laws: only where there are any

        answer = with_correction(answer, correction)
    written(folder / "results.json", json_text(answer))
    written(folder / "results.csv", loads_csv(results))
    written(folder / "impacts.csv", impacts_csv(results))
    written(folder / "budgets.csv", budgets_csv(results))
    ratios = theory_ratios(results, theory)
    recovered = None if truth is None else recovered_against(results, truth)
    page = environment().get_template("report.html")
    footnotes = _footnotes(results.loads)
    budgeted = shown_load(results)
    trust = trusted(session, results, folder, (origin or {}).get("sha256"))
    html = page.render(
        session=session,
        results=results,
        theory=theory,
        drifted=drift,
        drift_footnote=figures.DRIFT_FOOTNOTE,
        simulated=truth is not None or is_simulated(session),
        summary=summary(results, theory, ratios),
        trust=trust,
        next=what_next(trust),
        plates=plates,
        seen=figures.seen_intervals(results),
        typical=_typical_impact(session),
        spectra=figures.shown_spectra(results),
        amplitudes=figures.shown_amplitudes(results),
        checked=[c for load in results.loads if (c := spectral_check(load)) is not None],
        footnotes=footnotes,
        marks=_note_marks(footnotes),
        ratios=ratios,
        yielding=_yielding(contact, ratios),
        explained=explained,
        correction=correction,
        explanations_shown=SHOWN,
        taps=_taps(results),
        hammer_shown=figures.shown_responses(results.hammer),
        hammer_said=said_of(results.hammer),
        rejected=[(i, _impact(session, i)) for i in results.impacts if not i.accepted and not _left_out(i)],
        left_out=[(i, _impact(session, i)) for i in results.impacts if _left_out(i)],
        by_hand=[i for i in session.impacts if i.accepted and i.extra.get("overruled")],
        budgeted=budgeted,
        budgets=[] if budgeted is None else shown_budgets(budgeted),
        recovered=recovered,
        inside=count_inside(recovered),
        truth_missing=truth is not None and not recovered,
        level_percent=round(100 * LEVEL),
        pdf_figures=pdf_figures,
    )
    return written(folder / "report.html", html)


def refresh_trust(folder: Path, session: Session, results: SessionResults) -> None:
    """Say in a report that is written already what a diagnosis beside it has found since."""
    page, trust = folder / "report.html", trusted(session, results, folder)
    html = page.read_text(encoding="utf-8")
    for name in OF_TRUST:
        lines = environment().get_template(f"{name}.html").render(trust=trust, next=what_next(trust)).rstrip("\n")
        before, start, rest = html.partition(f"<!-- {name} -->")
        _, end, after = rest.partition(f"<!-- end of {name} -->")
        html = before + lines + after if start and end else html
    written(page, html)


def _yielding(contact: SphereContact | FlatContact | None, ratios: Sequence[Ratio]) -> str:
    """Say how far the asperities yield under the loads that are compared with theory."""
    if contact is None:
        return ""
    load = np.array([r.load.load_mn.value * N_PER_MN for r in ratios if r.load.load_mn is not None])
    return plasticity(contact, load).sentence(load)


def recording_report(
    folder: Path,
    recording: Recording,
    modes: RecordingModes,
    compared: Beside | None = None,
    responses: FrequencyResponse | None = None,
    *,
    origin: Mapping[str, Any] | None = None,
) -> Path:
    """Write the page of a recording that is not a session: ``report.html``, ``modes.json`` and ``modes.pdf``.

    Where a mode could be followed along the ring-down ``amplitude.pdf`` too, and with a stabilisation diagram
    ``stabilisation.pdf``.

    Parameters
    ----------
    folder
        Where to; made if it is not there.
    recording
        Samples (c, n) with rate, names and unit.
    modes
        What was identified in it.
    compared
        Its modes beside those of another recording.
    responses
        Its frequency responses, where it has a force; ``frequency-response.pdf`` is written too.
    origin
        The ``provenance`` of the modes, which ``modes.json`` is to hold.

    Returns
    -------
    Path
        The page.
    """
    folder.mkdir(parents=True, exist_ok=True)
    figure = figures.modes_figure(recording, modes)
    figures.save(figure, folder / "modes.pdf")
    followed = figures.shown_modes(modes)
    along = None
    if followed:
        drawn = figures.mode_amplitude_figure(recording, modes)
        figures.save(drawn, folder / "amplitude.pdf")
        along = Plate(Markup(figures.inline_svg(drawn, "mode-amplitude", LABELS["mode-amplitude"])))
    diagram = None
    if modes.diagram:
        drawn = figures.stabilisation_figure(modes)
        figures.save(drawn, folder / "stabilisation.pdf")
        diagram = Plate(Markup(figures.inline_svg(drawn, "stabilisation", LABELS["stabilisation"])))
    answer, by_force = with_beside(modes_json(modes), compared), None
    if origin is not None:
        answer["provenance"] = dict(origin)
    if responses is not None:
        drawn = figures.response_figure(responses)
        figures.save(drawn, folder / "frequency-response.pdf")
        by_force = Plate(Markup(figures.inline_svg(drawn, "frequency-response", LABELS["hammer"])))
        answer["frequency_response"] = response_json(responses)
    written(folder / "modes.json", json_text(answer))
    mac = modes.mac() if len(modes.modes) > 1 and len(modes.modes[0].shape) > 1 else None
    data = np.atleast_2d(np.asarray(recording.data))
    names = [str(recording.names[c]) if c < len(recording.names) else f"channel {c}" for c in range(data.shape[0])]
    own = [unit for _, unit in modes.channels]
    stated = own if len(own) == len(names) else [recording.unit] * len(names)
    units = [unit.replace("m/s2", "m/s²") for unit in stated]
    html = environment().get_template("recording.html").render(
        recording=recording,
        mac=None if mac is None else mac.tolist(),
        compared=compared,
        units=units,
        names=names,
        duration_s=data.shape[1] / recording.rate_hz,
        modes=modes,
        plate=Plate(Markup(figures.inline_svg(figure, "modes", LABELS["modes"]))),
        followed=followed,
        along=along,
        diagram=diagram,
        by_force=by_force,
        responses=responses,
        response_said=[] if responses is None else response_said(responses),
        many=sum(len(mode.along_decay) >= figures.FEWEST_POINTS for mode in modes.modes),
        level_percent=round(100 * LEVEL),
    )  # fmt: skip
    return written(folder / "report.html", html)


def published_report(folder: Path, published: Published) -> Path:
    """Write the page of the published tables analysed again: ``report.html``, ``published.json``, ``table5.pdf``, ...

    Parameters
    ----------
    folder
        Where to; made if it is not there.
    published
        The tables, theory beside them, and the conflicts in what was published.

    Returns
    -------
    Path
        The page.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written(folder / "published.json", json_text(published.as_json()))
    plates = []
    for table in published.tables:
        contact = cast("Literal['paper-flat', 'paper-sphere']", table.contact)
        figure = figures.published_figure(
            table.load_mn,
            table.contact_stiffness_n_per_m,
            theory_curves(contact),
            with_tubes=table.with_tubes.contact_stiffness_n_per_m,
        )
        name = f"table{table.number}"
        figures.save(figure, folder / f"{name}.pdf")
        plates.append(Plate(Markup(figures.inline_svg(figure, name, LABELS["published"])), wide=False))
    html = environment().get_template("published.html").render(
        published=published, tables=list(zip(published.tables, plates, strict=True))
    )  # fmt: skip
    return written(folder / "report.html", html)


LABELS = {
    "published": "Contact stiffness of a published table against load with theory",
    "calibration": "Strain gauge voltage against dead weight, before and after the session, with residuals",
    "explanations": "Stiffness against load with explanations, their errors at loads left out, and their probabilities",
    "record": "Acceleration of both accelerometers against time for one tap",
    "spectra": "Averaged acceleration spectra of several loads",
    "overview": "Contact stiffness against load, and its interval in percent",
    "stiffness": "Contact stiffness against load with theory",
    "damping": "Damping ratio of the contact mode against load",
    "impacts": "Contact stiffness of each impact in order, as deviation from the combined estimate of its load",
    "amplitude": "Frequency change and damping ratio of the contact mode against its amplitude along the ring-down",
    "hammer": "Size, phase and coherence of the frequency response over the hammer's force, and the force's spectrum",
    "stabilisation": "Poles of every model order over frequency, stable ones filled",
    "mode-amplitude": "Frequency change and damping ratio of modes against their amplitude along the ring-down",
    "modes": "Record against time, and spectrum with the identified modes",
}


WITH_LOADS = {
    "spectra",
    "overview",
    "stiffness",
    "damping",
    "impacts",
    "amplitude",
    "explanations",
}  # figures that say at which load


def _label(name: str, drifted: bool) -> str:
    """Return what a screen reader says of a figure, whose text is outlines."""
    return LABELS[name] + (f". {figures.DRIFT_FOOTNOTE}" if drifted and name in WITH_LOADS else "")


def figure_folder(folder: Path) -> Path:
    """Return the folder of a report's figures, made if it is not there.

    Raises
    ------
    UnwrittenError
        A link stands there, or it cannot be made.
    """
    place = folder / FIGURE_FOLDER
    if place.is_symlink():
        raise UnwrittenError(place, "it is a link to another place; remove it")
    try:
        place.mkdir(exist_ok=True)
    except OSError as error:
        raise write_error(place, error) from error
    return place


def written(path: Path, text: str) -> Path:
    """Write a text file, whole or not at all, and return its path."""
    write_whole(path, text.encode(errors="backslashreplace"))  # names of files need not be UTF-8
    return path


@functools.cache
def environment() -> Environment:
    """Return the templates' environment, with the filters that all pages share; it keeps what it has compiled."""
    templates = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["pm"] = lambda estimate, scale=1.0: _typographic(with_uncertainty(estimate, scale))
    templates.filters["with_ends"] = lambda v: _typographic(with_ends(v.value, v.low, v.high))
    templates.filters["digits"] = lambda value, count=3: _typographic(significant(value, count))
    templates.filters["shape"] = shown_shape
    templates.filters["signed"] = _signed
    templates.filters["known"] = lambda fitted: parameter(known(fitted))
    templates.filters["parameter"] = parameter
    templates.filters["chance"] = chance
    templates.filters["moment"] = lambda text: text.replace("T", " ").removesuffix("Z").removesuffix("+00:00")
    templates.filters["prose"] = prose
    templates.filters["unit"] = unit
    templates.filters["minus"] = _typographic
    return templates


def _typographic(number: str) -> str:
    return number.replace("-", "−")


def _signed(value: float | None) -> str:
    """Write a deviation in % with its sign."""
    if value is None or not math.isfinite(value):
        return UNKNOWN
    decimals = 3 if abs(value) < 0.1 else 2 if abs(value) < 10 else 0
    return _typographic(f"{value:+z.{decimals}f}")


def _session_figures(session: Session, results: SessionResults, theory: Sequence[TheoryCurve]) -> dict[str, Figure]:
    drawn: dict[str, Figure] = {}
    if session.pre is not None or session.post is not None:
        drawn["calibration"] = figures.calibration_figure(session, results)
    if (impact := _typical_impact(session)) is not None:
        drawn["record"] = figures.record_figure(impact)
    if figures.shown_spectra(results):
        drawn["spectra"] = figures.spectra_figure(results)
    if any(load.contact_stiffness_n_per_m is not None for load in results.loads):
        drawn[OVERVIEW] = figures.overview_figure(results)
        drawn["stiffness"] = figures.stiffness_figure(results, theory)
    if any(load.zeta2 is not None for load in results.loads):
        drawn["damping"] = figures.damping_figure(results)
    if any(impact.contact_stiffness_n_per_m is not None for impact in results.impacts):
        drawn["impacts"] = figures.impacts_figure(results)
    if figures.shown_amplitudes(results):
        drawn["amplitude"] = figures.amplitude_figure(results)
    if figures.shown_responses(results.hammer):
        drawn["hammer"] = figures.cross_check_figure(results.hammer)
    return drawn


def _typical_impact(session: Session) -> Impact | None:
    """Pick the accepted tap of the middle load with the median peak; a rejected one if there is no other."""
    impacts = [s for s in session.impacts if s.acceleration.shape[0] >= 2 and s.acceleration.shape[1] > 1]
    candidates = [s for s in impacts if s.accepted] or impacts
    if not candidates:
        return None
    load_sets = sorted({s.load_set for s in candidates})
    middle = [s for s in candidates if s.load_set == load_sets[len(load_sets) // 2]]
    middle.sort(key=lambda s: float(np.max(np.abs(s.acceleration))))
    return middle[len(middle) // 2]


def _impact(session: Session, result: ImpactResult) -> Impact | None:
    return next((s for s in session.impacts if s.name == result.name), None)


def _footnotes(loads: Sequence[LoadResult]) -> list[list[str]]:
    """Return the footnotes of each load: each note that other loads have too, and all that only it has as one."""
    loads_with = Counter(note for load in loads for note in set(load.notes))
    footnotes = []
    for load in loads:
        notes = list(dict.fromkeys(load.notes))
        own = [note for note in notes if loads_with[note] == 1]
        footnotes.append([note for note in notes if loads_with[note] > 1] + (["; ".join(own)] if own else []))
    return footnotes


def _note_marks(footnotes: Sequence[Sequence[str]]) -> dict[str, str]:
    """Give each distinct footnote a letter, in order."""
    distinct = dict.fromkeys(note for of_load in footnotes for note in of_load)
    return {note: _letter(index) for index, note in enumerate(distinct)}


def _letter(index: int) -> str:
    letter = chr(ord("a") + index % 26)
    return letter if index < 26 else _letter(index // 26 - 1) + letter


def _taps(results: SessionResults) -> list[Taps]:
    rows = []
    for load in results.loads:
        impacts = [i for i in results.impacts if i.load_set == load.load_set]
        rejected = [i for i in impacts if not i.accepted and not _left_out(i)]
        reasons = Counter(i.reject_reason or "no reason given" for i in rejected)
        text = "; ".join(f"{count} × {reason}" if count > 1 else reason for reason, count in reasons.items())
        accepted, left_out = sum(i.accepted for i in impacts), sum(map(_left_out, impacts))
        rows.append(Taps(load, len(impacts), accepted, text, left_out))
    return rows


def _left_out(impact: ImpactResult) -> bool:
    """Whether a tap was sound and others were chosen."""
    return not impact.accepted and impact.reject_reason.startswith(LEFT_OUT)
