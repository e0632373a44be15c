"""``devices`` and ``check``: what is connected, and whether it is fit for a session."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from mesotap.commands.outputs import write_json
from mesotap.commands.wire_options import NO_WIRE, WireOptions
from mesotap.configuration.config import Config, load_config
from mesotap.operator.console import KeyControl, TerminalOperator
from mesotap.operator.outlet import unhurried
from mesotap.operator.terminal import escape
from mesotap.session.bench import build_rig
from mesotap.session.guardian_link import guardian_for
from mesotap.session.self_test import Verdict, self_test
from rig import Operator, RigError
from rig.drivers.driver import Driver
from rig.drivers.settings import NewportStage
from rig.drivers.wire_record import WireFile


def devices(
    config_path: Path | None,
    changes: Sequence[str],
    simulate: bool,
    emulate: bool,
    seed: int | None,
    json_path: Path | None,
    console: Console,
    search: bool = False,
    wire: WireOptions = NO_WIRE,
) -> None:
    """List what is plugged into this machine, and say what each configured device answers. Nothing moves.

    ``search`` asks also the serial ports that are not configured; every question is one that changes nothing.
    """
    config = _not_homing(load_config(config_path, changes))
    found: list[dict[str, Any]] = []
    for item in () if simulate or emulate else _connected(config, search):
        found.append(item)
        console.print(escape(f"{item['port']}: {item['says']}"), highlight=False, soft_wrap=True)
    if not simulate and not emulate and not found:
        console.print("no serial port and no recorder is connected to this machine", highlight=False)
    with wire.begun(config, "devices") as file:
        answers = _answers(config, simulate, emulate, seed, console, file)
    for answer in answers:
        mark = "answers" if answer["answers"] else "no answer"
        console.print(escape(f"{answer['part']}: {mark}: {answer['says']}"), highlight=False, soft_wrap=True)
    write_json(json_path, {"format": "mesotap-devices", "version": 1, "ports": found, "parts": answers})


def check(
    config_path: Path | None,
    changes: Sequence[str],
    simulate: bool,
    emulate: bool,
    seed: int | None,
    touch: bool,
    json_path: Path | None,
    console: Console,
    wire: WireOptions = NO_WIRE,
) -> None:
    """Connect, test the rig part by part, print a verdict a line; `RigError` if any is bad."""
    config = load_config(config_path, changes)
    operator = TerminalOperator(console)
    verdicts: list[Verdict] = []
    troubles = ""
    keys = KeyControl(console, operator.keyboard)
    with wire.begun(config, "check") as file, unhurried(console), keys.listening() as control:
        rig = build_rig(config, simulate, operator, seed, emulated=emulate, wire_file=file)
        guardian = guardian_for(rig, config)
        try:
            for line in rig.open():
                _show(Verdict("connection", True, line), verdicts, console)
            if touch:
                guardian.start()
                guardian.arm(True)
            for verdict in self_test(rig, config, touch, guardian.beat, control.check, operator):
                _show(verdict, verdicts, console)
        except RigError as error:
            troubles = "; ".join([str(error), *getattr(error, "__notes__", ())])
            _show(Verdict("safe state" if verdicts else "connection", False, troubles), verdicts, console)
        finally:
            guardian.dismiss()
            rig.close()
    bad = [verdict.name for verdict in verdicts if verdict.passed is False]
    write_json(
        json_path,
        {
            "format": "mesotap-check",
            "version": 1,
            "passed": not bad,
            "verdicts": [{"name": v.name, "passed": v.passed, "says": v.says} for v in verdicts],
        },
    )
    if bad:
        raise RigError(f"check: {len(bad)} of {len(verdicts)} did not pass: {', '.join(bad)}")


def _show(verdict: Verdict, verdicts: list[Verdict], console: Console) -> None:
    verdicts.append(verdict)
    mark = {True: "good", False: "BAD", None: "-"}[verdict.passed]
    console.print(escape(f"{mark:5}{verdict.name}: {verdict.says}"), highlight=False, soft_wrap=True)


def _answers(
    config: Config, simulate: bool, emulate: bool, seed: int | None, console: Console, file: WireFile | None
) -> list[dict[str, Any]]:
    """What each configured part says: those that are no device say that."""
    operator = TerminalOperator(console)
    if simulate or emulate:
        rig = build_rig(config, simulate, operator, seed, emulated=emulate, wire_file=file)
        try:
            return [{"part": rig.name, "answers": True, "says": line} for line in rig.open()]
        finally:
            rig.close()
    return [_answer_of(name, config, operator, file) for name in ("load_cell", "stage", "accelerometers")]


def _answer_of(name: str, config: Config, operator: Operator, file: WireFile | None) -> dict[str, Any]:
    from rig.drivers import assembly
    from rig.wall_clock import WallClock

    part, clock = getattr(config.rig.parts, name), WallClock()
    if file is not None and not file.has_clock:
        file.set_clock(clock)
    if isinstance(part, str):
        says = "turned by hand" if part == "hand" else "no device is configured (rig.parts)"
        return {"part": name, "answers": part == "hand", "says": says}
    try:
        driver: object
        if name == "load_cell":
            driver = assembly.load_cell(config.rig, operator, clock, file)
        elif isinstance(part, NewportStage):
            driver = assembly.motor_stage(part, config.rig.limits.largest_approach_step_um, clock, file)
        elif name == "stage":
            driver = assembly.of_another(part, config.rig, operator, clock, file)
        else:
            driver = assembly.recorder(config.rig, operator, clock, file)
        if not isinstance(driver, Driver):
            return {"part": name, "answers": True, "says": "needs no connection"}
        try:
            return {"part": name, "answers": True, "says": driver.connect()}
        finally:
            driver.close()
    except RigError as error:
        return {"part": name, "answers": False, "says": str(error)}


def _not_homing(config: Config) -> Config:
    """Return the configuration with no stage that would look for its reference when it is connected."""
    stage = config.rig.parts.stage
    if not isinstance(stage, NewportStage):
        return config
    parts = config.rig.parts.model_copy(update={"stage": stage.model_copy(update={"home_at_connect": False})})
    return config.model_copy(update={"rig": config.rig.model_copy(update={"parts": parts})})


def _connected(config: Config, search: bool) -> Iterator[dict[str, Any]]:
    """Yield each port and recorder with what is known of it, one after the other as they answer."""
    from rig.drivers.search import who_answers
    from rig.wall_clock import WallClock

    configured = {getattr(part, "port", None) for part in (config.rig.parts.load_cell, config.rig.parts.stage)}
    for port in _serial_ports():
        if not search or port["port"] in configured:
            yield port
            continue
        try:
            answers = who_answers(port["port"], WallClock())
        except RigError as error:
            answers = str(error)
        yield {**port, "says": f"{port['says']}: {answers}"}
    yield from _recorders()
    yield from _ni_modules()


def _serial_ports() -> list[dict[str, Any]]:
    from serial.tools.list_ports import comports

    ports = sorted(comports(), key=lambda port: str(port.device))
    # "n/a" is what pyserial says of the built-in ports that most machines only seem to have
    return [{"port": p.device, "says": str(p.description)} for p in ports if str(p.hwid) != "n/a"]


def _recorders() -> list[dict[str, Any]]:
    from rig.drivers.usb1608_protocol import NAME, PRODUCT, VENDOR, Usb1608Protocol
    from rig.drivers.usb_transport import UsbTransport, connected

    try:
        there = connected(VENDOR, PRODUCT)
    except RigError as error:
        return [{"port": "usb", "says": str(error)}]
    found = []
    for candidate in there:
        transport = UsbTransport(candidate, NAME)
        try:
            transport.open()
            says = f"{NAME}, serial number {Usb1608Protocol(transport).serial_number()}"
        except RigError as error:
            says = str(error)
        finally:
            transport.close()
        found.append({"port": transport.port, "says": says})
    return found


def _ni_modules() -> list[dict[str, Any]]:
    from rig.drivers.ni9234 import modules

    try:
        return [{"port": name, "says": kind} for name, kind in modules()]
    except RigError as error:
        return [{"port": "NI", "says": str(error)}]
