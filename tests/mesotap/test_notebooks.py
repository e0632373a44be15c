"""The notebooks of the documentation, as they are stored, and their code; `make docs` executes them as notebooks."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import mesotap
from tests.mesotap.installed import ROOT

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def cells(file: Path) -> list[dict[str, object]]:
    return json.loads(file.read_text(encoding="utf-8"))["cells"]  # type: ignore[no-any-return]


def code(file: Path) -> str:
    return "\n".join("".join(cell["source"]) for cell in cells(file) if cell["cell_type"] == "code")  # type: ignore[arg-type]


def test_there_are_two_and_the_site_lists_them() -> None:
    assert [file.stem for file in NOTEBOOKS] == ["own-rig", "session"]
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    for file in NOTEBOOKS:
        assert f"(notebooks/{file.name})" in index
        assert f"\nnotebooks/{file.stem}\n" in index


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_no_results_are_stored(file: Path) -> None:
    for cell in cells(file):
        assert not cell.get("outputs"), cell["source"]
        assert cell.get("execution_count") is None


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_a_command_that_fails_fails_its_cell(file: Path) -> None:
    """A shell escape would go on; so would a process whose exit code nobody looks at."""
    for call in (node for node in ast.walk(ast.parse(code(file))) if isinstance(node, ast.Call)):
        if ast.unparse(call.func) == "subprocess.run":
            assert any(k.arg == "check" and ast.unparse(k.value) == "True" for k in call.keywords)


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_they_use_the_public_face_alone(file: Path) -> None:
    tree = ast.parse(code(file))
    imported = {
        name.name for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom) for name in node.names
    }
    assert "mesotap" in imported
    used = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "mesotap"
    }
    assert used
    assert used <= set(mesotap.__all__)


@pytest.mark.long
@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_their_code_runs_and_finds_what_the_text_promises(file: Path, tmp_path: Path) -> None:
    """In one process and without a kernel, as far as that shows it; the site executes them as notebooks."""
    (tmp_path / "cells.py").write_text(code(file), encoding="utf-8")
    settings = {"MPLBACKEND": "agg", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "cells.py"], cwd=tmp_path, env={**os.environ, **settings}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    promised = {
        "own-rig": r"tube_spring_cubic in the spring, probability 0\.9",
        "session": r"mN, 4 taps: +\d\.\d+ +\(\d",
    }
    assert re.search(promised[file.stem], done.stdout), done.stdout
