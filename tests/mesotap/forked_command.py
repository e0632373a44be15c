"""``mesotap`` in a fork of the tests: a process of its own that need not import everything again."""

from __future__ import annotations

import functools
import gc
import importlib
import io
import os
import pkgutil
import sys
import tempfile
import threading
import traceback
import warnings
from collections.abc import Sequence
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any, BinaryIO

import typer.main

import mesotap.__main__
import mesotap.commands
from mesotap.cli import app

# once, and not in every fork: the imports, and the parser of the command line
for _found in pkgutil.iter_modules(mesotap.commands.__path__, "mesotap.commands."):
    importlib.import_module(_found.name)
typer.main.get_command = functools.cache(typer.main.get_command)
typer.main.get_command(app)

WIDE = {"COLUMNS": "200"}


def run_forked(arguments: Sequence[str], cwd: Path | str | None = None) -> CompletedProcess[str]:
    """Run a command line in a fork; what it printed and its exit code are those of a new process."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = os.fork()
        if child == 0:
            gc.freeze()  # what the tests have made is neither looked through nor copied
            code = 1
            try:
                code = _command(arguments, cwd, out, err)
            finally:
                os._exit(code)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        out.seek(0)
        err.seek(0)
        return CompletedProcess([*arguments], status, out.read().decode(), err.read().decode())


def _command(arguments: Sequence[str], cwd: Path | str | None, out: BinaryIO, err: BinaryIO) -> int:
    with Path(os.devnull).open("rb") as nothing:
        for descriptor, file in enumerate((nothing, out, err)):
            os.dup2(file.fileno(), descriptor)
    sys.stdin, sys.stdout, sys.stderr = (_text(descriptor) for descriptor in range(3))
    sys.argv = ["mesotap", *arguments]
    os.environ.update(WIDE)
    if cwd is not None:
        os.chdir(cwd)
    _warn_as_python_does()
    code: Any = 0
    try:
        mesotap.__main__.main()
    except SystemExit as ended:
        code = ended.code or 0
    except BaseException:
        traceback.print_exc()
        code = 1
    threading._shutdown()  # type: ignore[attr-defined]  # as at the end of every program
    sys.stdout.flush()
    sys.stderr.flush()
    return int(code)


def _text(descriptor: int) -> io.TextIOWrapper:
    mode = "r" if descriptor == 0 else "w"
    return open(descriptor, mode, encoding="utf-8", closefd=False)


def _warn_as_python_does() -> None:
    """Show warnings as a new process does; in the tests they are errors."""
    warnings.resetwarnings()
    for kind in (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning):
        warnings.simplefilter("ignore", kind)
