"""Recordings of described rigs of one, two and four bodies, for the time that a diagnosis of them takes.

Rigs and recordings come from the generator of `mesotap prove --rigs`, which shares nothing with the program's own
integrator. A rig is a chain to the ground; each of its bodies is seen by a displacement sensor.
"""

from __future__ import annotations

import argparse
import json
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from analysis.mismatch.diagnosis import diagnose_recordings
from daq.exchange import import_recording
from mesotap.configuration.rig_files import load_rig
from mesotap.proof.rigs.cases import write
from mesotap.proof.rigs.description import GROUND, Constant, Element, Input, Rig, Sensor, known
from mesotap.proof.rigs.drives import lines, nothing
from mesotap.proof.rigs.laws import CUBIC
from mesotap.proof.rigs.noise import Noise
from mesotap.proof.rigs.plant import Law
from mesotap.proof.rigs.trial import Altered, Record, Trial, recorded
from sim_backend.mechanisms.catalogue import catalogue, variants

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks" / "rigs.md"
SAMPLES = 20_000
RATE_HZ = 2000.0
HIGHEST_HZ = 150.0
DAMPING_RATIO = 0.003
NOISE = 3e-3  # of a channel's rms
STIFFENED = 0.03  # of a spring's force at its largest deformation, by what is hidden


@dataclass(frozen=True, slots=True)
class Case:
    """A rig of so many bodies, recordings of it, and whether its first spring is cubic."""

    bodies: int
    files: int
    forced: bool
    hidden: bool

    @property
    def words(self) -> str:
        """What it is."""
        how = "forced" if self.forced else "free"
        return f"{self.bodies} {'body' if self.bodies == 1 else 'bodies'}, {how}, {self.files} x {SAMPLES}"


CASES = (
    *(Case(n, 1, forced, hidden) for n in (1, 2, 4) for forced in (True, False) for hidden in (False, True)),
    *(Case(2, 2, True, hidden) for hidden in (False, True)),
    *(Case(2, 3, False, hidden) for hidden in (False, True)),
)


def limit_s(case: Case) -> float:
    """Return how long it may take on two cores, s."""
    return 120.0 if case.files > 1 else 15.0 if case.bodies == 1 else 60.0


def trial_of(case: Case, seed: int) -> Trial:
    """Return the rig and what sets it going."""
    rng = np.random.default_rng([seed, case.bodies, case.files, case.forced])
    masses = rng.uniform(0.8, 1.2, case.bodies)
    stiffness = rng.uniform(0.8, 1.2, case.bodies) * (2 * np.pi * HIGHEST_HZ) ** 2 / 4
    elements = []
    for i, k in enumerate(stiffness):
        c = 2 * DAMPING_RATIO * k / (2 * np.pi * HIGHEST_HZ)
        elements.append(Element(f"spring {i + 1}", "joint", i, i - 1 if i else GROUND, Constant(k), Constant(c)))
    gains = (known(1.0), Constant(0.0, 0.0))
    sensors = tuple(
        Sensor(f"x{i + 1}", tuple(float(i == j) for j in range(case.bodies)), 0, *gains) for i in range(case.bodies)
    )
    drive = Input("force", case.bodies - 1, *gains, "band-limited") if case.forced else None
    rig = Rig("chain", tuple(map(known, masses.tolist())), tuple(elements), sensors, drive, RATE_HZ)
    records = []
    for _ in range(case.files):
        start = np.zeros(2 * case.bodies)
        if case.forced:
            given = lines("random", SAMPLES, (5 / RATE_HZ, 1.2 * HIGHEST_HZ / RATE_HZ), "band-limited", rng)
        else:
            start[case.bodies :] = rng.uniform(0.5, 1.0, case.bodies)
            given = nothing(SAMPLES)
        records.append(Record(start, given, 1.0))
    return Trial(rig, tuple(records))


def write_case(folder: Path, case: Case, seed: int) -> None:
    """Write recordings and the description of the rig."""
    trial = trial_of(case, seed)
    rig = trial.rig
    plant = rig.plant(rig.true_values())
    linear = recorded(trial, Altered(plant))
    reach = max(float(np.abs(x[:, 0]).max()) for x in linear)
    spring = rig.elements[0].stiffness
    if case.hidden and spring is not None:
        law = Law(CUBIC, rig.shape(rig.elements[0]), (STIFFENED * spring.true / reach**2,))
        linear = recorded(trial, Altered(replace(plant, laws=(law,))))
    noise = tuple(Noise(NOISE * float(np.std(x)), 0.0, 0.0, 0.0) for x in linear[0].T)
    write(folder, Trial(rig, trial.records, noise), linear, np.random.default_rng([seed, 7]))


def measure(folder: Path) -> dict[str, object]:
    """Diagnose the recordings of a folder in this process."""
    rig = load_rig(folder / "rig.yaml")
    recordings = [import_recording(f, rig.rate_hz) for f in sorted(folder.glob("*.csv"))]
    begin, used = time.perf_counter(), time.process_time()
    with threadpool_limits(limits=1, user_api="blas"):
        answer = diagnose_recordings(recordings, rig, variants(catalogue())).answer
    return {
        "whole_s": time.perf_counter() - begin,
        "cpu_s": time.process_time() - used,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "said": ", ".join(m.id for m in answer.mechanisms) or answer.verdict,
        "p_value": answer.p_value,
    }


def run(seed: int, numbers: Sequence[int]) -> None:
    """Diagnose cases in processes of their own, after one that compiles; write the page if they are all there are."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for number in numbers or range(len(CASES)):
            case = CASES[number]
            place = Path(folder) / f"case-{number}"
            write_case(place, case, seed)
            command = [sys.executable, __file__, str(place)]
            row = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            print(number, case.words, "cubic spring" if case.hidden else "nothing", row, flush=True)
            rows.append((case, row))
    if len(rows) == len(CASES):
        PAGE.write_text(page(rows, seed), encoding="utf-8")


def page(rows: Sequence[tuple[Case, dict[str, object]]], seed: int) -> str:
    """Return the page of the results."""
    lines = [
        "# Time of a diagnosis of described rigs",
        "",
        f"`python benchmarks/diagnosis.py --rigs --seed {seed}` on {date.today()}, Python {platform.python_version()}, "
        "one process on two cores, all mechanisms known. Chains on the ground, every body seen, 0.3 % noise; "
        f"hidden is a cubic part of {100 * STIFFENED:g} % of the first spring's force.",
        "",
        "| rig and recordings | hidden | whole, s | limit, s | processor, s | peak memory, MB | answer |",
        "|---|---|---|---|---|---|---|",
    ]
    for case, row in rows:
        hidden = "cubic spring" if case.hidden else "nothing"
        lines.append(
            f"| {case.words} | {hidden} | {row['whole_s']:.0f} | {limit_s(case):g} | {row['cpu_s']:.0f} | "
            f"{row['peak_mb']:.0f} | {row['said']} |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Diagnose one folder and print times.")
    parser.add_argument("folder", type=Path)
    print(json.dumps(measure(parser.parse_args().folder)))
