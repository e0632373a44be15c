"""Recordings that are simulated from end to end: with measured inputs, or decays of which only a band is looked at.

These are a few long segments. The noise is not known beforehand: residuals are in units of the channels' rms, and then
of what a first fit says of the noise; what is left of them says how large it is. Free are the rig's constants, each
recording's state where fitting begins, the mechanisms' parameters; the recordings are cut into blocks that fit, that
choose, and that are held out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any

import numpy as np

from analysis.mismatch.least_squares import Stopping, minimise
from analysis.mismatch.linearised import Evaluation
from analysis.mismatch.parameters import Term
from analysis.mismatch.policy import POLICY, SelectionPolicy
from analysis.mismatch.problem import Columns, ComputeBudget, Constants, Fit, Problem
from analysis.mismatch.recordings.beginning import FOLLOWED, STAGES, TELLING, leads_nowhere
from analysis.mismatch.recordings.covariances import Spread, covariances
from analysis.mismatch.recordings.model import DRAWS, Point, SimulationModel, residual
from analysis.mismatch.recordings.motion import Own, continued
from analysis.mismatch.recordings.noise import NoiseModel, mostly_missed
from analysis.mismatch.recordings.noise_colour import p_of_sensor_noise
from analysis.mismatch.recordings.recorded import CHOOSE, FIT, Recorded, level
from analysis.mismatch.recordings.second_impact import second_impact_score
from analysis.mismatch.recordings.signatures import columns_of
from analysis.mismatch.recordings.simulation import Simulation
from analysis.mismatch.rig_description import DescribedRig
from analysis.mismatch.score_test import Score
from sim_backend.arrangement import Arrangement
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import AddedBody, ChannelDistortion, Mechanism, Scale, SecondImpact, Tones

ROUGH_STEPS, FINE_STEPS, MOST_TRIES, FIRST_DAMPING = 30, 100, 8, 1e-3
ROUGH = 1e-4  # relative fall at which a fit that only ranks rivals ends
FINE = 0.005  # fall of chi-squared, over the reduced one, at which a fit ends that is used (decision 166)
SHOWN = 0.4  # of the sampling rate, up to which a recording shows what there is
RIGID = 1e-3  # of the highest mode, below which one is a rigid motion
NEAR_LINEAR = 0.01  # mean square of what the linear rig misses, in levels of the channels, up to which it starts well
OUTDATED = 0.5  # of the noise that priors were weighed by, below which they are weighed anew


@dataclass(frozen=True, slots=True)
class SimulatedRecordings(Problem["SimulatedFit"]):
    """Recordings and the described rig they are held against.

    Attributes
    ----------
    constants, highest_hz, states
        Starting values of all constants, highest mode (Hz), (2n,) state of each recording where fitting begins.
    rivals
        Other constants and states that spectra hardly tell from these.
    plain
        Whether residuals are compared with what mechanisms do as they are, and not whitened.
    looked_at
        Share of each recording, from its beginning, that fits look at which only rank rivals.
    noise
        Mean square of residuals that are noise: what cannot be predicted, and what noise of the inputs makes.
    """

    rig: DescribedRig
    recordings: tuple[Recorded, ...]
    constants: Mapping[str, float]
    highest_hz: float
    states: tuple[Real, ...]
    policy: SelectionPolicy = POLICY
    budget: ComputeBudget = field(default_factory=ComputeBudget, compare=False)
    noise_known: bool = False
    rivals: tuple[tuple[Mapping[str, float], tuple[Real, ...]], ...] = ()
    plain: bool = False
    looked_at: float = 1.0
    noise: float = 1.0
    shares: dict[object, float] = field(default_factory=dict, compare=False)  # of trials: what made as much as noise

    @property
    def arrangement(self) -> Arrangement:  # type: ignore[override]
        """What the rig is made of."""
        return self.rig.arrangement

    @property
    def name(self) -> str:
        """Name of the rig."""
        return self.rig.name

    @property
    def parts(self) -> tuple[str, ...]:
        """Components of the contract that the rig has beside those of its elements."""
        return self.rig.parts

    @property
    def samples(self) -> int:
        """Samples of a channel that are fitted."""
        return sum(r.fitted.stop - r.fitted.start for r in self.recordings)

    @property
    def banded(self) -> bool:
        """Whether the recordings were cut down to a band."""
        return any(r.band is not None for r in self.recordings)

    @property
    def one_decay(self) -> bool:
        """Whether amplitude and time go together in all there is: one free decay."""
        return len(self.recordings) == 1 and self.recordings[0].free

    def allows(self, mechanism: Mechanism) -> bool:
        """Whether the recordings can show it: a band has no harmonics, which tell a bent scale from a bent spring."""
        if mechanism.hidden:
            return False
        if isinstance(mechanism, SecondImpact) and any(r.free == mechanism.driven for r in self.recordings):
            return False
        return not (self.banded and isinstance(mechanism, ChannelDistortion | Tones | AddedBody | SecondImpact))

    def second_impact(self, fitted: SimulatedFit, mechanism: SecondImpact) -> Score:
        """Return the score of a second impact in free decays."""
        return second_impact_score(fitted, mechanism, self.plain)

    def scale_of(self, fitted: SimulatedFit, place: int) -> Scale:
        """Return how far an element moves in the recordings."""
        reach, speed = 1e-300, 1e-300
        for number in range(len(self.recordings)):
            d, v = fitted.simulation.deformations(fitted.x, fitted.own[number], number)
            reach, speed = max(reach, float(np.abs(d[place]).max())), max(speed, float(np.abs(v[place]).max()))
        values, element = fitted.values, self.arrangement.elements[place]
        mass = self.arrangement.matrices(values)[0]
        moved = float(np.mean(mass)) * speed**2 / reach
        stiffness = values[element.stiffness] if element.stiffness else 0.0
        static = self.rig.preload_n / stiffness if element.preload and stiffness else 0.0
        modes = [float(f) for f in self.arrangement.undamped_hz(values) if f >= RIGID * self.highest_hz]
        band = min(modes, default=self.highest_hz), max([self.highest_hz, *modes])
        seen = self.arrangement.bodies.index(self.arrangement.sensors[0].row[0][0])
        return Scale(
            reach, speed, static, max(stiffness * reach, moved), band,
            max(r.samples / r.rate_hz for r in self.recordings), float(mass[seen]),
            SHOWN * min(r.rate_hz for r in self.recordings),
        )  # fmt: skip

    def reach_of(self, fitted: SimulatedFit, place: int) -> tuple[float, float]:
        """Return the largest deformation (m) and rate (m/s) of an element."""
        scale = self.scale_of(fitted, place)
        return scale.deformation, scale.rate

    def columns(self, fitted: SimulatedFit, terms: Sequence[Term], ringing: Sequence[Term]) -> list[Iterator[Columns]]:
        """Return the columns of all recordings, whitened by an autoregression of the residual."""
        every = range(len(self.recordings))
        return [iter([columns_of(self, fitted, number, terms, ringing) for number in every])]

    def draws(self, fitted: SimulatedFit) -> int:
        """Return how many draws of noise come with the columns: where that of inputs counts."""
        if self.plain or fitted.spread is None or all(n.driven is None for n in fitted.spread()[1]):
            return 0
        return DRAWS

    def precision(self, fitted: SimulatedFit) -> Real:
        """Return none: what is declared is not weighed against a residual whose noise is not known."""
        return np.zeros(fitted.x.size)


@dataclass(frozen=True, slots=True)
class SimulatedFit(Fit):
    """A fit of simulated recordings.

    Attributes
    ----------
    x, own
        The parameters as they are fitted, and what is each recording's own.
    scatter
        Mean square of the residuals fitted, in the recordings' units.
    parts
        What was fitted.
    kept, shown
        Residuals that were asked for; noise likewise, where ``spread`` does not tell it.
    spread
        Makes the covariance of all parameters and the noise of each recording, of a fit that has converged.
    """

    problem: SimulatedRecordings
    simulation: Simulation
    x: Real
    own: tuple[Own, ...]
    scatter: float
    parts: tuple[int, ...] = (FIT,)
    spread: Spread | None = None
    kept: dict[tuple[int, bool], tuple[Real, slice]] = field(default_factory=dict, init=False, compare=False)
    shown: dict[int, NoiseModel] = field(default_factory=dict, init=False, compare=False)
    colour: list[float] = field(default_factory=list, init=False, compare=False)
    early: list[float] = field(default_factory=list, init=False, compare=False)  # see `_left_early`
    along: list[Any] = field(default_factory=list, init=False, compare=False)  # see `regression_of`

    def noise(self, number: int) -> NoiseModel:
        """Return the noise of a recording, as what is left of it shows it."""
        if self.spread is not None:
            return self.spread()[1][number]
        if number not in self.shown:
            recorded, (off, at) = self.problem.recordings[number], self.off(number)
            self.shown[number] = NoiseModel.of(recorded, (off, np.isin(recorded.part[at], (FIT, CHOOSE))))
        return self.shown[number]

    @property
    def values(self) -> dict[str, float]:
        """All the rig's constants."""
        return self.simulation.read(self.x)[0]

    def state(self, number: int) -> Real:
        """Return (2n,) the state of the rig's own bodies where fitting of a recording begins."""
        n, m, own = len(self.problem.arrangement.bodies), self.simulation.n, self.own[number].state
        return np.concatenate([own[:n], own[m : m + n]])

    @property
    def as_noise(self) -> bool:
        """Whether what is left is as good as noise: little of it can be predicted, or it has a sensor's colour."""
        return self.little_predicted or self.p_of_colour >= self.problem.policy.level

    @property
    def little_predicted(self) -> bool:
        """Whether what is left is not much more than what cannot be predicted of it."""
        return self.scatter < self.problem.policy.unlike_noise * self.problem.noise

    @property
    def p_of_colour(self) -> float:
        """The p-value of what is left having the colour of a sensor's noise."""
        if not self.colour:
            self.colour.append(p_of_sensor_noise(self))
        return self.colour[0]

    @property
    def missed(self) -> float:
        """Mean square of the residuals fitted, in levels of the channels."""
        levels = [(r.unit / level(r))[:, None] for r in self.problem.recordings]
        squares = [float(np.mean((rows * size) ** 2)) for rows, size in zip(self.residuals, levels, strict=True)]
        return float(np.average(squares, weights=[r.size for r in self.residuals]))

    def off(self, number: int, whole: bool = False) -> tuple[Real, slice]:
        """Return simulation minus recording in the recording's units, (c, n), and of which samples."""
        if (number, whole) not in self.kept:
            self.kept[number, whole] = residual(self.simulation, self.x, self.own[number], number, whole)
        return self.kept[number, whole]

    def error(self, number: int, whole: bool = False) -> tuple[Real, slice]:
        """Return simulation minus recording in the channels' own units, (c, n), and of which samples."""
        off, at = self.off(number, whole)
        return off * self.problem.recordings[number].unit[:, None], at

    def by_block(self, part: int, noise: SimulatedFit | None = None) -> tuple[float, ...]:
        """Return the mean square of what is left of each block of a part, in its units or whitened as a fit's noise."""
        found: list[float] = []
        for number, recorded in enumerate(self.problem.recordings):
            off, at = self.off(number)
            off = off if noise is None else noise.noise(number).white(off)
            kept, block = recorded.part[at] == part, recorded.block[at]
            found += [float(np.mean(off[:, kept & (block == b)] ** 2)) for b in np.unique(block[kept])]
        return tuple(found)

    def far_off(self) -> bool:
        """Whether a channel's error is most of what it shows, and could have been predicted from the error itself."""
        shares = self.problem.policy.missed, self.problem.policy.predictable
        return any(mostly_missed(r, *self.error(i, True), *shares) for i, r in enumerate(self.problem.recordings))

    def pinned(self) -> bool:
        """Whether a parameter of a mechanism ends at a bound of its range."""
        each = zip(self.simulation.parameters, self.x, strict=True)
        ends = ((x, b) for p, x in each if p.scope == "mechanism" for b in p.bounds if math.isfinite(b))
        return any(abs(x - b) < 1e-6 * max(abs(b), 1.0) for x, b in ends)


def fit(
    problem: SimulatedRecordings,
    terms: Sequence[Term] = (),
    begin: SimulatedFit | None = None,
    parts: Sequence[int] = (FIT,),
    staged: bool = False,
    fine: bool = False,
    to_beat: float = math.inf,
) -> SimulatedFit:
    """Fit a simulation to the samples of these parts.

    Parameters
    ----------
    terms
        Mechanisms with starting values.
    begin
        A fit to start from: its constants and states.
    staged
        Follow free decays from their beginning on before all of them is fitted: for a start whose frequencies are not
        yet known to within a cycle. Not to the end where mechanisms explain next to nothing of the beginning, or leave
        more of it than is ``to_beat``.
    fine
        Go on until it has converged, on all there is, and compute its covariance; not only until rivals can be ranked.
    to_beat
        Objective that matters: a fit that comes nearer too slowly to reach it is given up, and one is not made that
        leaves much of the beginning where noise has to be left (`leads_nowhere`).
    """
    constants, like = (problem.constants, None) if begin is None else (begin.values, begin.simulation)
    simulation = Simulation(problem.rig, problem.recordings, constants, problem.highest_hz, terms, like)
    states = problem.states if begin is None else [begin.state(i) for i in range(len(begin.own))]
    fresh = [simulation.own(s) for s in states]
    own = fresh if begin is None else continued(simulation, states, begin.simulation, begin.own)
    most, looked_at = (FINE_STEPS, 1.0) if fine else (ROUGH_STEPS, problem.looked_at)
    model = SimulationModel(simulation, own, parts, looked_at)
    point = Point(np.clip(simulation.begin(), model.low, model.high), tuple(own))
    stages = [s for s in STAGES if staged and s < looked_at]
    beside = begin if stages and begin is not None and len(terms) > len(begin.terms) else None
    most_early = math.inf if beside is None else _left_early(problem, beside)
    rough = Stopping(ROUGH_STEPS, 0.0, ROUGH, FIRST_DAMPING, MOST_TRIES), problem.policy.race()
    lost = math.isfinite(to_beat) and not fine and leads_nowhere(model, point, to_beat, problem.noise, rough)
    for part in (*stages, looked_at):
        if lost and part < looked_at:
            continue
        beats = to_beat if part == looked_at else math.inf
        model = SimulationModel(simulation, point.own, parts, part, rough=not fine)
        at = model.evaluate(point)
        model.noise, share = at.mean_square, FINE / at.samples if fine else ROUGH
        stopping = Stopping(0 if lost else most, 0.0, share, FIRST_DAMPING, MOST_TRIES, to_beat=beats)
        found, _ = minimise(model, model.evaluate(point), stopping, problem.policy.race())
        while fine and model.prior and found.mean_square < OUTDATED * model.noise:  # what priors are weighed by
            model.noise = found.mean_square
            found, _ = minimise(model, model.evaluate(found.point), stopping, problem.policy.race())
        little = part == TELLING and found.mean_square > FOLLOWED * most_early
        point, lost = found.point, little or found.objective > to_beat  # all of it leaves no less than a part
    return _finished(problem, model, found, fine)


def _left_early(problem: SimulatedRecordings, begin: SimulatedFit) -> float:
    """Return the mean square that what stands leaves of the beginning, up to `TELLING`; infinite if that is noise."""
    if not begin.early:
        begin.early.append(fit(replace(problem, looked_at=TELLING), begin.terms, begin, staged=True).scatter)
    return begin.early[0] if begin.early[0] > problem.policy.unlike_noise * problem.noise else math.inf


def _finished(
    problem: SimulatedRecordings, model: SimulationModel, found: Evaluation[Point], fine: bool
) -> SimulatedFit:
    simulation, point, arrangement = model.simulation, found.point, model.simulation.arrangement
    values, terms = simulation.read(point.x)
    constants = Constants(arrangement, np.array([values[p.name] for p in arrangement.parameters]), np.zeros((1, 0)))
    spread = cache(partial(model.spread, found)) if fine else None
    return SimulatedFit(
        terms, arrangement, constants, found.residuals, found.objective - found.penalty, found.penalty,
        cache(partial(covariances, simulation, terms, spread)), problem, simulation, point.x, point.own,
        found.mean_square, model.parts, spread,
    )  # fmt: skip
