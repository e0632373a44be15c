"""Do the intervals of `mesotap analyze` hold on ring-downs that the tester did not record?

Sums of decays in closed form with white noise: 1 to 4 modes, 5 to 60 dB, damping 0.01 to 40 %, 1 to 8 channels, spacing
down to 1 %. Nothing of the generator comes from the identification. Prints the table and writes
docs/benchmarks/recordings.md.

usage: recordings.py [--records N] [--seed N] [--write]
"""

from __future__ import annotations

import argparse
import datetime
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from cramer_rao import bounds
from numpy.typing import NDArray
from scipy import stats
from threadpoolctl import threadpool_limits

from analysis.modal.identify import identify_ring_down
from analysis.modal.modes import ModeEstimate

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

ROOT = Path(__file__).parents[1]
RATE_HZ, SAMPLES = 10_000.0, 4000
DECIBELS = (5.0, 10.0, 20.0, 40.0, 60.0)
FREQUENCIES = (100.0, 3000.0)
DAMPING = (1e-4, 0.4)
CLOSE = (0.01, 0.1)  # spacing of the closest two modes, relative, in half of the records
SEEN = 60.0  # energy of a mode over the variance of the noise, above which a record speaks for it
TOLD_APART = 8.0  # bounds on their difference, by which the poles of two modes have to lie apart
ESTIMATE = 6.0  # standard errors, or 3 %, by which an estimate may be off and still be meant for a mode
ERA_ORDER = 24
NORMAL_95 = float(stats.norm.ppf(0.975))


@dataclass(frozen=True)
class Drawn:
    """A record and what is in it."""

    y: Real
    frequencies: Real
    damping: Real
    seen: tuple[bool, ...]


def draw(rng: np.random.Generator, modes: int, decibel: float) -> Drawn:
    """One record: frequencies and damping ratios log-uniform, shapes normal, a phase a mode."""
    channels = int(rng.integers(1, 9))
    f = np.sort(np.exp(rng.uniform(*np.log(FREQUENCIES), modes)))
    if modes > 1 and rng.random() < 0.5:
        f[1] = f[0] * (1 + np.exp(rng.uniform(*np.log(CLOSE))))
        f.sort()
    zeta = np.exp(rng.uniform(*np.log(DAMPING), modes))
    omega = 2 * np.pi * f
    s = (-zeta * omega + 1j * omega * np.sqrt(1 - zeta**2)) / RATE_HZ
    shapes = rng.standard_normal((channels, modes)) * np.exp(2j * np.pi * rng.uniform(size=modes))
    y = (shapes @ np.exp(np.outer(s, np.arange(SAMPLES)))).real
    sigma = float(np.abs(y).max()) * 10 ** (-decibel / 20)
    return Drawn(
        y + sigma * rng.standard_normal(y.shape), f, zeta, tuple(_speaks(s, shapes / 2, sigma, j) for j in range(modes))
    )


def _speaks(s: Complex, amplitudes: Complex, sigma: float, own: int) -> bool:
    """Whether a record tells a mode from noise and from its neighbours: its energy, and the Cramer-Rao bounds."""
    energy = 2 * (np.abs(amplitudes[:, own]) ** 2).sum() * (np.exp(2 * s[own].real * np.arange(SAMPLES))).sum()
    if energy / sigma**2 < SEEN + 8 * amplitudes.shape[0]:
        return False
    poles = np.exp(s)
    information = np.zeros((2, 2))
    apart = np.inf
    for other in range(s.size):
        if other == own:
            continue
        pair = [own, other]
        information = sum(np.linalg.inv(bounds(poles[pair], a[pair], SAMPLES, sigma).sum(axis=0)) for a in amplitudes)
        gap = s[own] - s[other]
        d = np.array([gap.real, gap.imag])
        apart = min(apart, float(np.sqrt(d @ information @ d)))
    return apart > TOLD_APART


def meant_for(found: list[ModeEstimate], drawn: Drawn) -> dict[int, int]:
    """Which estimate is meant for which mode: nearest first, in units of what it may be off by."""
    pairs = []
    for i, f in enumerate(drawn.frequencies):
        for j, mode in enumerate(found):
            e = mode.frequency_hz
            off = abs(e.value - f) / max(ESTIMATE * e.standard_error, 0.03 * f)
            if off < 1:
                pairs.append((abs(e.value - f), i, j))
    taken: dict[int, int] = {}
    for _, i, j in sorted(pairs):
        if i not in taken and j not in taken.values():
            taken[i] = j
    return taken


def one(method: str, modes: int, decibel: float, seed: list[int]) -> Counter[str]:
    """Counts of one record."""
    threadpool_limits(1)
    drawn = draw(np.random.default_rng(seed), modes, decibel)
    # the stabilisation diagram takes most of the time, and maximum likelihood does not look at it
    answer = identify_ring_down(drawn.y, RATE_HZ, largest_order=0 if method == "ml" else ERA_ORDER, method=method)
    found = list(answer.modes)
    taken = meant_for(found, drawn)
    count: Counter[str] = Counter(
        records=1, modes=modes, false=len(found) - len(taken), era=int(answer.method != method)
    )
    for i, (f, zeta) in enumerate(zip(drawn.frequencies, drawn.damping, strict=True)):
        close = modes > 1 and float(np.abs(np.delete(drawn.frequencies, i) / f - 1).min()) < CLOSE[1]
        heavy = zeta > 0.3
        names = ["all", *(["close"] if close else []), *(["heavy"] if heavy else [])]
        for name in names:
            count[f"{name} modes"] += 1
            count[f"{name} speak"] += drawn.seen[i]
            count[f"{name} missed"] += drawn.seen[i] and i not in taken
            count[f"{name} faint found"] += not drawn.seen[i] and i in taken
        if i not in taken:
            continue
        mode = found[taken[i]]
        for name in names:
            count[f"{name} found"] += 1
            for what, true, e in (("f", f, mode.frequency_hz), ("zeta", zeta, mode.damping_ratio)):
                count[f"{name} {what} inside"] += abs(e.value - true) <= NORMAL_95 * e.standard_error
    return count


def _one(arguments: tuple[str, int, float, list[int]]) -> tuple[str, int, float, Counter[str]]:
    return *arguments[:3], one(*arguments)


def _share(count: Counter[str], of: str, among: str) -> str:
    return f"{100 * count[of] / count[among]:.1f}" if count[among] else "-"


def row(count: Counter[str], name: str) -> list[str]:
    """Cells of one row."""
    return [
        str(count[f"{name} modes"]),
        str(count[f"{name} speak"]),
        str(count[f"{name} missed"]),
        str(count[f"{name} faint found"]),
        str(count["false"]) if name == "all" else "",
        _share(count, f"{name} f inside", f"{name} found"),
        _share(count, f"{name} zeta inside", f"{name} found"),
    ]


HEADING = ["modes in it", "the record speaks for", "of these missed", "of the others found", "false"]
HEADING += ["f inside, %", "zeta inside, %"]


def table(found: list[tuple[str, int, float, Counter[str]]], method: str) -> str:
    """Rows by number of modes and noise, and what they sum to."""
    lines = [["modes", "dB", *HEADING]]
    total: Counter[str] = Counter()
    groups: dict[tuple[int, float], Counter[str]] = {}
    for _, modes, decibel, count in (f for f in found if f[0] == method):
        groups.setdefault((modes, decibel), Counter()).update(count)
        total.update(count)
    lines += [[str(m), f"{d:g}", *row(c, "all")] for (m, d), c in groups.items()]
    lines += [["all", "all", *row(total, "all")], ["closer than 10 %", "all", *row(total, "close")]]
    lines += [["damping over 30 %", "all", *row(total, "heavy")]]
    lines.insert(1, ["---"] * len(lines[0]))
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _per_row(found: list[tuple[str, int, float, Counter[str]]], method: str) -> int:
    return sum(c["records"] for m, *_, c in found if m == method) // (len(DECIBELS) * 4)


def page(found: list[tuple[str, int, float, Counter[str]]], seed: int) -> str:
    """The page docs/benchmarks/recordings.md."""
    return f"""# Intervals on any recording

Written by `benchmarks/recordings.py --write` (part of `make bench`). {datetime.datetime.now(datetime.UTC).date()}, seed
{seed}, {_per_row(found, "ml")} records in each row of {SAMPLES} samples at {RATE_HZ:g} Hz.

Sums of decays in closed form with white noise: frequencies log-uniform in {FREQUENCIES[0]:g} to {FREQUENCIES[1]:g} Hz,
damping in 0.01 to 40 %, 1 to 8 channels, normal shapes; in half of the records of several modes two are 1 to 10 %
apart. "dB" is the largest sample over the standard deviation of the noise. A record speaks for a mode whose energy is
more than {SEEN:g} + 8 c variances of the noise (c channels) and whose pole lies more than {TOLD_APART:g} Cramer-Rao
bounds of the difference from that of any other mode. "False" is an estimate that is no mode's. An interval is counted
for every mode that was found, also where the record hardly speaks for it.

## Maximum likelihood (`mesotap analyze`)

{table(found, "ml")}

## ERA (`mesotap analyze --method era`, and where least squares does not settle)

{_per_row(found, "era")} records in each row.

{table(found, "era")}

Least squares did not settle, and ERA served, in {sum(c["era"] for m, *_, c in found if m == "ml")} of
{sum(c["records"] for m, *_, c in found if m == "ml")} records.
"""


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=int, default=200, help="of each number of modes and noise")
    parser.add_argument("--era", type=int, default=60, help="of each with ERA, which is slow")
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--write", action="store_true", help="write docs/benchmarks/recordings.md")
    chosen = parser.parse_args()
    work = [
        (method, modes, decibel, [chosen.seed, modes, int(decibel), i])
        for method, count in (("ml", chosen.records), ("era", chosen.era))
        for modes in (1, 2, 3, 4)
        for decibel in DECIBELS
        for i in range(count)
    ]
    with ProcessPoolExecutor(chosen.workers) as pool:
        found = list(pool.map(_one, work, chunksize=8))
    text = page(found, chosen.seed)
    print(text)
    if chosen.write:
        (ROOT / "docs" / "benchmarks" / "recordings.md").write_text(text)


if __name__ == "__main__":
    main()
