"""What mechanisms do to ring-downs to first order, about the fitted linear motion and before projection."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from analysis.mismatch.parameters import Term
from analysis.mismatch.problem import Columns, Rung
from analysis.mismatch.ring_downs.modes import slope_columns
from analysis.mismatch.ring_downs.problem import RingDownFit
from analysis.mismatch.ring_downs.response import responses, whiten
from analysis.mismatch.ring_downs.ringing import families, rung
from sim_backend.arrays import Real
from sim_backend.force_law import MEMORY, along
from sim_backend.mechanisms.kinds import AtRest, ChannelDistortion, ForceLaw
from sim_backend.modal_response import parabolas

SUBSTEPS = 2  # of a sample
PARTS = 2  # in which segments are gone through side by side


class Signatures:
    """Of all segments of a fit; ``terms`` add bodies or tones, which ring on by themselves in every segment."""

    def __init__(self, fitted: RingDownFit, terms: Sequence[Term]):
        self.fitted = fitted
        self.rate = fitted.problem.experiment.sample_rate_hz
        self.to = [fitted.responded(g) for g in range(len(fitted.modes))]
        self.peak = max(float(np.abs(s.raw).max()) for s in fitted.problem.experiment.segments)
        self.families = families(fitted, terms, [to.rig for to in self.to])


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
        yield Columns(where, slopes, made, fitted.residuals[number].ravel(), own, one.rung)


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
            same: dict[Any, list[int]] = {}
            for row, (_, mechanism) in enumerate(at):
                same.setdefault(mechanism.law, []).append(row)
            for law, rows in same.items():
                p = np.stack([at[row][1].packed(terms[at[row][0]].values, rest, h) for row in rows])
                forces[rows, 0] = along(law, p, d, v, begin_s, h, np.zeros(MEMORY))
            respond = responses([self.to] * len(at), [place], h, SUBSTEPS)
            found[[i for i, _ in at]] += respond(forces, parabolas(forces))[:, :, run_up:]

    def rung(self, columns: Real) -> list[Rung]:
        """Return the products of what the session's terms ring with columns (c n, m)."""
        families = self.session.families[self.segment.group]
        return rung(families, self.to.rig, self.segment, self.amplitudes, columns, self.session.rate)
