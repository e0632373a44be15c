"""What mechanisms do to records to first order, about the fitted linear motion and before projection."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.fit import Fit
from analysis.mismatch.linear import LinearRig, linear_rigs
from analysis.mismatch.problem import Term, acted_on, law_parameters
from analysis.mismatch.response import response, responses, whiten
from sim_backend.modal_march import MEMORY, along

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

SUBSTEPS = 2  # of a sample

_Change = tuple[Complex, Complex, Complex, Complex, Complex]
"""Changes of poles (p,) and gains (c, p); poles (k,), gains (c, k) and left shapes (k,) of the added modes."""


class Signatures:
    """Of all records of a fit; ``terms`` add bodies or tones, which ring on by themselves in every record."""

    def __init__(self, fit: Fit, terms: Sequence[Term]):
        self.fit, self.terms = fit, terms
        self.rate = fit.problem.recordings.sample_rate_hz
        self.to = [
            response(fit.arrangement, fit.constants.at(g), m.rig, fit.problem.analog) for g, m in enumerate(fit.modes)
        ]
        self.struck = fit.arrangement.bodies.index(fit.arrangement.struck)
        self.peak = max(float(np.abs(r.raw).max()) for r in fit.problem.recordings.records)
        self.changes = [self._changes(t) if t.mechanism.extend is not None else [] for t in terms]

    def of(self, number: int) -> RecordSignatures:
        """Return those of a record."""
        return RecordSignatures(self, number)

    def _changes(self, term: Term) -> list[_Change]:
        """Return what a body that is added changes at every load."""
        fit, recordings = self.fit, self.fit.problem.recordings
        arrangement = term.mechanism.extend(fit.arrangement, term.values)  # type: ignore[misc]
        known = fit.constants.stacked()
        groups = len(fit.constants.load)
        values = {k: np.full(groups, v) for k, v in arrangement.declared().items()} | known
        rigs = linear_rigs(arrangement, values, fit.problem.analog, recordings.noise, self.rate)
        return [self._change(rig, to.rig) for rig, to in zip(rigs, self.to, strict=True)]

    def _change(self, rig: LinearRig, base: LinearRig) -> _Change:
        taken: list[int] = []
        for s in base.poles:
            order = np.argsort(np.abs(rig.poles - s))
            taken.append(next(int(i) for i in order if int(i) not in taken))
        rest = [i for i in range(len(rig.poles)) if i not in taken]
        return (
            rig.poles[taken] - base.poles,
            rig.gains[:, taken] - base.gains,
            rig.poles[rest],
            rig.gains[:, rest],
            rig.left[self.struck, rest],
        )


class RecordSignatures:
    """Of one record."""

    def __init__(self, session: Signatures, number: int):
        fit = session.fit
        self.session, self.noise = session, fit.problem.recordings.noise
        self.record, self.amplitudes = fit.records[number], fit.amplitudes[number]
        self.to = session.to[self.record.group]
        self.values = fit.constants.at(self.record.group)
        self.t: Real = np.arange(self.record.y.shape[1]) / session.rate
        self.waves = np.exp(np.outer(self.t, self.to.rig.poles)) * (self.to.rig.weight * self.amplitudes)
        self.clean = (self.to.rig.filtered @ self.waves.T).real

    def shared(self, terms: Sequence[Term]) -> Real:
        """Return (terms, c, n) what force laws and sensor chains do."""
        found = np.zeros((len(terms), *self.clean.shape))
        self._laws(terms, found)
        for out, term in zip(found, terms, strict=True):
            if term.mechanism.distort is not None:
                values = dict(term.values)
                own = max(float(np.abs(self.record.raw).max()), float(np.abs(self.clean).max()))
                values["peak"] = self.session.peak if values.get("of_session") else own
                out += term.mechanism.distort(self.clean, values, self.session.rate) - self.clean
        return whiten(found, self.noise)

    def _laws(self, terms: Sequence[Term], found: Real) -> None:
        """Add what the forces of laws do, each along the fitted motion of its elements."""
        run_up, rate = self.record.run_up, self.session.rate
        h = 1 / rate / SUBSTEPS
        lead = run_up / rate
        begun = self.record.start_s - lead
        t = np.asarray(np.arange((self.t.size - 1 + run_up) * SUBSTEPS + 1) * h, np.float64)
        elements = self.session.fit.arrangement.elements
        acting: dict[int, list[int]] = {}
        for i, term in enumerate(terms):
            if term.mechanism.law is not None or term.mechanism.shape is not None:
                for place in acted_on(term, self.session.fit.arrangement):
                    acting.setdefault(place, []).append(i)
        for place, at in acting.items():
            d, v = self.to.motion(self.amplitudes, place, t - lead)
            forces = np.empty((len(at), 1, t.size))
            for out, i in zip(forces[:, 0], at, strict=True):
                mechanism = terms[i].mechanism
                if mechanism.shape is not None:
                    out[:] = mechanism.shape(d, v, np.asarray(begun + t, np.float64), terms[i].values)
                else:
                    p = law_parameters(terms[i], elements[place], self.values, self.record, h)
                    out[:] = along(mechanism.law, p, d, v, begun, h, np.zeros(MEMORY))
            respond = responses([self.to] * len(at), [place], h, SUBSTEPS)
            found[at] += respond(forces)[:, :, run_up:]

    def ringing(self, index: int) -> tuple[Real, Real]:
        """Return what the session's term does: (c, n), and waves (k, c, n) of coefficients of the record's own."""
        term = self.session.terms[index]
        if term.mechanism.extend is None:
            return np.zeros_like(self.clean), self._lines(term)
        base = self.to.rig
        poles, gains, own_poles, own_gains, own_left = self.session.changes[index][self.record.group]
        shared = (gains @ self.waves.T + ((base.gains * poles) @ self.waves.T) * self.t).real
        if term.mechanism.tied:
            b = (
                self.amplitudes[0]
                * own_left
                / base.left[self.session.struck, 0]
                * np.exp((own_poles - base.poles[0]) * self.record.since_tap_s)
            )
            rung = (own_gains @ (np.exp(np.outer(own_poles, self.t)) * (2 * b)[:, None])).real
            return shared + rung, np.zeros((0, *shared.shape))
        return shared, self._waves(own_poles, own_gains.T)

    def _lines(self, term: Term) -> Real:
        poles = 2j * np.pi * np.array(term.mechanism.lines(term.values))  # type: ignore[misc]
        return self._waves(poles, np.stack([m.gain(poles, self.session.rate) for m in self.noise], axis=1))

    def _waves(self, poles: Complex, gains: Complex) -> Real:
        """Return (2 k, c, n) cosine and sine of each pole with its gains (k, c)."""
        waves = gains[:, :, None] * np.exp(np.outer(poles, self.t))[:, None]
        return np.stack([waves.real, waves.imag], axis=1).reshape(-1, *waves.shape[1:])
