"""The README's commands, each as it stands and in order."""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NEEDED = ("sample-files", "examples")  # folders of docs that the lines use
STARTED_BY = "mesotap config init"


def commands() -> list[str]:
    """Return the lines of the blocks from the first session on, without remarks and without what only sets up."""
    text = (ROOT / "README.md").read_text()
    part = text[text.index("## A first session") : text.index("## Where to go next")]
    lines = [line[4:].strip() for line in part.splitlines() if line.startswith("    ")]
    return [line for line in lines if not line.startswith(". ")]


def test_the_files_that_the_lines_name_are_here():
    named = [word for line in commands() for word in shlex.split(line, comments=True) if word.startswith("docs/")]
    assert named
    assert all((ROOT / word).is_file() and word.split("/")[1] in NEEDED for word in named)


def test_the_blocks_are_found():
    assert commands()[0].startswith(STARTED_BY)
    known = {"mesotap", "python"}
    assert {shlex.split(line, comments=True)[0] for line in commands()} == known


@pytest.mark.slow
@pytest.mark.skipif("MESOTAP_README" not in os.environ, reason="takes half an hour: make readme")
def test_every_line_runs_as_it_stands(tmp_path):
    for needed in NEEDED:
        shutil.copytree(ROOT / "docs" / needed, tmp_path / "docs" / needed)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "OPENBLAS_NUM_THREADS": "1", "BROWSER": "true"}
    faults = []
    for line in commands():
        began = time.monotonic()
        code, said = ended(line, tmp_path, environment)
        print(f"{time.monotonic() - began:6.1f} s  {line}", flush=True)
        if code not in ((0, 130) if line.startswith("mesotap console") else (0,)):
            faults.append(f"{line}\n{said[-2000:]}")
    assert not faults, "\n\n".join(faults)
    assert "guide_friction" in (tmp_path / "adopted.yaml").read_text()


def ended(line: str, folder: Path, environment: dict[str, str]) -> tuple[int, str]:
    """Run a line; return its exit code and what it said. What serves until it is told to end is told so."""
    running = subprocess.Popen(
        ["bash", "-c", line],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        # what is started in the background ignores Ctrl-C, and so would its children
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert running.stdout is not None
    said = ""
    if line.startswith("mesotap console"):
        said = running.stdout.readline()
        assert "http://127.0.0.1" in said, line
        os.killpg(running.pid, signal.SIGINT)
    said += running.communicate()[0]
    return running.returncode, said
