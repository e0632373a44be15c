"""Which threshold of the selection does any result depend on? Each one is halved and doubled.

    python -m benchmarks.thresholds [--fields NAME ...] [--cases NAME ...] [--kept FOLDER] [--jobs N]

Every practice session and real recording is diagnosed as it is and with every perturbed policy. What came of it is
kept in a file of the folder for each case, from which an interrupted study goes on: all of it takes a night. Prints the
table of docs/decisions/0081.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

from analysis.mismatch.diagnosis import diagnose
from analysis.mismatch.policy import POLICY, SelectionPolicy, thresholds
from analysis.mismatch.problem import ComputeBudget
from analysis.mismatch.recordings.fit import SimulatedRecordings
from analysis.mismatch.recordings.linear_rig import problem_of
from analysis.mismatch.recordings.recorded import prepare
from analysis.mismatch.ring_downs.problem import RingDowns
from analysis.mismatch.ring_downs.sessions import ring_downs
from daq.durable import write_whole
from daq.exchange import import_recording
from daq.session_file import read_session
from mesotap.configuration.declared import header_uncertainty
from mesotap.configuration.rig_files import load_rig, tester_rig
from mesotap.proof.sealed import practice_sessions
from sim_backend.mechanisms.catalogue import catalogue, variants

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("MESOTAP_DATA", ROOT.parent / "shared" / "data"))
RIGS = ROOT / "docs" / "rigs"
RECORDINGS = {
    "silverbox": (DATA / "silverbox" / "SNLS80mV.csv", RIGS / "driven-spring.yaml"),
    "beam": (DATA / "brake-reuss-beam" / "HammerImpact.mat", RIGS / "bolted-beam.yaml"),
}
FACTORS = (0.5, 2.0)
AS_IT_IS = "as it is"


def perturbed(name: str, factor: float) -> SelectionPolicy:
    """Return the policy with one threshold multiplied; whole numbers stay whole, at least one, and do change."""
    value: Any = getattr(POLICY, name)
    changed: Any = factor * value if isinstance(value, float) else None
    if isinstance(value, tuple):
        changed = tuple(factor * v for v in value)
    elif isinstance(value, int):
        near = max(round(value * factor), 1)
        changed = near if near != value else value + (1 if factor > 1 else -1)
    return replace(POLICY, **{name: changed})


def problem_named(case: str) -> RingDowns | SimulatedRecordings:
    """Return the problem of a practice session or of a real recording."""
    if case in RECORDINGS:
        file, description = RECORDINGS[case]
        rig = load_rig(description)
        return problem_of(rig, [prepare(import_recording(file, rig.rate_hz), rig)])
    session = read_session(practice_sessions(DATA / "concealed-practice")[0][case])
    return ring_downs([session], tester_rig(), header_uncertainty(session))


def outcome(problem: RingDowns | SimulatedRecordings, policy: SelectionPolicy) -> dict[str, Any]:
    """Return what a policy makes of a problem: names with probabilities and look-alikes, and what it took."""
    asked, began = replace(problem, policy=policy, budget=ComputeBudget()), time.monotonic()
    answer = diagnose(asked, variants(catalogue())).answer
    return {
        "verdict": answer.verdict,
        "named": {m.id: m.probability for m in answer.mechanisms},
        "alike": [sorted(m.indistinguishable_from) for m in answer.mechanisms],
        "spent": asked.budget.spent,
        "seconds": time.monotonic() - began,
    }


def study(case: str, names: Sequence[str], kept: Path) -> dict[str, Any]:
    """Return the outcomes of a case by threshold and factor; those that its file does not have yet are added to it."""
    path = kept / f"{case}.json"
    known: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    policies = {AS_IT_IS: POLICY, **{f"{n} x {f:g}": perturbed(n, f) for n in names for f in FACTORS}}
    problem = problem_named(case)
    for key, policy in policies.items():
        if key not in known:
            known[key] = outcome(problem, policy)
            write_whole(path, json.dumps(known, indent=1).encode())
    return known


def row(name: str, factor: float, outcomes: Sequence[Mapping[str, Any]]) -> str:
    """Return a line of the table: in how many cases what changes, and by how much."""
    pairs = [(o[AS_IT_IS], o[f"{name} x {factor:g}"]) for o in outcomes]
    named = sum((a["verdict"], list(a["named"])) != (b["verdict"], list(b["named"])) for a, b in pairs)
    alike = sum(list(a["named"]) == list(b["named"]) and a["alike"] != b["alike"] for a, b in pairs)
    shifts = [abs(p - b["named"][k]) for a, b in pairs for k, p in a["named"].items() if k in b["named"]]
    spent = sum(b["spent"] for _, b in pairs) / max(sum(a["spent"] for a, _ in pairs), 1.0) - 1
    value = getattr(POLICY, name)
    shown = ", ".join(f"{v:g}" for v in value) if isinstance(value, tuple) else f"{value:g}"
    return f"| {name} | {shown} | {factor:g} | {named} | {alike} | {max(shifts, default=0):.3f} | {100 * spent:+.1f} |"


def main() -> None:
    """Run the study and print its table."""
    every = [t.name for t in thresholds()]
    sessions = sorted(practice_sessions(DATA / "concealed-practice")[0])
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fields", nargs="+", choices=every, default=every, metavar="NAME")
    parser.add_argument("--cases", nargs="+", default=[*sessions, *RECORDINGS], metavar="NAME")
    parser.add_argument("--kept", type=Path, default=ROOT / "thresholds", help="folder of the outcomes")
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    asked.kept.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(asked.jobs, max_tasks_per_child=1) as pool:
        running = [pool.submit(study, case, asked.fields, asked.kept) for case in asked.cases]
        outcomes = [task.result() for task in running]
    print("| threshold | value | factor | names change | look-alikes change | change of a probability | compute, % |")
    print("|---|---|---|---|---|---|---|")
    for name in asked.fields:
        for factor in FACTORS:
            print(row(name, factor, outcomes))


if __name__ == "__main__":
    main()
