"""Packages installed into a folder of their own, and the command line as it is where they are on the path."""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from mesotap.__main__ import main
from sim_backend.mechanisms import catalogue

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Done:
    """What a command printed."""

    stdout: str
    stderr: str


class Packages:
    """A folder of installed packages."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()

    def install(self, wheel: Path) -> None:
        """Put a wheel into it."""
        command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", "--target"]
        subprocess.run([*command, str(self.folder), str(wheel)], check=True)

    def offer(self, package: str, **groups: dict[str, str]) -> None:
        """Put in a package of nothing but entry points, by group (without ``mesotap.``) and name."""
        metadata = self.folder / f"{package}-1.dist-info"
        metadata.mkdir()
        (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1\n")
        sections = [
            f"[mesotap.{group}]\n" + "".join(f"{name} = {value}\n" for name, value in entries.items())
            for group, entries in groups.items()
        ]
        (metadata / "entry_points.txt").write_text("\n".join(sections))

    def mesotap(self, *arguments: object, cwd: Path, code: int = 0) -> Done:
        """Run the command line with it, in this process: to start one takes longer than most commands."""
        said, complained, ended = io.StringIO(), io.StringIO(), 0
        with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(said):
            patch.syspath_prepend(self.folder)
            patch.chdir(cwd)
            patch.setattr(sys, "argv", ["mesotap", *map(str, arguments)])
            patch.setenv("COLUMNS", "200")
            catalogue._catalogue.cache_clear()
            with contextlib.redirect_stderr(complained):
                try:
                    main()
                except SystemExit as end:
                    ended = int(end.code or 0)
            catalogue._catalogue.cache_clear()
        assert ended == code, said.getvalue() + complained.getvalue()
        return Done(said.getvalue(), complained.getvalue())

    def refused(self, *arguments: object, cwd: Path) -> str:
        """Return the one sentence of a command that ends with code 2."""
        lines = self.mesotap(*arguments, cwd=cwd, code=2).stderr.strip().splitlines()
        assert len(lines) == 1, lines
        return lines[0]

    def in_a_process(self, *arguments: object, cwd: Path) -> str:
        """Run the command line with it in a process of its own, and return what it prints."""
        program = "import sys; sys.path.insert(0, sys.argv.pop(1)); from mesotap.__main__ import main; main()"
        return subprocess.run(
            [sys.executable, "-c", program, self.folder, *map(str, arguments)],
            cwd=cwd,
            env={**os.environ, "COLUMNS": "200"},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=True,
        ).stdout


def wheel_of(source: Path, folder: Path) -> Path:
    """Build the package in ``source`` without any network, and return its wheel."""
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-index", "--no-deps", "--no-build-isolation"]
    subprocess.run([*command, "--wheel-dir", str(folder), str(source)], check=True)
    (wheel,) = folder.glob("*.whl")
    return wheel
