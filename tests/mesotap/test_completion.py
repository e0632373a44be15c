"""What the shells complete, with the scripts that `mesotap --install-completion` installs."""

from __future__ import annotations

import os
import pty
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mesotap.operator.completion import ASKED, FIRST_TAB
from tests.mesotap.forked_command import run_forked

MESOTAP = Path(sys.executable).parent / "mesotap"
READY, PATIENCE_S = "ready> ", 120.0


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


@pytest.mark.slow
@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_the_tab_key_completes_in_the_shell_that_it_was_installed_from(shell: str, tmp_path: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} here to press Tab in")
    prompt = f"PS1='{READY}'\n" + ("unsetopt zle_bracketed_paste\n" if shell == "zsh" else "")
    (tmp_path / f".{shell}rc").write_text(prompt)
    (tmp_path / "tapped.h5").touch()
    with Typing(shell, tmp_path) as keys:
        said_of_it = keys.type("mesotap --install-completion; echo fin''ished\n", "finished")
        assert f"{shell} completion installed in" in said_of_it
    with Typing(shell, tmp_path) as keys:
        keys.type("mesotap conf\t", "mesotap config ")  # the very first Tab
        keys.type("\x15mesotap config mig\t", "mesotap config migrate ")
        keys.type("\x15mesotap analyze --met\t", "mesotap analyze --method ")
        keys.type("\x15mesotap analyze tap\t", "mesotap analyze tapped.h5")
        listed = keys.type("\x15mesotap di\t\t", "diagnose")
        assert "not found" not in listed
        assert "parse error" not in listed


@pytest.mark.slow
def test_it_is_installed_once_and_printed_for_a_file_of_one_s_own(tmp_path: Path) -> None:
    if shutil.which("zsh") is None:
        pytest.skip("no zsh here to install it in")
    (tmp_path / ".zshrc").write_text(f"PS1='{READY}'\nunsetopt zle_bracketed_paste\n")
    with Typing("zsh", tmp_path) as keys:
        for _ in range(2):
            keys.type("mesotap --install-completion; echo fin''ished\n", "finished")
        keys.type("mesotap --show-completion > shown.zsh; echo shown''it\n", "shownit")
    installed = (tmp_path / ".zfunc" / "_mesotap").read_text()
    assert installed.count(FIRST_TAB) == 1
    shown = tmp_path / "shown.zsh"
    script = f"autoload -Uz compinit; compinit -u; source {shown}; print ${{_comps[mesotap]}}"
    environment = {**os.environ, "HOME": str(tmp_path), "ZDOTDIR": str(tmp_path)}
    done = subprocess.run(["zsh", "-f", "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "_mesotap_completion"


@pytest.mark.parametrize(
    ("shell", "mark"), [("bash", "complete -o default"), ("zsh", "#compdef mesotap"), ("fish", "complete --command")]
)
def test_the_script_is_that_of_the_shell_that_is_named(shell: str, mark: str) -> None:
    asked = said(_MESOTAP_COMPLETE=f"source_{shell}").strip()
    assert mark in asked
    for words in (["--show-completion", shell], [f"--show-completion={shell}"]):
        done = run_forked(words)
        assert (done.returncode, done.stderr, done.stdout.strip()) == (0, "", asked)


@pytest.mark.parametrize("words", [["tcsh"], ["zsh", "analyze"], ["analyze"]])
@pytest.mark.parametrize("option", sorted(ASKED))
def test_what_is_no_shell_is_refused(option: str, words: list[str]) -> None:
    done = run_forked([option, *words])
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"mesotap: {option}: completion is for bash, zsh or fish, not for '{' '.join(words)}'\n"


def test_it_is_installed_for_the_shell_that_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    done = run_forked(["--install-completion", "zsh"])
    assert f"zsh completion installed in {tmp_path}" in done.stdout
    script = (tmp_path / ".zfunc" / "_mesotap").read_text()
    assert "#compdef mesotap" in script
    assert FIRST_TAB in script


@pytest.mark.skipif(shutil.which("dash") is None, reason="no dash here, for which there is no completion")
def test_a_shell_without_completion_is_told_so(tmp_path: Path) -> None:
    asked = ["dash", "-c", f"{MESOTAP} --show-completion; exit $?"]
    environment = {**os.environ, "HOME": str(tmp_path)}
    done = subprocess.run(asked, env=environment, capture_output=True, text=True, start_new_session=True, check=False)
    assert done.returncode == 2
    assert "completion is for bash, zsh and fish" in done.stderr


class Typing:
    """An interactive shell at a pseudo-terminal, with a home of its own."""

    def __init__(self, shell: str, home: Path) -> None:
        path = f"{MESOTAP.parent}{os.pathsep}{os.environ['PATH']}"
        own = {"HOME": str(home), "ZDOTDIR": str(home), "PATH": path, "TERM": "dumb"}
        self.pid, self.terminal = pty.fork()
        if self.pid == 0:
            os.chdir(home)
            os.execvpe(shell, [shell, "-i"], {**os.environ, **own})

    def __enter__(self) -> Typing:
        self.type("", READY)
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self.terminal)
        os.waitpid(self.pid, 0)

    def type(self, keys: str, until: str) -> str:
        """Press keys; return what the shell shows then, as far as what is waited for."""
        os.write(self.terminal, keys.encode())
        shown, end = "", time.monotonic() + PATIENCE_S
        while until not in shown:
            assert time.monotonic() < end, f"{keys!r} showed {shown!r}, not {until!r}"
            if select.select([self.terminal], [], [], 0.2)[0]:
                shown += os.read(self.terminal, 65536).decode(errors="replace")
        return shown
