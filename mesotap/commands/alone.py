"""``calibrate`` and ``simulate``: one part of a session by itself."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from calibration.line import fit_line
from calibration.routine import calibrate, check_points
from daq.records import Session
from daq.session_file import write_session
from daq.trigger import record_impact
from mesotap import __version__
from mesotap.commands.outputs import refuse_to_overwrite, write_json
from mesotap.configuration.config import effective_text, load_config
from mesotap.operator.console import TerminalOperator
from mesotap.operator.terminal import escape
from mesotap.session.bench import build_rig, simulated_rig, truth_now
from mesotap.session.impacts import judged_impact
from mesotap.session.progress import describe_rig
from rig import GaugeScale
from rig.interlock import Interlock


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
    config = load_config(config_path, [*changes, f"mesotap.load_plan_mn=[{load_mn}]"])
    rig = simulated_rig(config, seed=seed)
    scale = GaugeScale(rig.true_parameters()["sensitivity_mv_per_mn"], config.sim_backend.gauge.offset_mv)
    lines = rig.open()
    with Interlock(rig, config.rig.limits, scale, config.rig.spring_stiffness()) as interlock:
        interlock.approach()
        interlock.set_load(load_mn, config.mesotap.load_tolerance_mn)
        interlock.lock()
        before = interlock.read_load()
        record = record_impact(rig.accelerometers, rig.impactor, rig.clock, config.daq.trigger, before[0])
        impact = judged_impact(record, before, interlock.read_load(), (0, 0, load_mn), config, rig.accelerometers)
        truth = truth_now(rig)
    rig.close()
    session = Session(
        created=record.time,
        rig=describe_rig(config.rig),
        impacts=(impact,),
        operator=config.mesotap.operator,
        specimen=config.mesotap.specimen,
        title="one simulated ring-down",
        software=f"mesotap {__version__} (simulated rig)",
        complete=True,
        config=effective_text(config),
    )
    write_session(output, session)
    for line in lines:
        console.print(line, highlight=False)
    said = impact.reject_reason or "accepted"
    console.print(f"{escape(output)}: one tap at {before[0]:.1f} mN, {escape(said)}", highlight=False, soft_wrap=True)
    write_json(json_path, {"format": "mesotap-truth", "version": 1, "file": str(output), "truth": truth})
