"""How long the catalogue takes: to take in synthetic sessions of eight loads each, and to find some of them.

Prints a table; times are of this machine as it was. usage: catalogue.py [--sessions N] [--seed N]
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

import numpy as np

from mesotap.catalogue.entry import Entry, Found, LoadEntry, MechanismEntry
from mesotap.catalogue.question import asked
from mesotap.catalogue.store import Catalogue, Kept

LOADS = 8
REPEATS = 30
QUESTIONS = (
    "specimen:S017 operator:ann",
    "mechanism:micro_slip since:2025-06-01 until:2025-06-07",
    "load:340..350 kc:9.90..9.91",
    "verdict:unexplained zeta:2.9..",
    '"rough patch"',
    "-specimen:steel -specimen:brass -specimen:glass -specimen:ceramic",
)
MATERIALS, OPERATORS = ("steel", "brass", "glass", "ceramic"), ("Ann", "Bo", "Cem", "Dora")
VERDICTS = ("consistent", "missing_physics", "unexplained")


def synthetic(number: int, noise: np.random.Generator) -> Entry:
    day = np.datetime64("2020-01-01T08:00") + np.timedelta64(int(noise.integers(0, 3_000_000)), "m")
    verdict = VERDICTS[int(noise.choice(3, p=[0.9, 0.099, 0.001]))]
    loads = tuple(_load(i, float(p), noise) for i, p in enumerate(np.linspace(265, 927, LOADS)))
    slip = MechanismEntry("micro_slip", 0.9, "rough patch slips" if noise.random() < 0.01 else "the contact slips")
    return Entry(
        *(f"/lab/{number:06d}", f"{number:06d}", "complete"),
        created=f"{day}:00Z",
        operator=OPERATORS[int(noise.integers(4))],
        specimen=f"{MATERIALS[int(noise.integers(4))]} S{int(noise.integers(500)):03d}",
        sha256=f"{number:064d}",
        verdict=verdict,
        mechanisms=(slip,) if verdict == "missing_physics" else (),
        loads=loads,
    )


def _load(i: int, load_mn: float, noise: np.random.Generator) -> LoadEntry:
    def about(value: float) -> Found:
        drawn = value * (1 + 0.02 * noise.standard_normal())
        return Found(drawn, 0.99 * drawn, 1.01 * drawn)

    estimates = [about(v) for v in (load_mn, 356.0, 2000.0, 1e-4, 0.02, 4e4 * load_mn**0.8, 2.0)]
    return LoadEntry(i, load_mn, 8, *estimates)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=int, default=60_000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    noise = np.random.default_rng(given.seed)
    entries = [Kept("", synthetic(number, noise)) for number in range(given.sessions)]
    with tempfile.TemporaryDirectory() as place, Catalogue(Path(place) / "index.sqlite") as catalogue:
        began = time.perf_counter()
        catalogue.put(entries)
        took = time.perf_counter() - began
        print(f"load of the machine: {os.getloadavg()[0]:.1f}")
        print(f"{given.sessions} sessions of {LOADS} loads in {took:.2f} s, {1e6 * took / given.sessions:.0f} us each")
        print(f"size: {catalogue.path.stat().st_size / 1e6:.0f} MB")
        print("found | found and counted, ms | found and read, ms | question")
        for where in QUESTIONS:
            count, counted = timed(lambda where=where: catalogue.count(asked(where)))
            _, read = timed(lambda where=where: catalogue.find(asked(where)))
            print(f"{count:6d} | {1e3 * counted:7.3f} | {1e3 * read:8.3f} | {where}")


def timed(do) -> tuple[object, float]:
    """Result, and the median of the times."""
    times = []
    result = None
    for _ in range(REPEATS):
        began = time.perf_counter()
        result = do()
        times.append(time.perf_counter() - began)
        if sum(times) > 5:
            break
    return result, float(np.median(times))


if __name__ == "__main__":
    main()
