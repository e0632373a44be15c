"""Processes that heed an interrupt, also where the tests run in the background of a shell, which has them ignore it."""

from __future__ import annotations

import signal


def interruptible() -> None:
    """Heed an interrupt: for `subprocess.Popen(preexec_fn=...)`."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
