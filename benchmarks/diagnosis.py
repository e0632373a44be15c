"""Time and memory of a diagnosis: sessions of 6 loads x 8 impacts x 2 channels x 2500 samples, all mechanisms known.

Every session is diagnosed in a process of its own, after one null session that compiles what has to be compiled. The
sessions come from the generator of `mesotap prove`. Writes docs/benchmarks/diagnosis.md. With ``--rigs`` recordings of
described rigs are diagnosed instead (`benchmarks/rigs.py`), and docs/benchmarks/rigs.md is written once all are.
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
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import rigs
from threadpoolctl import threadpool_limits

from analysis.mismatch.diagnosis import diagnose_sessions
from analysis.mismatch.ring_downs.judge import ImpactJudge
from analysis.mismatch.ring_downs.sessions import ring_downs
from daq.session_file import read_session, write_session
from mesotap.configuration.declared import header_uncertainty
from mesotap.configuration.rig_files import tester_rig
from mesotap.proof.generator.concealed import Concealed, conceal, record
from mesotap.proof.generator.plan import PRETRIGGER, Plan, random_plan
from mesotap.proof.generator.scenarios import effect_named
from sim_backend.mechanisms.catalogue import catalogue, variants

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks" / "diagnosis.md"
BY_HAND = "## Sessions of 8 loads x 8 impacts"  # from here on the page is kept
LOADS, IMPACTS, SAMPLES = 6, 48, 2500
CASES = (
    ("", 0.0, ""),
    ("channel_gain", 60.0, ""),
    ("tube_spring_damping", 60.0, ""),
    ("hertz_stiffness", 60.0, ""),
    ("micro_slip", 60.0, ""),
    ("guide_friction", 200.0, ""),
    ("frame_compliance", 60.0, ""),
    ("attached_mass", 60.0, ""),
    ("double_hit", 60.0, ""),
    ("micro_slip", 60.0, "micro_slip"),
    ("quadratic_damping", 200.0, "quadratic_damping"),
    ("adhesion", 60.0, "adhesion"),
)
"""What is hidden, its d, and what is excluded from the list."""


def plan_of(seed: int, effect: str) -> Plan:
    """Return the first plan from this seed on that has the loads and impacts, with recordings of the right length.

    Where the effect is a contact law, k_c grows with load as it does by this law.
    """
    exponent = effect_named(effect).exponent if effect else None
    while True:
        plan = random_plan(np.random.default_rng(seed), exponent=exponent)
        if plan.loads.size == LOADS and plan.group.size == IMPACTS:
            return replace(plan, samples=SAMPLES - PRETRIGGER)
        seed += 1


def write(path: Path, plan: Plan, effect: str, d: float, seed: int) -> None:
    """Write a session with an effect hidden in it."""
    rng = np.random.default_rng(seed)
    concealed = Concealed(plan)
    if effect:
        found = effect_named(effect)
        concealed = conceal(plan, found, found.draw(rng, plan), d)
    write_session(path, record(rng, concealed, seed).session)


def measure(path: Path, without: str) -> dict[str, object]:
    """Diagnose a session in this process."""
    known = [m for m in variants(catalogue()) if m.id != without]
    session = read_session(path)
    rig, uncertainty = tester_rig(), header_uncertainty(session)
    with threadpool_limits(limits=1, user_api="blas"):
        judge = ImpactJudge.of(ring_downs([session], rig, uncertainty), known)
        baseline = judge.baseline()
        begin = time.perf_counter()
        judge.screen(baseline)
        screened = time.perf_counter() - begin
    begin = time.perf_counter()
    answer = diagnose_sessions([session], rig, uncertainty, known).answer
    return {
        "screening_s": screened,
        "whole_s": time.perf_counter() - begin,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "said": ", ".join(m.id for m in answer.mechanisms) or answer.verdict,
    }


def main() -> None:
    """Measure all cases and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--one", nargs=2, metavar=("SESSION", "WITHOUT"), help=argparse.SUPPRESS)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--rigs", nargs="*", type=int, metavar="CASE", help="recordings of described rigs; numbers, or all"
    )
    chosen = parser.parse_args()
    if chosen.rigs is not None:
        rigs.run(chosen.seed, chosen.rigs)
        return
    if chosen.one:
        print(json.dumps(measure(Path(chosen.one[0]), chosen.one[1])))
        return
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for number, (effect, d, without) in enumerate((CASES[0], *CASES)):
            path = Path(folder) / f"{number}.h5"
            plan = plan_of(1000 * chosen.seed, effect)
            write(path, plan, effect, d, chosen.seed + number)
            command = [sys.executable, __file__, "--one", str(path), without]
            row = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            if number:
                print(effect or "nothing", without and "(excluded)", row, flush=True)
                rows.append((effect or "nothing", d, bool(without), row))
    _, mark, rest = PAGE.read_text().partition(BY_HAND)
    PAGE.write_text(page(rows, chosen.seed) + (f"\n{mark}{rest}" if mark else ""))


def page(rows: list[tuple[str, float, bool, dict[str, object]]], seed: int) -> str:
    """Return the page of the results."""
    lines = [
        "# Time and memory of a diagnosis",
        "",
        f"`python benchmarks/diagnosis.py --seed {seed}` on {date.today()}, Python {platform.python_version()}, one "
        "process. Sessions of 6 loads x 8 impacts x 2 channels x 2500 samples; all mechanisms but the excluded one are "
        "known. Goals: 30 s, 1 GB, screening alone 3 s.",
        "",
        "| hidden | d | excluded from the list | screening, s | whole, s | peak memory, MB | answer |",
        "|---|---|---|---|---|---|---|",
    ]
    for effect, d, excluded, row in rows:
        lines.append(
            f"| {effect} | {d:g} | {'yes' if excluded else ''} | {row['screening_s']:.1f} | {row['whole_s']:.0f} | "
            f"{row['peak_mb']:.0f} | {row['said']} |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
