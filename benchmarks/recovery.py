"""Do the stated 95 % intervals hold the true values of 200 seeded simulated loads?

Each load is a session of its own (calibration before and after, eight good taps, fresh masses, springs and gauge
within their declared uncertainty), so that the loads are independent. What the simulated rig has no part for is drawn
here: a recorder whose clock runs wrong within its limits is the same recording of a rig whose truth is that much
faster, and weights in another gravity than the declared place's mean make the true load that much larger. Prints and
writes, for each quantity, how many of the true values lie inside, the median half-width of the interval, and the rms
deviation.

usage: recovery.py [--loads N] [--specimen flat|sphere] [--condition NAME] [--first SEED] [--processes N] [--json OUT]
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
PAPER_SCATTER = [
    "sim_backend.contact.stiffness_scatter_percent=2.6",
    "sim_backend.contact.damping_scatter_percent=11.1",
]
NOISE = ["sim_backend.noise.rms_m_s2=0.01", "daq.trigger.threshold_m_s2=0.1"]
CONDITIONS = {
    "default": [],
    "scatter": PAPER_SCATTER,
    "noise": NOISE,
    "scatter-noise": [*PAPER_SCATTER, *NOISE],
    "single-tap": [*PAPER_SCATTER, "mesotap.impacts_per_load=1"],
    "tubes": ["rig.springs={system_resonance_hz: 356.0, tube: {}}"],  # of the paper, their inertia declared to 5 %
}
PLACE = ["calibration.latitude_deg=52.3"]
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


def world(config, seed: int) -> dict[str, float]:
    """By what the true values of a rig are larger than those simulated, as the clock and the weights' place have it."""
    rng = np.random.default_rng([seed, 77])
    clock = 1 + 1e-6 * config.rig.wiring.clock_accuracy_ppm * rng.uniform(-1, 1)
    gravity = config.calibration.gravity
    force = 1 + gravity.standard_uncertainty / gravity.value * rng.standard_normal() + 1.5e-4 * rng.uniform(-1, 1)
    return {
        "load_mn": force,
        "f1_hz": clock,
        "f2_hz": clock,
        "contact_stiffness_n_per_m": clock**2,
        "contact_damping_n_s_per_m": clock,
    }


def one_load(specimen: str, condition: str, seed: int) -> dict[str, tuple[bool, float, float]]:
    """Run and analyse one load; for each quantity whether the truth is inside, relative deviation and half-width."""
    loads, changes = (FLAT, []) if specimen == "flat" else (SPHERE, SPHERE_CHANGES)
    changes = [*changes, *PLACE, *CONDITIONS[condition]]
    config = parse_config("", changes=[*changes, f"mesotap.load_plan_mn=[{loads[seed % len(loads)]}]"])
    rig = simulated_rig(config, seed=seed)
    header = {"created": "2026-01-01T00:00:00Z", "config": "", "simulated": True}
    with tempfile.TemporaryDirectory() as folder, SessionFolder.create(Path(folder) / "s", header) as kept:
        bench = Bench(rig, Nobody(), Nobody(), Uninterrupted(), lambda: truth_now(rig))
        progress = SessionRunner(config, kept, bench).run()
        session = assemble(header, config, progress, kept.impacts())
    results = analyse_session(
        session,
        config.analysis,
        config.calibration,
        config.rig.masses,
        config.rig.springs,
        wiring=config.rig.wiring,
    )
    truth, load = progress.truths[0], results.loads[0]
    larger = world(config, seed)
    answer = {}
    for name in QUANTITIES:
        estimate, true = getattr(load, name), truth[name] * larger.get(name, 1.0)
        if estimate is not None:
            inside = bool(estimate.low <= true <= estimate.high)
            answer[name] = (inside, estimate.value / true - 1, estimate.half_width / abs(true))
    return answer


def main() -> None:
    """Run the loads on both cores and print what came out."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--loads", type=int, default=200)
    parser.add_argument("--specimen", choices=("flat", "sphere"), default="flat")
    parser.add_argument("--condition", choices=CONDITIONS, default="default")
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    seeds = range(chosen.first, chosen.first + chosen.loads)
    found = []
    fixed = [chosen.specimen] * len(seeds), [chosen.condition] * len(seeds)
    with ProcessPoolExecutor(chosen.processes) as pool:
        for done, answer in enumerate(pool.map(one_load, *fixed, seeds), start=1):
            found.append(answer)
            if sys.stderr.isatty():
                sys.stderr.write(f"\r{done} of {len(seeds)} loads")
    summary = {}
    for name in QUANTITIES:
        rows = [a[name] for a in found if name in a]
        deviation, width = (np.array([row[i] for row in rows]) for i in (1, 2))
        summary[name] = {
            "inside": sum(row[0] for row in rows),
            "of": len(rows),
            "median_half_width_percent": 100 * float(np.median(width)),
            "rms_deviation_percent": 100 * float(np.sqrt(np.mean(deviation**2))),
            "largest_deviation_percent": 100 * float(np.max(np.abs(deviation))),
        }
    print(f"\n{chosen.specimen}, {chosen.condition}, seeds {seeds[0]} to {seeds[-1]}")
    for name, row in summary.items():
        print(
            f"{name:28s} {row['inside']:4d} of {row['of']} inside ({row['inside'] / row['of']:6.1%}), half-width "
            f"{row['median_half_width_percent']:.2g} %, rms {row['rms_deviation_percent']:.2g} %, at most "
            f"{row['largest_deviation_percent']:.2g} % off"
        )
    if chosen.json:
        chosen.json.write_text(json.dumps(summary, indent=1) + "\n")


if __name__ == "__main__":
    main()
