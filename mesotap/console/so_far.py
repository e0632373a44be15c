"""The diagnosis of a session that still runs: on request, of a copy, by a process that gives way to everything else."""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mesotap.console.board import DIAGNOSIS
from mesotap.console.frames import Message

NICENESS = 15
LONGEST_S = 1800.0
SNAPSHOT = "so-far.h5"


class SoFar:
    """One diagnosis at a time.

    Parameters
    ----------
    ask_for_snapshot
        Called with where the session so far is to be written; `written` hears when it is.
    changed
        Called when there is something new to show.
    """

    def __init__(self, ask_for_snapshot: Callable[[Path], None], changed: Callable[[], None]) -> None:
        self._ask, self._changed = ask_for_snapshot, changed
        self._folder = Path(tempfile.mkdtemp(prefix="mesotap-console-"))
        self._task: asyncio.Task[None] | None = None
        self.shown: dict[str, Any] = {"running": False, "taps": 0, "ready": False, "why": ""}

    @property
    def page(self) -> Path:
        """Where the last one is."""
        return self._folder / "page" / DIAGNOSIS

    def begin(self) -> bool:
        """Begin one; whether none ran already."""
        if self.shown["running"]:
            return False
        self.shown = {"running": True, "taps": 0, "ready": False, "why": ""}
        self._changed()
        self._ask(self._folder / SNAPSHOT)
        return True

    def written(self, message: Message) -> None:
        """Hear that the session so far was written, or why not."""
        if "path" not in message:
            self._done(message["why"])
            return
        self.shown["taps"] = message["taps"]
        self._task = asyncio.get_running_loop().create_task(self._diagnose())

    def forget(self) -> None:
        """See another session begin: what was found is not its."""
        if not self.shown["running"]:
            self.shown = {"running": False, "taps": 0, "ready": False, "why": ""}
            self._changed()

    async def end(self) -> None:
        """End what runs, and leave nothing behind."""
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task
        shutil.rmtree(self._folder, ignore_errors=True)

    async def _diagnose(self) -> None:
        nowhere = asyncio.subprocess.DEVNULL
        report = self._folder / "page"
        shutil.rmtree(report, ignore_errors=True)
        process = await asyncio.create_subprocess_exec(
            *("nice", "-n", str(NICENESS), sys.executable, "-m", "mesotap", "diagnose"),
            str(self._folder / SNAPSHOT),
            *("--report", str(report)),
            stdin=nowhere,
            stdout=nowhere,
            stderr=asyncio.subprocess.PIPE,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"},
        )
        try:
            _, said = await asyncio.wait_for(process.communicate(), LONGEST_S)
        except TimeoutError:
            self._done(f"it took longer than {LONGEST_S / 60:.0f} minutes")
            return
        finally:
            if process.returncode is None:
                process.kill()
        lines = said.decode(errors="replace").strip().splitlines()
        self._done("" if process.returncode == 0 else (lines[-1] if lines else "it failed"))

    def _done(self, why: str) -> None:
        self.shown.update(running=False, why=why, ready=not why and self.page.is_file())
        self._changed()
