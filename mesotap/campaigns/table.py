"""The answers of a sweep as a table: a row for each load of each session."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from mesotap.campaigns.design import DIAGNOSIS, RESULTS

QUANTITIES = ("load_mn", "f1_hz", "f2_hz", "zeta1", "zeta2", "contact_stiffness_n_per_m", "contact_damping_n_s_per_m")
ENDS = ("value", "low", "high")


def sweep_csv(sessions: Iterable[tuple[str, Mapping[str, Any], Mapping[str, Any] | None]]) -> bytes:
    """Return the answers of sessions that are done as CSV; sessions without one have no row.

    Parameters
    ----------
    sessions
        Name, what was planned (``varied`` and ``seed``), and the result, of each.
    """
    listed = list(sessions)
    names = list(listed[0][1]["varied"]) if listed else []
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    said = ("verdict", "named", "probability")
    columns = [f"{q}_{end}" for q in QUANTITIES for end in ENDS]
    writer.writerow(["session", *names, "seed", "target_load_mn", "impacts_used", *columns, *said])
    for name, planned, result in listed:
        if result is not None:
            varied = [_cell(planned["varied"][key]) for key in names]
            for row in _rows(result["answers"]):
                writer.writerow([name, *varied, planned["seed"], *row])
    return out.getvalue().encode()


def _rows(answers: Mapping[str, Any]) -> Iterator[list[Any]]:
    verdict, named = verdict_of(answers)
    said = [verdict, " + ".join(named), min(named.values()) if named else ""]
    for load in answers[RESULTS]["loads"]:
        values = [(load.get(q) or {}).get(end, "") for q in QUANTITIES for end in ENDS]
        yield [load["target_load_mn"], load["impacts_used"], *values, *said]


def verdict_of(answers: Mapping[str, Any]) -> tuple[str, dict[str, float]]:
    """Return verdict and named mechanisms with their probabilities; an empty verdict where nothing was diagnosed."""
    diagnosis = answers.get(DIAGNOSIS)
    if diagnosis is None:
        return "", {}
    return str(diagnosis["verdict"]), {str(m["id"]): float(m["probability"]) for m in diagnosis["mechanisms"]}


def _cell(value: Any) -> Any:
    return value if isinstance(value, str | int | float) else json.dumps(value)
