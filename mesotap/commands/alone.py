"""``calibrate`` and ``simulate``: one part of a session by itself."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from calibration.line import fit_line
from calibration.routine import calibrate, check_points
from daq.session_file import write_session
from mesotap.commands.outputs import refuse_to_overwrite, write_json
from mesotap.configuration.config import load_config
from mesotap.operator.console import TerminalOperator
from mesotap.operator.terminal import escape
from mesotap.session.bench import build_rig
from mesotap.session.one_tap import simulated_tap


def calibrate_gauge(
    config_path: Path | None,
    changes: Sequence[str],
    simulate: bool,
    seed: int | None,
    json_path: Path | None,
    console: Console,
    emulate: bool = False,
) -> None:
    """Calibrate the strain gauge by itself and say what came out."""
    config = load_config(config_path, changes)
    operator = TerminalOperator(console)
    rig = build_rig(config, simulate, operator, seed, emulated=emulate)
    try:
        rig.open()
        points = calibrate(rig, config.calibration, operator.say)
    finally:
        rig.close()
    fit = fit_line(
        points, config.calibration.typical_weight_error_mn(points.load_mn), config.calibration.drift_test_level
    )
    complaints = check_points(points, config.calibration, config.rig.gauge_sensitivity_mv_per_mn)
    sensitivity, offset = fit.sensitivity_mv_per_mn, fit.offset_mv
    console.print(
        f"sensitivity {sensitivity.value:.5f} mV/mN (95 % {sensitivity.low:.5f} to {sensitivity.high:.5f}), "
        f"offset {offset.value:.3f} mV, {fit.nonlinearity_percent:.3f} % off a line at most",
        highlight=False,
    )
    for complaint in complaints:
        console.print(complaint, highlight=False)
    write_json(
        json_path,
        {
            "format": "mesotap-calibration",
            "version": 1,
            "time": points.time,
            "load_mn": points.load_mn.tolist(),
            "voltage_mv": points.voltage_mv.tolist(),
            "sensitivity_mv_per_mn": sensitivity.as_json(),
            "offset_mv": offset.as_json(),
            "nonlinearity_percent": fit.nonlinearity_percent,
            "complaints": complaints,
        },
    )


def simulate_one(
    config_path: Path | None,
    changes: Sequence[str],
    output: Path,
    load_mn: float,
    seed: int | None,
    json_path: Path | None,
    console: Console,
) -> None:
    """Record one tap of the simulated rig into a session file."""
    refuse_to_overwrite(output)
    tap = simulated_tap(load_config(config_path, [*changes, f"mesotap.load_plan_mn=[{load_mn}]"]), load_mn, seed)
    write_session(output, tap.session)
    for line in tap.said:
        console.print(line, highlight=False)
    (impact,) = tap.session.impacts
    tapped = f"one tap at {impact.load_before_mn:.1f} mN, {escape(impact.reject_reason or 'accepted')}"
    console.print(f"{escape(output)}: {tapped}", highlight=False, soft_wrap=True)
    write_json(json_path, {"format": "mesotap-truth", "version": 1, "file": str(output), "truth": tap.truth})
