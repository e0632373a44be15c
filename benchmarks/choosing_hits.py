"""Damping from loads with bad hits: as they come, with the best of surplus hits chosen, and with clean hits alone.

    python benchmarks/choosing_hits.py [LOADS] [SEED] [SURPLUS] [SCATTER]

Taps come from Eq. 9 as a state-space model, by the matrix exponential, and from a third mode in which the mass turns;
none of it is the simulated rig's. A tap is bad with a probability of 0.3, in one of five ways of random severity, also
far below what the judge of taps detects: a second impact, off centre, soft, overloaded (an amplifier that compresses
without a flat top), a burst of noise in the ring-down. Rejected taps are made up for, as a session does. In the rows
"30 % of the accepted" bad taps that the judge rejects are made up for by bad ones: 30 % of what is accepted is bad. In
the rows "bad ones known" the first good ones of the same taps are used, as nobody could choose who does not know them:
they differ from clean hits by chance alone. The contact of a tap scatters as on the simulated rig as shipped (0.04 % of
k_c, 2 % of c_c) unless SCATTER is 0.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import lfilter

from analysis.session import analyse_session
from analysis.settings import AnalysisSettings
from calibration.settings import CalibrationSettings
from daq.hits import is_left_out, with_chosen
from daq.quality import judge
from daq.records import Impact, RigDescription, Session
from daq.settings import Quality
from rig.settings import Masses, Springs

RATE, PRETRIGGER, SAMPLES = 25_000.0, 250, 2_500
OVER = 8  # steps of the integration in a sample
M1, M2, K1, K2 = 0.107, 0.108, 4.6e5, 4.7e5
NOISE, PRELOAD_MN, BAD, WANTED = 1e-3, 500.0, 0.3, 8
KINDS = ("second impact", "off centre", "soft", "overloaded", "burst")
Random = np.random.Generator


def system(kc: float, cc: float) -> NDArray[np.float64]:
    k = np.array([[K1 + kc, -kc], [-kc, K2 + kc]]) / np.array([[M1], [M2]])
    c = np.array([[cc, -cc], [-cc, cc]]) / np.array([[M1], [M2]])
    return np.block([[np.zeros((2, 2)), np.eye(2)], [-k, -c]])


def truth(kc: float, cc: float) -> tuple[float, float]:
    poles = np.linalg.eigvals(system(kc, cc))
    pole = max(poles, key=lambda p: p.imag)
    return abs(pole) / 2 / math.pi, -pole.real / abs(pole)


def tap(kc: float, cc: float, random: Random, bad: str) -> NDArray[np.float64]:
    """Return accelerations (2, n) of a tap; ``bad`` is what is wrong with it, nothing where empty."""
    a, dt = system(kc, cc), 1 / RATE / OVER
    step = expm(a * dt)
    begin = (PRETRIGGER + random.uniform(-1, 1)) / RATE
    peak = random.uniform(0.15, 0.3) * PRELOAD_MN * 1e-3 * (random.uniform(0.01, 0.15) if bad == "soft" else 1.0)
    pulses = [(begin, random.uniform(2.5e-4, 4e-4), peak)]
    if bad == "second impact":
        share = 10 ** random.uniform(-2.5, -0.3)
        pulses.append((begin + random.uniform(2e-3, 3e-2), random.uniform(2.5e-4, 4e-4), peak * share))
    t = np.arange(SAMPLES * OVER) * dt
    force = np.zeros(t.size)
    for start, length, size in pulses:
        inside = (t > start) & (t < start + length)
        force[inside] += size * np.sin(math.pi * (t[inside] - start) / length)
    values, vectors = np.linalg.eig(step)
    push = np.linalg.solve(vectors, np.array([0, 0, dt / M1, 0]).astype(complex))
    modes = [lfilter([0, b], [1, -v], force) for v, b in zip(values, push, strict=True)]
    seen = ((a @ vectors)[3] @ np.array(modes)).real[::OVER]
    time = np.arange(SAMPLES) / RATE - begin
    turn = 10 ** random.uniform(-1.5, 0.3) if bad == "off centre" else random.uniform(0, 0.02)
    pole = 2 * math.pi * random.normal(2900, 10) * (1j - random.uniform(0.004, 0.02))
    turning = (
        turn * np.abs(seen).max() * np.where(time > 3e-4, np.exp(pole.real * time) * np.sin(pole.imag * time), 0.0)
    )
    rows = np.array([seen + turning, seen - random.uniform(0.6, 1.0) * turning])
    if bad == "overloaded":
        limit = np.abs(rows).max() * random.uniform(0.6, 1.2)
        rows = limit * np.tanh(rows / limit)
    if bad == "burst":
        at, width = random.uniform(2e-3, 5e-2), random.uniform(1e-3, 2e-2)
        size = np.abs(rows).max() * 10 ** random.uniform(-2.5, -0.5)
        rows += size * np.exp(-(((time - at) / width) ** 2)) * random.normal(size=SAMPLES)
    return rows + NOISE * random.normal(size=rows.shape)


def judged(rows: NDArray[np.float64], number: int) -> Impact:
    verdict = judge(rows, RATE, PRETRIGGER, PRELOAD_MN, PRELOAD_MN, PRELOAD_MN, M2, K2, math.nan, 0, Quality())
    loads = (PRELOAD_MN,) * 3
    return Impact(number, 0, *loads, "", RATE, PRETRIGGER, rows, verdict.accepted, verdict.reason)


def taps(
    contact: tuple[float, float, float], random: Random, wanted: int, bad: float, insist: bool
) -> tuple[list[Impact], dict[int, str]]:
    """Make taps until ``wanted`` are accepted; return them and what is wrong with each."""

    def one(kind: str) -> NDArray[np.float64]:
        kc, cc, scatter = contact
        return tap(
            kc * (1 + 4e-4 * scatter * random.normal()), cc * (1 + 0.02 * scatter * random.normal()), random, kind
        )

    made: list[Impact] = []
    wrong: dict[int, str] = {}
    while sum(i.accepted for i in made) < wanted:
        kind = str(random.choice(KINDS)) if random.random() < bad else ""
        impact = judged(one(kind), len(made))
        while insist and kind and not impact.accepted:
            impact = judged(one(kind), len(made))
        made.append(impact)
        wrong[impact.number] = kind
    return made, wrong


def measured(impacts: list[Impact]) -> tuple[float, float, float, float]:
    """Return f2 (Hz) and the 95 % interval and value of zeta2 of a load, NaN where there is none."""
    rig = RigDescription(m1_kg=M1, m2_kg=M2, k1_n_per_m=K1, k2_n_per_m=K2, sample_rate_hz=RATE, filter_family="none")
    session = Session(created="2026-01-01T00:00:00Z", rig=rig, impacts=tuple(impacts), complete=True, source="made.h5")
    springs, masses = Springs(k1_n_per_m=K1, k2_n_per_m=K2), Masses(m1_kg=M1, m2_kg=M2)
    found = analyse_session(session, AnalysisSettings(), CalibrationSettings(), masses, springs).loads[0]
    if found.zeta2 is None or found.f2_hz is None:
        return (math.nan,) * 4
    return found.f2_hz.value, found.zeta2.value, found.zeta2.low, found.zeta2.high


def main() -> None:
    loads, seed, surplus, scatter = (int(v) for v in (*sys.argv[1:], *("100", "1", "8", "1")[len(sys.argv) - 1 :]))
    errors: dict[str, list[tuple[float, float, float]]] = {}
    kept_bad: dict[str, Counter[str]] = {}
    for number in range(loads):
        random = np.random.default_rng([seed, number])
        kc = 8e6 * random.uniform(0.7, 1.3)
        cc = 2 * random.uniform(0.003, 0.01) * math.sqrt(kc * M1 * M2 / (M1 + M2))
        f2, zeta2 = truth(kc, cc)
        cases = {"clean hits": taps((kc, cc, scatter), random, WANTED, 0.0, False)}
        for name, insist in (("30 % bad", False), ("30 % of the accepted bad", True)):
            made = taps((kc, cc, scatter), random, WANTED + surplus, BAD, insist)
            good = [i for i in made[0] if i.accepted]
            first = {i.number for i in good[:WANTED]}
            cases[f"{name}, as they come"] = [i for i in good if i.number in first], made[1]
            cases[f"{name}, best of {WANTED + surplus}"] = [i for i in with_chosen(good, WANTED) if i.accepted], made[1]
            cases[f"{name}, bad ones known"] = [i for i in good if not made[1][i.number]][:WANTED], made[1]
        for name, (impacts, wrong) in cases.items():
            used = [replace(i, number=k) for k, i in enumerate(i for i in impacts if i.accepted and not is_left_out(i))]
            found = measured(used)
            held = math.nan if math.isnan(found[1]) else float(found[2] <= zeta2 <= found[3])
            errors.setdefault(name, []).append((found[0] / f2 - 1, found[1] / zeta2 - 1, held))
            kinds = kept_bad.setdefault(name, Counter())
            kinds.update(wrong[i.number] for i in impacts if i.accepted and wrong[i.number])
        if (number + 1) % 10 == 0:
            show(errors, kept_bad, number + 1)


def show(errors: dict[str, list[tuple[float, float, float]]], kept: dict[str, Counter[str]], loads: int) -> None:
    rms = {name: np.sqrt(np.nanmean(np.array(e) ** 2, axis=0)) for name, e in errors.items()}
    lost = {name: int(np.isnan(np.array(e)[:, 1]).sum()) for name, e in errors.items()}
    clean = rms["clean hits"]
    print(f"\n{loads} loads of {WANTED} taps used")
    held = {name: float(np.nanmean(np.array(e)[:, 2])) for name, e in errors.items()}
    for name, (f, z, _) in rms.items():
        largest = float(np.nanmax(np.abs(np.array(errors[name])[:, 1])))
        print(
            f"{name:40s} zeta2 {1e2 * z:7.3f} % rms ({z / clean[1]:5.2f} of clean), worst {1e2 * largest:6.2f} %; "
            f"f2 {1e6 * f:7.2f} ppm ({f / clean[0]:5.2f}); "
            f"intervals hold {100 * held[name]:.0f} %; lost {lost[name]}; bad used: {dict(kept[name])}",
            flush=True,
        )


if __name__ == "__main__":
    main()
