"""A process that the console started: what it, or what outlives it, writes to standard error is passed on."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor

from mesotap.console.child import LONGEST_LINE, Child

OUTLIVED = """
import subprocess, sys
code = "import sys, time; time.sleep(0.5); print('after its end', file=sys.stderr)"
sys.stderr.write("while it runs\\n" + "x" * {long} + "\\n")
subprocess.Popen([sys.executable, "-c", code], start_new_session=True)
"""


def test_lines_of_it_and_of_what_outlives_it(tmp_path, monkeypatch, capfd):
    (tmp_path / "dying.py").write_text(OUTLIVED.format(long=2 * LONGEST_LINE))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    async def lines() -> list[str]:
        told: list[str] = []
        gone, last = asyncio.Event(), asyncio.Event()

        def said(line: str) -> None:
            told.append(line if gone.is_set() else f"{line}, before it was gone")
            if line == "after its end":
                last.set()

        child = Child("dying", lambda message, numbers: None, lambda code: gone.set(), said=said)
        await child.start()
        await asyncio.wait_for(gone.wait(), 60)
        await asyncio.wait_for(last.wait(), 60)
        await child.end()
        return told

    with ThreadPoolExecutor() as apart:  # a browser of other tests may have its own loop in this thread
        told = apart.submit(asyncio.run, lines()).result()
    assert told[0].startswith("while it runs")
    assert "too long" in told[1]
    assert told[-1] == "after its end"
    assert "after its end" in capfd.readouterr().err
