"""The checks of a driver: the program's own pass them, and one that does not do as it has to fails the right one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import pytest
from pydantic import ConfigDict

from mesotap.session.bench import emulated_rig
from rig import LoadCell, LoadReading, RigError, Stage, StageReading
from rig.drivers import conformance as module
from rig.drivers.conformance import conformance, exercised
from rig.drivers.driver import Driver
from rig.drivers.plugins import Around, DriverPlugin
from rig.section import Positive, Section
from rig.wall_clock import WallClock
from tests.mesotap.benches import small_config

SMC = "rig.parts.stage={driver: smc100, port: /dev/ttyUSB1, zero_mm: 1.5, resolution_um: 0.02}"
SOLENOID = "rig.parts.impactor={driver: solenoid, line: 3}"


@pytest.mark.parametrize("changes", [(), (SMC, SOLENOID)], ids=str)
def test_the_programs_own_drivers_pass(changes: tuple[str, ...]) -> None:
    rig = emulated_rig(small_config(*changes), seed=5)
    rig.open()
    parts = (rig.load_cell, rig.stage, rig.accelerometers, rig.impactor)
    checks = [check for part in parts for check in exercised(part, rig.clock)]
    rig.close()
    assert len(checks) == 10
    assert not [check for check in checks if not check.holds]


class Settings(Section):
    driver: Literal["mine"]
    rate_hz: Positive = 10.0


class Gauge(LoadCell, Driver):
    """A gauge as it should be."""

    there = True

    def __init__(self, settings: Settings, around: Around) -> None:
        self.clock, self.open = around.clock, False

    def connect(self) -> str:
        self.open = True
        return "answers"

    def close(self) -> None:
        self.open = False

    def read(self, duration_s: float = 0.1) -> LoadReading:
        if not self.there:
            raise RigError("it is gone")
        self.idle()
        return LoadReading(self.clock.now(), 1.0, 0.1, 2)


class Carriage(Stage):
    """A stage as it should be."""

    def __init__(self, settings: Settings, around: Around) -> None:
        self.at, self.clamped = 0.0, False

    def read(self) -> StageReading:
        return StageReading(0.0, self.at, self.clamped)

    def move_by(self, step_um: float, aim: str = "") -> StageReading:
        if self.clamped:
            raise RigError("it is clamped")
        if step_um > 0:
            self.permit()
        self.idle()
        self.at += step_um
        return self.read()

    def advance(self, travel_um, step_um, stop, aim="") -> StageReading:
        end = self.at + travel_um
        while not stop() and self.at < end:
            self.move_by(step_um)
        return self.read()

    def lock(self) -> None:
        self.clamped = True

    def unlock(self) -> None:
        self.clamped = False


@contextmanager
def nothing_needed(around: Around) -> Iterator[Mapping[str, Any]]:
    Gauge.there = True
    yield {}
    Gauge.there = False


GAUGE = DriverPlugin("mine", "load_cell", Settings, Gauge, stand_in=nothing_needed)


def failing(plugin: DriverPlugin, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Return what fails of a driver, and what is said of it."""
    monkeypatch.setattr(module, "plugin_in", lambda loaded, where: plugin)
    monkeypatch.setattr(module, "module_of", lambda file, prefix: None)
    return {check.name.split(":")[0]: check.said for check in conformance("mine.py") if not check.holds}


def test_a_gauge_as_it_should_be_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    assert failing(GAUGE, monkeypatch) == {}


class Loose(Section):
    model_config = ConfigDict(extra="ignore")

    driver: Literal["mine"]


class Forgetful(Section):
    driver: Literal["mine"]
    rate_hz: float = 1.0

    def model_dump(self, **options: Any) -> dict[str, Any]:
        return {"driver": "mine", "rate_hz": self.rate_hz + 1}


class Deaf(Gauge):
    def read(self, duration_s: float = 0.1) -> LoadReading:
        return LoadReading(self.clock.now(), 1.0, 0.1, 2) if self.there else super().read()


class Dateless(Gauge):
    def read(self, duration_s: float = 0.1) -> LoadReading:
        return replace(super().read(), time_s=-1.0)


class Immortal(Gauge):
    there = True

    def read(self, duration_s: float = 0.1) -> LoadReading:
        self.idle()
        return LoadReading(self.clock.now(), 1.0, 0.1, 2)


class Rude(Gauge):
    def read(self, duration_s: float = 0.1) -> LoadReading:
        if not Gauge.there:
            raise KeyError("b'x'")
        return super().read()


class Once(Gauge):
    count = 0

    def connect(self) -> str:
        self.count += 1
        return "answers" if self.count == 1 else ""


@pytest.mark.parametrize(
    ("change", "check", "said"),
    [
        ({"settings": Loose}, "an unknown key is refused", "no_such_key was taken"),
        ({"settings": Forgetful}, "its settings are read back as they are written", "other settings"),
        ({"example": {"rate_hz": 0}}, "its example is a configuration of it", "rate_hz: "),
        ({"make": lambda settings, around: object()}, "it makes the part", "makes a object, which is no LoadCell"),
        ({"make": lambda settings, around: 1 / 0}, "it makes the part", "failed: ZeroDivisionError"),
        ({"make": Deaf}, "heeds while reading", "does not call self.idle()"),
        ({"make": Dateless}, "reads", "time_s"),
        ({"make": Immortal}, "it says that its device is gone", "it goes on as if its device were there"),
        ({"make": Rude}, "it says that its device is gone", "a RigError says it"),
        ({"make": Once}, "it can be connected again", "one line"),
        ({"name": "conex-cc"}, "its name is free", "a driver of mesotap's own"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_a_driver_does_wrong_is_found(
    change: dict[str, Any], check: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert said in failing(replace(GAUGE, **change), monkeypatch)[check]


class Unasked(Carriage):
    def move_by(self, step_um: float, aim: str = "") -> StageReading:
        self.permit = lambda: None  # type: ignore[method-assign]
        return super().move_by(step_um)


class Headlong(Carriage):
    def advance(self, travel_um, step_um, stop, aim="") -> StageReading:
        self.move_by(travel_um)
        stop()
        return self.read()


class Slipping(Carriage):
    def move_by(self, step_um: float, aim: str = "") -> StageReading:
        return super().move_by(0.8 * step_um)


class Unclamped(Carriage):
    def lock(self) -> None:
        pass


class Stuck(Carriage):
    def retract(self, travel_um: float, aim: str = "") -> StageReading:
        return self.move_by(-travel_um)


class Hasty(Carriage):
    def move_by(self, step_um: float, aim: str = "") -> StageReading:
        self.idle = lambda: None  # type: ignore[method-assign]
        return super().move_by(step_um)


@pytest.mark.parametrize(
    ("kind", "check"),
    [
        (Unasked, "asks before it moves"),
        (Headlong, "advances until told"),
        (Slipping, "moves"),
        (Unclamped, "keeps its clamp"),
        (Stuck, "keeps its clamp"),
        (Hasty, "moves"),
    ],
)
def test_what_a_stage_does_wrong_is_found(kind: type[Carriage], check: str) -> None:
    around = Around(WallClock(), None, None, 0.5)  # type: ignore[arg-type]
    right, wrong = (list(exercised(k(Settings(driver="mine"), around), around.clock)) for k in (Carriage, kind))
    assert all(found.holds for found in right)
    assert check in [found.name.split(":")[0] for found in wrong if not found.holds]


def test_the_example_in_a_file_is_checked(tmp_path: Path) -> None:
    (tmp_path / "none.py").write_text("DRIVER = 1\n")
    (check,) = conformance(str(tmp_path / "none.py"))
    assert (check.holds, "holds no DRIVER" in check.said) == (False, True)
