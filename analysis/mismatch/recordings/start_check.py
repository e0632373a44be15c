"""How well the linear rig begins: what it misses before anything is fitted, and what should be left free."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from analysis.mismatch.linearised import covariance
from analysis.mismatch.recordings.fit import SimulatedFit, SimulatedRecordings
from analysis.mismatch.recordings.linear_rig import problem_of
from analysis.mismatch.recordings.model import Point, SimulationModel, residual
from analysis.mismatch.recordings.recorded import FIT, UNUSED, Recorded, level, prepare
from analysis.mismatch.recordings.simulation import Simulation
from analysis.mismatch.rig_description import DescribedRig
from analysis.session import AnalysisError
from daq.exchange import Recording
from sim_backend.arrays import Real

POOR: Final = 0.7  # of a channel's rms: a linear rig that misses more has hardly begun
MUCH_BETTER: Final = 0.7  # factor in what is missed from which on a constant is said to be better left free
ZERO: Final = 1.05  # of a channel's rms: predicting zero, or a rig that does not move, misses 1
HELPS: Final = 0.5  # of a channel's rms, that a rig with another constant may miss for the constant to be worth naming
AS_GOOD: Final = 2.0  # factor in what is missed within which constants mend alike
ALMOST: Final = 0.05  # of a channel's rms: what is missed less than that begins well, whichever constant did it
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


def better_unknown(problem: SimulatedRecordings, among: Sequence[str] | None = None) -> dict[str, float]:
    """Return declared constants, of all or ``among`` some, without whose values the linear rig begins much better.

    The best first; for each, the rms that it then misses of the channels, over their rms.
    """
    before, freed = float(np.linalg.norm(_missed(problem))), {}
    for name in declared(problem.rig) if among is None else among:
        try:
            after = float(np.linalg.norm(_missed(problem_of(with_unknown(problem.rig, name), problem.recordings))))
        except (AnalysisError, ArithmeticError, np.linalg.LinAlgError):
            continue
        if after < MUCH_BETTER * before:
            freed[name] = after / math.sqrt(len(problem.rig.seen))
    return dict(sorted(freed.items(), key=lambda item: item[1]))


def frame_remark(rig: DescribedRig, recordings: Sequence[Recording]) -> str:
    """Say that accelerations of a rig on a shaken base are absolute, or relative, where the file says otherwise.

    The linear rig with constants from the spectra then misses far less. Empty where it does not, and where no base is
    shaken.
    """
    other = _in_the_other_frame(rig)
    if other is None:
        return ""
    try:
        here, there = (max(_missed(problem_of(r, [prepare(one, r) for one in recordings]))) for r in (rig, other))
    except (AnalysisError, ArithmeticError, np.linalg.LinAlgError):
        return ""
    if there > min(MUCH_BETTER * here, HELPS):
        return ""
    changed = [new for old, new in zip(rig.seen, other.seen, strict=True) if old.absolute != new.absolute]
    names = ", ".join(str(s.channel) for s in changed)
    what, to_write = ("absolute", "true") if changed[0].absolute else ("relative to the base", "false")
    return (
        f"the linear rig misses {100 * there:.3g} % of the channels instead of {100 * here:.3g} % where accelerations "
        f"are {what}: write 'absolute: {to_write}' in the sensors of {names}"
    )


def _in_the_other_frame(rig: DescribedRig) -> DescribedRig | None:
    """Return the rig whose accelerations are absolute instead of relative to the base, or the other way round."""
    known = {p.name for p in rig.arrangement.parameters if math.isfinite(p.value)}
    base = [d.gain for d in rig.drives if d.base]
    able = [s.sensor.quantity == "acceleration" and s.gain in known and len(s.sensor.row) == 1 for s in rig.seen]
    if not base or not known.issuperset(base) or not any(able):
        return None
    seen = tuple(replace(s, absolute=s.absolute != can) for s, can in zip(rig.seen, able, strict=True))
    return replace(rig, seen=seen)


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


def declared(rig: DescribedRig) -> list[str]:
    """Return constants that are declared exactly, gains first: these are what is most often wrong."""
    names = [p.name for p in rig.arrangement.parameters if p.unit and p.uncertainty == 0 and math.isfinite(p.value)]
    return sorted(names, key=lambda n: not n.startswith("gain"))


def with_unknown(rig: DescribedRig, name: str) -> DescribedRig:
    """Return the rig with one constant that nobody knows."""
    parameters = tuple(
        replace(p, value=math.nan, uncertainty=math.inf) if p.name == name else p for p in rig.arrangement.parameters
    )
    return replace(rig, arrangement=replace(rig.arrangement, parameters=parameters))


def worse_than_zero(fitted: SimulatedFit, best: SimulatedFit) -> str:
    """Say that the linear rig predicts the recordings worse than zero would, and what to leave free; empty if not.

    Parameters
    ----------
    fitted, best
        The linear rig fitted, and the fit with all that was accepted: where that predicts them, nothing is said.

    Returns
    -------
    str
        Errors are those of the channel that is missed most, before and after the fit, over the channel's rms.
    """
    problem = fitted.problem
    begins, ends = np.array(_missed(problem)), _missed_by(fitted)
    if max(_missed_by(best)) <= POOR or not max(begins.max(), ends.max()) > ZERO:
        return ""
    at = int(np.argmax(np.maximum(begins, ends)))
    said = (
        f"The linear rig as described is worse than predicting zero: it misses {begins[at]:.3g} times the rms of "
        f"channel {problem.rig.seen[at].channel} before its unknown constants are fitted and {ends[at]:.3g} times it "
        "after."
    )
    return f"{said} {left_free(problem)}"


def far_off_words(problem: SimulatedRecordings) -> str:
    """Return what is said of a residual that is most of the motion."""
    said = "is most of the motion: check the stiffness and mass described, their units, and the channels"
    better = next(iter(better_unknown(problem)), None)
    return said if better is None else f"{said}; the linear rig begins much better where the {better} is unknown"


def left_free(problem: SimulatedRecordings) -> str:
    """Say which declared constants to leave free for the linear rig to begin well, and how they are written."""
    rig = problem.rig.arrangement
    masses = [p.name for p in rig.parameters if p.name in rig.masses and math.isfinite(p.uncertainty)]
    kept = masses if len(masses) == 1 else []  # one mass has to be given
    found: dict[tuple[str, ...], float] = {
        (n,): missed for n, missed in better_unknown(problem).items() if n not in kept
    }
    gains = tuple(s.gain for s in problem.rig.seen if s.gain in declared(problem.rig))
    if len(gains) > 1 and min(found.values(), default=1.0) > HELPS:
        with suppress(AnalysisError, ArithmeticError, np.linalg.LinAlgError):
            freed = functools.reduce(with_unknown, gains, problem.rig)
            found[gains] = max(_missed(problem_of(freed, problem.recordings)))
    # a gain is what is most often wrong, that of an input first: what mends as much stands in for it
    rank = {c.gain: 1 for c in problem.rig.seen} | {c.gain: 0 for c in problem.rig.drives}
    limit = max(AS_GOOD * min(found.values(), default=1.0), ALMOST)
    good = [(names, missed) for names, missed in found.items() if missed <= limit]
    names, missed = min(good, key=lambda one: (rank.get(one[0][0], 2), one[1]), default=((), 1.0))
    if missed > HELPS:
        return (
            "No constant left free alone mends that: check the units of masses, stiffnesses and channels, which "
            "channel shows which body, and what is connected to what ('mesotap rig check')."
        )
    how = "; ".join(_written(problem.rig, name) for name in names)
    return f"It begins at {missed:.2g} where the {' and the '.join(names)} is not declared: {how}."


def _written(rig: DescribedRig, name: str) -> str:
    """Return how a constant is left unknown in a rig file."""
    channel = ({c.gain: c.channel for c in rig.seen} | {c.gain: c.channel for c in rig.drives}).get(name)
    if channel is not None:
        return f"write 'gain: unknown' for channel {channel}"
    for kind in ("stiffness", "damping"):
        if name.startswith(f"{kind} of "):
            return f"write '{kind}: unknown' in {name.removeprefix(f'{kind} of ')}"
    if name.startswith("mass of "):
        return f"write '{name.removeprefix('mass of ')}: unknown' under bodies"
    return f"write 'unknown' for {name}"


def _missed_by(fitted: SimulatedFit) -> Real:
    """Return (channels,) what a fit misses of all that is used of the recordings, over the channels' rms."""
    squares = np.zeros(len(fitted.problem.rig.seen))
    for number, recorded in enumerate(fitted.problem.recordings):
        off, at = fitted.error(number, whole=True)
        used = recorded.part[at] != UNUSED
        squares += np.mean((off[:, used] / level(recorded)[:, None]) ** 2, axis=1)
    return np.sqrt(squares / len(fitted.problem.recordings))
