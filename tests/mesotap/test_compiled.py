"""What is compiled at first use is compiled ahead, and a part that fails is told."""

from __future__ import annotations

import subprocess
import sys

import pytest

from mesotap import compiled


def fails() -> None:
    raise SystemExit(3)


def test_a_part_that_fails_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "PARTS", (compiled.rung_down, fails))
    assert compiled.main() == 1


@pytest.mark.slow
def test_a_session_that_follows_compiles_nothing_of_what_it_identifies_with() -> None:
    code = (
        "from numba.core import event; seen = event.RecordingListener(); event.register('numba:compile', seen)\n"
        "import mesotap; mesotap.identify(mesotap.simulate())\n"
        "print(sum(e.is_start for _, e in seen.buffer))"
    )
    assert compiled.main() == 0
    assert int(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout) == 0
