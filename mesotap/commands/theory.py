"""``surface``, ``figures`` and ``diagnose --published``: theory, and the paper's own measurements beside it."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from analysis.contact.gap import diagnose_published
from analysis.contact.weighing import Weighed
from analysis.published import PublishedTable, reanalyse
from analysis.quoted import Quoted, quoted_numbers
from analysis.results import SessionResults
from analysis.surface.moments import SurfaceAnswer, SurfaceParameters, analyse_scan, together
from analysis.surface.scan import read_scan
from daq.records import Session
from daq.session_file import read_session
from mesotap.answers.explanations import chance, known
from mesotap.answers.rounding import with_uncertainty
from mesotap.commands.answers import analysed
from mesotap.commands.outputs import make_ready, write_json
from mesotap.configuration.config import load_config
from mesotap.operator.tables import Table
from mesotap.operator.terminal import escape
from rig.errors import SessionAborted

SHOWN = 10  # explanations of a gap in the terminal
SPHERE_DAMPING = (0.17, 100.0, -0.75)  # 17 % at 100 mN to 3 % at 1 N (Sec. 4.1), a power of the load in between


def published_gap(which: str, json: Path | None, report: Path | None, console: Console) -> None:
    """Say what may fill the gap between theory and the published stiffnesses of ``flat`` or ``sphere``."""
    make_ready(None, report)
    gap = diagnose_published(which)
    show_weighed(gap.weighed, f"Table {gap.table}: explanations of the contact stiffness", console)
    lists = Table(title="Does a spring in series take part?")
    for heading in ("list", "explanations", "spring in series, %", "most probable", "%"):
        lists.add_column(heading, justify="left" if heading in ("list", "most probable") else "right", overflow="fold")
    for u in gap.lists:
        best = escape(u.best.replace("_", " "))
        lists.add_row(u.name, str(u.explanations), f"{100 * u.spring:.0f}", best, f"{100 * u.best_probability:.0f}")
    console.print(lists)
    for sentence in gap.sentences():
        console.print(f"- {escape(sentence)}", highlight=False)
    if report is not None:
        from mesotap.report.theory_pages import gap_report

        console.print(f"report {escape(gap_report(report, gap))}", highlight=False, soft_wrap=True)
    write_json(json, gap.as_json())


def show_weighed(weighed: Sequence[Weighed], title: str, console: Console) -> None:
    """Print the table of the most probable explanations."""
    shown = Table(title=title, caption="95 % intervals; ‹ › where only the range allowed beforehand bounds them")
    shown.add_column("explanation", overflow="fold")
    shown.add_column("probability, %", justify="right")
    shown.add_column("parameters", overflow="fold")
    shown.add_column("load left out, %", justify="right")
    shown.add_column("scatter, %", justify="right")
    for w in weighed[:SHOWN]:
        parameters = "; ".join(known(p) for p in w.parameters)
        shown.add_row(
            escape(w.candidate.id.replace("_", " ")),
            chance(w),
            escape(parameters),
            f"{100 * w.left_out_rms:.1f}",
            f"{100 * w.scatter.value:.1f}",
        )
    console.print(shown)


def surface(
    files: Sequence[Path], unit: str | None, spacing_um: float | None, degree: int, json: Path | None, console: Console
) -> None:
    """Print roughness, asperity radius and density of scans, and of the gap between the surfaces of several."""
    answers = [analyse_scan(read_scan(file, unit, spacing_um), degree) for file in files]
    shown = Table(title="Spectral moments along a line and the asperities they stand for, 95 % intervals")
    headings = (
        "scan",
        "spacing, µm",
        "R_q, nm",
        "R_s, µm",
        "eta, 1/µm²",
        "slope R_dq",
        "m0 m4 / m2²",
        "corr. length, µm",
    )
    for heading in headings:
        shown.add_column(heading, justify="left" if heading == "scan" else "right")
    for answer in answers:
        _surface_row(shown, answer.source, answer.spacing, answer.parameters, f"{answer.correlation_length * 1e6:.3g}")
        for spacing, parameters in answer.coarser:
            _surface_row(shown, "  the same, decimated", spacing, parameters, "")
    combined = together([answer.parameters for answer in answers]) if len(answers) > 1 else None
    if combined is not None:
        _surface_row(shown, "all together", None, combined, "")
    console.print(shown)
    for answer in answers:
        for note in answer.notes:
            console.print(f"- {escape(answer.source)}: {escape(note)}", highlight=False)
    write_json(
        json,
        {
            "format": "mesotap-surface",
            "version": 1,
            "form_degree": degree,
            "scans": [_surface_json(answer) for answer in answers],
            "together": None if combined is None else _parameters_json(combined),
        },
    )


def _surface_row(shown: Table, name: str, spacing: float | None, p: SurfaceParameters, length: str) -> None:
    shown.add_row(
        escape(name),
        "" if spacing is None else f"{spacing * 1e6:.3g}",
        with_uncertainty(p.R_q, 1e9),
        with_uncertainty(p.R_s, 1e6),
        with_uncertainty(p.eta, 1e-12),
        f"{p.m2.value**0.5:.3g}",
        f"{p.bandwidth:.3g}",
        length,
    )


def _surface_json(answer: SurfaceAnswer) -> dict[str, Any]:
    return {
        "source": answer.source,
        "spacing_m": answer.spacing,
        **_parameters_json(answer.parameters),
        "correlation_length_m": answer.correlation_length,
        "skewness": answer.skewness,
        "kurtosis": answer.kurtosis,
        "coarser": [{"spacing_m": spacing, **_parameters_json(p)} for spacing, p in answer.coarser],
        "notes": list(answer.notes),
    }


def _parameters_json(p: SurfaceParameters) -> dict[str, Any]:
    return {
        "roughness_rq_m": p.R_q.as_json(),
        "asperity_radius_m": p.R_s.as_json(),
        "asperity_density_per_m2": p.eta.as_json(),
        "m0_m2": p.m0.as_json(),
        "m2": p.m2.as_json(),
        "m4_per_m2": p.m4.as_json(),
        "bandwidth": p.bandwidth,
    }


def paper_figures(output: Path, seed: int, json: Path | None, console: Console) -> None:
    """Draw Fig. 3, 5, 6, 7, 8 and 9 and hold the numbers of the text against theory."""
    from analysis.contact.theory import theory
    from mesotap.report import figures
    from mesotap.report.theory_pages import paper_page

    make_ready(None, output)
    flat, sphere = reanalyse().tables
    console.print("simulating a session on flats and one on a sphere", highlight=False)
    session, on_flats = _simulated_session(_settings(flat), seed, console)
    _, on_sphere = _simulated_session(_settings(sphere), seed, console)
    impact = max((s for s in session.impacts if s.accepted), key=lambda s: s.target_load_mn)
    quoted = quoted_numbers()
    drawn = [
        (
            "fig3",
            "Figure 3",
            "Contact stiffness by theory against load; circles: what the text quotes.",
            figures.paper_figure_3(),
        ),
        (
            "fig5",
            "Figure 5",
            "Calibration of the strain gauge before and after a simulated session.",
            figures.calibration_figure(session, on_flats),
        ),
        ("fig6a", "Figure 6 (a)", "Acceleration after a tap, simulated.", figures.record_figure(impact)),
        (
            "fig6b",
            "Figure 6 (b)",
            "Averaged spectra of flats at several loads, simulated.",
            figures.spectra_figure(on_flats),
        ),
        (
            "fig7",
            "Figure 7",
            "Sphere: (a) stiffness, (b) damping against load.",
            figures.paper_figure_7_8(sphere, on_sphere, theory("paper-sphere")),
        ),
        (
            "fig8",
            "Figure 8",
            "Flats: (a) stiffness, (b) damping against load.",
            figures.paper_figure_7_8(flat, on_flats, theory("paper-flat")),
        ),
        (
            "fig9",
            "Figure 9",
            "Flats dry, with wear debris and lubricated: (a) stiffness, (b) damping against load.",
            figures.paper_figure_9(flat),
        ),
    ]
    page = paper_page(output, drawn, quoted)
    _show_quoted(quoted, console)
    console.print(f"figures {escape(page)}", highlight=False, soft_wrap=True)
    write_json(json, {"format": "mesotap-quoted", "version": 1, "numbers": [q.as_json() for q in quoted]})


def _show_quoted(quoted: Sequence[Quoted], console: Console) -> None:
    shown = Table(title="Numbers that the text quotes")
    for heading in ("where", "what", "quoted", "computed", "by", "comes out", "remark"):
        shown.add_column(heading, justify="right" if heading in ("quoted", "computed") else "left", overflow="fold")
    for q in quoted:
        shown.add_row(q.place, q.what, f"{q.quoted:g} {q.unit}", f"{q.computed:.4g}", q.by, q.verdict, escape(q.why))
    console.print(shown)
    count = sum(q.comes_out for q in quoted)
    console.print(f"{count} of {len(quoted)} come out, rounded or cut off", highlight=False)


def _settings(table: PublishedTable) -> list[str]:
    """Settings of a simulated session on a table's contact."""
    loads = table.load_mn.tolist()
    changes = [
        f"analysis.contact={table.contact}",
        f"mesotap.load_plan_mn={loads}",
        f"rig.springs.system_resonance_hz={table.system_resonance_hz}",
        f"sim_backend.contact.load_mn={loads}",
        f"sim_backend.contact.contact_stiffness_n_per_um={(table.contact_stiffness_n_per_m * 1e-6).tolist()}",
    ]
    if table.number == 3:
        zeta, at, exponent = SPHERE_DAMPING
        changes.append(f"sim_backend.contact.damping_ratio={[zeta * (load / at) ** exponent for load in loads]}")
    return changes


def _simulated_session(changes: Sequence[str], seed: int, console: Console) -> tuple[Session, SessionResults]:
    from mesotap.commands.recordings import SESSION_FILE
    from mesotap.commands.session import run
    from mesotap.session.order import RigChoice

    with tempfile.TemporaryDirectory() as folder:
        unheard = Console(file=io.StringIO())
        choice = RigChoice(simulate=True, seed=seed)
        try:
            run(None, changes, choice, Path(folder) / "session", None, unheard)
        except SessionAborted as aborted:  # nobody can resume what is gone with its folder
            raise KeyboardInterrupt from aborted
        session = read_session(Path(folder) / "session" / SESSION_FILE)
    return session, analysed(session, load_config(None, changes), console)
