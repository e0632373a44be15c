"""What the linear rig makes of the spectra of pieces of recordings, and how that changes with its constants.

A piece of a recording, weighed by an exponential, has the spectrum of the rig at ``s = i omega + alpha``: of its
response to the measured inputs, and to the state that it begins and ends with, which is found by linear least squares.
So it makes no difference whether a recording is driven or free, or where a piece begins.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from analysis.mismatch.recordings.pieces import Piece, Pieces, held
from analysis.mismatch.rig_description import DescribedRig
from sim_backend.arrangement import DERIVATIVES, LOAD
from sim_backend.arrays import Complex, Real

EVALUATIONS: Final = 60
TYPICAL_RATIO: Final = 0.02  # damping ratio that is usual
WEAK_PRIOR: Final = 1e-3  # relative noise beside which constants stay within a factor of e of what is usual
RELATIVE_NOISE: Final = 0.02  # that declared constants are weighed against
POLYNOMIAL: Final = 3  # terms, in the frequency, of what begins and ends at samples and not at once
MOST_EXPONENT: Final = 40.0
LOGARITHMIC: Final = ("kg", "N/m", "N s/m")
POWER_OF_TIME: Final = {"kg": 0, "N/m": 2, "N s/m": 1}  # by which constants of a faster rig are larger
FASTER: Final = 0.7  # deviation of the logarithm of how fast rigs are that fits begin with


class Unknowns:
    """The constants that nobody knows as numbers (k,): logarithms over what is usual, then gains.

    Of those that are known to within an error the logarithms too; what is usual is then what is declared.

    Parameters
    ----------
    centre
        Angular frequency about which the rig moves, rad/s.

    Attributes
    ----------
    acting
        (masses, stiffnesses and dampings, k) one where a constant is that body's or element's.
    """

    def __init__(self, rig: DescribedRig, centre: float):
        parameters = rig.arrangement.parameters
        unknown = [p for p in parameters if not math.isfinite(p.value) or p.scope == LOAD]
        uncertain = [p for p in parameters if p.value > 0 and 0 < p.uncertainty < math.inf]
        gains = {*(d.gain for d in rig.drives), *(s.gain for s in rig.seen)}
        self.rig = rig
        self.bent = [p for p in (*unknown, *uncertain) if p.unit in LOGARITHMIC]
        self.gains = [p for p in unknown if p.name in gains]
        size = usual_sizes(rig, centre)
        self.told = told = [p in uncertain for p in self.bent]
        self.usual = np.array([math.log(p.value if t else size[p.unit]) for p, t in zip(self.bent, told, strict=True)])
        self.spread = np.array([p.uncertainty / p.value if t else 1.0 for p, t in zip(self.bent, told, strict=True)])
        self.weight = np.where(told, RELATIVE_NOISE, WEAK_PRIOR) / self.spread
        elements = rig.arrangement.elements
        owners = (*rig.arrangement.masses, *(e.stiffness for e in elements), *(e.damping for e in elements))
        self.acting = np.array([[owner == p.name for p in self.bent] for owner in owners], np.float64)
        plain = {p.name: 1.0 if p in self.gains else 0.0 for p in unknown}
        self.base = {**{p.name: p.value for p in parameters}, **plain}

    @property
    def names(self) -> list[str]:
        """Names of the constants, in the order of the numbers."""
        return [p.name for p in (*self.bent, *self.gains)]

    def drawn(self, random: np.random.Generator, count: int) -> list[Real]:
        """Return starting points: the usual values, and others about them, each of a rig that is faster or slower."""
        power = np.array([0 if told else POWER_OF_TIME[p.unit] for p, told in zip(self.bent, self.told, strict=True)])
        each = random.normal(0.0, 1.0, (count, len(self.bent))) * self.spread
        faster = random.normal(0.0, FASTER, (count, 1))
        points = each + faster * power
        points[0] = 0.0
        return list(np.column_stack([points, np.ones((count, len(self.gains)))]))

    def point(self, values: Mapping[str, float]) -> Real:
        """Return the numbers of constants, which are positive where they are logarithms."""
        bent = np.log([max(values[p.name], math.exp(-MOST_EXPONENT)) for p in self.bent]) - self.usual
        return np.concatenate([bent, [values[p.name] for p in self.gains]])

    def constants(self, x: Real) -> dict[str, float]:
        """Return the values of all constants."""
        k = len(self.bent)
        bent = self.usual + np.clip(x[:k], -MOST_EXPONENT, MOST_EXPONENT)
        values = self.base | {p.name: math.exp(v) for p, v in zip(self.bent, bent.tolist(), strict=True)}
        return values | {p.name: float(v) for p, v in zip(self.gains, x[k:], strict=True)}


def usual_sizes(rig: DescribedRig, centre: float) -> dict[str, float]:
    """Return the size, by unit, of constants of a rig that moves about an angular frequency, rad/s."""
    known = {p.name: p.value for p in rig.arrangement.parameters}
    masses = np.array([known[m] for m in rig.arrangement.masses])
    typical = float(np.nanmean(masses)) if np.any(np.isfinite(masses)) else 1.0
    return {"kg": typical, "N/m": typical * centre**2, "N s/m": 2 * TYPICAL_RATIO * typical * centre}


@dataclass(frozen=True, slots=True)
class _Matrices:
    """Matrices of the rig for some constants, and rows (.., bodies) of its elements, sensors and drives."""

    mass: Real
    damping: Real
    stiffness: Real
    elements: Real
    sensors: Real
    drives: Real

    @classmethod
    def of(cls, rig: DescribedRig, values: Mapping[str, float]) -> _Matrices:
        """Return them."""
        arrangement = rig.arrangement
        rows = (
            np.array([arrangement.vector(of.row, values) for of in found]).reshape(-1, len(arrangement.masses))
            for found in (arrangement.elements, [seen.sensor for seen in rig.seen], rig.drives)
        )
        return cls(*arrangement.matrices(values), *rows)


@dataclass(frozen=True, slots=True)
class _Linear:
    """The linear rig at the lines of pieces.

    Attributes
    ----------
    shown
        (p, lines, channels, bodies) what the channels show of a force on each body.
    compliance
        (p, lines, bodies, bodies) inverse of the dynamic stiffness.
    begun, mass
        (p, lines, bodies, bodies) and (bodies,) forces that a displacement and a speed at the beginning stand for.
    driven, pushed
        (p, lines, bodies) forces of each input for a gain of one, by the gain's name, and of all inputs.
    own
        (p, lines, channels, k) columns of a beginning, and of what the ends and an offset add.
    """

    shown: Complex
    compliance: Complex
    begun: Complex
    mass: Real
    driven: dict[str, Complex]
    pushed: Complex
    own: Complex

    @classmethod
    def of(
        cls, rig: DescribedRig, values: Mapping[str, float], at: _Matrices, pieces: Pieces, centre: float
    ) -> _Linear | None:
        """Return it for some constants; None where it has no response."""
        s, mass, rows = pieces.s[:, :, None], at.mass, at.sensors
        begun = np.asarray(s[..., None] * np.diag(mass) + at.damping, np.complex128)
        order = np.array([DERIVATIVES[seen.sensor.quantity] for seen in rig.seen])
        gains = np.array([values[seen.gain] for seen in rig.seen])
        try:
            compliance = np.asarray(np.linalg.inv(s[..., None] * begun + at.stiffness), np.complex128)
        except np.linalg.LinAlgError:
            return None
        shown = np.asarray((s**order * gains / pieces.level[:, None])[..., None] * (rows @ compliance), np.complex128)
        driven = {}
        for i, (drive, vector) in enumerate(zip(rig.drives, at.drives, strict=True)):
            u = pieces.inputs[:, :, i, None]
            driven[drive.gain] = np.asarray(u * (-mass * vector if drive.base else vector), np.complex128)
        nothing = np.zeros((*pieces.s.shape, mass.size), np.complex128)
        pushed = sum((values[gain] * one for gain, one in driven.items()), nothing)
        ends = [(s[..., None] / centre) ** i * np.eye(len(rows)) for i in (*range(POLYNOMIAL), -1)]
        own = np.concatenate([shown @ begun, shown * mass, *ends], axis=3)
        return cls(shown, compliance, begun, mass, driven, pushed, own) if np.all(np.isfinite(own)) else None

    def force(self, coefficients: Real) -> Complex:
        """Return (p, lines, bodies) all forces, those of beginnings (p, k: displacements, then speeds) among them."""
        n = self.mass.size
        displaced = np.einsum("plij,pj->pli", self.begun, coefficients[:, :n])
        return np.asarray(self.pushed + displaced + self.mass * coefficients[:, None, n : 2 * n], np.complex128)

    def showing(self, force: Complex) -> Complex:
        """Return (p, lines, channels) what the channels show of forces (p, lines, bodies)."""
        return np.asarray(np.einsum("plcn,pln->plc", self.shown, force), np.complex128)


class SpectralModel:
    """What the linear rig makes of some pieces' spectra, as a function of its unknown constants."""

    def __init__(self, unknowns: Unknowns, pieces: Sequence[Piece], centre: float):
        self.unknowns, self.pieces, self.centre = unknowns, Pieces.of(pieces), centre
        self.total = math.sqrt(sum(float(np.sum(np.abs(p.outputs) ** 2)) for p in pieces))

    def begun(self, x: Real) -> Real:
        """Return a point with the gains that fit best beside its other constants."""
        k, names = len(self.unknowns.bent), [p.name for p in self.unknowns.gains]
        if not names:
            return x
        off, slopes = self.evaluated(np.concatenate([x[:k], np.ones(len(names))]))
        # of either one input's gain or its sensor's, which multiply each other
        inputs = [i for i, name in enumerate(names) if name in {d.gain for d in self.unknowns.rig.drives}]
        solved = inputs or list(range(len(names)))
        found = np.ones(len(names))
        found[solved] -= np.linalg.lstsq(slopes[:, [k + i for i in solved]], off, rcond=1e-8)[0]
        return np.concatenate([x[:k], np.where(found == 0, 1.0, found)])

    def cost(self, x: Real) -> float:
        """Return the sum of squares at a point."""
        off, _ = self.evaluated(x)
        return float(off @ off)

    def improved(self, x: Real) -> Real:
        """Return the point that least squares leads to."""
        known: dict[bytes, tuple[Real, Real]] = {}

        def both(at: Real) -> tuple[Real, Real]:
            if at.tobytes() not in known:
                known.clear()
                left, changes = self.evaluated(at)
                weight = self.unknowns.weight / math.sqrt(left.size)
                stay = np.diag(np.concatenate([weight, np.zeros(len(self.unknowns.gains))]))
                known[at.tobytes()] = np.concatenate([left, stay @ at]), np.vstack([changes, stay])
            return known[at.tobytes()]

        if not x.size:
            return x

        def off(at: Real) -> Real:
            return both(at)[0]

        def slopes(at: Real) -> Real:
            return both(at)[1]

        return np.asarray(least_squares(off, x, slopes, method="lm", max_nfev=EVALUATIONS).x, np.float64)

    def evaluated(self, x: Real) -> tuple[Real, Real]:
        """Return what is left of the spectra (m,), over all of them, and its slopes (m, k)."""
        values = self.unknowns.constants(x)
        at = _Matrices.of(self.unknowns.rig, values)
        parts = [self._of_pieces(values, at, pieces) for pieces in self.pieces]
        off = np.concatenate([o for o, _ in parts]) / self.total
        slopes = np.concatenate([s for _, s in parts]) / self.total
        if np.all(np.isfinite(off)) and np.all(np.isfinite(slopes)):
            return off, slopes
        return np.full(off.shape, 10.0 / math.sqrt(off.size)), np.zeros(slopes.shape)

    def made(self, x: Real, coefficients: Real) -> Complex:
        """Return (channels, lines) what a single piece would hold with a beginning and ends of its own."""
        values, rig = self.unknowns.constants(x), self.unknowns.rig
        linear = _Linear.of(rig, values, _Matrices.of(rig, values), self.pieces[0], self.centre)
        if linear is None:
            raise ArithmeticError("the rig has no response")
        return np.asarray((linear.showing(linear.pushed) + linear.own @ coefficients)[0].T, np.complex128)

    def _of_pieces(self, values: Mapping[str, float], at: _Matrices, pieces: Pieces) -> tuple[Real, Real]:
        """Return what is left of pieces beside their own beginnings and ends, and the slopes of that."""
        linear = _Linear.of(self.unknowns.rig, values, at, pieces, self.centre)
        if linear is None:
            samples = 2 * pieces.outputs.size
            return np.full(samples, np.inf), np.zeros((samples, len(self.unknowns.names)))
        u, size, v = np.linalg.svd(_real(linear.own), full_matrices=False)
        kept = size > 1e-9 * size[:, :1]
        u, v = u * kept[:, None], v * (kept / np.where(kept, size, 1.0))[:, :, None]
        across = u.swapaxes(1, 2)
        target = _real((pieces.outputs - linear.showing(linear.pushed))[..., None])
        found = across @ target
        slopes = _real(self._changes(values, at, pieces, linear, (v.swapaxes(1, 2) @ found)[..., 0]))
        count, rows, k = slopes.shape
        return (target - u @ found).ravel(), -(slopes - u @ (across @ slopes)).reshape(count * rows, k)

    def _changes(
        self, values: Mapping[str, float], at: _Matrices, pieces: Pieces, linear: _Linear, coefficients: Real
    ) -> Complex:
        """Return (p, lines, channels, k) how the model changes with each unknown: logarithms, then gains."""
        rig, s, shown, n = self.unknowns.rig, pieces.s[:, :, None], linear.shown, linear.mass.size
        position, speed = coefficients[:, None, :n], coefficients[:, None, n : 2 * n]
        force = linear.force(coefficients)
        moved = (linear.compliance @ force[..., None])[..., 0]
        inertial = s**2 * moved - s * position - speed
        for i, (drive, vector) in enumerate(zip(rig.drives, at.drives, strict=True)):
            if drive.base:
                inertial = inertial + values[drive.gain] * pieces.inputs[:, :, i, None] * vector
        across, deformed = shown @ at.elements.T, moved @ at.elements.T
        rate = s * deformed - position @ at.elements.T
        parts = shown * inertial[:, :, None], across * deformed[:, :, None], across * rate[:, :, None]
        sizes = np.array([values[p.name] for p in self.unknowns.bent])
        found = [-np.concatenate(parts, axis=3) @ (self.unknowns.acting * sizes)]
        pushed = linear.showing(force)
        for p in self.unknowns.gains:
            if p.name in linear.driven:
                change = linear.showing(linear.driven[p.name])
            else:
                change = pushed * np.array([seen.gain == p.name for seen in rig.seen]) / values[p.name]
            found.append(change[..., None])
        return np.concatenate(found, axis=3)


def responses(rig: DescribedRig, values: Mapping[str, float], hz: Real, rate_hz: float) -> Complex:
    """Return (lines, channels, inputs) what the channels show of each input of one, at frequencies above zero.

    Raises
    ------
    numpy.linalg.LinAlgError
        The rig has no response.
    """
    at = _Matrices.of(rig, values)
    s = np.asarray(2j * np.pi * hz[:, None], np.complex128)
    dynamic = s[:, None] ** 2 * np.diag(at.mass) + s[:, None] * at.damping + at.stiffness
    pushed = np.array([
        values[d.gain] * (-at.mass * row if d.base else row) for d, row in zip(rig.drives, at.drives, strict=True)
    ])  # fmt: skip
    order = np.array([DERIVATIVES[seen.sensor.quantity] for seen in rig.seen])
    gains = np.array([values[seen.gain] for seen in rig.seen])
    moved = np.linalg.solve(dynamic, np.broadcast_to(pushed.T, (hz.size, *pushed.T.shape)))
    seen = (gains * s**order)[:, :, None] * (at.sensors @ moved)
    return np.asarray(seen * held(s[:, 0] / rate_hz, rig.hold)[:, None, None], np.complex128)


def _real(columns: Complex) -> Real:
    """Return (p, lines, channels, k) complex columns as real ones, (p, 2 lines channels, k), of the same size."""
    pieces, lines, channels, k = columns.shape
    flat = columns.reshape(pieces, lines * channels, k)
    return np.concatenate([flat.real, flat.imag], axis=1)
