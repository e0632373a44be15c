"""Where the workers of a cluster come from: others started them, this machine, SLURM."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Protocol

from mesotap.campaigns.errors import CampaignError

PATIENCE_S = 600.0  # without scheduler or worker, before a campaign stops
START_AGAIN_S = 2.0  # between starts of a process that ends at once
ENDS_WITHIN_S = 5.0  # of a process that is asked to end
EXPECTED = "expected an address such as 'tcp://10.0.0.1:8786', 'local:N', or 'slurm:FILE.yaml'"


class Site(Protocol):
    """Has a scheduler and workers.

    Attributes
    ----------
    name
        What was asked for.
    address
        The scheduler's.
    patience_s
        How long it may be without a worker.
    advice
        What to do where that is longer.
    """

    name: str
    address: str
    patience_s: float
    advice: str

    def look_after(self) -> None:
        """Start again what ended and should not have."""

    def close(self) -> None:
        """End what was started."""


def kind_of(asked: str) -> tuple[str, str]:
    """Return the kind of place that ``--cluster`` asks for, and the rest of it; nothing is needed or started for that.

    Raises
    ------
    CampaignError
        It is not to be understood.
    """
    kind, _, rest = asked.partition(":")
    if kind == "local" and not re.fullmatch("[1-9][0-9]{0,3}", rest):
        raise CampaignError(f"--cluster {asked}: expected the number of workers, such as 'local:4'")
    if kind not in ("local", "slurm") and not re.fullmatch(r"(tcp|tls)://\S+:\d{1,5}|[^\s:/]+:\d{1,5}", asked):
        raise CampaignError(f"--cluster {asked}: {EXPECTED}")
    return kind, rest


def site_of(asked: str) -> Site:
    """Return what ``--cluster`` asks for.

    Raises
    ------
    CampaignError
        It is not to be understood, or the extra is not installed.
    """
    kind, rest = kind_of(asked)
    if importlib.util.find_spec("distributed") is None:
        raise CampaignError("--cluster needs another package: pip install 'mesotap[cluster]'")
    if kind == "slurm":
        from mesotap.campaigns.slurm import Slurm

        return Slurm(Path(rest))
    return Local(int(rest)) if kind == "local" else Address(asked)


class Address:
    """A scheduler that others started, with whatever workers come to it."""

    def __init__(self, address: str) -> None:
        self.name = self.address = address
        self.patience_s = PATIENCE_S
        self.advice = f"start 'dask scheduler' there, and 'dask worker {address} --nthreads 1' on each machine"

    def look_after(self) -> None:
        """Leave it to others."""

    def close(self) -> None:
        """Leave it to others."""


class Local:
    """A scheduler and workers on this machine, each a process that is started again when it ends."""

    def __init__(self, workers: int) -> None:
        self.name = f"local:{workers}"
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{port}"
        self.patience_s = 120.0
        self.advice = "its processes end at once: does 'dask worker --version' work here?"
        self._place = Path(tempfile.mkdtemp(prefix="mesotap-cluster-"))
        scheduler = ["dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
        scheduler += ["--idle-timeout", "10 minutes"]  # should nobody be left to end it
        worker = ["dask_worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard", "--memory-limit", "0"]
        worker += ["--death-timeout", "60", "--local-directory", str(self._place)]
        self._commands = [scheduler, *([worker] * workers)]
        self._running: dict[int, subprocess.Popen[bytes]] = {}
        self._started: dict[int, float] = {}

    def look_after(self) -> None:
        """Start what does not run."""
        for part, (program, *arguments) in enumerate(self._commands):
            running = self._running.get(part)
            if running and running.poll() is None:
                continue
            if time.monotonic() - self._started.get(part, -START_AGAIN_S) < START_AGAIN_S:
                continue
            self._started[part] = time.monotonic()
            with (self._place / "log").open("ab") as log:
                self._running[part] = subprocess.Popen(
                    [sys.executable, "-m", f"distributed.cli.{program}", *arguments],
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    start_new_session=True,
                )

    def close(self) -> None:
        """End them, the workers first."""
        running = [process for _, process in sorted(self._running.items(), reverse=True)]
        for how in (signal.SIGTERM, signal.SIGKILL):
            for process in running:
                if process.poll() is None:
                    with contextlib.suppress(ProcessLookupError):
                        os.killpg(process.pid, how)
            until = time.monotonic() + ENDS_WITHIN_S
            while time.monotonic() < until and any(process.poll() is None for process in running):
                time.sleep(0.02)
        self._running.clear()
        shutil.rmtree(self._place, ignore_errors=True)
