"""``published``: the paper's own tables, analysed again."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from mesotap.commands.outputs import make_ready, write_json
from mesotap.operator.tables import Table
from mesotap.operator.terminal import escape


def published(report: Path | None, json_path: Path | None, console: Console) -> None:
    """Print the published tables through Eq. 11, and the paper's conflicts."""
    from analysis.published import reanalyse

    make_ready(None, report)
    answer = reanalyse()
    for table in answer.tables:
        shown = Table(
            title=f"Table {table.number}: k1 = k2 = {table.k1_n_per_m * 1e-6:.4f} MN/m from "
            f"{table.system_resonance_hz:g} Hz; k_c grows as load^{table.log_slope:.2f}"
        )
        of_laws = [f"over {law.equation}" for law in table.theories]
        for heading in ("load, mN", "f2, Hz", "k_c, MN/m", "with tubes, MN/m", *of_laws):
            shown.add_column(heading, justify="right")
        for i, load in enumerate(table.load_mn):
            ratios = [f"{law.measured_over_theory[i]:.2f}" for law in table.theories]
            stiffnesses = (table.contact_stiffness_n_per_m, table.with_tubes.contact_stiffness_n_per_m)
            both = [f"{k[i] * 1e-6:.3f}" for k in stiffnesses]
            shown.add_row(f"{load:.1f}", f"{table.f2_hz[i]:.0f}", *both, *ratios)
        console.print(shown)
        console.print(f"- {table.about_plasticity}", highlight=False)
        console.print(f"- {table.about_tubes}", highlight=False)
    console.print("Conflicts in the paper's text:")
    for conflict in answer.conflicts:
        console.print(f"- {escape(conflict)}", highlight=False)
    if report is not None:
        from mesotap.report.report import published_report

        console.print(f"report {escape(published_report(report, answer))}", highlight=False, soft_wrap=True)
    write_json(json_path, answer.as_json())
