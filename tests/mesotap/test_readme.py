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
STARTED_BY = "mesotap config init"


def commands() -> tuple[list[str], list[str]]:
    """Return the lines of the blocks from the first session on: those that set up, and all others."""
    text = (ROOT / "README.md").read_text()
    part = text[text.index("## A first session") : text.index("## Where to go next")]
    lines = [line[4:].strip() for line in part.splitlines() if line.startswith("    ")]
    first = next(at for at, line in enumerate(lines) if line.startswith(STARTED_BY))
    return lines[:first], lines[first:]


def clone(folder: Path) -> Path:
    """Clone what is committed into a folder, as a user does."""
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        pytest.skip("this is no clone itself, or there is no git")
    subprocess.run(["git", "clone", "--quiet", "--no-hardlinks", str(ROOT), str(folder)], check=True)
    return folder


def own_folder(setting_up: list[str], cloned: Path) -> tuple[Path, str]:
    """Run the lines that set up in a clone; return the folder where they end, and the path for commands."""
    script = "\n".join(["set -e", *setting_up, "pwd", "printenv PATH"])
    bare = {k: v for k, v in os.environ.items() if k != "VIRTUAL_ENV"}
    said = subprocess.run(["bash", "-c", script], cwd=cloned, env=bare, check=True, capture_output=True, text=True)
    folder, path = said.stdout.splitlines()
    return Path(folder), path


def test_the_blocks_are_found():
    setting_up, lines = commands()
    assert setting_up[0].startswith(". .venv")
    known = {"mesotap", "python"}
    assert {shlex.split(line, comments=True)[0] for line in lines} == known


def test_what_the_lines_make_has_a_folder_of_its_own_in_a_clone_and_what_they_name_is_there(tmp_path):
    cloned = clone(tmp_path / "mesotap")
    setting_up, lines = commands()
    folder, _ = own_folder(setting_up[1:], cloned)
    assert folder.parent == cloned
    assert not list(folder.iterdir())  # so that neither catalog nor reanalyze walks tests and .venv
    (folder / "made").touch()
    assert not subprocess.run(["git", "status", "--porcelain"], cwd=cloned, capture_output=True, check=True).stdout
    named = [word for line in lines for word in shlex.split(line, comments=True) if "docs/" in word]
    assert named
    assert all((folder / word).is_file() for word in named)


@pytest.mark.slow
@pytest.mark.skipif("MESOTAP_README" not in os.environ, reason="takes half an hour: make readme")
def test_every_line_runs_as_it_stands(tmp_path):
    cloned = clone(tmp_path / "mesotap")
    subprocess.run(["make", "demo", f"PYTHON={sys.executable}"], cwd=cloned, check=True)
    setting_up, lines = commands()
    folder, path = own_folder(setting_up, cloned)
    assert (cloned / ".venv" / "bin").samefile(path.split(os.pathsep)[0])
    environment = {**os.environ, "PATH": path, "OPENBLAS_NUM_THREADS": "1", "BROWSER": "true"}
    faults = []
    for line in lines:
        began = time.monotonic()
        code, said = ended(line, folder, environment)
        print(f"{time.monotonic() - began:6.1f} s  {line}", flush=True)
        if code not in ((0, 130) if line.startswith("mesotap console") else (0,)):
            faults.append(f"{line}\n{said[-2000:]}")
    assert not faults, "\n\n".join(faults)
    assert "guide_friction" in (folder / "adopted.yaml").read_text()


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
