"""Residuals and derivatives of simulated recordings, as the least-squares solver asks for them."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any, TypeVar

import numpy as np

from analysis.mismatch.linearised import Evaluation, Linearisation, Tangent, covariance
from analysis.mismatch.recordings.input_noise import drawn, rms_of_inputs
from analysis.mismatch.recordings.motion import Own, Place
from analysis.mismatch.recordings.nearby import nearby
from analysis.mismatch.recordings.noise import InputNoiseMade, NoiseModel
from analysis.mismatch.recordings.recorded import CHOOSE, FIT, Recorded, level, of_the_base
from analysis.mismatch.recordings.simulation import Simulation
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import AddedBody

Made = TypeVar("Made")

STEP = 1e-6  # of differences, before anything is known of what a step changes
FINE_STEP = 3e-7  # change of the channels, in levels, that a step then makes; rounding makes some 1e-12, of either sign
SHORTEST_STEP, LONGEST_STEP = 1e-10, 1e-4  # and between which steps it stays
JUMPING_STEP = 1e-5  # the least where a force jumps, and with it the division of the steps
JUMP_SEEN_STEP = 3e-4  # where accelerations show it: at a point a jump that passes a sample would be all of the slope
SEEN_STEP, LARGEST_STEP = 5e-4, 0.03  # change of the channels, in their levels, that a step then makes; and the largest
DRAWS = 80  # of the noise of measured inputs: standard errors from them are known to 8 %
DRAWS_SEED = 144
SMALL_DRAW = 0.1  # of such noise, where no force jumps: about a motion that a little sets on another course
LOST = 30.0  # residual, in levels of the channel, that stands for a simulation that ran away


def residual(
    simulation: Simulation, x: Real, own: Own, number: int, whole: bool = False, samples: int | None = None
) -> tuple[Real, slice]:
    """Return simulation minus recording in the recording's units, (c, n), and of which samples."""
    off, at = residuals(simulation, [(x, own)], number, whole, samples)
    return off[0], at


def residuals(
    simulation: Simulation, places: Sequence[Place], number: int, whole: bool = False, samples: int | None = None
) -> tuple[Real, slice]:
    """Return (places, c, n) what `residual` does, for several places at once."""
    recorded = simulation.recordings[number]
    shown, at = simulation.runs(places, number, whole, samples)
    lost = (LOST * level(recorded) / recorded.unit)[:, None]
    with np.errstate(over="ignore", invalid="ignore"):
        off = (shown - recorded.outputs[:, at]) / recorded.unit[:, None]
    return np.asarray(np.clip(np.where(np.isfinite(off), off, lost), -lost, lost), np.float64), at


def made_by_input_noise(
    simulation: Simulation, x: Real, own: Own, number: int, samples: int | None = None
) -> Real | None:
    """Return (draws, c, n) what draws of the noise of measured inputs make of a recording, in its units.

    Of what is fitted, or of so many samples from its beginning; None where the inputs are taken to have none.
    """
    recorded = simulation.recordings[number]
    if not np.any(rms_of_inputs(simulation.rig, recorded)):
        return None
    fitted = recorded.fitted.stop - recorded.fitted.start
    there = np.concatenate([x, own.state, own.tones.ravel(), own.impact, own.memory]).tobytes()
    return _made_by_draws(_Asked(simulation, number, samples or fitted, there, x, own))


@dataclass(frozen=True, slots=True)
class _Asked:
    """Of what draws of inputs' noise are simulated: ``there`` holds all numbers of ``x`` and ``own``."""

    simulation: Simulation
    number: int
    samples: int
    there: bytes
    x: Real = field(compare=False)
    own: Own = field(compare=False)


@lru_cache(maxsize=6)  # a fit's covariance, its screening and its held-out errors ask for the same
def _made_by_draws(asked: _Asked) -> Real:
    simulation, x, own, number, samples = asked.simulation, asked.x, asked.own, asked.number, asked.samples
    recorded = simulation.recordings[number]
    share = 1.0 if simulation.jumps else SMALL_DRAW
    left, at = residual(simulation, x, own, number, samples=samples)
    normal = np.random.default_rng(DRAWS_SEED).standard_normal((DRAWS, *recorded.inputs.shape))
    errors = drawn(recorded, rms_of_inputs(simulation.rig, recorded), normal)

    def made(error: Real) -> Real:
        noisy = simulation.with_inputs(number, recorded.inputs + share * error)
        shown = of_the_base(error, simulation.rig)[:, at] / recorded.unit[:, None]  # what was taken off the channels
        return np.asarray((residual(noisy, x, own, number, samples=samples)[0] - left) / share + shown, np.float64)

    found = np.array(side_by_side(made, [(error,) for error in errors]))
    found.setflags(write=False)
    return found


def slopes(
    changed: Callable[[Sequence[Place]], Real], x: Real, own: Own, steps: Real, signs: Real, scale: Real
) -> tuple[Real, Real]:
    """Return what a unit of each parameter, and of each number that is a recording's own, changes, by differences.

    Parameters
    ----------
    changed
        From parameters and a recording's own numbers at several places to how residuals (places, n) differ from those
        at ``x`` and ``own``.
    steps
        (own.size + k,) of the differences; see `steps_of`.
    signs, scale
        (k,) direction of each parameter's, 0 for both ways; (own.size,) what counts as a unit of the own numbers, which
        go both ways where any parameter does.

    Returns
    -------
    tuple
        (n, k) and (n, own.size).
    """
    size = own.size
    way = np.append(np.full(size, 1.0 if np.all(signs) else 0.0), signs)
    reach = steps * np.append(np.ones(size), np.maximum(1.0, np.abs(x))) * np.where(way == 0, 1.0, way)
    back = np.flatnonzero(way == 0)
    units = np.concatenate([np.diag(reach), -np.diag(reach)[back]])
    places = [(x + u[size:], own.moved(u[:size] * scale)) for u in units]
    rows = changed(places).reshape(len(places), -1)
    rows[back] = (rows[back] - rows[way.size :]) / 2
    rows = rows[: way.size] / reach[:, None]
    return rows[size:].T, rows[:size].T


def steps_of(simulation: Simulation, x: Real, own: Own, number: int, samples: int | None = None) -> Real:
    """Return (own.size + k,) the steps of differences: of a recording's own numbers, then of the parameters.

    Where a force jumps a step changes the motion by `SEEN_STEP`: where it turns about moves on from step to step of the
    motion, and what is less than the error that this makes says nothing of a slope. Where none does, see `keep_steps`.
    """
    known = simulation.steps.get(number)
    if known is not None and known.size == own.size + x.size:
        return known
    if not simulation.jumps:
        return np.full(own.size + x.size, STEP)
    recorded = simulation.recordings[number]
    near = nearby(simulation, x, own, number, samples)
    base, _ = residual(near, x, own, number, samples=samples)

    def changed(places: Sequence[Place]) -> Real:
        return np.asarray(residuals(near, places, number, samples=samples)[0] - base)

    shown = (sensor.quantity for sensor in simulation.arrangement.sensors)
    tried = np.full(own.size + x.size, JUMP_SEEN_STEP if "acceleration" in shown else JUMPING_STEP)
    found = slopes(changed, x, own, tried, ways(simulation), simulation.own_scale(number, own))
    known = np.clip(SEEN_STEP / _shown(recorded, x, *found), tried, LARGEST_STEP)
    simulation.steps[number] = known
    return known


def keep_steps(simulation: Simulation, x: Real, number: int, common: Real, begun: Real) -> None:
    """Choose the steps of the next differences so that each changes the motion by `FINE_STEP`, as slopes tell.

    Of a frequency that many periods tell, a longer step bends the motion by more than what parts it from a force that
    does nearly the same, and fits creep; of what does little, a shorter one is lost in rounding.
    """
    if not simulation.jumps:
        each = _shown(simulation.recordings[number], x, common, begun)
        simulation.steps[number] = np.clip(FINE_STEP / each, SHORTEST_STEP, LONGEST_STEP)


def _shown(recorded: Recorded, x: Real, common: Real, begun: Real) -> Real:
    """Return (own.size + k,) rms of the change of the channels, in their levels, that a unit step makes."""
    every = np.column_stack([begun, common * np.maximum(1.0, np.abs(x))])
    size = (recorded.unit / level(recorded))[:, None]
    each = np.sqrt(np.mean((every.reshape(size.size, -1, every.shape[1]) * size[:, :, None]) ** 2, axis=(0, 1)))
    return np.asarray(np.maximum(each, 1e-300))


def ways(simulation: Simulation) -> Real:
    """Return (k,) the direction of each parameter's difference: both ways beside a force that jumps.

    Steps that the motion shows are long; along one of them a motion bends by more than what parts two parameters that
    do nearly the same.
    """
    return np.full(len(simulation.parameters), 0.0 if simulation.jumps else 1.0)


def side_by_side(simulated: Callable[..., Made], places: Sequence[tuple[Any, ...]]) -> list[Made]:
    """Return what is simulated at each place; compiled code lets go of the interpreter."""
    workers = min(len(os.sched_getaffinity(0)), len(places))
    if workers < 2:
        return [simulated(*place) for place in places]
    contexts = [copy_context() for _ in places]  # numpy's handling of errors is kept in it
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(lambda context, place: context.run(simulated, *place), contexts, places))


@dataclass(frozen=True, slots=True)
class Point:
    """Parameters (k,) as they are fitted, and what is each recording's own."""

    x: Real
    own: tuple[Own, ...]


class SimulationModel:
    """See `analysis.mismatch.least_squares.Fitted`; ``share`` of a free decay is fitted, of these parts.

    Beside a force that jumps differences go both ways but where a fit is ``rough``.
    """

    approximates, reuses, bends = False, True, True

    def __init__(
        self, simulation: Simulation, own: Sequence[Own], parts: Sequence[int], share: float, rough: bool = False
    ):
        self.simulation, self.parts = simulation, tuple(parts)
        self.ways = ways(simulation) if not rough else np.ones(len(simulation.parameters))
        self.scales = [simulation.own_scale(i, o) for i, o in enumerate(own)]
        low, high = zip(*(p.bounds for p in simulation.parameters), strict=True) if simulation.parameters else ((), ())
        self.low, self.high = np.array(low), np.array(high)
        self.fixed, self.settles = np.zeros(self.low.size, bool), not simulation.jumps
        self.samples = [
            None if share >= 1.0 else math.ceil(share * (r.fitted.stop - r.fitted.start)) for r in simulation.recordings
        ]
        self.prior = [(i, *p.prior) for i, p in enumerate(simulation.parameters) if p.prior is not None]
        self.noise = 1.0  # variance by which priors are weighed
        self.basis = _basis(simulation)

    def used(self, places: Sequence[Place], number: int, simulation: Simulation | None = None) -> Real:
        """Return minus the residuals (places, c, m) at the samples that are fitted."""
        off, at = residuals(simulation or self.simulation, places, number, samples=self.samples[number])
        return -off[:, :, np.isin(self.simulation.recordings[number].part[at], self.parts)]

    def evaluate(self, point: Point) -> Evaluation[Point]:
        """Return the residuals at a point."""
        rows = tuple(self.used([(point.x, o)], i)[0] for i, o in enumerate(point.own))
        penalty = self.noise * sum(((point.x[i] - mean) / error) ** 2 for i, mean, error in self.prior)
        return Evaluation(point, sum(float(np.vdot(r, r)) for r in rows) + penalty, float(penalty), rows)

    def linearise(self, at: Evaluation[Point], exact: bool) -> Linearisation:
        """Return the derivatives of every recording, by differences, with respect to steps in the basis."""
        x, k = at.point.x, at.point.x.size
        normal, tangents = np.zeros((k, k)), []
        for number, (own, base) in enumerate(zip(at.point.own, at.residuals, strict=True)):
            steps = steps_of(self.simulation, x, own, number, self.samples[number])
            reach = steps[own.size :] * np.maximum(1.0, np.abs(x))
            signs = np.where((x + reach > self.low) & (x + reach < self.high), self.ways, -1.0)
            signs = np.where((signs == 0) & (x - reach <= self.low), 1.0, signs)
            near = nearby(self.simulation, x, own, number, self.samples[number])
            changed = partial(self._changed, near, number, base)
            common, own_slopes = slopes(changed, x, own, steps, signs, self.scales[number])
            keep_steps(self.simulation, x, number, common, own_slopes)
            tangent = Tangent.of(np.arange(k), own_slopes, common @ self.basis)
            normal += tangent.common.T @ tangent.common
            tangents.append(tangent)
        for i, _, error in self.prior:
            normal[i, i] += self.noise / error**2
        return Linearisation(self.basis, normal, tuple(tangents))

    def _changed(self, near: Simulation, number: int, base: Real, places: Sequence[Place]) -> Real:
        return np.asarray(base - self.used(places, number, near), np.float64)

    def spread(self, found: Evaluation[Point]) -> tuple[Real, tuple[NoiseModel, ...]]:
        """Return the covariance that noise as it is gives to least squares, which weigh all of it alike, and the noise.

        Returns
        -------
        tuple
            (k, k) and the noise of each recording.
        """
        self.simulation.steps.clear()  # parameters have moved since they were chosen
        point, linear = found.point, self.linearise(found, True)
        inverse, basis = covariance(linear.normal), linear.basis
        inner, noises = np.zeros(inverse.shape), []
        recordings, made = self.simulation.recordings, self._made_by_input_noise(point, linear.tangents, inverse)
        for number, (recorded, tangent) in enumerate(zip(recordings, linear.tangents, strict=True)):
            off, at = residual(self.simulation, point.x, point.own[number], number)
            part = recorded.part[at]
            noises.append(NoiseModel.of(recorded, (off, np.isin(part, (FIT, CHOOSE))), made[number]))
            columns = tangent.common.reshape(len(off), -1, point.x.size)
            inner += noises[number].information(columns, np.isin(part, self.parts), made[number])
        for i, _, error in self.prior:
            inner[i, i] += self.noise / error**2 * self.noise
        return np.asarray(basis @ inverse @ inner @ inverse @ basis.T, np.float64), tuple(noises)

    def _made_by_input_noise(
        self, point: Point, tangents: Sequence[Tangent], inverse: Real
    ) -> list[InputNoiseMade | None]:
        """Return what draws of the inputs' noise make of each recording; the fit takes most of it for its constants."""
        found, follows = [], np.zeros((DRAWS, point.x.size))
        for number, (recorded, tangent) in enumerate(zip(self.simulation.recordings, tangents, strict=True)):
            used = np.isin(recorded.part[recorded.fitted], self.parts)
            made = made_by_input_noise(self.simulation, point.x, point.own[number], number)
            found.append(None if made is None else (used, made[:, :, used]))
            if made is not None:
                follows += made[:, :, used].reshape(DRAWS, -1) @ tangent.common
        moved = follows @ inverse
        out: list[InputNoiseMade | None] = []
        for one, tangent in zip(found, tangents, strict=True):
            if one is None:
                out.append(None)
                continue
            flat = one[1].reshape(DRAWS, -1)
            left = flat - (flat @ tangent.q) @ tangent.q.T - moved @ tangent.common.T
            out.append(InputNoiseMade(*one, left.reshape(one[1].shape)))
        return out

    def prior_slope(self, at: Evaluation[Point], basis: Real) -> Real:
        """Return half the negative slope of the penalty."""
        out = np.zeros(at.point.x.size)
        for i, mean, error in self.prior:
            out[i] = -self.noise * (at.point.x[i] - mean) / error**2
        return np.asarray(basis.T @ out, np.float64)

    def bounds(self, at: Evaluation[Point]) -> tuple[Real, Real]:
        """Return how far each step may go; what follows another one is cut off where it ends."""
        follows = np.count_nonzero(self.basis, axis=1) > 1
        low, high = self.low - at.point.x, self.high - at.point.x
        return np.where(follows, -np.inf, low), np.where(follows, np.inf, high)

    def moved(self, at: Evaluation[Point], step: Real, own: Sequence[Real], iteration: int) -> Evaluation[Point] | None:
        """Return the evaluation after a step."""
        x = np.clip(at.point.x + self.basis @ step, self.low, self.high)
        moved = [o.moved(s * scale) for o, s, scale in zip(at.point.own, own, self.scales, strict=True)]
        found = self.evaluate(Point(x, tuple(moved)))
        return found if math.isfinite(found.objective) else None


def _basis(simulation: Simulation) -> Real:
    """Return (k, k) what steps mean: a heavier added body keeps its frequency and damping ratio.

    These the recordings tell far better than mass, stiffness and damping one by one.
    """
    at = {(p.owner, p.name): k for k, p in enumerate(simulation.parameters) if p.scope == "mechanism" and p.log}
    basis = np.eye(len(simulation.parameters))
    for i, term in enumerate(simulation.terms):
        body = term.mechanism.body if isinstance(term.mechanism, AddedBody) else None
        if body is not None and all((i, name) in at for name in body):
            mass, stiffness, damping = (at[i, name] for name in body)
            basis[stiffness, mass] = basis[damping, mass] = 1.0
            basis[damping, stiffness] = 0.5
    return basis
