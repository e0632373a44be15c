"""`mesotap trend`: whether gauge, springs, noise or a check specimen have changed over the sessions."""

from __future__ import annotations

import math
from pathlib import Path

from rich.console import Console

from analysis.control_charts import BETWEEN_FALSE_ALARMS
from daq.errors import RecordingError
from mesotap.answers.rounding import counted, significant
from mesotap.catalogue.trends import Trend, alarm_sentence, in_order, trends, trends_json
from mesotap.commands.catalog import Asked, look_up
from mesotap.commands.compare import refuse_figure
from mesotap.commands.outputs import write_json
from mesotap.operator.tables import Table
from mesotap.operator.terminal import escape

USUAL_LOAD_MN = 500.0


def trend(what: Asked, load_mn: float | None, figure: Path | None, json_path: Path | None, console: Console) -> None:
    """Draw control charts of the sessions that are asked for, and say what has changed since when."""
    if load_mn is not None and not (math.isfinite(load_mn) and load_mn > 0):
        raise RecordingError(f"--at {load_mn}: is not a load")
    if figure is not None:
        refuse_figure(figure)
    found = look_up(what, console)
    checks = load_mn is not None or what.options.get("specimen") is not None or "specimen:" in what.where
    made, said = trends(found.found, (load_mn or USUAL_LOAD_MN) if checks else None)
    if not checks:
        said.append("k_c: --specimen names the check specimen, --at the load (mN) at which its k_c is read off")
    left_out = len(found.found) + len(found.not_judged) - len(in_order(found.found))
    if left_out:
        said.append(
            f"left out: {counted(left_out, 'session')}: copies, not dated, or not to be read ('mesotap catalog' tells)"
        )
    _show(made, said, console)
    if figure is not None and made:
        from mesotap.report.figures._files import save
        from mesotap.report.figures._trend import trend_figure

        save(trend_figure([(t.quantity, t.unit, t.chart) for t in made]), figure)
        console.print(f"figure {escape(figure)}", highlight=False, soft_wrap=True)
    write_json(json_path, trends_json(made, said))


def _show(made: list[Trend], said: list[str], console: Console) -> None:
    shown = Table(
        title=f"control charts (EWMA and CUSUM); one false alarm in {BETWEEN_FALSE_ALARMS} sessions for each quantity"
    )
    for heading in ("quantity", "unit", "sessions", "first", "last", "scatter, %", "alarms"):
        shown.add_column(heading)
    for one in made:
        values = one.chart.values
        spread = 100 * float(values.std(ddof=1)) / abs(float(values.mean())) if values.mean() else math.nan
        cells = (str(len(values)), significant(float(values[0]), 5), significant(float(values[-1]), 5))
        shown.add_row(one.quantity, one.unit, *cells, significant(spread, 2), str(len(one.chart.alarms) or "none"))
    console.print(shown)
    for one in made:
        for number in range(len(one.chart.alarms)):
            console.print(f"- {escape(alarm_sentence(one, number))}", highlight=False, soft_wrap=True)
    for note in said:
        console.print(f"- {escape(note)}", highlight=False, soft_wrap=True)
