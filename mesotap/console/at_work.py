"""The session that the console runs: starts its process, passes on what is wanted of it and what it tells."""

from __future__ import annotations

import asyncio
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from daq.durable import make_folder, write_error
from mesotap.configuration.config import Config, load_config, text_of
from mesotap.console.board import Board
from mesotap.console.child import Child
from mesotap.console.frames import Message
from mesotap.console.settings_form import SettingsFile
from mesotap.console.so_far import SoFar
from mesotap.console.what_to_do import VIEW_IDLE
from mesotap.session.order import FOLDER_NAME, RigChoice
from rig.errors import MesotapError

SESSION, ANALYST = "mesotap.console.session_process", "mesotap.console.analyst_process"
ANALYST_NICENESS = 2
STARTING = (
    "Nothing to do: the devices are being connected. The first time after an installation it takes a minute or two."
)


class Refused(MesotapError, ValueError):
    """What a page asked for cannot be done; one sentence."""


@dataclass(frozen=True, slots=True)
class Bench:
    """What a session is run with.

    Attributes
    ----------
    config_path
        The configuration, read anew for each session; None for the defaults.
    changes
        Keys that override it, as on the command line.
    choice
        Which rig.
    root
        Folder of all sessions.
    log_wire
        Whether session.log has every byte on every wire.
    scope
        Whether the console is for setting up alone: it shows the live view, and runs no session.
    """

    config_path: Path | None
    changes: tuple[str, ...]
    choice: RigChoice
    root: Path
    log_wire: bool = False
    scope: bool = False

    def config(self) -> Config:
        """Return the configuration in force; `ConfigError` says what is wrong with it."""
        return load_config(self.config_path, self.changes)

    def config_text(self) -> str:
        """Return its text."""
        path = self.config_path or Path("config.yaml")
        return text_of(path, "a configuration") if path.exists() else ""

    def settings(self) -> SettingsFile:
        """Return the configuration as a form."""
        return SettingsFile(self.config_path or Path("config.yaml"))

    def new_folder(self) -> Path:
        """Return a folder that is not there yet, named by the time."""
        name = datetime.now(UTC).strftime(FOLDER_NAME)
        candidates = (self.root / (name if i == 1 else f"{name}-{i}") for i in range(1, 1000))
        return next(path for path in candidates if not path.exists())


class AtWork:
    """The one session at a time.

    Parameters
    ----------
    bench
        What it is run with.
    board
        Where it is shown.
    """

    def __init__(self, bench: Bench, board: Board) -> None:
        self.bench = bench
        self.board = board
        self.so_far = SoFar(lambda path: self._analysed({"kind": "snapshot", "path": str(path)}), self._show_so_far)
        self._child: Child | None = None
        self._analyst: Child | None = None
        self._starting = asyncio.Lock()
        self._stopped = False
        if bench.scope:
            board.state.update(next=VIEW_IDLE, words="no view")

    @property
    def running(self) -> bool:
        """Whether a session runs."""
        return self._child is not None and self._child.running

    async def run(self, changes: list[str]) -> Path:
        """Begin a session in a new folder.

        Raises
        ------
        Refused
            One runs already.
        ConfigError
            The configuration cannot be used.
        """
        self._runs_sessions()
        path = self.bench.new_folder()
        try:
            make_folder(self.bench.root)
        except OSError as error:
            raise write_error(self.bench.root, error) from error
        load_config(self.bench.config_path, (*self.bench.changes, *changes))
        name = str(self.bench.config_path or "config.yaml")
        await self._start(
            {
                "do": "run",
                "path": str(path),
                "config": self.bench.config_text(),
                "name": name,
                "changes": [*self.bench.changes, *changes],
                "choice": asdict(self.bench.choice),
                "log_wire": self.bench.log_wire,
            }
        )
        return path

    async def view(self) -> None:
        """Begin the live view."""
        config = self.bench.config()
        name = str(self.bench.config_path or "config.yaml")
        order = {"do": "view", "config": self.bench.config_text(), "name": name, "changes": list(self.bench.changes)}
        begun = {"running": False, "viewing": True, "viewed": True, "limit_mn": config.rig.limits.load_mn}
        await self._start({**order, "choice": asdict(self.bench.choice)}, **begun)

    def wish(self, wish: Message) -> bool:
        """Tell the live view what a page wants; whether there is one."""
        return bool(self.board.state["viewing"]) and self.tell({"do": "wish", "wish": wish})

    async def resume(self, path: Path) -> None:
        """Go on with a session."""
        self._runs_sessions()
        speed, log_wire = self.bench.choice.speed, self.bench.log_wire
        await self._start({"do": "resume", "path": str(path), "speed": speed, "log_wire": log_wire})

    def _runs_sessions(self) -> None:
        if self.bench.scope:
            raise Refused("this console was begun with --scope, for setting up: begin one without it for a session")

    def tell(self, message: Message) -> bool:
        """Tell the session something; whether there is one."""
        if not self.running or self._child is None:
            return False
        self._child.tell(message)
        return True

    def stop(self) -> bool:
        """Have what runs, or is only being started, end with the surfaces apart; whether there is anything."""
        if not self.running and not self._starting.locked():
            return False
        self._stopped = True
        self.board.stopping()
        self.tell({"do": "stop"})
        return True

    async def ready(self) -> None:
        """Have the analysis ready before there is anything to analyse."""
        if self._analyst is None or not self._analyst.running:
            self._analyst = Child(ANALYST, self._hear_analyst, lambda code: None, ANALYST_NICENESS)
            await self._analyst.start()

    async def end(self) -> None:
        """Have the session end, and wait until its surfaces are apart."""
        if self._child is not None:
            await self._child.end()
        await self.so_far.end()
        if self._analyst is not None:
            await self._analyst.end(at_once=True)

    def _hear(self, message: Message, numbers: bytes) -> None:
        """Hear what the session tells: the pages are shown it, and the analysis is given what it needs."""
        kind, before = message.get("kind"), self.board.state["load_set"]
        self.board.hear(message, numbers)
        if self.board.state["viewed"]:
            return
        if kind in ("begun", "tap", "judged"):
            self._analysed(message, numbers)
        elif kind == "point":
            point = [message["weight_mn"], message["voltage_mv"]]
            self._analysed({"kind": "points", "when": self.board.calibrating(), "points": [point]})
        elif kind == "points":
            when = "before" if message["state"] == "PRE_CALIBRATION" else "after"
            self._analysed({"kind": "points", "when": when, "points": message["points"]})
        elif kind in ("told", "ended") or (kind == "aim" and message["load_set"] != before):
            self._analysed({"kind": "all"})  # springs and noise are those of all taps so far

    def _analysed(self, message: Message, numbers: bytes = b"") -> None:
        if self._analyst is not None:
            self._analyst.tell(message, numbers)

    def _hear_analyst(self, message: Message, numbers: bytes) -> None:
        if message.get("kind") == "snapshot":
            self.so_far.written(message)
        else:
            self.board.hear(message, numbers)

    def _show_so_far(self) -> None:
        self.board.state["so_far"] = self.so_far.shown
        self.board.show("state")

    async def _start(self, order: dict[str, Any], **begun: Any) -> None:
        async with self._starting:
            if self.running:
                what = "the live view" if self.board.state["viewing"] else "a session"
                raise Refused(f"{what} runs already; end it, or press STOP, before anything else is begun")
            self._stopped = False
            self.board.clear()
            self.board.state.update({"running": True, "words": "starting", "next": STARTING, **begun})
            self.board.show(*self.board.parts())
            self.so_far.forget()
            await self.ready()

            def said(line: str) -> None:
                if self._child is child:  # not of the guardian of an earlier session
                    self.board.said(line)

            guarded = self.bench.choice.outlives
            child = Child(SESSION, self._hear, lambda code: self.board.gone(code, guarded), beats=True, said=said)
            await child.start()
            self._child = child
            child.tell(order)
            if self._stopped:
                child.tell({"do": "stop"})
