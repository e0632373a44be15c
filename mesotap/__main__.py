"""``mesotap`` and ``python -m mesotap``: run a command; what a person can cause ends in a sentence and exit code 2."""

from __future__ import annotations

import errno
import os
import sys

REFUSED = 2
INTERRUPTED = 130


def main() -> None:
    """Run the command line; an interrupt ends it without a traceback, while the program is still loading too."""
    try:
        _command()
    except KeyboardInterrupt:
        sys.stderr.write("mesotap: interrupted\n")
        sys.exit(INTERRUPTED)


def _command() -> None:
    # the matrices here are small: a second BLAS thread only gets in the way of the first
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from mesotap.cli import app
    from mesotap.operator.completion import ASKED, INSTALL, NO_SHELL, complete_at_the_first_tab, completed_for
    from mesotap.operator.terminal import complain, let_go_of_the_dead, survive_any_text

    survive_any_text()
    try:
        of_a_shell = completed_for(sys.argv[1:])
        if of_a_shell is not None:
            print(of_a_shell)
            return
        ended = app(standalone_mode=False)
        if ended == INTERRUPTED:  # what typer makes of an interrupt, without a word
            raise KeyboardInterrupt
        if isinstance(ended, int) and ended:
            if ASKED & set(sys.argv[1:]):
                complain(NO_SHELL)
                ended = REFUSED
            sys.exit(ended)
    except KeyboardInterrupt:
        complain("mesotap: interrupted")
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        sys.exit(0)  # whoever read the output has gone; nothing more can be told
    except Exception as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            error.show()  # type: ignore[attr-defined]
            sys.exit(REFUSED)
        sentence = _sentence(error)
        if sentence is None:
            raise
        whole = "; ".join([sentence, *getattr(error, "__notes__", ())])
        complain(f"mesotap: {whole}")
        sys.exit(INTERRUPTED if type(error).__name__ == "SessionAborted" else REFUSED)
    finally:
        if any(word.split("=", 1)[0] == INSTALL for word in sys.argv[1:]):
            complete_at_the_first_tab()
        let_go_of_the_dead()


def _sentence(error: Exception) -> str | None:
    """Return the sentence of an error that is meant for a person, None for a fault of the program."""
    from daq.errors import one_line
    from rig.errors import MesotapError

    if isinstance(error, MesotapError):
        # a configuration's faults have a line each; anything else is one sentence, whatever it quotes
        return str(error) if type(error).__name__ == "ConfigError" else one_line(str(error))
    usage = getattr(error, "format_message", None)  # of a command that does not exist, an option that is none, ...
    if usage is not None:
        return one_line(str(usage()))
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename!s}: {error.strerror}"
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EIO, errno.EDQUOT):
        return f"the output cannot be written ({error.strerror})"
    return None


if __name__ == "__main__":
    main()
