"""Compile what numba compiles at first use, so that no first tap waits a minute: ``python -m mesotap.compiled``.

What is compiled is kept beside the modules; a second time this takes seconds.
"""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Callable

import numpy as np


def tapped() -> None:
    """Simulate a tap and identify it, as a session does."""
    import mesotap

    mesotap.identify(mesotap.simulate())


def rung_down() -> None:
    """Identify the modes of a free decay, as of any recording."""
    import mesotap

    t = np.arange(2000) / 1e4
    noise = 1e-3 * np.random.default_rng(1).standard_normal((2, t.size))
    decay = np.exp(-20 * t) * np.sin(2 * np.pi * 300 * t) + np.exp(-40 * t) * np.sin(2 * np.pi * 900 * t)
    mesotap.identify(decay + noise, 1e4)


PARTS: tuple[Callable[[], None], ...] = (tapped, rung_down)


def main() -> int:
    """Do all parts side by side; return the exit code."""
    running = [multiprocessing.Process(target=part) for part in PARTS]
    for process in running:
        process.start()
    for process in running:
        process.join()
    return int(any(process.exitcode for process in running))


if __name__ == "__main__":
    sys.exit(main())
