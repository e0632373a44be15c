"""Starting values of a fit: unknown constants of the linear rig, from spectra of pieces of the recordings.

A piece of a recording, weighed by an exponential, has the spectrum of the rig at ``s = i omega + alpha``: of its
response to the measured inputs, and to the state that it begins and ends with, which is found by linear least squares.
So it makes no difference whether a recording is driven or free, or where a piece begins. A large ``alpha`` makes
resonances broad, and they are found from far away; it is then taken back until whole recordings are looked at.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from analysis.mismatch.recordings.recorded import Recorded, level
from analysis.mismatch.rig_description import DescribedRig, Hold
from analysis.session import AnalysisError
from sim_backend.arrangement import DERIVATIVES
from sim_backend.arrays import Complex, Real

DRAWS: Final = 200  # random starting points
KEPT: Final = (10, 4, 2, 1)  # of them, after each stage
STAGES: Final = (0.15, 0.03, 0.006, 0.0)  # weights alpha, of the spectra's mean angular frequency
FADED: Final = 6.0  # time constants of the exponential that a piece is long
PIECES: Final = 6  # that are looked at in a stage
LINES, FEWEST_LINES = 400, 80  # of all pieces' spectra together, of each
EVALUATIONS: Final = 60
SEED: Final = 7
TYPICAL_RATIO: Final = 0.02  # damping ratio about which starting points are drawn
WEAK_PRIOR: Final = 1e-3  # relative noise beside which constants stay within a factor of e of what is usual
RELATIVE_NOISE: Final = 0.02  # that declared constants are weighed against
POLYNOMIAL: Final = 3  # terms, in the frequency, of what begins and ends at samples and not at once
MOST_EXPONENT: Final = 40.0
LOGARITHMIC: Final = ("kg", "N/m", "N s/m")


def start_values(rig: DescribedRig, recordings: Sequence[Recorded]) -> tuple[dict[str, float], float]:
    """Return a value for every constant of the rig, and the highest frequency of it, Hz.

    Raises
    ------
    AnalysisError
        The rig as described neither swings nor comes to rest.
    """
    values = _from_spectra(rig, recordings)
    mass, damping, stiffness = rig.arrangement.matrices(values)
    highest = float(np.abs(_poles(mass, damping, stiffness)).max()) / (2 * math.pi)
    if not 0 < highest < math.inf:
        raise AnalysisError(
            f"{recordings[0].source}: {rig.name} as described neither swings nor comes to rest; check its constants"
        )
    return values, min(highest, 0.5 * recordings[0].rate_hz)


def _from_spectra(rig: DescribedRig, recordings: Sequence[Recorded]) -> dict[str, float]:
    """Return the constants with which the linear rig is nearest to the recordings' spectra."""
    centre = _centre(recordings)
    unknowns = _Unknowns(rig, centre)
    points = unknowns.drawn(np.random.default_rng(SEED))
    longest = max(r.samples / r.rate_hz for r in recordings)
    for share, kept in zip(STAGES, KEPT, strict=True):
        alpha = share * centre
        if alpha and alpha * longest < FADED:
            continue  # all of it is a shorter piece than that
        model = SpectralModel(unknowns, pieces_of(recordings, alpha, rig.hold), centre)
        if len(points) > KEPT[0]:
            points = sorted((model.begun(x) for x in points), key=model.cost)[: KEPT[0]]
        points = sorted((model.improved(x) for x in points), key=model.cost)[:kept]
    return unknowns.constants(points[0])


def _poles(mass: Real, damping: Real, stiffness: Real) -> Complex:
    n = len(mass)
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness / mass[:, None], -damping / mass[:, None]]])
    return np.asarray(np.linalg.eigvals(a), np.complex128)


@dataclass(frozen=True, slots=True)
class Piece:
    """Spectra of a piece of a recording at ``s`` (lines,): channels (c, lines) over their levels, inputs."""

    s: Complex
    outputs: Complex
    inputs: Complex
    level: Real

    @classmethod
    def of(cls, recorded: Recorded, at: slice, alpha: float, hold: Hold, lines: int) -> Piece:
        """Return the strongest lines of the samples ``at``, weighed by ``exp(-alpha t)``."""
        levels, rate = level(recorded), recorded.rate_hz
        y = recorded.outputs[:, at] - recorded.outputs.mean(axis=1, keepdims=True)
        u = recorded.inputs[:, at]
        n = y.shape[1]
        weight = np.exp(-alpha * np.arange(n) / rate) / rate
        outputs = np.fft.rfft(y * weight, axis=1) / levels[:, None]
        inputs = np.fft.rfft((u - recorded.inputs.mean(axis=1, keepdims=True)) * weight, axis=1)
        power = np.sum(np.abs(outputs) ** 2, axis=0)
        power[0] = 0.0
        used = np.sort(np.argsort(power[: int(0.9 * power.size)])[::-1][:lines])
        s = np.asarray(alpha + 2j * np.pi * np.fft.rfftfreq(n, 1 / rate)[used], np.complex128)
        return cls(s, outputs[:, used], inputs[:, used] * held(s / rate, hold), levels)


def held(sh: Complex, hold: Hold) -> Complex:
    """Return what an input's spectrum is multiplied by for what it does between samples, at ``s`` times their time."""
    if hold == "band-limited":
        return np.ones(sh.size, np.complex128)
    step = -np.expm1(-sh) / sh
    return np.asarray(step if hold == "zero" else step**2 * np.exp(sh), np.complex128)


def pieces_of(recordings: Sequence[Recorded], alpha: float, hold: Hold) -> list[Piece]:
    """Return the pieces that are looked at with a weight: of all recordings, where most happens in them."""
    found: list[tuple[float, Recorded, slice]] = []
    for recorded in recordings:
        first, last = recorded.fitted.start, recorded.fitted.stop
        first, last = max(first, recorded.edge), min(last, recorded.samples - recorded.edge)
        longest = last - first
        size = longest if alpha == 0 else min(longest, math.ceil(FADED / alpha * recorded.rate_hz))
        y = recorded.outputs[:, first:last] / level(recorded)[:, None]
        for begin in np.unique(np.linspace(0, longest - size, 1 if size == longest else PIECES).astype(int)).tolist():
            energy = float(np.sum(y[:, begin : begin + size] ** 2))
            found.append((energy, recorded, slice(first + begin, first + begin + size)))
    found = sorted(found, key=lambda piece: -piece[0])[:PIECES]
    lines = max(LINES // len(found), FEWEST_LINES)
    return [Piece.of(recorded, at, alpha, hold, lines) for _, recorded, at in found]


def _centre(recordings: Sequence[Recorded]) -> float:
    """Return the mean angular frequency of the channels' power, rad/s."""
    total, moment = 0.0, 0.0
    for recorded in recordings:
        y = recorded.outputs[:, recorded.fitted] / level(recorded)[:, None]
        power = np.sum(np.abs(np.fft.rfft(y - y.mean(axis=1, keepdims=True), axis=1)) ** 2, axis=0)
        omega = 2 * math.pi * np.fft.rfftfreq(y.shape[1], 1 / recorded.rate_hz)
        total, moment = total + float(power.sum()), moment + float(omega @ power)
    return moment / max(total, 1e-300) or 1.0


class _Unknowns:
    """The constants that nobody knows as numbers (k,): logarithms over what is usual, then gains."""

    def __init__(self, rig: DescribedRig, centre: float):
        parameters = rig.arrangement.parameters
        unknown = [p for p in parameters if not math.isfinite(p.value)]
        uncertain = [p for p in parameters if p.value > 0 and 0 < p.uncertainty < math.inf]
        self.rig = rig
        self.bent = [p for p in (*unknown, *uncertain) if p.unit in LOGARITHMIC]
        self.gains = [p for p in unknown if p.name in {*(d.gain for d in rig.drives), *(s.gain for s in rig.seen)}]
        known = {p.name: p.value for p in parameters}
        masses = np.array([known[m] for m in rig.arrangement.masses])
        typical = float(np.nanmean(masses)) if np.any(np.isfinite(masses)) else 1.0
        size = {"kg": typical, "N/m": typical * centre**2, "N s/m": 2 * TYPICAL_RATIO * typical * centre}
        self.usual = np.array([math.log(p.value if p.value > 0 else size[p.unit]) for p in self.bent])
        self.spread = np.array([p.uncertainty / p.value if p.value > 0 else 1.0 for p in self.bent])
        self.weight = np.array([RELATIVE_NOISE if p.value > 0 else WEAK_PRIOR for p in self.bent]) / self.spread
        self.base = {**known, **{p.name: 1.0 if p in self.gains else 0.0 for p in unknown}}

    def drawn(self, random: np.random.Generator) -> list[Real]:
        """Return starting points: the usual values, and others about them."""
        count = DRAWS if self.bent else 1
        each = [random.normal(0.0, 1.0, len(self.bent)) * self.spread * (i > 0) for i in range(count)]
        return [np.concatenate([q, np.ones(len(self.gains))]) for q in each]

    def constants(self, x: Real) -> dict[str, float]:
        """Return the values of all constants."""
        k = len(self.bent)
        bent = self.usual + np.clip(x[:k], -MOST_EXPONENT, MOST_EXPONENT)
        values = self.base | {p.name: math.exp(v) for p, v in zip(self.bent, bent.tolist(), strict=True)}
        return values | {p.name: float(v) for p, v in zip(self.gains, x[k:], strict=True)}


class SpectralModel:
    """What the linear rig makes of some pieces' spectra, as a function of its unknown constants."""

    def __init__(self, unknowns: _Unknowns, pieces: Sequence[Piece], centre: float):
        self.unknowns, self.pieces, self.centre = unknowns, pieces, centre
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
        parts = [self._of_piece(values, piece) for piece in self.pieces]
        off = np.concatenate([o for o, _ in parts]) / self.total
        slopes = np.concatenate([s for _, s in parts]) / self.total
        if np.all(np.isfinite(off)) and np.all(np.isfinite(slopes)):
            return off, slopes
        return np.full(off.shape, 10.0 / math.sqrt(off.size)), np.zeros(slopes.shape)

    def _of_piece(self, values: Mapping[str, float], piece: Piece) -> tuple[Real, Real]:
        """Return what is left of a piece beside its own beginning and end, and the slopes of that."""
        rig, s = self.unknowns.rig, piece.s
        mass, damping, stiffness = rig.arrangement.matrices(values)
        n, k = mass.size, len(self.unknowns.bent) + len(self.unknowns.gains)
        inertia = np.diag(mass)
        dynamic = (s**2)[:, None, None] * inertia + s[:, None, None] * damping + stiffness
        rows = np.array([rig.arrangement.vector(seen.sensor.row, values) for seen in rig.seen])
        order = np.array([DERIVATIVES[seen.sensor.quantity] for seen in rig.seen])
        gains = np.array([values[seen.gain] for seen in rig.seen])
        lines, channels = s.size, len(rows)
        failed = np.full(2 * lines * channels, np.inf), np.zeros((2 * lines * channels, k))
        try:
            shown = (s[:, None] ** order * gains / piece.level)[:, :, None] * (rows @ np.linalg.inv(dynamic))
        except np.linalg.LinAlgError:
            return failed
        pushed = np.zeros((lines, n), np.complex128)
        driven = {}
        for drive, u in zip(rig.drives, piece.inputs, strict=True):
            vector = rig.arrangement.vector(drive.row, values)
            one = u[:, None] * (-mass * vector if drive.base else vector)
            driven[drive.gain], pushed = one, pushed + values[drive.gain] * one
        begun = s[:, None, None] * inertia + damping
        own = np.concatenate([shown @ begun, shown * mass, self._ends(s, channels)], axis=2)
        if not np.all(np.isfinite(own)):
            return failed
        u, size, v = np.linalg.svd(_real(own), full_matrices=False)
        kept = size > 1e-9 * size[0]
        u, v = u[:, kept], v[kept] / size[kept][:, None]
        target = _real((piece.outputs.T - np.einsum("lcn,ln->lc", shown, pushed))[:, :, None])[:, 0]
        coefficients = v.T @ (u.T @ target)
        force = pushed + begun @ coefficients[:n] + mass * coefficients[n : 2 * n]
        moved = np.asarray(np.linalg.solve(dynamic, force[:, :, None])[:, :, 0], np.complex128)
        changes = self._changes(values, piece, (shown, moved, coefficients), driven)
        slopes = _real(np.stack(changes, axis=2)) if changes else np.zeros((target.size, 0))
        return target - u @ (u.T @ target), -(slopes - u @ (u.T @ slopes))

    def _changes(
        self,
        values: Mapping[str, float],
        piece: Piece,
        at: tuple[Complex, Complex, Real],
        driven: Mapping[str, Complex],
    ) -> list[Complex]:
        """Return (lines, channels) how the model changes with each unknown: logarithms, then gains."""
        rig, s = self.unknowns.rig, piece.s
        shown, moved, coefficients = at
        n = len(rig.arrangement.bodies)
        position, speed = coefficients[:n], coefficients[n : 2 * n]
        found: list[Complex] = []
        for p in self.unknowns.bent:
            change = np.zeros(shown.shape[:2], np.complex128)
            for i, name in enumerate(rig.arrangement.masses):
                if name == p.name:
                    inertial = s**2 * moved[:, i] - s * position[i] - speed[i]
                    for drive, u in zip(rig.drives, piece.inputs, strict=True):
                        if drive.base:
                            inertial = inertial + values[drive.gain] * u * rig.arrangement.vector(drive.row, values)[i]
                    change = change - shown[:, :, i] * inertial[:, None]
            for element in rig.arrangement.elements:
                row = rig.arrangement.vector(element.row, values)
                if element.stiffness == p.name:
                    change = change - (shown @ row) * (moved @ row)[:, None]
                if element.damping == p.name:
                    change = change - (shown @ row) * (s * (moved @ row) - row @ position)[:, None]
            found.append(values[p.name] * change)
        for p in self.unknowns.gains:
            if p.name in driven:
                found.append(np.einsum("lcn,ln->lc", shown, driven[p.name]))
                continue
            pushed = sum((values[g] * one for g, one in driven.items()), np.zeros_like(moved))
            of = np.array([seen.gain == p.name for seen in rig.seen])
            found.append(np.einsum("lcn,ln->lc", shown, pushed) * of / values[p.name])
        return found

    def _ends(self, s: Complex, channels: int) -> Complex:
        """Return (lines, channels, k) columns for what a piece's first and last sample, and an offset, add."""
        terms = [(s / self.centre) ** i for i in range(POLYNOMIAL)] + [self.centre / s]
        return np.concatenate([np.eye(channels)[None] * term[:, None, None] for term in terms], axis=2)


def _real(columns: Complex) -> Real:
    """Return (lines, channels, k) complex columns as real ones, (2 lines channels, k), of the same size."""
    flat = columns.reshape(-1, columns.shape[2])
    return np.concatenate([flat.real, flat.imag])
