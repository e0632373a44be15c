"""Error and time of `sim_backend.propagate` for every kind of mechanism, over substeps, against scipy's DOP853.

`python -m benchmarks.propagate` writes docs/benchmarks/propagate.md. Beside its numbers stand those of the integrations
that it replaced: parabolas in modes for free motions, straight lines and a matrix exponential for given inputs.
"""

from __future__ import annotations

import platform
import time
from datetime import date
from pathlib import Path

from sim_backend.propagate import TOLERANCE
from tests.sim_backend.motions import RATE_HZ, SAMPLES, Case, cases, error, motion, reference

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks" / "propagate.md"
SUBSTEPS = (1, 2, 4, 8, 16)
TOLERANCES = (TOLERANCE, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5, 2e-5, 1e-5, 1e-6)
TOGETHER = 32
REPEATED = 9  # the quickest counts
BEFORE = {  # error and time (ms) in 1, 2, 4, 8 and 16 substeps, with the code of commit fab03ab
    "smooth law": ((1.8e-03, 0.06), (1.1e-04, 0.10), (9.8e-06, 0.20), (1.2e-06, 0.40), (1.4e-07, 0.78)),
    "contact loss": ((1.7e-01, 0.06), (6.9e-02, 0.11), (2.4e-02, 0.21), (1.3e-03, 0.40), (8.3e-04, 0.78)),
    "end stop": ((3.1e-03, 0.06), (4.8e-04, 0.11), (1.7e-04, 0.20), (1.4e-05, 0.39), (9.7e-06, 0.77)),
    "dry friction": ((5.4e-03, 0.07), (1.0e-03, 0.13), (2.0e-04, 0.24), (1.1e-05, 0.48), (1.2e-06, 0.96)),
    "hysteresis": ((9.0e-04, 0.06), (3.6e-04, 0.11), (8.1e-05, 0.20), (1.4e-05, 0.40), (4.0e-06, 0.78)),
    "rate law": ((3.5e-03, 0.08), (7.8e-04, 0.16), (1.9e-04, 0.31), (4.7e-05, 0.61), (1.2e-05, 1.22)),
    "added body": ((1.5e-03, 0.06), (1.1e-04, 0.11), (1.2e-05, 0.21), (1.5e-06, 0.41), (1.9e-07, 0.82)),
    "input held": ((9.8e-03, 0.33), (5.1e-04, 0.37), (9.1e-05, 0.47), (2.2e-05, 0.66), (6.3e-06, 1.05)),
    "input linear": ((9.2e-03, 0.32), (8.0e-04, 0.37), (1.2e-04, 0.46), (2.5e-05, 0.65), (4.9e-06, 1.05)),
    "input band-limited": ((1.0e-02, 0.33), (2.0e-03, 0.37), (5.1e-04, 0.46), (1.3e-04, 0.65), (3.3e-05, 1.04)),
    "second impact": ((4.6e-03, 0.06), (1.8e-04, 0.10), (1.6e-05, 0.20), (2.4e-06, 0.39), (4.7e-07, 0.77)),
}


def measured(case: Case) -> dict[float, list[tuple[float, float]]]:
    """Return error and time of a motion, ms, for each number of substeps at each tolerance."""
    true, runs = reference(case), 1 if case.given else TOGETHER
    found: dict[float, list[tuple[float, float]]] = {}
    for tolerance in TOLERANCES:
        found[tolerance] = []
        for substeps in SUBSTEPS:
            off = error(case, motion(case, substeps, tolerance), true)
            took = []
            for _ in range(REPEATED):
                began = time.perf_counter()
                motion(case, substeps, tolerance, runs)
                took.append(time.perf_counter() - began)
            found[tolerance].append((off, 1e3 * min(took) / runs))
    return found


def as_good(found: dict[float, list[tuple[float, float]]], wanted: float) -> str:
    """Return the least time, ms, in which the error is no larger than wanted."""
    times = [took for rows in found.values() for off, took in rows if off <= wanted]
    return f"{min(times):.2f}" if times else "-"


def page(found: dict[str, dict[float, list[tuple[float, float]]]]) -> str:
    head = "| kind | | " + " | ".join(f"{n} substep{'s' * (n > 1)}" for n in SUBSTEPS) + " |"
    lines = [
        "# Error and time of the propagator",
        "",
        f"`python -m benchmarks.propagate` on {date.today()}, Python {platform.python_version()}, one core. Each cell: "
        "the largest error of a displacement over the largest displacement, and the time of the motion in ms "
        f"({SAMPLES} samples at {RATE_HZ:g} Hz after a tap; {TOGETHER} free motions in a call, those with an input one "
        "by one, where about 0.3 ms is the call itself). Before: the code of commit fab03ab, measured on the same "
        "machine on the same day; it was busy, so that times hold to about a third. The truth is scipy's DOP853 at a "
        "relative tolerance of 1e-12 with located kinks.",
        "",
        head,
        "|---|---|" + "---|" * len(SUBSTEPS),
    ]
    for name, after in found.items():
        for label, rows in (("before", BEFORE[name]), ("after", after[TOLERANCE])):
            cells = " | ".join(f"{off:.1e}, {took:.2f}" for off, took in rows)
            lines.append(f"| {name if label == 'before' else ''} | {label} | {cells} |")
    lines += [
        "",
        "Least time in ms for an error no larger than the one before in 4 and in 16 substeps, where steps are divided "
        f"at one of the tolerances {', '.join(f'{t:g}' for t in TOLERANCES)} (above: {TOLERANCE:g}):",
        "",
        "| kind | as in 4: before | after | as in 16: before | after |",
        "|---|---|---|---|---|",
    ]
    for name, after in found.items():
        old = BEFORE[name]
        cells = " | ".join(f"{old[i][1]:.2f} | {as_good(after, old[i][0])}" for i in (2, 4))
        lines.append(f"| {name} | {cells} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page({name: measured(case) for name, case in cases().items()}))
