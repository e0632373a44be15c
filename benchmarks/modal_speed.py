"""Time beside the peers on the same data, and growth of time and memory with the length of the record."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from modal_data import IMPACTS, RATE_HZ, SAMPLES, Case, Complex, Real, free_decay_bounds, free_decays, truth
from modal_peers import PEERS, Identify, quiet

from analysis.modal.free_decay import identify_free_decays

CASES = (Case(356.0, 2234.0, 0.0016, 40.0), Case(356.0, 1925.0, 0.02, 40.0), Case(281.0, 733.0, 0.08, 40.0))
COMPARABLE = 3.0  # times the bound: docs/decisions/0005-peers-of-comparable-accuracy.md
LENGTHS = (1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000)


def seconds(call: Callable[[], object], repeats: int) -> float:
    """Median time of a call, warm."""
    call()
    taken = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        taken.append(time.perf_counter() - start)
    return float(np.median(taken))


def nearest(found: Complex, poles: Complex) -> Complex:
    """Of the poles found, the one nearest to each true one."""
    usable = found[np.isfinite(found) & (np.abs(found) > 1e-9)]
    if usable.size == 0:
        return np.full(poles.size, np.nan + 0j)
    logs = np.log(usable)
    return usable[[int(np.argmin(np.abs(logs - np.log(z)))) for z in poles]]


def beside_the_peers(seed: int, quick: bool) -> dict[str, Any]:
    """Time for eight impacts and error over the bound (f1, f2, zeta1, zeta2): mesotap and every peer, every case."""
    rng = np.random.default_rng([seed, 4])
    data = [[free_decays(case, rng) for _ in range(1 if quick else 6)] for case in CASES]
    own: dict[str, Any] = {"ms": [], "rms": []}
    for draws in data:
        own["ms"].append(1e3 * seconds(partial(identify_free_decays, draws[0][0], RATE_HZ), 50 if quick else 400))
        ratios = []
        for y, poles, amplitudes, sigmas in draws:
            found = identify_free_decays(y, RATE_HZ)
            least = free_decay_bounds(poles, amplitudes, sigmas, SAMPLES)
            ratios += [(truth(found.poles[i]) - truth(poles[i])) / least[i] for i in range(IMPACTS)]
        own["rms"].append(np.sqrt(np.mean(np.square(ratios), axis=0)).tolist())
    rows = []
    for name, (package, settings) in PEERS.items():
        for setting, make in settings:
            row: dict[str, Any] = {"peer": name, "package": package, "setting": setting, "ms": [], "rms": []}
            try:
                identify = make()
                for draws in data:
                    taken, rms = _peer(identify, draws)
                    row["ms"].append(1e3 * IMPACTS * taken)
                    row["rms"].append(rms)
            except Exception as reason:  # a peer that fails is listed with what it says
                row["failure"] = f"{type(reason).__name__}: {reason}".splitlines()[0][:160]
            rows.append(row)
    return {
        "draws": len(data[0]),
        "mesotap": own,
        "peers": rows,
        "cases": [[c.f1_hz, c.f2_hz, c.zeta2, c.snr_db] for c in CASES],
    }


def _peer(identify: Identify, draws: list[Any]) -> tuple[float, list[float]]:
    """Median time for one impact, and errors over the bound, on the same impacts for all."""
    taken: list[float] = []
    ratios = []
    quiet(identify, draws[0][0][0].mean(axis=0, keepdims=True), RATE_HZ)
    for y, poles, amplitudes, sigmas in draws:
        least = free_decay_bounds(poles, amplitudes, sigmas, SAMPLES)
        for i in range(IMPACTS):
            record: Real = y[i].mean(axis=0, keepdims=True)
            start = time.perf_counter()
            found = quiet(identify, record, RATE_HZ)
            taken.append(time.perf_counter() - start)
            ratios.append((truth(nearest(found, poles[i])) - truth(poles[i])) / least[i])
    return float(np.median(taken)), np.sqrt(np.mean(np.square(ratios), axis=0)).tolist()


def comparable(
    rows: list[dict[str, Any]], quantities: tuple[int, ...], case: int | None, factor: float = COMPARABLE
) -> dict[str, Any] | None:
    """Return the fastest peer within so many bounds in these quantities: of one case, or with one setting of all.

    Of all cases the sum of the times counts.
    """
    chosen = range(len(CASES)) if case is None else (case,)
    within = [row for row in rows if "failure" not in row and farthest(row, quantities, case) <= factor]
    return min(within, key=lambda row: sum(row["ms"][c] for c in chosen), default=None)


def farthest(row: dict[str, Any], quantities: tuple[int, ...], case: int | None) -> float:
    """Largest error over the bound of a peer in these quantities, in one case or in all."""
    chosen = range(len(CASES)) if case is None else (case,)
    largest = max(row["rms"][c][q] for c in chosen for q in quantities)
    return largest if np.isfinite(largest) else np.inf


def growth(seed: int, quick: bool) -> dict[str, Any]:
    """Time and peak memory of one impact in two channels against its length, and the exponents."""
    rng = np.random.default_rng([seed, 5])
    lengths = LENGTHS[:5] if quick else LENGTHS
    took, peak = [], []
    for n in lengths:
        y = free_decays(CASES[1], rng, n)[0][0]
        took.append(seconds(partial(identify_free_decays, y, RATE_HZ), max(5, min(100, 2_000_000 // n))))
        tracemalloc.start()
        identify_free_decays(y, RATE_HZ)
        peak.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    x = np.log(lengths)
    return {
        "samples": list(lengths),
        "ms": [1e3 * t for t in took],
        "mb": [p / 1e6 for p in peak],
        "time_exponent": float(np.polyfit(x, np.log(took), 1)[0]),
        "memory_exponent": float(np.polyfit(x, np.log(peak), 1)[0]),
        "last_time_exponent": float(np.polyfit(x[-3:], np.log(took[-3:]), 1)[0]),
        "last_memory_exponent": float(np.polyfit(x[-3:], np.log(peak[-3:]), 1)[0]),
    }
