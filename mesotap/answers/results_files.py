"""Results for other programs: the JSON contract, and tables of a row a load and a row an impact."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from typing import Any

from analysis.modal.amplitude import AmplitudePoint
from analysis.modal.spectrum import SpectralMode
from analysis.results import ImpactResult, LoadResult, RecordingModes, SessionResults
from calibration.estimate import Estimate
from calibration.gauge import GaugeResult
from calibration.weights import Gravity
from daq.errors import one_line
from mesotap.answers.budgets import COLUMNS, budget_rows, budgets_json
from mesotap.answers.formats import MODES_FORMAT, RESULTS_FORMAT, VERSION
from mesotap.answers.frequency_response import cross_check_json

MODAL = ("f1_hz", "f2_hz", "zeta1", "zeta2")
CONTACT = ("contact_stiffness_n_per_m", "contact_damping_n_s_per_m")
QUANTITIES = ("load_mn", *MODAL, *CONTACT)
DRIFT_NOTE = "the strain gauge drifted during the test: the load is in doubt"


def results_json(results: SessionResults) -> dict[str, Any]:
    """Return the session's results as the ``mesotap-results`` mapping: finite numbers, None where there is none."""
    drift = _drifted(results)
    return {
        "format": RESULTS_FORMAT,
        "version": VERSION,
        "source": results.source,
        "method": results.method,
        "loads": [_load(load, drift) for load in results.loads],
        "impacts": [_impact(impact, drift) for impact in results.impacts],
        "calibration": None if results.calibration is None else _calibration(results.calibration),
        "springs_n_per_m": [_estimate(spring) for spring in results.springs_n_per_m],
        "notes": [*results.remarks, *results.notes],
        **({"hammer": [cross_check_json(check) for check in results.hammer]} if results.hammer else {}),
    }


def modes_json(modes: RecordingModes) -> dict[str, Any]:
    """Return the modes of any other recording as the ``mesotap-modes`` mapping."""
    return {
        "format": MODES_FORMAT,
        "version": VERSION,
        "source": modes.source,
        "method": modes.method,
        "channels": [{"name": name, "unit": unit} for name, unit in modes.channels],
        "modes": [
            {
                "frequency_hz": _estimate(mode.frequency_hz),
                "damping_ratio": _estimate(mode.damping_ratio),
                "amplitude": [_number(a) for a in mode.amplitude],
                "emac": _number(mode.emac),
                "mpc": _number(mode.mpc),
                "shape": [[_number(z.real), _number(z.imag)] for z in mode.shape],
                "along_decay": [_point(point, "amplitude") for point in mode.along_decay],
            }
            for mode in modes.modes
        ],
        "mac": [[_number(float(value)) for value in row] for row in modes.mac()],
        "notes": list(modes.notes),
    }


def json_text(mapping: dict[str, Any]) -> str:
    """Write a mapping as JSON text; a NaN or an infinity in it is an error."""
    return json.dumps(mapping, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def loads_csv(results: SessionResults) -> str:
    """Return a table of one row a load: each quantity with the ends of its 95 % interval, units in the header."""
    header = ["load_set", "target_load_mn", "impacts_used", *_columns(QUANTITIES), "notes"]
    drift = _drifted(results)
    rows = [
        [
            load.load_set,
            _number(load.target_load_mn),
            load.impacts_used,
            *_cells(load, QUANTITIES),
            "; ".join(_with_drift(load.notes, drift)),
        ]
        for load in results.loads
    ]
    return table_csv(header, rows)


def impacts_csv(results: SessionResults) -> str:
    """Return a table of one row an impact, the rejected ones with their reason."""
    peaks = ["peak_acceleration_m_s2", "peak_contact_force_n"]
    header = ["id", "load_set", "accepted", "reject_reason", *_columns(QUANTITIES), *peaks, "notes"]
    drift = _drifted(results)
    rows = [
        [
            *(impact.name, impact.load_set, int(impact.accepted), impact.reject_reason),
            *_cells(impact, QUANTITIES),
            *(_number(impact.peak_acceleration_m_s2), _number(impact.peak_contact_force_n)),
            "; ".join(_with_drift(impact.notes, drift)),
        ]
        for impact in results.impacts
    ]
    return table_csv(header, rows)


def budgets_csv(results: SessionResults) -> str:
    """Return a table of one row for each source of uncertainty of each number of each load."""
    return table_csv(COLUMNS, budget_rows(results))


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def _estimate(estimate: Estimate | None) -> dict[str, float] | None:
    if estimate is None:
        return None
    numbers = estimate.as_json()
    return {key: float(v) for key, v in numbers.items()} if all(map(math.isfinite, numbers.values())) else None


def _estimates(source: LoadResult | ImpactResult, quantities: Sequence[str]) -> dict[str, dict[str, float] | None]:
    return {quantity: _estimate(getattr(source, quantity)) for quantity in quantities}


def _reasons(source: LoadResult | ImpactResult, estimates: dict[str, dict[str, float] | None]) -> list[str]:
    """Notes of a result, with a word on every null that they might not speak of."""
    notes = list(source.notes)
    for quantity, written in estimates.items():
        if written is None and getattr(source, quantity) is not None:
            notes.append(f"{quantity}: the data give no finite 95 % interval")
    if not notes and (missing := [quantity for quantity, written in estimates.items() if written is None]):
        notes.append(f"not estimated: {', '.join(missing)}")
    return notes


def _drifted(results: SessionResults) -> bool:
    return results.calibration is not None and results.calibration.drifted


def _with_drift(notes: Sequence[str], drift: bool) -> list[str]:
    """Notes of a load or an impact, with the gauge's drift among them where there was one."""
    said = any(note.startswith(DRIFT_NOTE.partition(":")[0]) for note in notes)
    return [*notes, *([DRIFT_NOTE] if drift and not said else [])]


def _spectral(mode: SpectralMode | None) -> dict[str, Any] | None:
    if mode is None:
        return None
    return {"frequency_hz": _estimate(mode.frequency_hz), "damping_ratio": _estimate(mode.damping_ratio)}


def _point(point: AmplitudePoint, amplitude: str) -> dict[str, Any]:
    return {
        amplitude: _number(point.amplitude),
        "time_s": _number(point.time_s),
        "frequency_hz": _estimate(point.frequency_hz),
        "damping_ratio": _estimate(point.damping_ratio),
    }


def _load(load: LoadResult, drift: bool) -> dict[str, Any]:
    estimates = _estimates(load, QUANTITIES)
    return {
        "load_set": int(load.load_set),
        "target_load_mn": _number(load.target_load_mn),
        "impacts_used": int(load.impacts_used),
        **estimates,
        "spectral_mode": _spectral(load.spectral_mode),
        "along_decay": [_point(point, "amplitude_m_s2") for point in load.along_decay],
        "budgets": budgets_json(load),
        "notes": _with_drift(_reasons(load, estimates), drift),
    }


def _impact(impact: ImpactResult, drift: bool) -> dict[str, Any]:
    estimates = _estimates(impact, QUANTITIES)
    notes = _reasons(impact, estimates) if impact.accepted else list(impact.notes)
    peak = _number(impact.peak_acceleration_m_s2)
    if peak is None:  # the contract wants a number here
        notes.append("peak_acceleration_m_s2: unknown, 0 stands in its place")
    return {
        "id": impact.name,
        "load_set": int(impact.load_set),
        "accepted": bool(impact.accepted),
        "reject_reason": impact.reject_reason,
        **estimates,
        "peak_acceleration_m_s2": 0.0 if peak is None else peak,
        "peak_contact_force_n": _number(impact.peak_contact_force_n),
        "notes": _with_drift(notes, drift),
    }


def _calibration(calibration: GaugeResult) -> dict[str, Any]:
    return {
        "sensitivity_mv_per_mn": _estimate(calibration.sensitivity_mv_per_mn),
        "offset_mv": _estimate(calibration.offset_mv),
        "nonlinearity_percent": _number(calibration.nonlinearity_percent),
        "drifted": bool(calibration.drifted),
        "drift_p_value": _number(calibration.drift_p_value),
        "hysteresis_percent": _number(calibration.hysteresis_percent),
        "misfit_mn": _number(calibration.misfit_mn),
        "zero_readings": int(calibration.zero_readings),
        "gravity_m_s2": None if calibration.gravity is None else _gravity(calibration.gravity),
        "statement": calibration.statement,
    }


def _gravity(gravity: Gravity) -> dict[str, Any]:
    return {
        "value": gravity.value,
        "standard_uncertainty": gravity.standard_uncertainty,
        "distribution": gravity.distribution,
        "source": gravity.source,
    }


def _columns(quantities: Sequence[str]) -> list[str]:
    return [name for quantity in quantities for name in (quantity, f"{quantity}_low", f"{quantity}_high")]


def _cells(source: LoadResult | ImpactResult, quantities: Sequence[str]) -> list[float | None]:
    cells: list[float | None] = []
    for written in _estimates(source, quantities).values():
        cells += [None] * 3 if written is None else [written["value"], written["low"], written["high"]]
    return cells


_FORMULA = (
    "=",
    "+",
    "-",
    "@",
    "\t",
    "\r",
    *"\uff1d\uff0b\uff0d\uff20",
)  # the last four are the wide forms of the first


def _cell(value: object) -> object:
    """Return a cell that no spreadsheet takes for a formula: a text that begins as one gets an apostrophe."""
    if not isinstance(value, str):
        return value
    text = one_line(value)
    begins = [written.lstrip(" \n").startswith(_FORMULA) for written in (value, text)]
    return f"'{text}" if any(begins) else text


def table_csv(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return a table as CSV in which no spreadsheet finds a formula."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return stream.getvalue()
