"""All hostile inputs, and the table of what became of them: ``python -m tests.hostile.corpus``."""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests.hostile import folders, hdf5_files, places, recordings, settings
from tests.hostile.case import LARGEST_MEMORY, LONGEST_S, Case, Outcome, fault, run

MAKING = threading.Lock()  # HDF5 writes one file of a name at a time
PAGE = Path(__file__).parents[2] / "docs" / "hostile.md"


def cases() -> Iterator[Case]:
    """All of them."""
    for module in (hdf5_files, recordings, settings, folders, places):
        yield from module.cases()


def tried(case: Case) -> tuple[Case, Outcome, str]:
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "here"
        folder.mkdir()
        with MAKING:
            command = case.make(folder)
        outcome = run(command, folder)
    return case, outcome, fault(case, outcome)


def told(case: Case) -> tuple[Case, Outcome, str]:
    """As `tried`; an input that could not be made counts as one that is not as it must be."""
    try:
        return tried(case)
    except Exception as error:
        return case, Outcome(0, b"", b"", 0.0, 0.0, 0), f"it could not be made: {error!r}"


def table(found: list[tuple[Case, Outcome, str]]) -> str:
    """Return the page."""
    lines = [
        "# Hostile and damaged files",
        "",
        "Written by `make hostile`. Each input is given to the command line as it stands; every process of it",
        f"may have {LARGEST_MEMORY // 10**9} GB of addresses, and it may take {LONGEST_S:.0f} s of the processor. It",
        "is refused in one sentence with exit code 2, or read rightly; nothing that is printed holds a control",
        "character. Memory is that of the largest process, time that of the clock.",
        "",
        "| kind | inputs | refused | read | most memory, MB | longest, s |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    kinds = sorted({case.kind for case, _, _ in found})
    for kind in (*kinds, "all"):
        of = [outcome for case, outcome, _ in found if kind in (case.kind, "all")]
        refused, memory = sum(o.status == 2 for o in of), max(o.memory for o in of) / 1e6
        longest = max(o.seconds for o in of)
        lines.append(f"| {kind} | {len(of)} | {refused} | {len(of) - refused} | {memory:.0f} | {longest:.1f} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Try all, or those whose kind and name hold a text; write the page where all are as they must be.

    With ``--kept`` each outcome is written to a file as it comes, and one that stands there is not tried again.
    """
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("which", nargs="?", default="")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--kept", type=Path)
    options = parser.parse_args()
    chosen = [case for case in cases() if options.which in title(case)]
    kept = {} if options.kept is None or not options.kept.exists() else read_kept(options.kept)
    found = [(case, kept[title(case)], "") for case in chosen if title(case) in kept]
    with ThreadPoolExecutor(options.jobs) as pool:
        for case, outcome, wrong in pool.map(told, [case for case in chosen if title(case) not in kept]):
            found.append((case, outcome, wrong))
            if wrong:
                print(f"{title(case)!r}: {wrong}", flush=True)
            elif options.kept is not None:
                numbers = [title(case), outcome.status, outcome.seconds, outcome.processor_s, outcome.memory]
                with options.kept.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(numbers) + "\n")
    bad = sum(bool(wrong) for _, _, wrong in found)
    print(table(found))
    print(f"{len(found)} inputs, {bad} not as they must be")
    if not bad and not options.which and "MESOTAP_WRITE_HOSTILE" in os.environ:
        PAGE.write_text(table(found), encoding="utf-8")
    sys.exit(bool(bad))


def title(case: Case) -> str:
    return f"{case.kind}: {case.name}"


def read_kept(path: Path) -> dict[str, Outcome]:
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return {name: Outcome(status, b"", b"", seconds, used, memory) for name, status, seconds, used, memory in lines}


if __name__ == "__main__":
    main()
