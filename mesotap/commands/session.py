"""``run``, ``resume``, ``calibrate`` and ``simulate``: what drives a rig."""

from __future__ import annotations

import contextlib
import datetime
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from rich.console import Console

from analysis.results import SessionResults
from calibration.line import fit_line
from calibration.routine import calibrate, check_points
from daq.errors import RecordingError
from daq.journal import HEADER, SessionFolder
from daq.records import Session
from daq.session_file import read_session, write_session
from daq.trigger import record_impact
from mesotap import __version__
from mesotap.answers.results_files import results_json
from mesotap.commands.answers import analysed, show_session
from mesotap.commands.outputs import refuse_to_overwrite, write_json
from mesotap.commands.recordings import SESSION_FILE
from mesotap.commands.wire_options import NO_WIRE, WireOptions
from mesotap.configuration.config import Config, ConfigError, effective_text, load_config
from mesotap.operator.console import KeyControl, SessionDisplay, TerminalOperator
from mesotap.operator.outlet import unhurried
from mesotap.operator.terminal import escape
from mesotap.session.bench import build_rig, simulated_rig, truth_now
from mesotap.session.emulated_devices import SeparateRig, refuse_foreign_devices
from mesotap.session.entries import progress_in
from mesotap.session.guardian_link import guardian_for
from mesotap.session.header import FOLDER_FORMAT, FOLDER_VERSION, header_fault, kept_config, note_version, read_header
from mesotap.session.impacts import judged_impact
from mesotap.session.progress import HARDWARE, assemble, describe_rig
from mesotap.session.runner import Bench, SessionRunner
from mesotap.session.session_log import Logged, session_log
from mesotap.session.states import State
from rig import GaugeScale, Rig
from rig.drivers.wire_record import WireFile
from rig.errors import MesotapError
from rig.hardware_log import HardwareLog
from rig.interlock import Interlock
from rig.wall_clock import WallClock


def run(
    config_path: Path | None,
    changes: Sequence[str],
    simulate: bool,
    seed: int | None,
    realtime: bool,
    output: Path | None,
    json_path: Path | None,
    console: Console,
    emulate: bool = False,
    wire: WireOptions = NO_WIRE,
) -> None:
    """Begin a session in a new folder and carry it to its report."""
    config = load_config(config_path, changes)
    now = datetime.datetime.now(datetime.UTC)
    path = output or Path("sessions") / now.strftime("%Y%m%d-%H%M%S")
    header: dict[str, Any] = {
        "format": FOLDER_FORMAT,
        "format_version": FOLDER_VERSION,
        "created": now.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
        "config": effective_text(config),
        "simulated": simulate or emulate,
        "emulated": emulate,
        "seed": config.sim_backend.seed if seed is None else seed,
        "realtime": realtime,
        "software": f"mesotap {__version__}",
    }
    if fault := header_fault(header):
        raise ConfigError(f"--seed, or sim_backend.seed: this session could not be resumed: its header {fault}")
    if emulate and realtime:
        header["devices"] = tempfile.mkdtemp(prefix="mesotap-devices-")
    operator = TerminalOperator(console)
    with wire.begun(config, "run") as file:
        rig: Rig | None = None
        try:
            rig = _rig_of(header, config, operator, file)  # before a folder is begun to no purpose
            begun = SessionFolder.create(path, header)
        except BaseException:
            if isinstance(rig, SeparateRig):
                rig.end_devices()
            if "devices" in header:
                shutil.rmtree(header["devices"], ignore_errors=True)
            raise
        with begun as folder:
            _carry_out(folder, config, rig, operator, json_path, console, wire.log)


def _rig_of(header: dict[str, Any], config: Config, operator: TerminalOperator, file: WireFile | None) -> Rig:
    simulated, emulated = bool(header["simulated"]), bool(header.get("emulated"))
    devices = Path(str(header["devices"])) if header.get("devices") else None
    seed, realtime = int(header["seed"]), bool(header["realtime"])
    return build_rig(config, simulated, operator, seed, realtime, emulated, devices, file)


def resume(path: Path, json_path: Path | None, console: Console, wire: WireOptions = NO_WIRE) -> None:
    """Go on with a session wherever it was left."""
    with SessionFolder.open(path) as folder:
        header = read_header(folder)
        kept = kept_config(header.config, str(path / HEADER))
        config = kept.config
        progress = progress_in(folder, len(config.mesotap.load_plan_mn))
        for line in note_version(folder, header, kept, WallClock().utc()):
            console.print(escape(line), highlight=False, soft_wrap=True)
        if progress.state is State.DONE and (path / SESSION_FILE).exists():
            console.print(f"{escape(path)}: this session is finished; its report is written again", highlight=False)
            session = read_session(path / SESSION_FILE)
            session = replace(session, source=SESSION_FILE)
            results = _report(session, config, path, progress.truths, console)
            write_json(json_path, results_json(results))
            _diagnose(session, results, config, path, console)
            return
        operator = TerminalOperator(console)
        if header.devices:
            refuse_foreign_devices(Path(header.devices), folder.path / HEADER)
        with wire.begun(config, "resume") as file:
            rig = _rig_of(folder.header, config, operator, file)
            _carry_out(folder, config, rig, operator, json_path, console, wire.log)


def _carry_out(
    folder: SessionFolder,
    config: Config,
    rig: Rig,
    operator: TerminalOperator,
    json_path: Path | None,
    console: Console,
    log_wire: bool = False,
) -> None:
    header = folder.header
    wanted = config.mesotap.impacts_per_load * len(config.mesotap.load_plan_mn)
    good = sum(bool(e.get("accepted")) for e in folder.events() if e["event"] == "shot")
    control = KeyControl(console, operator.keyboard)
    with (
        session_log(folder.path, log_wire) as hardware,
        unhurried(console),
        control.listening(),
        SessionDisplay(wanted, good, console) as display,
    ):
        guardian = guardian_for(rig, config, folder)
        bench = Bench(rig, operator, Logged(display), control, lambda: truth_now(rig), guardian)
        runner = SessionRunner(config, folder, bench)
        try:
            runner.run()
        finally:
            _note_hardware(folder, runner, hardware)
    file = folder.path / SESSION_FILE
    session = assemble(header, config, runner.progress, folder.impacts())
    write_session(file, session)
    runner.finish()
    if isinstance(rig, SeparateRig):
        rig.end_devices()  # not earlier: who is killed before the session is filed resumes with them
    session = replace(session, source=SESSION_FILE)
    results = _report(session, config, folder.path, runner.progress.truths, console)
    console.print(f"session file {escape(file)}", highlight=False, soft_wrap=True)
    write_json(json_path, results_json(results))
    _diagnose(session, results, config, folder.path, console)


def _note_hardware(folder: SessionFolder, runner: SessionRunner, hardware: HardwareLog) -> None:
    """Keep in the journal what this run had to repeat, so that the runs of a session add up."""
    entry = {"event": HARDWARE, "at": WallClock().utc(), "repeated": [asdict(e) for e in hardware.account()]}
    with contextlib.suppress(RecordingError):  # a full disk is told by whoever has something to lose
        folder.append(entry)
        runner.progress.apply(entry)


def _report(
    session: Session, config: Config, folder: Path, truths: Sequence[dict[str, Any]], console: Console
) -> SessionResults:
    from analysis.contact.theory import theory
    from mesotap.report.report import write_report

    results = analysed(session, config, console)
    page = write_report(
        folder,
        session,
        results,
        theory(config.analysis.contact),
        list(truths) if truths else None,
        contact=config.analysis.contact,
    )
    show_session(results, console)
    console.print(f"report       {escape(page)}", highlight=False, soft_wrap=True)
    return results


def _diagnose(session: Session, results: SessionResults, config: Config, folder: Path, console: Console) -> None:
    """Diagnose a finished session where its configuration says so; whatever fails, the session stays what it is."""
    if not config.mesotap.diagnose:
        return
    from mesotap.commands.diagnose import diagnose_finished

    try:
        diagnose_finished(folder, session, results, console, config.analysis.mechanisms)
    except Exception as error:
        reason = str(error) if isinstance(error, MesotapError) else f"{type(error).__name__}: {error}"
        console.print(
            f"no diagnosis: {escape(reason)} (the session is complete; 'mesotap diagnose' tries again)",
            highlight=False,
            soft_wrap=True,
        )


def partial(path: Path) -> tuple[Session, Config, list[dict[str, Any]]]:
    """Return what a session folder holds so far, for a report of a session that was not finished."""
    with SessionFolder.open(path) as folder:
        config = kept_config(read_header(folder).config, str(path / HEADER)).config
        progress = progress_in(folder, len(config.mesotap.load_plan_mn))
        session = assemble(folder.header, config, progress, folder.impacts())
        if not session.impacts:
            raise RecordingError(f"{path}: holds no impacts yet")
        return replace(session, source=str(path)), config, progress.truths


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
    fit = fit_line(points, config.calibration.weight_uncertainty_mn, config.calibration.drift_test_level)
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
