"""What the shells complete, with the scripts that `mesotap --install-completion` installs."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

MESOTAP = Path(sys.executable).parent / "mesotap"


def said(**environment: str) -> str:
    """Return what the program prints to a shell that asks."""
    done = subprocess.run(
        [str(MESOTAP)], env={**os.environ, **environment}, capture_output=True, text=True, check=True, timeout=120
    )
    assert not done.stderr
    return done.stdout


def test_bash_completes_commands_and_options() -> None:
    script = said(_MESOTAP_COMPLETE="source_bash")
    asked = """
    COMP_WORDS=(mesotap conf); COMP_CWORD=1; _mesotap_completion mesotap; echo "${COMPREPLY[@]}"
    COMP_WORDS=(mesotap config mig); COMP_CWORD=2; _mesotap_completion mesotap; echo "${COMPREPLY[@]}"
    COMP_WORDS=(mesotap analyze --me); COMP_CWORD=2; _mesotap_completion mesotap; echo "${COMPREPLY[@]}"
    complete -p mesotap
    """
    path = f"{MESOTAP.parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", script + asked], env={**os.environ, "PATH": path}, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines() == [
        "config",
        "migrate",
        "--method",
        "complete -o default -F _mesotap_completion mesotap",
    ]


def test_zsh_completes_with_what_a_command_does() -> None:
    answer = said(_MESOTAP_COMPLETE="complete_zsh", _TYPER_COMPLETE_ARGS="mesotap config m")
    assert answer.startswith('_arguments \'*: :(("migrate":"Rewrite a configuration')
    script = said(_MESOTAP_COMPLETE="source_zsh")
    assert "#compdef mesotap" in script
    if shutil.which("zsh") is None:
        pytest.skip("no zsh here to read the script")
    subprocess.run(["zsh", "-n"], input=script, text=True, check=True)


def test_it_is_installed_for_the_shell_that_asks(tmp_path: Path) -> None:
    environment = {**os.environ, "HOME": str(tmp_path), "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    for shell, file in (("bash", ".bash_completions/mesotap.sh"), ("zsh", ".zfunc/_mesotap")):
        subprocess.run([str(MESOTAP), "--install-completion", shell], env=environment, check=True, capture_output=True)
        assert "_MESOTAP_COMPLETE" in (tmp_path / file).read_text()
