"""The report of a session: one self-contained page with tables, figures and verdicts, and the numbers beside it."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from analysis.contact.theory import TheoryCurve
from analysis.results import ImpactResult, LoadResult, RecordingModes, SessionResults
from calibration.estimate import LEVEL, Estimate
from daq.durable import write_whole
from daq.records import Session, Shot
from mesotap import figures
from mesotap.figures import Recording
from mesotap.results_files import impacts_csv, json_text, loads_csv, modes_json, results_json
from mesotap.rounding import UNKNOWN, significant, with_uncertainty

__all__ = ["recording_report", "results_json", "with_uncertainty", "write_report"]

N_PER_MN = 1e-3  # newtons in a millinewton
FIGURE_FOLDER = "figures"
RECOVERED = {  # quantity of a truth mapping -> what reports call it
    "load_mn": "P",
    "f1_hz": "f1",
    "f2_hz": "f2",
    "zeta1": "ζ1",
    "zeta2": "ζ2",
    "contact_stiffness_n_per_m": "kc",
    "contact_damping_n_s_per_m": "cc",
}


@dataclass(frozen=True, slots=True)
class Plate:
    """One figure of the page."""

    svg: Markup
    wide: bool = True


@dataclass(frozen=True, slots=True)
class Ratio:
    """Measured stiffness of one load over what each theory predicts there."""

    load: LoadResult
    ratios: tuple[Estimate | None, ...]


@dataclass(frozen=True, slots=True)
class Taps:
    """How many taps one load took."""

    load: LoadResult
    made: int
    accepted: int
    reasons: str


@dataclass(frozen=True, slots=True)
class Recovery:
    """One quantity of one load against the truth of the simulated rig; ``inside`` its 95 % interval or not."""

    estimate: Estimate | None
    true: float | None
    deviation_percent: float | None
    inside: bool | None


def write_report(
    folder: Path,
    session: Session,
    results: SessionResults,
    theory: Sequence[TheoryCurve],
    truth: Sequence[Mapping[str, Any]] | None = None,
    *,
    pdf_figures: bool = True,
) -> Path:
    """Write ``report.html`` and beside it ``results.json``, ``results.csv``, ``impacts.csv`` and ``figures/*.pdf``.

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
    pdf_figures
        Whether to write ``figures/*.pdf``, which takes longer than all the rest.

    Returns
    -------
    Path
        The report.
    """
    folder.mkdir(parents=True, exist_ok=True)
    drawn = _session_figures(session, results, theory)
    if pdf_figures:
        (folder / FIGURE_FOLDER).mkdir(exist_ok=True)
        for name, figure in drawn.items():
            figures.save(figure, folder / FIGURE_FOLDER / f"{name}.pdf")
    _written(folder / "results.json", json_text(results_json(results)))
    _written(folder / "results.csv", loads_csv(results))
    _written(folder / "impacts.csv", impacts_csv(results))
    ratios = _ratios(results, theory)
    recovered = None if truth is None else _recovered(results, truth)
    page = _environment().get_template("report.html")
    html = page.render(
        session=session,
        results=results,
        theory=theory,
        drifted=results.calibration is not None and results.calibration.drifted,
        simulated=truth is not None,
        summary=_summary(results, theory, ratios),
        plates={name: Plate(Markup(figures.inline_svg(drawn[name], name, LABELS[name]))) for name in drawn},
        typical=_typical_shot(session),
        spectra=figures.shown_spectra(results),
        marks=_note_marks(results.loads),
        ratios=ratios,
        taps=_taps(results),
        rejected=[(i, _shot(session, i)) for i in results.impacts if not i.accepted],
        recovered=recovered,
        inside=_count_inside(recovered),
        truth_missing=truth is not None and not recovered,
        level_percent=round(100 * LEVEL),
        pdf_figures=pdf_figures,
    )
    return _written(folder / "report.html", html)


def recording_report(folder: Path, recording: Recording, modes: RecordingModes) -> Path:
    """Write the page of a recording that is no session: ``report.html``, ``modes.json`` and ``modes.pdf``.

    Parameters
    ----------
    folder
        Where to; made if it is not there.
    recording
        Samples (c, n) with rate, names and unit.
    modes
        What was identified in it.

    Returns
    -------
    Path
        The page.
    """
    folder.mkdir(parents=True, exist_ok=True)
    figure = figures.modes_figure(recording, modes)
    figures.save(figure, folder / "modes.pdf")
    _written(folder / "modes.json", json_text(modes_json(modes)))
    data = np.atleast_2d(np.asarray(recording.data))
    names = [str(recording.names[c]) if c < len(recording.names) else f"channel {c}" for c in range(data.shape[0])]
    html = _environment().get_template("recording.html").render(
        recording=recording,
        names=names,
        duration_s=data.shape[1] / recording.rate_hz,
        modes=modes,
        plate=Plate(Markup(figures.inline_svg(figure, "modes", LABELS["modes"]))),
        level_percent=round(100 * LEVEL),
    )  # fmt: skip
    return _written(folder / "report.html", html)


LABELS = {
    "calibration": "Strain gauge voltage against dead weight, before and after the session, with residuals",
    "record": "Acceleration of both accelerometers against time for one tap",
    "spectra": "Averaged acceleration spectra of several loads",
    "stiffness": "Contact stiffness against load with theory",
    "damping": "Damping ratio of the contact mode against load",
    "impacts": "Contact stiffness of each impact in order, as deviation from the combined estimate of its load",
    "modes": "Record against time, and spectrum with the identified modes",
}


def _written(path: Path, text: str) -> Path:
    write_whole(path, text.encode())
    return path


def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["pm"] = lambda estimate, scale=1.0: _typographic(with_uncertainty(estimate, scale))
    environment.filters["digits"] = lambda value, count=3: _typographic(significant(value, count))
    environment.filters["signed"] = _signed
    environment.filters["moment"] = lambda text: text.replace("T", " ").removesuffix("Z")
    return environment


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
    if (shot := _typical_shot(session)) is not None:
        drawn["record"] = figures.record_figure(shot)
    if figures.shown_spectra(results):
        drawn["spectra"] = figures.spectra_figure(results)
    if any(load.contact_stiffness_n_per_m is not None for load in results.loads):
        drawn["stiffness"] = figures.stiffness_figure(results, theory)
    if any(load.zeta2 is not None for load in results.loads):
        drawn["damping"] = figures.damping_figure(results)
    if any(impact.contact_stiffness_n_per_m is not None for impact in results.impacts):
        drawn["impacts"] = figures.impacts_figure(results)
    return drawn


def _typical_shot(session: Session) -> Shot | None:
    """Pick the accepted tap of the middle load with the median peak; a rejected one if there is no other."""
    shots = [s for s in session.shots if s.acceleration.shape[0] >= 2 and s.acceleration.shape[1] > 1]
    candidates = [s for s in shots if s.accepted] or shots
    if not candidates:
        return None
    load_sets = sorted({s.load_set for s in candidates})
    middle = [s for s in candidates if s.load_set == load_sets[len(load_sets) // 2]]
    middle.sort(key=lambda s: float(np.max(np.abs(s.acceleration))))
    return middle[len(middle) // 2]


def _shot(session: Session, impact: ImpactResult) -> Shot | None:
    return next((shot for shot in session.shots if shot.name == impact.name), None)


def _note_marks(loads: Sequence[LoadResult]) -> dict[str, str]:
    """Give each distinct note of the loads a letter, in order."""
    notes = dict.fromkeys(note for load in loads for note in load.notes)
    return {note: _letter(index) for index, note in enumerate(notes)}


def _letter(index: int) -> str:
    letter = chr(ord("a") + index % 26)
    return letter if index < 26 else _letter(index // 26 - 1) + letter


def _ratios(results: SessionResults, theory: Sequence[TheoryCurve]) -> list[Ratio]:
    rows = []
    for load in results.loads:
        k = load.contact_stiffness_n_per_m
        if k is None or load.load_mn is None or load.load_mn.value <= 0:
            continue
        preload = np.array([load.load_mn.value * N_PER_MN])
        predicted = [float(np.asarray(curve.stiffness(preload))[0]) for curve in theory]
        usable = [value if math.isfinite(value) and value > 0 else None for value in predicted]
        rows.append(Ratio(load, tuple(None if p is None else _scaled(k, 1 / p) for p in usable)))
    return rows


def _scaled(estimate: Estimate, factor: float) -> Estimate:
    return replace(estimate, value=estimate.value * factor, standard_error=estimate.standard_error * factor)


def _taps(results: SessionResults) -> list[Taps]:
    rows = []
    for load in results.loads:
        impacts = [i for i in results.impacts if i.load_set == load.load_set]
        reasons = Counter(i.reject_reason or "no reason given" for i in impacts if not i.accepted)
        text = "; ".join(f"{count} × {reason}" if count > 1 else reason for reason, count in reasons.items())
        rows.append(Taps(load, len(impacts), sum(i.accepted for i in impacts), text))
    return rows


def _recovered(
    results: SessionResults, truth: Sequence[Mapping[str, Any]]
) -> list[tuple[LoadResult, dict[str, Recovery]]]:
    by_set = {int(entry["load_set"]): entry for entry in truth if entry.get("load_set") is not None}
    return [
        (load, {q: _recovery(getattr(load, q), by_set[load.load_set].get(q)) for q in RECOVERED})
        for load in results.loads
        if load.load_set in by_set
    ]


def _recovery(estimate: Estimate | None, true: float | None) -> Recovery:
    if estimate is None or true is None or not math.isfinite(true):
        return Recovery(estimate, true, None, None)
    deviation = 100 * (estimate.value / true - 1) if true else None
    return Recovery(estimate, true, deviation, estimate.low <= true <= estimate.high)


def _count_inside(recovered: list[tuple[LoadResult, dict[str, Recovery]]] | None) -> tuple[int, int]:
    verdicts = [r.inside for _, row in recovered or [] for r in row.values() if r.inside is not None]
    return sum(verdicts), len(verdicts)


def _summary(results: SessionResults, theory: Sequence[TheoryCurve], ratios: Sequence[Ratio]) -> list[str]:
    """Say in a few plain sentences what was found, how theory compares and how good the taps and the gauge were."""
    sentences = []
    measured = [load for load in results.loads if load.contact_stiffness_n_per_m is not None]
    measured.sort(key=lambda load: load.load_mn.value if load.load_mn is not None else load.target_load_mn)
    if not measured:
        sentences.append("No contact stiffness could be estimated; the notes below say why.")
    elif len(measured) == 1:
        sentences.append(f"At {_load_words(measured[0])} the contact stiffness is {_stiffness(measured[0])} MN/m.")
    else:
        first, last = measured[0], measured[-1]
        sentences.append(
            f"The contact stiffness goes from {_stiffness(first)} MN/m at {_load_words(first)}"
            f" to {_stiffness(last)} MN/m at {_load_words(last)}{_exponent_words(measured)}{_damping_words(measured)}."
        )
    if comparison := _closest_theory(theory, ratios):
        sentences.append(comparison)
    rejected = sum(not impact.accepted for impact in results.impacts)
    used = sum(load.impacts_used for load in results.loads)
    taps = f"{len(results.impacts)} taps at {len(results.loads)} load{'s' * (len(results.loads) != 1)}:"
    taps += f" {used} used, {rejected} rejected."
    sentences.append(taps)
    if results.calibration is not None and results.calibration.drifted:
        sentences[-1] += " The strain gauge drifted, so the loads are in doubt."
    elif results.calibration is not None:
        tested = results.calibration.drift_p_value is not None
        sentences[-1] += " The strain gauge did not drift." if tested else " The gauge's drift could not be tested."
    return [_typographic_words(sentence) for sentence in sentences]


def _typographic_words(sentence: str) -> str:
    """Set minus signs, and keep a number together with its uncertainty and unit."""
    sentence = sentence.replace(" -", " −").replace(" ± ", "\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}")
    return re.sub(r"(?<=[\d)]) (?=MN/m|mN|%)", "\N{NO-BREAK SPACE}", sentence)


def _load_words(load: LoadResult) -> str:
    if load.load_mn is None:
        return f"a target load of {significant(load.target_load_mn, 4)} mN"
    return f"{with_uncertainty(load.load_mn)} mN"


def _stiffness(load: LoadResult) -> str:
    return with_uncertainty(load.contact_stiffness_n_per_m, 1e-6)


def _exponent_words(measured: Sequence[LoadResult]) -> str:
    points = [
        (math.log(load.load_mn.value), math.log(k.value))
        for load in measured
        if load.load_mn is not None and load.load_mn.value > 0
        if (k := load.contact_stiffness_n_per_m) is not None and k.value > 0
    ]
    if len(points) < 3 or len({x for x, _ in points}) < 3:
        return ""
    log_load, log_stiffness = np.array(points).T
    slope = float(np.polynomial.Polynomial.fit(log_load, log_stiffness, 1).convert().coef[1])
    return f", about as the load to the power {slope:.2f}"


def _damping_words(measured: Iterable[LoadResult]) -> str:
    ratios = [load.zeta2 for load in measured if load.zeta2 is not None]
    if len(ratios) < 2:
        return ""
    return f"; the contact mode's damping ratio goes from {_percent(ratios[0])} % to {_percent(ratios[-1])} %"


def _percent(estimate: Estimate) -> str:
    text = with_uncertainty(estimate, 100)
    return f"({text})" if "±" in text else text


def _closest_theory(theory: Sequence[TheoryCurve], ratios: Sequence[Ratio]) -> str:
    best: tuple[float, str] | None = None
    for index, curve in enumerate(theory):
        values = [r.ratios[index] for r in ratios]
        numbers = [v.value for v in values if v is not None and v.value > 0]
        if not numbers or len(numbers) < len(ratios):
            continue
        distance = float(np.sqrt(np.mean(np.log(numbers) ** 2)))
        span = f"{min(numbers):.2f} to {max(numbers):.2f} times" if len(numbers) > 1 else f"{numbers[0]:.2f} times"
        equation = f" ({curve.equation})" if curve.equation else ""
        if best is None or distance < best[0]:
            best = (
                distance,
                f"Of the theories, {curve.name}{equation} is closest: the measured stiffness is {span} its prediction.",
            )
    return "" if best is None else best[1]
