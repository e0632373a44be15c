"""What a diagnosis says of sessions of the simulated rig as shipped, whose taps may go wrong: how often is it wrong?

``--hidden nothing``: every name and every `unexplained` is a false alarm. ``--hidden friction``: dry friction between
0.3 and 5 mN, even in its logarithm, at 2 loads with 4 taps and records of 2000 samples; how often does its interval
contain it? The mechanisms looked for are then friction and damping of the tube springs, unless ``--all-mechanisms``.
Prints a line for each session, whose seed is that of `mesotap run --simulate --seed`, and the counts.

usage: as_shipped.py [--hidden nothing|friction] [--first SEED] [--sessions N] [--plan 3x5|8x8] [--all-mechanisms]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.mismatch.answer import Answer
from analysis.mismatch.diagnosis import diagnose_sessions
from daq.journal import SessionFolder
from daq.records import Session
from mesotap import __version__
from mesotap.configuration.config import effective_text, parse_config
from mesotap.configuration.declared import header_uncertainty
from mesotap.configuration.rig_files import tester_rig
from mesotap.session.bench import simulated_rig, truth_now
from mesotap.session.header import FOLDER_FORMAT, FOLDER_VERSION
from mesotap.session.progress import assemble
from mesotap.session.runner import Bench, SessionRunner, Uninterrupted
from rig import Operator
from sim_backend.mechanisms.catalogue import catalogue, variants

PLANS = {
    "3x5": ("mesotap.load_plan_mn=[250, 500, 800]", "mesotap.impacts_per_load=5"),
    "8x8": ("mesotap.load_plan_mn=[100, 200, 300, 400, 500, 600, 750, 900]", "mesotap.impacts_per_load=8"),
    "2x4": ("mesotap.load_plan_mn=[300, 700]", "mesotap.impacts_per_load=4", "daq.trigger.record_samples=2000"),
}
FRICTION_N = (0.3e-3, 5e-3)
PULSE_S, EARLY_S, GUARD = 0.5e-3, 4e-3, 5  # until a pulse is over, what is looked at after it, samples before a tap
TURNED = 2.0  # power of A - B after a tap over that before, from which on the mass turned (noise: 1 +- 0.14)
FEW = ("guide_friction", "tube_spring_damping")


class _Nobody(Operator):
    """An operator to whom everything may be said."""

    def say(self, text: str) -> None:
        """Say nothing."""

    def wait_ready(self, text: str) -> None:
        """Go on at once."""

    def turn(self, text: str, step_um: float, live: object) -> None:
        """Turn nothing: a motor does."""


class _Unseen:
    """An observer who looks at nothing."""

    def progress(self, state: object, text: str) -> None:
        """Show nothing."""

    def impact(self, impact: object, accepted: int, wanted: int) -> None:
        """Show nothing."""


@dataclass(frozen=True, slots=True)
class Made:
    """A session, and the friction that is hidden in it, N."""

    session: Session
    friction_n: float = 0.0

    @property
    def turned(self) -> list[str]:
        """Names of accepted impacts after which A and B differ by more than before: the mass turned."""
        found = []
        for s in (s for s in self.session.impacts if s.accepted):
            difference = (s.acceleration[0] - s.acceleration[1]) ** 2
            early = s.pretrigger + round(PULSE_S * s.sample_rate_hz) + np.arange(round(EARLY_S * s.sample_rate_hz))
            if difference[early].mean() > TURNED * difference[: s.pretrigger - GUARD].mean():
                found.append(s.name)
        return found


def make(seed: int, plan: str, friction_n: float = 0.0) -> Made:
    """Record a session as `mesotap run --simulate` does, without its report."""
    hidden = f"sim_backend.mechanisms=[{{id: guide_friction, parameters: {{friction_force_n: {friction_n!r}}}}}]"
    config = parse_config("", changes=[*PLANS[plan], *([hidden] if friction_n else [])])
    rig = simulated_rig(config, seed=seed)
    header = {
        "format": FOLDER_FORMAT, "format_version": FOLDER_VERSION, "created": "2026-01-01T00:00:00.000Z",
        "config": effective_text(config), "simulated": True, "seed": seed, "realtime": False,
        "software": f"mesotap {__version__}",
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as base, SessionFolder.create(Path(base) / "s", header) as folder:
        bench = Bench(rig, _Nobody(), _Unseen(), Uninterrupted(), lambda: truth_now(rig))
        runner = SessionRunner(config, folder, bench)
        runner.run()
        return Made(assemble(header, config, runner.progress, folder.impacts()), friction_n)


def diagnosed(made: Made, only: tuple[str, ...]) -> Answer:
    """Return the answer; with names, only these are looked for."""
    known = [m for m in variants(catalogue()) if not only or m.id in only]
    return diagnose_sessions([made.session], tester_rig(), header_uncertainty(made.session), known).answer


def said(made: Made, answer: Answer) -> str:
    """Return in a word what an answer is worth."""
    same = sorted(a.name for a in answer.set_aside) == made.turned
    aside = "" if same and not answer.set_aside else f", set aside {'as turned' if same else 'otherwise'}"
    names = " and ".join(m.id for m in answer.mechanisms) or answer.verdict
    found = {m.id: m.parameters for m in answer.mechanisms}.get("guide_friction")
    if not made.friction_n or found is None:
        return names + aside
    interval = found["friction_force_n"]
    where = "inside" if interval.low <= made.friction_n <= interval.high else "outside"
    left = "something left" if answer.remainder.where else "nothing left"
    return f"{names}, {where}, {left}{aside}"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hidden", choices=("nothing", "friction"), default="nothing")
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--sessions", type=int, default=40)
    parser.add_argument("--plan", choices=("3x5", "8x8"), default="3x5")
    parser.add_argument(
        "--all-mechanisms", action="store_true", help="look for all mechanisms where friction is hidden"
    )
    chosen = parser.parse_args()
    friction, counted = chosen.hidden == "friction", Counter[str]()
    for seed in range(chosen.first, chosen.first + chosen.sessions):
        drawn = np.random.default_rng(seed).uniform(*np.log(FRICTION_N))
        made = make(seed, "2x4" if friction else chosen.plan, float(np.exp(drawn)) if friction else 0.0)
        begun = time.process_time()
        answer = diagnosed(made, FEW if friction and not chosen.all_mechanisms else ())
        worth = said(made, answer)
        counted[worth] += 1
        print(seed, made.friction_n or "", *made.turned, worth, f"{time.process_time() - begun:.0f} s", flush=True)
    print(dict(counted))


if __name__ == "__main__":
    main()
