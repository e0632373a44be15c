"""What mechanisms do to ring-downs to first order, about the fitted linear motion and before projection."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.mismatch.parameters import Term
from analysis.mismatch.problem import Columns
from analysis.mismatch.ring_downs.linear import LinearRig, linear_rigs
from analysis.mismatch.ring_downs.modes import slope_columns
from analysis.mismatch.ring_downs.problem import RingDownFit
from analysis.mismatch.ring_downs.response import responses, whiten
from sim_backend.arrays import Complex, Real
from sim_backend.force_law import MEMORY, along
from sim_backend.mechanisms.kinds import AddedBody, AtRest, ChannelDistortion, ForceLaw, Tones
from sim_backend.modal_response import parabolas

SUBSTEPS = 2  # of a sample
PARTS = 2  # in which segments are gone through side by side


@dataclass(frozen=True, slots=True)
class _Change:
    """Changes of poles (p,) and gains (c, p) by an added body; poles, gains and left shapes of its own modes."""

    poles: Complex
    gains: Complex
    own_poles: Complex
    own_gains: Complex
    own_left: Complex


class Signatures:
    """Of all segments of a fit; ``terms`` add bodies or tones, which ring on by themselves in every segment."""

    def __init__(self, fitted: RingDownFit, terms: Sequence[Term]):
        self.fitted, self.terms = fitted, terms
        self.rate = fitted.problem.experiment.sample_rate_hz
        self.to = [fitted.responded(g) for g in range(len(fitted.modes))]
        self.tapped = fitted.arrangement.bodies.index(fitted.arrangement.tapped)
        self.peak = max(float(np.abs(s.raw).max()) for s in fitted.problem.experiment.segments)
        self.changes = [self._changes(t) for t in terms]

    def _changes(self, term: Term) -> list[_Change]:
        """Return what a body that is added changes at every load."""
        if not isinstance(term.mechanism, AddedBody):
            return []
        fitted, experiment = self.fitted, self.fitted.problem.experiment
        arrangement = term.mechanism.extend(fitted.arrangement, term.values, term.place)
        groups = len(fitted.constants.load)
        values = {k: np.full(groups, v) for k, v in arrangement.declared().items()} | fitted.constants.stacked()
        rigs = linear_rigs(arrangement, values, fitted.problem.analog, experiment.noise, self.rate)
        return [_change(rig, to.rig) for rig, to in zip(rigs, self.to, strict=True)]


def _change(rig: LinearRig, base: LinearRig) -> _Change:
    taken: list[int] = []
    for s in base.poles:
        order = np.argsort(np.abs(rig.poles - s))
        taken.append(next(int(i) for i in order if int(i) not in taken))
    rest = [i for i in range(len(rig.poles)) if i not in taken]
    return _Change(
        rig.poles[taken] - base.poles, rig.gains[:, taken] - base.gains, rig.poles[rest], rig.gains[:, rest],
        rig.left[:, rest],
    )  # fmt: skip


def columns_of(fitted: RingDownFit, terms: Sequence[Term], ringing: Sequence[Term]) -> list[Iterator[Columns]]:
    """Return the columns of all segments, always in the same parts."""
    signatures = Signatures(fitted, ringing)
    count = len(fitted.segments)
    parts = [range(i, min(i + count // PARTS + 1, count)) for i in range(0, count, count // PARTS + 1)]
    return [_part(signatures, terms, numbers) for numbers in parts]


def _part(signatures: Signatures, terms: Sequence[Term], numbers: Sequence[int]) -> Iterator[Columns]:
    fitted = signatures.fitted
    nuisance = fitted.problem.nuisance(fitted.terms)
    common = fitted.constants.rig.size
    each = fitted.constants.load.shape[1]
    for number in numbers:
        one = SegmentSignatures(signatures, number)
        segment = one.segment
        modes = fitted.modes[segment.group]
        own, _ = nuisance.basis(modes, segment)
        slopes = slope_columns(modes, fitted.amplitudes[number], segment, signatures.rate).reshape(len(own), -1)
        made = one.shared(terms).reshape(len(terms), -1).T
        where = np.r_[np.arange(common), common + segment.group * each + np.arange(each)]
        yield Columns(where, slopes, made, fitted.residuals[number].ravel(), own, one.ringing)


class SegmentSignatures:
    """Of one segment."""

    def __init__(self, session: Signatures, number: int):
        fitted = session.fitted
        self.session, self.noise = session, fitted.problem.experiment.noise
        self.segment, self.amplitudes = fitted.segments[number], fitted.amplitudes[number]
        self.to = session.to[self.segment.group]
        self.values = fitted.constants.at(self.segment.group)
        self.t: Real = np.arange(self.segment.y.shape[1]) / session.rate
        self.waves = np.exp(np.outer(self.t, self.to.rig.poles)) * (self.to.rig.weight * self.amplitudes)
        self.clean = (self.to.rig.filtered @ self.waves.T).real

    def shared(self, terms: Sequence[Term]) -> Real:
        """Return (terms, c, n) what force laws and sensor chains do."""
        found = np.zeros((len(terms), *self.clean.shape))
        self._laws(terms, found)
        own = max(float(np.abs(self.segment.raw).max()), float(np.abs(self.clean).max()))
        for out, term in zip(found, terms, strict=True):
            if isinstance(term.mechanism, ChannelDistortion):
                values = dict(term.values) | {"peak": self.session.peak if term.values.get("of_session") else own}
                rows = self.clean[list(term.place)]
                out[list(term.place)] += term.mechanism.distort(rows, values, self.session.rate) - rows
        return whiten(found, self.noise)

    def _laws(self, terms: Sequence[Term], found: Real) -> None:
        """Add what the forces of laws do, each along the fitted motion of its elements."""
        run_up, rate = self.segment.run_up, self.session.rate
        h = 1 / rate / SUBSTEPS
        lead = run_up / rate
        begin_s = self.segment.start_s - lead
        t = np.asarray(np.arange((self.t.size - 1 + run_up) * SUBSTEPS + 1) * h, np.float64)
        elements = self.session.fitted.arrangement.elements
        acting: dict[int, list[tuple[int, ForceLaw]]] = {}
        for i, term in enumerate(terms):
            if isinstance(term.mechanism, ForceLaw):
                for place in term.place:
                    acting.setdefault(place, []).append((i, term.mechanism))
        for place, at in acting.items():
            d, v = self.to.motion(self.amplitudes, place, t - lead)
            forces = np.empty((len(at), 1, t.size))
            rest = AtRest.of(elements[place], self.values, self.segment.preload_n)
            for out, (i, mechanism) in zip(forces[:, 0], at, strict=True):
                p = mechanism.packed(terms[i].values, rest, h)
                out[:] = along(mechanism.law, p, d, v, begin_s, h, np.zeros(MEMORY))
            respond = responses([self.to] * len(at), [place], h, SUBSTEPS)
            found[[i for i, _ in at]] += respond(forces, parabolas(forces))[:, :, run_up:]

    def ringing(self, index: int) -> tuple[Real, Real]:
        """Return waves (k, c n) of coefficients of the segment's own, and what the session's term does (c n,)."""
        term = self.session.terms[index]
        if isinstance(term.mechanism, Tones):
            return self._lines(term.mechanism.lines(term.values)), np.zeros(self.clean.size)
        base, change = self.to.rig, self.session.changes[index][self.segment.group]
        shared = (change.gains @ self.waves.T + ((base.gains * change.poles) @ self.waves.T) * self.t).real
        if term.phase_locked:
            tapped = self.session.tapped
            b = (
                self.amplitudes[0] * change.own_left[tapped] / base.left[tapped, 0]
                * np.exp((change.own_poles - base.poles[0]) * self.segment.since_tap_s)
            )  # fmt: skip
            rung = (change.own_gains @ (np.exp(np.outer(change.own_poles, self.t)) * (2 * b)[:, None])).real
            return np.zeros((0, self.clean.size)), (shared + rung).ravel()
        return self._waves(change.own_poles, change.own_gains.T), shared.ravel()

    def _lines(self, lines: Sequence[float]) -> Real:
        poles = 2j * np.pi * np.array(lines)
        return self._waves(poles, np.stack([m.gain(poles, self.session.rate) for m in self.noise], axis=1))

    def _waves(self, poles: Complex, gains: Complex) -> Real:
        """Return (2 k, c n) cosine and sine of each pole with its gains (k, c)."""
        waves = gains[:, :, None] * np.exp(np.outer(poles, self.t))[:, None]
        return np.stack([waves.real, waves.imag], axis=1).reshape(2 * len(poles), gains.shape[1] * self.t.size)
