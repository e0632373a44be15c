"""Conformance checks of a driver, for anyone who writes a driver of their own; they take seconds and need no device."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from rig.drivers.driver import Driver
from rig.drivers.plugins import BUILT_IN, Around, DriverPlugin, installed, plugin_in
from rig.errors import InterlockRefusal, RigError, SessionAborted
from rig.interface import Accelerometers, Clock, Impactor, LoadCell, Stage, nothing
from rig.plugins import Check, PluginError, module_of
from rig.readings import LoadReading, StageReading
from rig.section import Section
from rig.settings import Limits, Wiring
from rig.wall_clock import WallClock

READING_S = 0.3
MOVE_UM = 20.0
ARRIVED_UM = 1.0  # within which a move has to end, unless the stage's own step is larger
BLOCKS = 5
LOAD_MN = 300.0
NO_KEY = "no_such_key"


class _Wrong(Exception):
    """A part does something else than its interface says."""


def conformance(name: str) -> list[Check]:
    """Check a driver: the installed one of this name, or the one in this Python file.

    Its settings are validated, written and read back; it makes the part that it says. At its `stand_in` it is
    connected, does what `rig.interface` says of that part, is closed and connected again, and says in a `RigError` that
    the device is gone when it is.
    """
    file = Path(name)
    try:
        own = file.suffix == ".py"
        plugin = plugin_in(module_of(file, "mesotap_driver"), name) if own else installed(name)
    except PluginError as error:
        return [Check("it is a driver", False, str(error))]
    if plugin is None:
        what = f"{name} is a driver of mesotap's own" if name in BUILT_IN else f"no installed package offers {name}"
        return [
            Check("it is a driver", False, f"{what}; name the driver of a package, or a Python file that holds one")
        ]
    return [Check("it is a driver", True, f"{plugin.name}, a {plugin.part}"), _free(plugin, file), *_tried(plugin)]


def _free(plugin: DriverPlugin, file: Path) -> Check:
    name = "its name is free"
    if plugin.name in BUILT_IN:
        return Check(name, False, f"{plugin.name} is a driver of mesotap's own")
    try:
        other = installed(plugin.name)
    except PluginError as error:
        return Check(name, False, str(error))
    return Check(name, True, "" if other is None or file.suffix == ".py" else "installed")


def _tried(plugin: DriverPlugin) -> Iterator[Check]:
    around = Around(WallClock(), None, Wiring(), Limits().largest_approach_step_um)
    example = {"driver": plugin.name, **plugin.example}
    yield _said("its example is a configuration of it", lambda: _valid(plugin, example))
    yield _said("an unknown key is refused", lambda: _refuses(plugin, example))
    yield _said("its settings are read back as they are written", lambda: _read_back(plugin, example))
    yield _said("it makes the part", lambda: type(plugin.made(_valid(plugin, example), around)).__name__)
    if plugin.stand_in is None:
        yield Check("what it does with a device", True, "was not tried: it has no stand_in")
        return
    try:
        with plugin.stand_in(around) as reached:
            part = plugin.made(_valid(plugin, {"driver": plugin.name, **reached}), around)
            yield from _connected(part, around)
        yield _said("it says that its device is gone", lambda: _gone(part))
    except Exception as error:
        yield Check("its stand_in", False, f"{type(error).__name__}: {error}")


def _valid(plugin: DriverPlugin, settings: Mapping[str, Any]) -> Section:
    try:
        return plugin.settings.model_validate(dict(settings))
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        raise _Wrong(f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}") from error


def _refuses(plugin: DriverPlugin, example: Mapping[str, Any]) -> None:
    with suppress(ValidationError):
        plugin.settings.model_validate({**example, NO_KEY: 1})
        raise _Wrong(f"{NO_KEY} was taken: a misspelt key would pass; leave extra='forbid' as it is")


def _read_back(plugin: DriverPlugin, example: Mapping[str, Any]) -> None:
    settings = _valid(plugin, example)
    written = json.loads(json.dumps(settings.model_dump(mode="json")))
    if _valid(plugin, written) != settings:
        raise _Wrong(f"{written} is read as other settings: a session that is resumed would have others")


def _connected(part: Any, around: Around) -> Iterator[Check]:
    """Check a part with its device, from the first connecting to the last closing."""
    if isinstance(part, Driver):
        yield _said("it connects, and says what answered", lambda: _one_line(part.connect()))
    yield from exercised(part, around.clock)
    if isinstance(part, Driver):
        yield _said("it can be closed twice", lambda: _closed_twice(part))
        yield _said("it can be connected again", lambda: _one_line(part.connect()))


def _closed_twice(part: Driver) -> None:
    part.close()
    part.close()


def exercised(part: Any, clock: Clock) -> Iterator[Check]:
    """Check that a part that is connected does what `rig.interface` says of it. A stage goes some 20 um to and fro."""
    checks: dict[type, list[Callable[[Any, Clock], str | None]]] = {
        LoadCell: [reads, heeds_while_reading],
        Stage: [stands, moves, asks_before_it_moves, advances_until_told, keeps_its_clamp],
        Accelerometers: [streams, starts_anew],
        Impactor: [taps],
    }
    for kind, functions in checks.items():
        for check in functions if isinstance(part, kind) else ():
            yield _said(f"{check.__name__.replace('_', ' ')}: {_first_line(check)}", partial(check, part, clock))


def _first_line(check: Callable[..., object]) -> str:
    return (check.__doc__ or "").replace("``", "").strip().rstrip(".")


def _said(name: str, check: Callable[[], object]) -> Check:
    try:
        said = check()
    except Exception as error:
        text = str(error) if isinstance(error, _Wrong) else f"{type(error).__name__}: {error}"
        return Check(name, False, text)
    return Check(name, True, said if isinstance(said, str) else "")


def _one_line(said: object) -> str:
    if not isinstance(said, str) or not said.strip() or "\n" in said:
        raise _Wrong(f"connect() has to return one line that says what answered, not {said!r}")
    return said


def _must(holds: bool, otherwise: str) -> None:
    if not holds:
        raise _Wrong(otherwise)


@contextmanager
def _hook(part: Any, name: str, function: Callable[[], None]) -> Iterator[None]:
    setattr(part, name, function)
    try:
        yield
    finally:
        setattr(part, name, nothing)


def _end() -> None:
    raise SessionAborted("the session is to end")


def _no() -> None:
    raise InterlockRefusal("the load is not known")


# --- the gauge ------------------------------------------------------------------------------------------------


def reads(cell: LoadCell, clock: Clock) -> str:
    """Two readings, the later one with the later time."""
    before, one, two = clock.now(), cell.read(), cell.read(0.0)
    for reading in (one, two):
        _must(isinstance(reading, LoadReading), f"read() returns a {type(reading).__name__}, no LoadReading")
        _must(math.isfinite(reading.voltage_mv), f"its voltage is {reading.voltage_mv} mV")
        _must(reading.samples >= 1 and reading.spread_mv >= 0, "samples has to be at least 1, spread_mv at least 0")
    times = (before, one.time_s, two.time_s, clock.now())
    _must(list(times) == sorted(times), "time_s of a reading is not the rig time at which its last sample was taken")
    return f"{one.voltage_mv:.4g} mV, {one.samples} samples in 0.1 s"


def heeds_while_reading(cell: LoadCell, clock: Clock) -> None:
    """What ``idle`` raises ends a reading."""
    with _hook(cell, "idle", _end), suppress(SessionAborted):
        cell.read(READING_S)
        raise _Wrong("read() does not call self.idle() while it reads: nobody could stop a session meanwhile")


# --- the stage ------------------------------------------------------------------------------------------------


def _position(stage: Stage) -> float:
    reading = stage.read()
    _must(isinstance(reading, StageReading), f"read() returns a {type(reading).__name__}, no StageReading")
    return reading.position_um


def _went(stage: Stage, start: float, wanted_um: float, what: str) -> None:
    went = _position(stage) - start
    slack = max(ARRIVED_UM, 2 * stage.step_um)
    _must(math.isnan(went) or abs(went - wanted_um) <= slack, f"{what} went {went:.3g} um, not {wanted_um:.3g}")


def stands(stage: Stage, clock: Clock) -> str:
    """Position and clamp."""
    stage.unlock()
    _must(not stage.read().locked, "it is clamped after unlock()")
    return f"at {_position(stage):.4g} um"


def moves(stage: Stage, clock: Clock) -> None:
    """Away from contact, and there again; what ``idle`` raises ends a move."""
    start = _position(stage)
    stage.move_by(-MOVE_UM)
    _went(stage, start, -MOVE_UM, f"move_by(-{MOVE_UM:g})")
    with _hook(stage, "idle", _end), suppress(SessionAborted):
        stage.move_by(-MOVE_UM)
        raise _Wrong("move_by() does not call self.idle() while it moves: nobody could stop a session meanwhile")
    stage.move_by(start - _position(stage))
    _went(stage, start, 0.0, "move_by() and back")


def asks_before_it_moves(stage: Stage, clock: Clock) -> None:
    """``permit`` is asked before any move towards contact, and not for one away from it."""
    stage.move_by(-MOVE_UM)
    start = _position(stage)
    with _hook(stage, "permit", _no):
        for what, move in (
            ("move_by", lambda: stage.move_by(MOVE_UM / 2)),
            ("advance", lambda: stage.advance(MOVE_UM / 2, 2.0, lambda: False)),
        ):
            with suppress(InterlockRefusal):
                move()
                raise _Wrong(f"{what}() does not call self.permit() before it moves towards contact")
            _went(stage, start, 0.0, f"a refused {what}()")
        stage.move_by(-1.0)


def advances_until_told(stage: Stage, clock: Clock) -> None:
    """``stop`` is asked before the first step and after each, and ends the move."""
    stage.move_by(-MOVE_UM)
    start = _position(stage)
    stage.advance(MOVE_UM, 2.0, lambda: True)
    _went(stage, start, 0.0, "advance() with a stop() that is true at once")
    asked: list[float] = []

    def third() -> bool:
        asked.append(_position(stage))
        return len(asked) == 3

    stage.advance(MOVE_UM, 4.0, third)
    _must(len(asked) == 3, f"advance() asked stop() {len(asked)} times, which ended it the third time")
    _went(stage, start, 8.0, "advance() by two steps of 4 um")


def keeps_its_clamp(stage: Stage, clock: Clock) -> None:
    """Clamped it moves for nobody, but is taken back all the same."""
    stage.lock()
    try:
        _must(stage.read().locked, "it is not clamped after lock()")
        with suppress(RigError):
            stage.move_by(-1.0)
            raise _Wrong("move_by() moves a stage that is clamped; it has to raise RigError")
        start = _position(stage)
        stage.retract(MOVE_UM)
        _went(stage, start, -MOVE_UM, f"retract({MOVE_UM:g}) of a clamped stage")
    finally:
        stage.unlock()


# --- the recorder and the tap ---------------------------------------------------------------------------------


def streams(recorder: Accelerometers, clock: Clock) -> str:
    """Blocks follow each other without a gap, in m/s2."""
    _must(recorder.sample_rate_hz > 0 and recorder.full_scale_m_s2 > 0 and recorder.bits >= 1, "rate, range or bits: 0")
    recorder.start()
    try:
        expected = 0
        for _ in range(BLOCKS):
            block = recorder.read_block()
            shape = block.acceleration.shape
            _must(len(shape) == 2 and shape[0] == 2 and shape[1] > 0, f"acceleration is {shape}, not (2, n)")
            _must(bool(np.isfinite(block.acceleration).all()), "acceleration holds what is no number")
            _must(block.strain_mv is None or block.strain_mv.shape == shape[1:], "strain_mv is not (n,)")
            _must(block.force is None or block.force.shape == shape[1:], "force is not (n,)")
            _must(block.first_sample == expected, f"a block begins with {block.first_sample}, expected {expected}")
            expected += shape[1]
    finally:
        recorder.stop()
    return f"{expected} samples at {recorder.sample_rate_hz:g} Hz"


def starts_anew(recorder: Accelerometers, clock: Clock) -> None:
    """A stream that is stopped twice and started again begins with sample 0."""
    recorder.stop()
    recorder.start()
    try:
        first = recorder.read_block().first_sample
        _must(first == 0, f"a stream that is started again begins with sample {first}, not 0")
    finally:
        recorder.stop()


def taps(impactor: Impactor, clock: Clock) -> None:
    """One tap; nothing stays switched on."""
    impactor.tap(LOAD_MN)
    impactor.release()
    impactor.release()


def _gone(part: Any) -> str:
    """Return what a part says whose device is gone."""

    def used() -> None:
        if isinstance(part, LoadCell | Stage):
            part.read()
        elif isinstance(part, Accelerometers):
            part.start()
            while True:
                part.read_block()
        else:
            part.tap(LOAD_MN)

    try:
        used()
    except RigError as error:
        return str(error)
    except Exception as error:
        raise _Wrong(
            f"{type(error).__name__} ({error}) is raised; a RigError says it to the person at the rig"
        ) from error
    finally:
        if isinstance(part, Driver):
            with suppress(RigError):
                part.close()
    raise _Wrong("it goes on as if its device were there")
