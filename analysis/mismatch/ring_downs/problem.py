"""Ring-downs: free decays after taps, each with amplitudes of its own, fitted together.

Free are, for every impact, the modal amplitudes when its pulse has ended and the slow ringing of each channel; for
every load the constants that differ from load to load; for the session the declared constants within their
uncertainties and the mechanisms' parameters. The rig is carried along in its modes; what belongs to one impact is
eliminated.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from analysis.mismatch.answer import TESTER
from analysis.mismatch.parameters import Term, lines_of
from analysis.mismatch.policy import POLICY, SelectionPolicy
from analysis.mismatch.problem import Columns, ComputeBudget, Fit, Problem
from analysis.mismatch.ring_downs.added_response import AddedResponse, Run, Variant
from analysis.mismatch.ring_downs.experiment import Experiment, Segment
from analysis.mismatch.ring_downs.model import SUBSTEPS
from analysis.mismatch.ring_downs.modes import Nuisance, Sensitivity
from analysis.mismatch.ring_downs.response import Response, response
from sim_backend.arrangement import LOAD, Arrangement
from sim_backend.arrays import Complex, Real
from sim_backend.mechanisms.kinds import ForceLaw, Scale, SecondImpact
from sim_backend.state_space import StateSpace

if TYPE_CHECKING:
    from analysis.mismatch.score_test import Score


PARTS = (
    "contact", "upper mass", "lower mass", "tube springs", "frame", "impactor", "sensor chain", "load cell",
)  # fmt: skip
SHOWN = 0.36  # of the sampling rate, up to which anti-aliasing filters leave the channels as they are
EARLY_S = 2.5e-3  # of a segment: where its largest motion is read


@dataclass(frozen=True, slots=True)
class RingDowns(Problem["RingDownFit"]):
    """Impacts and the linear rig they are held against.

    Attributes
    ----------
    analog
        Declared filter.
    slow
        Poles that every channel may ring on by itself: an offset and the declared high-pass.
    start
        (groups, k) starting values of the constants that differ from load to load.
    scattered
        Whether these differ from impact to impact instead: every segment is a group of its own.
    rig_start
        Starting values of constants of the rig for the linear rig alone, where the declared ones are too far off.
    budget
        What has been spent on the problem and on all its parts.
    name, parts
        Of the rig, and the components of the contract that it has.
    """

    experiment: Experiment
    arrangement: Arrangement
    analog: StateSpace
    slow: Complex
    start: Real
    policy: SelectionPolicy = POLICY
    scattered: bool = False
    rig_start: Mapping[str, float] = field(default_factory=dict)
    budget: ComputeBudget = field(default_factory=ComputeBudget, compare=False)
    noise_known: bool = True
    name: str = TESTER
    parts: tuple[str, ...] = PARTS

    @property
    def is_tester(self) -> bool:
        """Whether the rig is that of Eq. 9, with its contact at each load."""
        names = {p.name for p in self.arrangement.parameters}
        return {"m1", "m2", "k1", "k2", "kc", "cc"} <= names

    @property
    def linear(self) -> str:
        """What the linear rig is called in sentences."""
        return "Eq. 9" if self.is_tester else "the rig as described"

    @property
    def samples(self) -> int:
        """Samples of a channel, all segments together."""
        return sum(s.y.shape[1] for s in self.experiment.segments)

    @property
    def groups_by_load(self) -> tuple[tuple[int, ...], ...]:
        """Groups of each load: one, or all impacts of the load where each has constants of its own."""
        own: dict[float, list[int]] = {}
        for group, load in enumerate(self.experiment.loads_n):
            own.setdefault(load if self.scattered else group, []).append(group)
        return tuple(tuple(groups) for groups in own.values())

    def per_impact_constants(self) -> RingDowns:
        """Return the same problem with constants of its own for every impact, and a compute budget of its own."""
        segments = tuple(replace(s, group=i) for i, s in enumerate(self.experiment.segments))
        loads = tuple(s.preload_n for s in segments)
        start = self.start[[s.group for s in self.experiment.segments]]
        experiment = replace(self.experiment, segments=segments, loads_n=loads)
        return replace(self, experiment=experiment, start=start, scattered=True, budget=ComputeBudget())

    def with_segments(self, segments: Sequence[Segment]) -> RingDowns:
        """Return the same problem with other segments."""
        return replace(self, experiment=replace(self.experiment, segments=tuple(segments)))

    def only(self, kept: Sequence[int]) -> RingDowns:
        """Return the same problem with these segments alone."""
        return self.with_segments([self.experiment.segments[i] for i in kept])

    def cropped(self, skipped: int) -> RingDowns:
        """Return the same problem with every segment beginning so many samples later."""
        rate = self.experiment.sample_rate_hz
        return self.with_segments(
            [
                replace(
                    s,
                    y=s.y[:, skipped:],
                    raw=s.raw[:, skipped:],
                    start_s=s.start_s + skipped / rate,
                    pulse=np.concatenate([s.pulse, s.raw[:, :skipped]], axis=1) if s.pulse.size else s.pulse,
                    second=s.second - skipped,
                )
                for s in self.experiment.segments
            ]
        )

    def nuisance(self, terms: Sequence[Term] = ()) -> Nuisance:
        """Return the columns of what rings in every segment by itself, the tones among terms too."""
        return Nuisance(self.experiment, np.append(self.slow, 2j * np.pi * np.array(lines_of(terms))))

    def _moved(self, fitted: RingDownFit, place: int) -> Real:
        """Return (segments, 4) deformation, rate, preload over stiffness and force of an element after each tap."""
        count, rate = int(EARLY_S * self.experiment.sample_rate_hz), self.experiment.sample_rate_hz
        t = np.arange(count) / rate
        values = [fitted.constants.at(g) for g in range(len(fitted.modes))]
        elements = fitted.arrangement.elements
        own = [elements[place].stiffness, *(e.stiffness for e in elements)]  # of the first that has one
        name = next(n for n in own if n is not None)
        rows = []
        for segment, amplitudes in zip(fitted.segments, fitted.amplitudes, strict=True):
            stiffness = values[segment.group][name]
            d, v = fitted.responded(segment.group).motion(amplitudes, place, t)
            largest = float(np.abs(d).max())
            rows.append((largest, np.abs(v).max(), segment.preload_n / stiffness, stiffness * largest))
        return np.array(rows, np.float64)

    def reach_of(self, fitted: RingDownFit, place: int) -> tuple[float, float]:
        """Return the largest deformation (m) and rate (m/s) of an element."""
        deformation, rate, *_ = self._moved(fitted, place).max(axis=0).tolist()
        return deformation, rate

    def scale_of(self, fitted: RingDownFit, place: int) -> Scale:
        """Return how far an element moves after the taps."""
        rate = self.experiment.sample_rate_hz
        values = [fitted.constants.at(g) for g in range(len(fitted.modes))]
        deformation, rate_, static, force = map(float, np.median(self._moved(fitted, place), axis=0))
        hz = np.array([np.abs(m.rig.poles) / (2 * np.pi) for m in fitted.modes])
        seen = self.arrangement.masses[self.arrangement.bodies.index(self.arrangement.sensors[0].row[0][0])]
        longest = max(s.y.shape[1] for s in self.experiment.segments) / rate
        return Scale(
            deformation,
            rate_,
            static,
            force,
            (float(hz.min()), float(hz.max())),
            longest,
            values[0][seen],
            SHOWN * rate,
        )

    def columns(
        self, fitted: RingDownFit, terms: Sequence[Term], ringing: Sequence[Term]
    ) -> Iterable[Iterable[Columns]]:
        """Return the columns of all segments, in parts that may be summed side by side."""
        from analysis.mismatch.ring_downs.signatures import columns_of

        return columns_of(fitted, terms, ringing)

    def second_impact(self, fitted: RingDownFit, mechanism: SecondImpact) -> Score:
        """Return the score of a second impact, its delay anywhere in each segment."""
        from analysis.mismatch.ring_downs.second_impact import second_impact_score

        return second_impact_score(fitted, mechanism)

    def unmodelled(self, fitted: RingDownFit) -> tuple[list[float], float]:
        """Return the p-values of the residual's power by frequency and by time, and what is beyond noise in lines."""
        from analysis.mismatch.evidence.excess import excess_by_frequency, excess_by_time

        bins = excess_by_frequency(fitted)
        return [bins.p_value, excess_by_time(fitted).p_value], bins.gain

    def precision(self, fitted: RingDownFit) -> Real:
        """Return the inverse variance of all constants: none for those of the loads, which nothing declares."""
        rig = [1 / p.uncertainty**2 for p in fitted.arrangement.parameters if p.scope != LOAD]
        return np.array(rig + [0.0] * fitted.constants.load.size)


@dataclass(frozen=True, slots=True)
class RingDownFit(Fit):
    """A fit of ring-downs.

    Attributes
    ----------
    problem
        What was fitted.
    amplitudes, coefficients
        Of each segment: modal amplitudes, and all free coefficients.
    segments
        What was fitted, with the time of the tap and of a second impact as they were found.
    substeps
        Of a sample, in which extra forces were computed: what is predicted with the fit is computed likewise.
    """

    problem: RingDowns
    modes: tuple[Sensitivity, ...]
    responses: tuple[Response, ...]
    coefficients: tuple[Real, ...]
    amplitudes: tuple[Complex, ...]
    segments: tuple[Segment, ...]
    substeps: int = SUBSTEPS

    def force_ratios(self) -> Real:
        """Return (segments,) the largest dynamic force after the pulse over the preload of the element that carries it.

        By the fitted linear rig; NaN without a preload.
        """
        ratios = np.full(len(self.segments), np.nan)
        elements, rate = self.arrangement.elements, self.problem.experiment.sample_rate_hz
        for place in [i for i, e in enumerate(elements) if e.preload][:1]:
            names, t = (elements[place].stiffness, elements[place].damping), np.arange(int(EARLY_S * rate)) / rate
            for i, (segment, amplitudes) in enumerate(zip(self.segments, self.amplitudes, strict=True)):
                values, to = self.constants.at(segment.group), self.responded(segment.group)
                moved = zip(names, to.motion(amplitudes, place, t), strict=True)
                force = sum(values[name] * one for name, one in moved if name is not None)
                if segment.preload_n > 0:
                    ratios[i] = float(np.abs(force).max()) / segment.preload_n
        return ratios

    def rms(self) -> Real:
        """Return (segments,) rms of each segment's residual, m/s2."""
        deviations = np.array([m.deviation for m in self.problem.experiment.noise])[:, None]
        return np.array([np.sqrt(np.mean((r * deviations) ** 2)) for r in self.residuals])

    @property
    def only_laws(self) -> bool:
        """Whether force laws, and nothing else, act beside the linear rig."""
        return bool(self.terms) and all(isinstance(t.mechanism, ForceLaw) for t in self.terms)

    def responded(self, group: int) -> Response:
        """Return the response to forces in the elements at a load."""
        if self.responses[group] is not None:
            return self.responses[group]
        return response(self.arrangement, self.constants.at(group), self.modes[group].rig, self.problem.analog)

    def run(self, number: int) -> Run:
        """Return with what a segment is predicted."""
        segment = self.segments[number]
        values, to = self.constants.at(segment.group), self.responses[segment.group]
        return segment, Variant(self.terms, self.amplitudes[number], values, to)

    def added(self) -> AddedResponse:
        """Return what computes the terms' part of the segments."""
        return AddedResponse(self.problem, self.terms, self.substeps)
