"""What a session runs for the taps of a load, beside other programs that are given the same taps.

Eight whole taps in each case: noise before the trigger, pulse, the declared band-pass, 40 dB. Mesotap gets them as they
are; the peers cannot find where a pulse ends and are told: each gets the record from the first sample after it. Prints
the table and writes docs/benchmarks/session-speed.md.

usage: session_speed.py [--loads N] [--seed N] [--write]
"""

from __future__ import annotations

import argparse
import datetime
import time
from pathlib import Path

import numpy as np
from modal_accuracy import values
from modal_data import IMPACTS, PRETRIGGER, PULSE_S, RATE_HZ, Case, Complex, Real, declared_rig, taps, truth
from modal_peers import PEERS, Identify, quiet
from modal_speed import CASES, nearest
from threadpoolctl import threadpool_limits

from analysis.modal.noise import NoiseModel
from analysis.modal.tester import identify_impacts
from daq.records import RigDescription

ROOT = Path(__file__).parents[1]
REPEATS = 20  # of a load, warm
Load = tuple[list[Real], Real, Real, RigDescription, NoiseModel]


def load(case: Case, rng: np.random.Generator) -> Load:
    """Records of a load, truth, bounds, and what a session knows of rig and noise."""
    records, true, least, sigma, tester = taps(case, rng)
    return records, true, least, declared_rig(tester), NoiseModel(np.ones(1), sigma**2)


def own(loads: list[Load]) -> tuple[float, float, list[float]]:
    """Milliseconds of processor and of wall time for a load, medians, and errors over the bound."""
    processor, wall, ratios = [], [], []
    for records, true, least, rig, noise in loads:
        for repeat in range(REPEATS + 1):
            started = time.process_time(), time.perf_counter()
            found = identify_impacts(records, [PRETRIGGER] * IMPACTS, RATE_HZ, rig, noise)
            if repeat:
                processor.append(time.process_time() - started[0])
                wall.append(time.perf_counter() - started[1])
        ratios += [(values((m.system, m.contact))[0] - true) / b for m, b in zip(found, least, strict=True)]
    return 1e3 * float(np.median(processor)), 1e3 * float(np.median(wall)), _rms(ratios)


def peer(identify: Identify, loads: list[Load]) -> tuple[float, list[float]]:
    """Milliseconds of processor time for eight taps, and errors over the bound."""
    first = PRETRIGGER + int(np.ceil(PULSE_S * RATE_HZ)) + 1
    taken, ratios = [], []
    quiet(identify, loads[0][0][0][None, first:], RATE_HZ)
    for records, true, least, *_ in loads:
        for record, bound in zip(records, least, strict=True):
            started = time.process_time()
            found: Complex = quiet(identify, record[None, first:], RATE_HZ)
            taken.append(time.process_time() - started)
            ratios.append((truth(nearest(found, _poles(true))) - true) / bound)
    return 1e3 * IMPACTS * float(np.median(taken)), _rms(ratios)


def _poles(true: Real) -> Complex:
    """Sampled poles of (f1, f2, zeta1, zeta2)."""
    omega, zeta = 2 * np.pi * true[:2], true[2:]
    return np.exp((-zeta * omega + 1j * omega * np.sqrt(1 - zeta**2)) / RATE_HZ)


def _rms(ratios: list[Real]) -> list[float]:
    return np.sqrt(np.mean(np.square(ratios), axis=0)).tolist()


def _cell(ms: float, rms: list[float]) -> str:
    return f"{ms:.3g} ms; {max(rms):.3g}"


def rows(seed: int, count: int) -> list[list[str]]:
    """Cells of the table: mesotap, and every peer with every setting."""
    loads = [[load(c, np.random.default_rng([seed, i, d])) for d in range(count)] for i, c in enumerate(CASES)]
    mine = [own(one) for one in loads]
    table = [["**mesotap**", "", *(_cell(processor, rms) for processor, _, rms in mine)]]
    table.append(["mesotap, wall time", "", *(f"{wall:.3g} ms" for _, wall, _ in mine)])
    for name, (_, settings) in PEERS.items():
        for setting, make in settings:
            try:
                identify = make()
                cells = [_cell(*peer(identify, one)) for one in loads]
            except Exception as reason:  # a peer that fails is listed with what it says
                cells = [f"{type(reason).__name__}: {reason}".splitlines()[0][:80]] * len(CASES)
            table.append([name, setting, *cells])
            print(" | ".join(table[-1]), flush=True)
    return table


def page(table: list[list[str]], seed: int, count: int) -> str:
    """The page docs/benchmarks/session-speed.md."""
    heading = ["program", "setting", *(f"f2 {c.f2_hz:g} Hz, zeta2 {100 * c.zeta2:g} %" for c in CASES)]
    lines = [heading, ["---"] * len(heading), *table]
    text = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    return f"""# What a session runs, beside other programs

Written by `benchmarks/session_speed.py --write` (part of `make bench`).
{datetime.datetime.now(datetime.UTC).date()}, seed {seed}, {count} loads of eight taps in each case.

Whole taps: noise before the trigger, a half-sine of 0.3 ms, the declared band-pass, 5000 samples, 40 dB. Mesotap's time
is that of `identify_impacts`, which every session and every analysis of one runs: where the pulse ends, the filter's
pole, both modes of each tap with their covariance, and ERA beside them. The peers are told where the pulse ends, give
poles and no uncertainty, and know nothing of the filter. Processor time for eight taps, median, warm, one thread; after
it the largest of the rms errors of f1, f2, zeta1 and zeta2 over the Cramer-Rao bound. Wall time is what it was while
others used the same two cores.

{text}
"""


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--loads", type=int, default=6)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--write", action="store_true", help="write docs/benchmarks/session-speed.md")
    chosen = parser.parse_args()
    threadpool_limits(1)
    text = page(rows(chosen.seed, chosen.loads), chosen.seed, chosen.loads)
    print(text)
    if chosen.write:
        (ROOT / "docs" / "benchmarks" / "session-speed.md").write_text(text)


if __name__ == "__main__":
    main()
