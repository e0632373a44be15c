"""A console of its own process for tests, and pages of it in the machine's Chromium."""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium")
FLAGS = [
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update"),
]
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium on this machine")
PATIENCE_MS = 120_000
"""A machine that does other things too may take so long over what takes a second."""

SMALL = """
mesotap: {load_plan_mn: [300, 900], impacts_per_load: 2, dwell_s: 1, specimen: a pair of plates}  # kept
calibration: {weights_mn: [0, 500, 1000], averaging_s: 0.2, repeats: 1}
daq: {trigger: {record_samples: 2000}}
rig: {limits: {expected_contact_um: 12}}
sim_backend:
  contact_position_um: 12
  gauge: {weight_settling_s: 0.5}
  bad_taps: {double: 0, too_hard: 0, too_weak: 0, off_centre: 0, clipped: 0}
"""


class ConsoleProcess:
    """``mesotap console`` in a folder."""

    def __init__(self, folder: Path, *options: str, config: str = SMALL, rig: str = "--simulate") -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.config, self.sessions = folder / "config.yaml", folder / "sessions"
        if not self.config.exists():
            self.config.write_text(config)
        command = [sys.executable, "-m", "mesotap", "console", rig, "-c", str(self.config), "-o", str(self.sessions)]
        self._errors = (folder / "errors.txt").open("a+")
        self.process = subprocess.Popen(
            [*command, "--port", "0", "--no-browser", *options],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "300"},
        )
        assert self.process.stdout is not None
        self.warned = ""
        while (found := re.search(r"https?://(\S+):(\d+)(/\S+)", said := self.process.stdout.readline())) is None:
            assert said, self.warned + self.errors()
            self.warned += said
        self.link, self.host, self.port, self.path = found[0], found[1], int(found[2]), found[3]

    def errors(self) -> str:
        """What it said on standard error."""
        self._errors.seek(0)
        return self._errors.read()

    def kill(self) -> None:
        """End it at once."""
        self.process.kill()
        self.process.wait()

    def close(self) -> None:
        """End it, and its session with it."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            self.process.wait(60)
        assert self.process.stdout is not None
        self.process.stdout.close()
        self._errors.close()


@contextlib.contextmanager
def console_in(folder: Path, *options: str, **more: str) -> Iterator[ConsoleProcess]:
    console = ConsoleProcess(folder, *options, **more)
    try:
        yield console
    finally:
        console.close()


class Client:
    """Plain requests to a console, with its cookie."""

    def __init__(self, console: ConsoleProcess) -> None:
        self.port = console.port
        status, headers, _ = self.request("GET", console.path)
        assert status == 303
        self.cookie = headers["set-cookie"].partition(";")[0]

    cookie = ""

    def request(
        self, method: str, path: str, body: bytes | None = None, headers: dict[str, str] | None = None
    ) -> tuple[int, dict[str, str], bytes]:
        """Send a request as it is; headers of None are left out."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.request(method, path, body, {"Cookie": self.cookie, **(headers or {})})
            answer = connection.getresponse()
            return answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read()
        finally:
            connection.close()

    def post(self, what: str, content: dict[str, Any], **headers: str) -> tuple[int, dict[str, Any]]:
        """Send what a page would."""
        all_headers = {"X-Mesotap": "1", "Content-Type": "application/json", **headers}
        status, _, answer = self.request("POST", f"/api/{what}", json.dumps(content).encode(), all_headers)
        return status, json.loads(answer)


def client_of(page: Any, console: ConsoleProcess) -> Client:
    """Return a client with the cookie that a page was given: the link is used up."""
    client = Client.__new__(Client)
    client.port = console.port
    cookie = page.context.cookies()[0]
    client.cookie = f"{cookie['name']}={cookie['value']}"
    return client


def journal_of(console: ConsoleProcess) -> list[dict[str, Any]]:
    """Entries of the journal of the console's one session."""
    (folder,) = [path for path in console.sessions.iterdir() if path.is_dir()]
    return [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]
