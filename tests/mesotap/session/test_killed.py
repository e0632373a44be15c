"""SIGKILL at random moments: nothing accepted is lost or doubled, and the end is the same.

``MESOTAP_KILLS`` sets the number of kills (``make kills`` takes 200).
"""

from __future__ import annotations

import io
import os
import random
import signal
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from rich.console import Console

from daq.journal import SessionFolder
from mesotap.commands import session as commands

KILLS = int(os.environ.get("MESOTAP_KILLS", "5"))
SMALL = [
    "mesotap.load_plan_mn=[300, 500]",
    "mesotap.impacts_per_load=3",
    "calibration.weights_mn=[0, 500, 1000]",
    "daq.trigger.record_samples=2000",
    "sim_backend.bad_taps={double: 0.1, too_hard: 0.1, too_weak: 0.1, off_centre: 0.1, clipped: 0.0}",
]
TIMES = {"time", "created"}


def silent() -> Console:
    return Console(file=io.StringIO())


def begin(folder: Path, seed: int) -> None:
    commands.run(None, SMALL, commands.RigChoice(simulate=True, seed=seed), folder, None, silent())


def child(work) -> int:
    """Run ``work`` in a process of its own; its id."""
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            work()
            code = 0
        except BaseException as error:
            os.write(2, f"{type(error).__name__}: {error}\n".encode())
        finally:
            os._exit(code)
    return pid


def finish(pid: int) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def content(path: Path) -> dict[str, object]:
    """Everything in a session file but the times."""
    found: dict[str, object] = {}

    def visit(name: str, node) -> None:
        for key, value in node.attrs.items():
            if key not in TIMES:
                found[f"{name}@{key}"] = value.tolist() if hasattr(value, "tolist") else value
        if isinstance(node, h5py.Dataset):
            found[name] = node[()].tobytes() if isinstance(node[()], np.ndarray) else node[()]

    with h5py.File(path) as file:
        visit("/", file)
        file.visititems(visit)
    return found


def accepted(folder: Path) -> dict[int, bytes]:
    """Accepted impacts on the disk of a session."""
    if not (folder / "session.json").exists():
        return {}
    with SessionFolder.open(folder) as session:
        return {s.number: s.acceleration.tobytes() for s in session.impacts() if s.accepted}


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_killed_session_ends_as_an_unbroken_one(tmp_path):
    rng = random.Random(20261121)
    killed = seed = sessions = 0
    while killed < KILLS:
        seed += 1
        whole = tmp_path / f"whole-{seed}"
        begun = time.monotonic()
        begin(whole, seed)
        lasts = time.monotonic() - begun
        expected = content(whole / "session.h5")
        for _ in range(10):
            if killed >= KILLS:
                break
            sessions += 1
            broken = tmp_path / f"broken-{sessions}"
            pid = child(lambda folder=broken, number=seed: begin(folder, number))
            kept: dict[int, bytes] = {}
            while True:
                time.sleep(rng.uniform(0, lasts))
                os.kill(pid, signal.SIGKILL)
                code = finish(pid)
                if code != 0:
                    assert code == -signal.SIGKILL
                    killed += 1
                now = accepted(broken)
                assert now.items() >= kept.items(), "an accepted shot was lost or altered"
                kept = now
                if not (broken / "session.json").exists():
                    pid = child(lambda folder=broken, number=seed: begin(folder, number))
                elif rng.random() < 0.3:
                    pid = child(lambda folder=broken: commands.resume(folder, None, silent()))
                    continue
                else:
                    pid = child(lambda folder=broken: commands.resume(folder, None, silent()))
                assert finish(pid) == 0
                break
            assert accepted(broken).items() >= kept.items()
            assert content(broken / "session.h5") == expected
