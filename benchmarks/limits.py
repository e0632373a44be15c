"""How often upper limits hold: sessions with one weak effect or none, the linear rig fitted and screened, no selection.

The sessions come from the generator of `mesotap prove`: each of its listed effects at d = 3 and at d = 10, and a null
after every fourth. For each mechanism it prints how often its limit holds its true strength, with the binomial 95 %
interval, and the median of limit over true strength; and in how many of all sessions it has a limit.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from functools import partial
from itertools import count
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from analysis.mismatch.limits import upper_limits
from analysis.mismatch.ring_downs.judge import ImpactJudge
from analysis.mismatch.ring_downs.sessions import ring_downs
from analysis.session import AnalysisError
from daq.session_file import read_session
from mesotap.configuration.declared import header_uncertainty
from mesotap.configuration.rig_files import tester_rig
from mesotap.proof.generator.effects import LISTED
from mesotap.proof.generator.scenarios import NULLS, Scenario, make
from mesotap.proof.parameters import true_parameters
from mesotap.proof.scores import Count
from sim_backend.mechanisms.catalogue import catalogue, variants
from sim_backend.mechanisms.rocking import SHARE_OF_MASS

WEAK = (3.0, 10.0)  # d of the effects
A_NULL_AFTER = 4  # effects


def scenarios(sessions: int) -> list[Scenario]:
    """Return the sessions: all effects at the first d, then at the other, and again."""
    found: list[Scenario] = []
    for turn in count():
        for i, effect in enumerate(LISTED):
            found.append(Scenario(len(found), "single", (effect,), (WEAK[turn % len(WEAK)],)))
            if i % A_NULL_AFTER == A_NULL_AFTER - 1:
                found.append(Scenario(len(found), "null", variety=NULLS[1 - len(found) % 2]))
            if len(found) >= sessions:
                return found[:sessions]
    raise AssertionError


def limits_of(path: Path) -> dict[str, tuple[str, float]]:
    """Return parameter and limit of each mechanism about the linear rig."""
    session = read_session(path)
    with threadpool_limits(limits=1, user_api="blas"), np.errstate(all="ignore"):
        judge = ImpactJudge.of(ring_downs([session], tester_rig(), header_uncertainty(session)), variants(catalogue()))
        scores = judge.screen(judge.baseline()).scores
    return {u.id: (u.parameter, u.value) for u in upper_limits(scores)}


def true_strength(truth: Mapping[str, Any], parameter: str) -> float | None:
    """Return the strength of what is hidden; an offset with the inertia that `rocking` takes for granted."""
    effect, (name,) = truth["effect"], truth["kinds"]
    if name == "rocking":
        inertia = effect["rocking_inertia_kg_m2"] / effect["accelerometer_arm_m"] ** 2
        share = effect["contact_offset_m"] / effect["accelerometer_arm_m"]
        return float(share * SHARE_OF_MASS * truth["masses_kg"][1] / inertia)
    return true_parameters(truth, name).get(parameter)


def tried(seed: int, scenario: Scenario) -> tuple[dict[str, Any], dict[str, tuple[str, float]]] | None:
    """Make a session, and return its truth and limits; None where the session cannot carry a diagnosis."""
    with tempfile.TemporaryDirectory() as folder, suppress(AnalysisError):
        truth = make(seed, scenario, Path(folder))
        return truth, limits_of(Path(folder) / f"{scenario.name}.h5")
    return None


def main() -> None:
    """Try all sessions and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=20261122)
    parser.add_argument("--sessions", type=int, default=150)
    parser.add_argument("--jobs", type=int, default=2)
    chosen = parser.parse_args()
    with ProcessPoolExecutor(chosen.jobs) as pool:
        found = [f for f in pool.map(partial(tried, chosen.seed), scenarios(chosen.sessions)) if f is not None]
    ratios: dict[str, list[float]] = {}
    for truth, limits in found:
        for name in truth["kinds"]:
            if name in limits and (true := true_strength(truth, limits[name][0])) is not None:
                ratios.setdefault(name, []).append(limits[name][1] / abs(true))
    print(f"seed {chosen.seed}, {len(found)} sessions, {sum(not t['kinds'] for t, _ in found)} of them nulls")
    for name in sorted({m.id for m in variants(catalogue())}):
        has = sum(name in limits for _, limits in found)
        held = Count(sum(r >= 1 for r in ratios.get(name, ())), len(ratios.get(name, ())))
        middle = f"{median(ratios[name]):8.2g}" if name in ratios else 8 * " "
        print(f"{name:26}{has:5d} {_said(held)} {middle}")
    every = [r for one in ratios.values() for r in one]
    print(f"{'all':32}{_said(Count(sum(r >= 1 for r in every), len(every)))}")


def _said(held: Count) -> str:
    low, high = held.interval
    return f"{held.hits:4d} of {held.of:4d}" + (f"  {low:.2f} to {high:.2f}" if held.of else 14 * " ")


if __name__ == "__main__":
    main()
