"""How well the linear rig begins: what it misses before anything is fitted, and what should be left free."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from analysis.mismatch.least_squares import covariance
from analysis.mismatch.recordings.fit import SimulatedRecordings, problem_of
from analysis.mismatch.recordings.model import Point, SimulationModel, residual
from analysis.mismatch.recordings.recorded import FIT, Recorded, level
from analysis.mismatch.recordings.simulation import Simulation
from analysis.mismatch.rig_description import DescribedRig
from analysis.session import AnalysisError

POOR: Final = 0.7  # of a channel's rms: a linear rig that misses more has hardly begun
MUCH_BETTER: Final = 0.7  # factor in what is missed from which on a constant is said to be better left free
NOISE: Final = 0.01  # of a channel's rms, for which standard errors are stated
WEAK: Final = 0.1  # relative standard error from which on a constant counts as hardly held


@dataclass(frozen=True, slots=True)
class StartCheck:
    """What is known before a fit.

    Attributes
    ----------
    missed
        Of each channel, by name: rms of what the linear rig misses of it, over the channel's rms.
    weak
        Constants and the relative standard errors they would have with noise of `NOISE`, where these are large.
    freed
        Constants that are declared, and what would be missed (of all channels) if one of them were unknown.
    """

    missed: dict[str, float]
    weak: dict[str, float]
    freed: dict[str, float]

    @property
    def poor(self) -> bool:
        """Whether the linear rig has hardly begun."""
        return max(self.missed.values()) > POOR


def start_check(rig: DescribedRig, recordings: Sequence[Recorded]) -> StartCheck:
    """Return how well the rig with constants from the recordings' spectra describes them.

    Raises
    ------
    AnalysisError
        The rig as described cannot have made them.
    """
    problem = problem_of(rig, recordings)
    by_channel = _missed(problem)
    missed = {str(s.channel): m for s, m in zip(rig.seen, by_channel, strict=True)}
    freed = better_unknown(problem) if max(by_channel) > POOR else {}
    return StartCheck(missed, _weak(problem), freed)


def better_unknown(problem: SimulatedRecordings) -> dict[str, float]:
    """Return declared constants without whose values the linear rig begins much better, the best first.

    For each, the rms that it then misses of the channels, over their rms.
    """
    before, freed = float(np.linalg.norm(_missed(problem))), {}
    for name in _declared(problem.rig):
        try:
            after = float(np.linalg.norm(_missed(problem_of(with_unknown(problem.rig, name), problem.recordings))))
        except (AnalysisError, ArithmeticError, np.linalg.LinAlgError):
            continue
        if after < MUCH_BETTER * before:
            freed[name] = after / math.sqrt(len(problem.rig.seen))
    return dict(sorted(freed.items(), key=lambda item: item[1]))


def _missed(problem: SimulatedRecordings) -> list[float]:
    simulation = Simulation(problem.rig, problem.recordings, problem.constants, problem.highest_hz)
    squares = np.zeros(len(problem.rig.seen))
    for number, state in enumerate(problem.states):
        off, _ = residual(simulation, simulation.begin(), simulation.own(state), number)
        recorded = problem.recordings[number]
        squares += np.mean((off * (recorded.unit / level(recorded))[:, None]) ** 2, axis=1)
    return [float(m) for m in np.sqrt(squares / len(problem.states))]


def _weak(problem: SimulatedRecordings) -> dict[str, float]:
    """Return the constants that noise would leave badly known."""
    simulation = Simulation(problem.rig, problem.recordings, problem.constants, problem.highest_hz)
    own = [simulation.own(s) for s in problem.states]
    model = SimulationModel(simulation, own, (FIT,), 1.0)
    if not simulation.parameters:
        return {}
    model.noise = NOISE**2
    at = model.evaluate(Point(np.clip(simulation.begin(), model.low, model.high), tuple(own)))
    spread = NOISE * np.sqrt(np.maximum(np.diag(covariance(model.linearise(at, True).normal)), 0.0))
    found = {}
    for p, x, error in zip(simulation.parameters, at.point.x, spread, strict=True):
        relative = float(error) if p.log else float(error) / max(abs(float(x)), 1e-300)
        if p.unit and relative > WEAK:
            found[p.name] = relative
    return found


def _declared(rig: DescribedRig) -> list[str]:
    """Return constants that are declared exactly, gains first: these are what is most often wrong."""
    names = [p.name for p in rig.arrangement.parameters if p.unit and p.uncertainty == 0 and math.isfinite(p.value)]
    return sorted(names, key=lambda n: not n.startswith("gain"))


def with_unknown(rig: DescribedRig, name: str) -> DescribedRig:
    """Return the rig with one constant that nobody knows."""
    parameters = tuple(
        replace(p, value=math.nan, uncertainty=math.inf) if p.name == name else p for p in rig.arrangement.parameters
    )
    return replace(rig, arrangement=replace(rig.arrangement, parameters=parameters))
