"""``mesotap`` and ``python -m mesotap``: run a command; what a person can cause ends in a sentence and exit code 2."""

from __future__ import annotations

import os
import sys

REFUSED = 2
INTERRUPTED = 130


def main() -> None:
    """Run the command line."""
    # the matrices here are small: a second BLAS thread only gets in the way of the first
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from mesotap.cli import app

    try:
        app()
    except KeyboardInterrupt:
        sys.stderr.write("mesotap: interrupted\n")
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        # whoever read the output has gone; nothing more can be told
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except Exception as error:
        sentence = _sentence(error)
        if sentence is None:
            raise
        whole = "; ".join([sentence, *getattr(error, "__notes__", ())])
        sys.stderr.write(f"mesotap: {whole}\n")
        sys.exit(INTERRUPTED if type(error).__name__ == "SessionAborted" else REFUSED)


def _sentence(error: Exception) -> str | None:
    """Return the sentence of an error that is meant for a person, None for a fault of the program."""
    from rig.errors import MesotapError

    if isinstance(error, MesotapError):
        return str(error)
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return None


if __name__ == "__main__":
    main()
