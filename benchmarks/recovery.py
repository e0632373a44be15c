"""Do the stated 95 % intervals hold the true values of 200 seeded simulated loads?

Each load is a session of its own (calibration before and after, eight good taps, fresh masses, springs and gauge
within their declared uncertainty), so that the loads are independent. Prints and writes, for each quantity, how many
of the true values lie inside, and the largest deviation.

usage: recovery.py [--loads N] [--specimen flat|sphere] [--first SEED] [--json OUT.json]
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from analysis.session import analyse_session
from daq.journal import SessionFolder
from mesotap.configuration.config import parse_config
from mesotap.session.bench import simulated_rig, truth_now
from mesotap.session.progress import assemble
from mesotap.session.runner import Bench, SessionRunner, Uninterrupted

FLAT = [264.9, 348.3, 431.6, 524.8, 549.4, 627.8, 784.8, 927.0]
SPHERE = [73.6, 147.2, 220.7, 245.3, 392.4, 490.5, 735.8, 981.0]
SPHERE_CHANGES = [
    "rig.springs.system_resonance_hz=281",
    "rig.limits.load_mn=1200",
    "analysis.contact=paper-sphere",
    f"sim_backend.contact.load_mn={SPHERE}",
    "sim_backend.contact.contact_stiffness_n_per_um=[0.591, 0.680, 0.920, 0.973, 1.232, 1.380, 1.544, 1.768]",
    "sim_backend.contact.damping_ratio=[0.18, 0.14, 0.10, 0.09, 0.06, 0.05, 0.035, 0.03]",
    "mesotap.load_tolerance_mn=5",
]
QUANTITIES = (
    "load_mn",
    "f1_hz",
    "f2_hz",
    "zeta1",
    "zeta2",
    "contact_stiffness_n_per_m",
    "contact_damping_n_s_per_m",
)


class Nobody:
    """Sees, says and asks nothing."""

    def __getattr__(self, name: str):
        return lambda *args, **kwargs: None


def one_load(specimen: str, seed: int) -> dict[str, tuple[bool, float]]:
    """Run and analyse one load; for each quantity whether the truth is inside, and the relative deviation."""
    loads, changes = (FLAT, []) if specimen == "flat" else (SPHERE, SPHERE_CHANGES)
    config = parse_config("", changes=[*changes, f"mesotap.load_plan_mn=[{loads[seed % len(loads)]}]"])
    rig = simulated_rig(config, seed=seed)
    header = {"created": "2026-01-01T00:00:00Z", "config": "", "simulated": True}
    with tempfile.TemporaryDirectory() as folder, SessionFolder.create(Path(folder) / "s", header) as kept:
        bench = Bench(rig, Nobody(), Nobody(), Uninterrupted(), lambda: truth_now(rig))
        progress = SessionRunner(config, kept, bench).run()
        session = assemble(header, config, progress, kept.impacts())
    results = analyse_session(session, config.analysis, config.calibration, config.rig.masses, config.rig.springs)
    truth, load = progress.truths[0], results.loads[0]
    answer = {}
    for name in QUANTITIES:
        estimate, true = getattr(load, name), truth[name]
        answer[name] = (bool(estimate.low <= true <= estimate.high), estimate.value / true - 1)
    return answer


def main() -> None:
    """Run the loads on both cores and print what came out."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--loads", type=int, default=200)
    parser.add_argument("--specimen", choices=("flat", "sphere"), default="flat")
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    seeds = range(chosen.first, chosen.first + chosen.loads)
    found = []
    with ProcessPoolExecutor(2) as pool:
        for done, answer in enumerate(pool.map(one_load, [chosen.specimen] * len(seeds), seeds), start=1):
            found.append(answer)
            if sys.stderr.isatty():
                sys.stderr.write(f"\r{done} of {len(seeds)} loads")
    summary = {
        name: {
            "inside": sum(a[name][0] for a in found),
            "of": len(found),
            "largest_deviation_percent": 100 * float(np.max(np.abs([a[name][1] for a in found]))),
        }
        for name in QUANTITIES
    }
    print(f"\n{chosen.specimen}, seeds {seeds[0]} to {seeds[-1]}")
    for name, row in summary.items():
        share = row["inside"] / row["of"]
        off = row["largest_deviation_percent"]
        print(f"{name:28s} {row['inside']:4d} of {row['of']} inside ({share:6.1%}), at most {off:.4g} % off")
    if chosen.json:
        chosen.json.write_text(json.dumps(summary, indent=1) + "\n")


if __name__ == "__main__":
    main()
