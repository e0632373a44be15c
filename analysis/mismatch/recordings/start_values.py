"""Starting values of a fit: constants of the linear rig, from spectra of pieces of the recordings, and states.

Pieces of recordings are weighed by ``exp(-alpha t)``. A large ``alpha`` makes resonances broad, and they are found from
far away; it is then taken back until whole recordings are looked at.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from analysis.mismatch.recordings.pieces import Piece
from analysis.mismatch.recordings.recorded import Recorded, level
from analysis.mismatch.recordings.simulation import Simulation
from analysis.mismatch.recordings.spectral_model import SpectralModel, Unknowns
from analysis.mismatch.rig_description import DescribedRig, Hold
from analysis.session import AnalysisError
from sim_backend.arrays import Complex, Real

DRAWS: Final = 200  # random starting points
ATTEMPTS: Final = ((10, 4, 2, 2), (30, 15, 8, 4), (30, 15, 8, 4))  # of them kept after each stage
SAME: Final = 0.999  # of a minimum's cost, below which one is another minimum
AS_GOOD: Final = 4.0  # times the best cost, up to which spectra do not tell which of several minima is meant
WHITE: Final = 2.5  # mean over median of the squares that noise leaves (2.2 of white noise), up to which a start is it
STAGES: Final = (0.15, 0.03, 0.006, 0.0)  # weights alpha, of the spectra's mean angular frequency
FADED: Final = 6.0  # time constants of the exponential that a piece is long
PIECES: Final = 6  # that are looked at in a stage
LINES, FEWEST_LINES = 400, 80  # of all pieces' spectra together, of each
FIRST_PERIODS, FEWEST_FIRST = 4, 40  # of the highest mode (at least one of the lowest), samples: they tell the state
SEED: Final = 7  # of the first attempt's starting points, then one more


def start_values(rig: DescribedRig, recordings: Sequence[Recorded]) -> tuple[list[dict[str, float]], float]:
    """Return values for the constants of the rig, the likeliest first, and the highest frequency of it, Hz.

    Raises
    ------
    AnalysisError
        The rig as described neither swings nor comes to rest.
    """
    values = _from_spectra(rig, recordings)
    mass, damping, stiffness = rig.arrangement.matrices(values[0])
    highest = float(np.abs(_poles(mass, damping, stiffness)).max()) / (2 * math.pi)
    if not 0 < highest < math.inf:
        raise AnalysisError(
            f"{recordings[0].source}: {rig.name} as described neither swings nor comes to rest; check its constants"
        )
    return values, min(highest, 0.5 * recordings[0].rate_hz)


def _from_spectra(rig: DescribedRig, recordings: Sequence[Recorded]) -> list[dict[str, float]]:
    """Return the constants with which the linear rig is nearest to the recordings' spectra, and others as near."""
    centre = _centre(recordings)
    unknowns = Unknowns(rig, centre)
    longest = max(r.samples / r.rate_hz for r in recordings)
    alphas = [share * centre for share in STAGES]
    # all of it is a shorter piece than some ask for
    looked_at = [(k, alpha) for k, alpha in enumerate(alphas) if not alpha or alpha * longest >= FADED]
    stages = [(k, SpectralModel(unknowns, pieces_of(recordings, alpha, rig.hold), centre)) for k, alpha in looked_at]
    whole, found, least = stages[-1][1], list[Real](), math.inf
    for number, kept in enumerate(ATTEMPTS):
        points = unknowns.drawn(np.random.default_rng(SEED + number), DRAWS if unknowns.bent else 1)
        for k, model in stages:
            if len(points) > kept[0]:
                points = sorted((model.begun(x) for x in points), key=model.cost)[: kept[0]]
            points = _distinct(model, [model.improved(x) for x in points])[: kept[k]]
        found += points
        squares = whole.evaluated(points[0])[0] ** 2
        settled = bool(np.sum(squares) > SAME * least or np.mean(squares) < WHITE * np.median(squares))
        least = min(least, float(np.sum(squares)))
        if settled or not unknowns.bent:
            break
    return [unknowns.constants(x) for x in _distinct(whole, found) if whole.cost(x) <= AS_GOOD * least]


def _distinct(model: SpectralModel, points: Sequence[Real]) -> list[Real]:
    """Return points, the best first, without those that lie in the minimum of a better one."""
    found: list[Real] = []
    costs: list[float] = []
    for cost, point in sorted(((model.cost(x), x) for x in points), key=lambda pair: pair[0]):
        if not costs or costs[-1] < SAME * cost:
            found.append(point)
            costs.append(cost)
    return found


def _poles(mass: Real, damping: Real, stiffness: Real) -> Complex:
    n = len(mass)
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness / mass[:, None], -damping / mass[:, None]]])
    return np.asarray(np.linalg.eigvals(a), np.complex128)


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
    """Return the mean angular frequency of the channels' power, rad/s, without what follows inputs at once.

    Under steps a rig's displacement is mostly its rest under the input, which says nothing of how fast it moves.
    """
    total, moment = 0.0, 0.0
    for recorded in recordings:
        y = recorded.outputs[:, recorded.fitted] / level(recorded)[:, None]
        y, u = (rows - rows.mean(axis=1, keepdims=True) for rows in (y, recorded.inputs[:, recorded.fitted]))
        y = y if recorded.free else y - np.linalg.lstsq(u.T, y.T, rcond=None)[0].T @ u
        power = np.sum(np.abs(np.fft.rfft(y, axis=1)) ** 2, axis=0)
        omega = 2 * math.pi * np.fft.rfftfreq(y.shape[1], 1 / recorded.rate_hz)
        total, moment = total + float(power.sum()), moment + float(omega @ power)
    return moment / max(total, 1e-300) or 1.0


def with_first_states(
    rig: DescribedRig, recordings: Sequence[Recorded], found: Sequence[Mapping[str, float]], highest_hz: float
) -> list[tuple[Mapping[str, float], tuple[Real, ...]]]:
    """Return constants, the likeliest first, with the state (2n,) in which each recording must have begun.

    Constants that spectra hardly tell from the likeliest may still make a motion that runs away: these are left out.

    Raises
    ------
    AnalysisError
        All of them run away.
    """
    kept: list[tuple[Mapping[str, float], tuple[Real, ...]]] = []
    away: list[AnalysisError] = []
    for values in found:
        try:
            kept.append((values, tuple(first_state(rig, r, values, highest_hz) for r in recordings)))
        except AnalysisError as error:
            away.append(error)
    if not kept:
        raise away[0]
    return kept


def first_state(rig: DescribedRig, recorded: Recorded, values: Mapping[str, float], highest_hz: float) -> Real:
    """Return the state (2n,) that the linear rig must have had for the first periods, by linear least squares."""
    n = len(rig.arrangement.bodies)
    if not recorded.free:
        return np.zeros(2 * n)
    periods = max(FIRST_PERIODS / highest_hz, 1 / max(float(rig.arrangement.undamped_hz(values).min()), 1e-300))
    count = min(max(round(periods * recorded.rate_hz), FEWEST_FIRST), recorded.samples - 2 * recorded.edge)
    window = slice(recorded.edge, recorded.edge + count)
    simulation = Simulation(rig, [recorded], values, highest_hz)
    scale = np.repeat([1.0, 2 * math.pi * highest_hz], n)
    columns = []
    for j in range(2 * n):
        own = simulation.own(np.eye(2 * n)[j] * scale)
        shown, _ = simulation.run(simulation.begin(), own, 0, samples=window.stop + recorded.edge + 2)
        columns.append((shown[:, window] / level(recorded)[:, None]).ravel())
    target = (recorded.outputs[:, window] / level(recorded)[:, None]).ravel()
    if not np.all(np.isfinite(columns)):
        raise AnalysisError(
            f"{recorded.source}: the rig {rig.name!r} as described runs away from any start: its constants or "
            "its times are far from what was recorded; check their units"
        )
    found = np.linalg.lstsq(np.stack(columns, axis=1), target, rcond=1e-6)[0]
    return np.asarray(found * scale, np.float64)
