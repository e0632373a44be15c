"""A bench for tests: the simulated rig with nobody watching, and small sessions."""

from __future__ import annotations

from pathlib import Path

from daq.journal import SessionFolder
from mesotap.configuration.config import Config, effective_text, parse_config
from mesotap.session.bench import simulated_rig, truth_now
from mesotap.session.runner import Bench, SessionRunner, Uninterrupted
from rig import Operator, Rig

SMALL = (
    "mesotap.load_plan_mn=[300, 900]",
    "mesotap.impacts_per_load=2",
    "calibration.weights_mn=[0, 500, 1000]",
    "calibration.averaging_s=0.2",
    "daq.trigger.record_samples=2000",
    "sim_backend.bad_taps={double: 0, too_hard: 0, too_weak: 0, off_centre: 0, clipped: 0}",
)


class Silent(Operator):
    """An operator who only remembers what was said."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def say(self, text: str) -> None:
        self.said.append(text)

    def wait_ready(self, text: str) -> None:
        self.said.append(text)

    def turn(self, text, step_um, live) -> None:
        self.said.append(text)


class Watching:
    """An observer who remembers the impacts."""

    def __init__(self) -> None:
        self.impacts = []
        self.seen = []

    def progress(self, state, text) -> None:
        self.seen.append((state, text))

    def impact(self, impact, accepted, wanted) -> None:
        self.impacts.append(impact)


def small_config(*changes: str) -> Config:
    return parse_config("", changes=[*SMALL, *changes])


def header_of(config: Config, seed: int = 1) -> dict:
    return {
        "created": "2026-01-01T00:00:00.000Z",
        "config": effective_text(config),
        "simulated": True,
        "seed": seed,
        "realtime": False,
    }


def runner_in(folder: SessionFolder, config: Config, rig: Rig, control=None, observer=None) -> SessionRunner:
    bench = Bench(rig, Silent(), observer or Watching(), control or Uninterrupted(), lambda: truth_now(rig))
    return SessionRunner(config, folder, bench)


def new_runner(path: Path, config: Config, rig: Rig | None = None, **more) -> tuple[SessionFolder, SessionRunner]:
    folder = SessionFolder.create(path, header_of(config))
    return folder, runner_in(folder, config, rig or simulated_rig(config), **more)
