"""Do the intervals of a tap hold where the recording is not as it should be?

Taps in closed form: two modes driven by a half-sine, with white noise; the identification shares no code with it. For
each condition coverage and bias of f2 and zeta2 by a session (`identify_impacts`, eight taps a load), and by
`mesotap analyze` of each tap as a recording of others. Prints the table and writes docs/benchmarks/harsh-taps.md.

usage: harsh_taps.py [--loads N] [--alone N] [--seed N] [--write]
"""

from __future__ import annotations

import argparse
import datetime
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from threadpoolctl import threadpool_limits

from analysis.modal.identify import identify_ring_down
from analysis.modal.modes import ModeEstimate
from analysis.modal.noise import NoiseModel
from analysis.modal.tester import identify_impacts
from daq.records import RigDescription

Real = NDArray[np.float64]

ROOT = Path(__file__).parents[1]
RATE_HZ, SAMPLES, QUIET, IMPACTS = 25_000.0, 5000, 250, 8
F1_HZ, ZETA1 = 281.0, 0.002
MASS_KG = 0.215
NORMAL_95 = float(stats.norm.ppf(0.975))


@dataclass(frozen=True)
class Condition:
    """What is harsh about the taps of a load."""

    name: str
    f2_hz: float
    zeta2: float
    decibel: float = 40.0
    pulse_s: float = 0.3e-3
    trigger_off_s: float = 0.0
    clipped_at: float = 1.0


CONDITIONS = (
    Condition("none", 733.0, 0.08),
    Condition("none, 17 %", 733.0, 0.17),
    Condition("trigger 1 ms late, 17 %", 733.0, 0.17, trigger_off_s=1e-3),
    Condition("trigger 1 ms early, 17 %", 733.0, 0.17, trigger_off_s=-1e-3),
    Condition("pulse of 2 ms", 700.0, 0.03, pulse_s=2e-3),
    Condition("clipped at 60 %", 733.0, 0.03, clipped_at=0.6),
    Condition("5 dB", 733.0, 0.02, decibel=5.0),
    Condition("10 dB, 17 %", 733.0, 0.17, decibel=10.0),
)


def driven(f: float, zeta: float, pulse_s: float, t: Real) -> Real:
    """Acceleration-like response of one mode to a half-sine of unit height that begins at t = 0: closed form."""
    omega = 2 * np.pi * f
    s = -zeta * omega + 1j * omega * np.sqrt(1 - zeta**2)
    w = np.pi / pulse_s
    until = np.clip(t, 0, pulse_s)
    # integral of sin(w u) exp(-s u) from 0 to the end of what has acted
    inner = (w - np.exp(-s * until) * (s * np.sin(w * until) + w * np.cos(w * until))) / (s * s + w * w)
    force = np.where((t > 0) & (t < pulse_s), np.sin(w * until), 0.0)
    return np.where(t > 0, force + (s * s * np.exp(s * np.maximum(t, 0)) * inner).imag / s.imag, 0.0)


def load(condition: Condition, rng: np.random.Generator) -> tuple[list[Real], float]:
    """Taps of one load, and the noise in each."""
    records, sigma = [], 0.0
    for _ in range(IMPACTS):
        t = (np.arange(SAMPLES) - QUIET - rng.uniform()) / RATE_HZ
        y = driven(F1_HZ, ZETA1, condition.pulse_s, t)
        y += rng.uniform(0.8, 1.2) * driven(condition.f2_hz, condition.zeta2, condition.pulse_s, t)
        y /= np.abs(y).max()
        sigma = 10 ** (-condition.decibel / 20)
        y += sigma * rng.standard_normal(SAMPLES)
        highest = condition.clipped_at * np.abs(y).max() if condition.clipped_at < 1 else np.inf
        records.append(np.clip(y, -highest, highest))
    return records, sigma


def by_session(condition: Condition, rng: np.random.Generator) -> list[ModeEstimate | None]:
    """Contact modes of the taps of one load as a session finds them."""
    records, sigma = load(condition, rng)
    k = MASS_KG / 2 * (2 * np.pi * F1_HZ) ** 2
    rig = RigDescription(0.107, 0.108, k, k, RATE_HZ, np.nan, 1, 10000.0, 4, "none", 50.0, 16)
    said = QUIET + round(condition.trigger_off_s * RATE_HZ)
    found = identify_impacts(records, [said] * IMPACTS, RATE_HZ, rig, NoiseModel(np.ones(1), sigma**2))
    return [m.contact for m in found]


def by_itself(condition: Condition, rng: np.random.Generator) -> list[ModeEstimate | None]:
    """Contact mode of one tap as a recording of others: of the modes above the system mode the one nearest to f2."""
    records, _ = load(condition, rng)
    found = identify_ring_down(records[0][None], RATE_HZ, largest_order=0)
    above = [m for m in found.modes if m.frequency_hz.value > 1.15 * F1_HZ]
    return [min(above, key=lambda m: abs(m.frequency_hz.value - condition.f2_hz), default=None)]


def row(condition: Condition, way: str, found: list[ModeEstimate | None]) -> list[str]:
    """Cells of one row."""
    given = [m for m in found if m is not None]
    cells = [condition.name, way, str(len(found)), str(len(found) - len(given))]
    if not given:
        return [*cells, "-", "-", "-", "-", "-"]
    for true, estimates in (
        (condition.f2_hz, [m.frequency_hz for m in given]),
        (condition.zeta2, [m.damping_ratio for m in given]),
    ):
        error = np.array([e.value - true for e in estimates])
        stated = np.array([e.standard_error for e in estimates])
        cells += [f"{100 * np.mean(np.abs(error) <= NORMAL_95 * stated):.1f}", f"{100 * np.median(error) / true:+.2g}"]
    return [*cells, str(sum(m.damping_ratio.value < 0 for m in given))]


HEADING = ["condition", "by", "taps", "refused", "f2 inside, %", "median error of f2, %"]
HEADING += ["zeta2 inside, %", "median error of zeta2, %", "negative damping"]


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--loads", type=int, default=25, help="of eight taps in each condition, by a session")
    parser.add_argument("--alone", type=int, default=200, help="taps in each condition, each by itself")
    parser.add_argument("--seed", type=int, default=2027)
    parser.add_argument("--write", action="store_true", help="write docs/benchmarks/harsh-taps.md")
    chosen = parser.parse_args()
    threadpool_limits(1)
    lines = [HEADING, ["---"] * len(HEADING)]
    for i, condition in enumerate(CONDITIONS):
        for j, (way, count, call) in enumerate(
            (("session", chosen.loads, by_session), ("analyze", chosen.alone, by_itself))
        ):
            found = [m for d in range(count) for m in call(condition, np.random.default_rng([chosen.seed, i, j, d]))]
            if found:
                lines.append(row(condition, way, found))
                print(" | ".join(lines[-1]), flush=True)
    rows = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    text = f"""# Harsh taps

Written by `benchmarks/harsh_taps.py --write` (part of `make bench`). {datetime.datetime.now(datetime.UTC).date()}, seed
{chosen.seed}. Two modes ({F1_HZ:g} Hz at {100 * ZETA1:g} %, and f2 with zeta2) driven by a half-sine of 0.3 ms unless
said, in closed form, 40 dB unless said; {SAMPLES} samples at {RATE_HZ:g} Hz, {QUIET} of them before the tap. "session"
is `identify_impacts`, eight taps a load, told the noise; "analyze" is `mesotap analyze` of one tap as a recording of
others, told nothing. "Refused" are taps without a contact mode.

{rows}
"""
    if chosen.write:
        (ROOT / "docs" / "benchmarks" / "harsh-taps.md").write_text(text)


if __name__ == "__main__":
    main()
