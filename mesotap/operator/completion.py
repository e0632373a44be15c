"""What typer leaves to be done for completion: a shell that is named, and zsh's first Tab.

typer knows the calling shell only. Its script for zsh only registers what completes, and zsh loads it at the first Tab:
that Tab would complete nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rig.errors import MesotapError

SHELLS = ("bash", "zsh", "fish")
INSTALL, SHOW = "--install-completion", "--show-completion"
ASKED = {INSTALL, SHOW}
NO_SHELL = (
    "mesotap: completion is for bash, zsh and fish; the shell that this was called from is none of them, or cannot be "
    "told: call it from the shell itself, not from a script"
)
FIRST_TAB = """
# the Tab at which zsh loads this file completes too
if [[ "${funcstack[1]}" == _mesotap ]]; then _mesotap_completion "$@"; fi
"""


def complete_at_the_first_tab() -> None:
    """Have the script that was installed for zsh, if one was, complete when it is loaded."""
    script = Path.home() / ".zfunc" / "_mesotap"
    if script.is_file() and FIRST_TAB not in (text := script.read_text(encoding="utf-8")):
        script.write_text(text.rstrip("\n") + "\n" + FIRST_TAB, encoding="utf-8")


class ShellError(MesotapError):
    """A shell was named for which there is no completion."""


def completed_for(arguments: Sequence[str]) -> str | None:
    """Carry out ``--show-completion SHELL`` or ``--install-completion SHELL``, or with ``=`` between the two.

    Parameters
    ----------
    arguments
        The command line behind the program's name.

    Returns
    -------
    str or None
        What is to be printed; None where no shell is named, which is left to typer.

    Raises
    ------
    ShellError
        The shell is none of ``SHELLS``, or something follows it.
    """
    words = [*arguments[0].split("=", 1), *arguments[1:]] if arguments else []
    if len(words) < 2 or words[0] not in ASKED or words[1].startswith("-"):
        return None
    option, shell, *more = words
    if shell not in SHELLS or more:
        raise ShellError(f"{option}: completion is for bash, zsh or fish, not for {' '.join([shell, *more])!r}")
    from typer.completion import get_completion_script, install

    if option == SHOW:
        return get_completion_script(prog_name="mesotap", complete_var="_MESOTAP_COMPLETE", shell=shell)
    _, path = install(shell=shell, prog_name="mesotap")
    return f"{shell} completion installed in {path}\nCompletion will take effect once you restart the terminal"
