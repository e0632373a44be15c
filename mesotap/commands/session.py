"""``run`` and ``resume``: a session, from its folder to its report."""

from __future__ import annotations

import contextlib
import datetime
import functools
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from rich.console import Console

from analysis.results import SessionResults
from daq.errors import RecordingError
from daq.journal import HEADER, SessionFolder
from daq.records import Session
from daq.session_file import read_session, write_session
from mesotap import __version__
from mesotap.answers.results_files import results_json
from mesotap.commands.answers import analysed, show_session, writing_report
from mesotap.commands.outputs import write_json
from mesotap.commands.recordings import SESSION_FILE
from mesotap.commands.wire_options import NO_WIRE, WireOptions
from mesotap.configuration.config import Config, ConfigError, effective_text, load_config
from mesotap.configuration.usual import unusual
from mesotap.operator.outlet import unhurried
from mesotap.operator.people import Filing, People, at_terminal
from mesotap.operator.terminal import escape
from mesotap.session.bench import build_rig, truth_now
from mesotap.session.emulated_devices import SeparateRig, refuse_foreign_devices
from mesotap.session.entries import progress_in
from mesotap.session.guardian_link import guardian_for
from mesotap.session.hand_verdicts import with_hand_verdicts
from mesotap.session.header import (
    FOLDER_FORMAT,
    FOLDER_VERSION,
    header_fault,
    kept_config,
    note_version,
    read_header,
    with_former_motor,
)
from mesotap.session.order import FOLDER_NAME, RigChoice
from mesotap.session.progress import HARDWARE, assemble
from mesotap.session.runner import GOES_ON, Bench, SessionRunner
from mesotap.session.session_log import Logged, session_log
from mesotap.session.states import State
from rig import Rig
from rig.drivers.wire_record import WireFile
from rig.errors import MesotapError, SessionAborted
from rig.hardware_log import HardwareLog
from rig.wall_clock import WallClock
from sim_backend.clock import VirtualClock


def run(
    config_path: Path | None,
    changes: Sequence[str],
    choice: RigChoice,
    output: Path | None,
    json_path: Path | None,
    console: Console,
    wire: WireOptions = NO_WIRE,
) -> None:
    """Begin a session in a new folder and carry it to its report."""
    config = load_config(config_path, changes)
    path = output or Path("sessions") / datetime.datetime.now(datetime.UTC).strftime(FOLDER_NAME)
    with _resumable(path):
        begin(config, choice, path, at_terminal(console), json_path, wire)


@contextlib.contextmanager
def _resumable(path: Path) -> Iterator[None]:
    """Say of an interrupt how the session in a folder goes on, which the end of the program would not."""
    try:
        yield
    except KeyboardInterrupt as interrupt:
        if not (path / HEADER).is_file():
            raise
        aborted = SessionAborted("interrupted")
        for note in getattr(interrupt, "__notes__", ()) or (GOES_ON,):
            aborted.add_note(note)
        raise aborted from interrupt


def begin(
    config: Config,
    choice: RigChoice,
    path: Path,
    people: People,
    json_path: Path | None = None,
    wire: WireOptions = NO_WIRE,
) -> None:
    """Begin a session in the new folder ``path`` and carry it to its report."""
    for remark in unusual(config.model_dump(mode="json")):
        people.console.print(escape(remark), highlight=False, soft_wrap=True)
    now = datetime.datetime.now(datetime.UTC)
    header: dict[str, Any] = {
        "format": FOLDER_FORMAT,
        "format_version": FOLDER_VERSION,
        "created": now.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
        "config": effective_text(config),
        "simulated": choice.simulate or choice.emulate,
        "emulated": choice.emulate,
        "seed": config.sim_backend.seed if choice.seed is None else choice.seed,
        "realtime": choice.realtime,
        "software": f"mesotap {__version__}",
    }
    if fault := header_fault(header):
        raise ConfigError(f"--seed, or sim_backend.seed: this session could not be resumed: its header {fault}")
    if choice.emulate and choice.realtime and choice.speed == 1.0:
        header["devices"] = tempfile.mkdtemp(prefix="mesotap-devices-")
    with wire.begun(config, "run") as file:
        rig: Rig | None = None
        try:
            rig = _rig_of(header, config, people, choice.speed, file)  # before a folder is begun to no purpose
            begun = SessionFolder.create(path, header)
        except BaseException:
            if isinstance(rig, SeparateRig):
                rig.end_devices()
            if "devices" in header:
                shutil.rmtree(header["devices"], ignore_errors=True)
            raise
        with begun as folder:
            _carry_out(folder, config, rig, people, json_path, wire.log)


def _rig_of(header: dict[str, Any], config: Config, people: People, speed: float, file: WireFile | None) -> Rig:
    simulated, emulated = bool(header["simulated"]), bool(header.get("emulated"))
    devices = Path(str(header["devices"])) if header.get("devices") else None
    seed, realtime = int(header["seed"]), bool(header["realtime"])
    rig = build_rig(config, simulated, people.operator, seed, realtime, emulated, devices, file, speed)
    if isinstance(rig.clock, VirtualClock):
        rig.clock.began = datetime.datetime.fromisoformat(str(header["created"]))
    return rig


def resume(path: Path, json_path: Path | None, console: Console, wire: WireOptions = NO_WIRE) -> None:
    """Go on with a session wherever it was left."""
    with _resumable(path):
        go_on(path, at_terminal(console), json_path, wire)


def go_on(
    path: Path, people: People, json_path: Path | None = None, wire: WireOptions = NO_WIRE, speed: float = 1.0
) -> None:
    """Go on with a session wherever it was left; ``speed`` is that of simulated time, where it passes at all."""
    console = people.console
    with SessionFolder.open(path) as folder:
        header = read_header(folder)
        kept = kept_config(header.config, str(path / HEADER))
        config = with_former_motor(header, kept.config)
        progress = progress_in(folder, len(config.mesotap.load_plan_mn))
        for line in note_version(folder, header, kept, WallClock().utc()):
            console.print(escape(line), highlight=False, soft_wrap=True)
        if progress.state is State.DONE and (path / SESSION_FILE).exists():
            console.print(f"{escape(path)}: this session is finished; its report is written again", highlight=False)
            session = read_session(path / SESSION_FILE)
            session = replace(session, source=SESSION_FILE)
            results = _report(session, config, path, progress.truths, people)
            write_json(json_path, {**results_json(results), "provenance": _origin(session, config, path)})
            _diagnose(session, results, config, path, people)
            return
        if header.devices:
            refuse_foreign_devices(Path(header.devices), folder.path / HEADER)
        with wire.begun(config, "resume") as file:
            rig = _rig_of(folder.header, config, people, speed, file)
            _carry_out(folder, config, rig, people, json_path, wire.log)


def _carry_out(
    folder: SessionFolder,
    config: Config,
    rig: Rig,
    people: People,
    json_path: Path | None,
    log_wire: bool = False,
) -> None:
    header, console = folder.header, people.console
    with (
        session_log(folder.path, log_wire) as hardware,
        unhurried(console),
        people.watching(folder, config) as observer,  # shown a moment longer, in which Ctrl-C is what it always is
        people.control.listening(),
    ):
        guardian = guardian_for(rig, config, folder)
        bench = Bench(
            rig,
            people.operator,
            Logged(observer),
            people.control,
            lambda: truth_now(rig),
            guardian,
            people.gauge,
            people.verdicts,
        )
        runner = SessionRunner(config, folder, bench)
        try:
            runner.run()
        finally:
            _note_hardware(folder, runner, hardware)
    people.filing(Filing.FILE, "")
    file = folder.path / SESSION_FILE
    session = assemble(header, config, runner.progress, with_hand_verdicts(folder.impacts(), folder.events()))
    write_session(file, session)
    runner.finish()
    if isinstance(rig, SeparateRig):
        rig.end_devices()  # not earlier: who is killed before the session is filed resumes with them
    session = replace(session, source=SESSION_FILE)
    results = _report(session, config, folder.path, runner.progress.truths, people)
    console.print(f"session file {escape(file)}", highlight=False, soft_wrap=True)
    write_json(json_path, {**results_json(results), "provenance": _origin(session, config, folder.path)})
    _diagnose(session, results, config, folder.path, people)


def _note_hardware(folder: SessionFolder, runner: SessionRunner, hardware: HardwareLog) -> None:
    """Keep in the journal what this run had to repeat, so that the runs of a session add up."""
    entry = {"event": HARDWARE, "at": WallClock().utc(), "repeated": [asdict(e) for e in hardware.account()]}
    with contextlib.suppress(RecordingError):  # a full disk is told by whoever has something to lose
        folder.append(entry)
        runner.progress.apply(entry)


def _report(
    session: Session, config: Config, folder: Path, truths: Sequence[dict[str, Any]], people: People
) -> SessionResults:
    from analysis.contact.theory import theory
    from mesotap.report.report import write_report

    console = people.console
    people.filing(Filing.REPORT, "")
    results = analysed(session, config, console, lambda text: people.filing(Filing.REPORT, text))
    people.filing(Filing.REPORT, "drawing")
    with writing_report(console) as on_progress:

        def tell(step: str) -> None:
            on_progress(step)
            people.filing(Filing.REPORT, step)

        page = write_report(
            folder,
            session,
            results,
            theory(config.analysis.contact),
            list(truths) if truths else None,
            contact=config.analysis.contact,
            origin=_origin(session, config, folder),
            on_progress=tell,
        )
    show_session(results, console)
    console.print(f"report       {escape(page)}", highlight=False, soft_wrap=True)
    return results


def _origin(session: Session, config: Config, folder: Path) -> dict[str, Any]:
    from mesotap.answers.provenance import provenance

    return provenance(session, config, folder / SESSION_FILE)


def _diagnose(session: Session, results: SessionResults, config: Config, folder: Path, people: People) -> None:
    """Diagnose a finished session where its configuration says so; whatever fails, the session stays what it is."""
    if not config.mesotap.diagnose:
        return
    from mesotap.commands.diagnose import diagnose_finished
    from mesotap.report.report import refresh_trust

    console, folders = people.console, config.analysis.mechanisms
    people.filing(Filing.DIAGNOSIS, "")
    try:
        told = functools.partial(people.filing, Filing.DIAGNOSIS)
        diagnose_finished(folder, session, results, console, folders, told)
        refresh_trust(folder, session, results)
    except Exception as error:
        reason = str(error) if isinstance(error, MesotapError) else f"{type(error).__name__}: {error}"
        people.operator.say(f"no diagnosis: {reason} (the session is complete; 'mesotap diagnose' tries again)")


def partial(path: Path) -> tuple[Session, Config, list[dict[str, Any]]]:
    """Return what a session folder holds so far, for a report of a session that was not finished."""
    with SessionFolder.open(path) as folder:
        config = kept_config(read_header(folder).config, str(path / HEADER)).config
        progress = progress_in(folder, len(config.mesotap.load_plan_mn))
        session = assemble(folder.header, config, progress, with_hand_verdicts(folder.impacts(), folder.events()))
        if not session.impacts:
            raise RecordingError(f"{path}: holds no impacts yet")
        return replace(session, source=str(path)), config, progress.truths
