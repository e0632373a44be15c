"""What candidate bodies and tones would ring in a segment: its products with columns, and with itself.

Everything that rings is ``exp(s t)`` with a complex gain in each channel. So products with columns are those of
``exp(s t)`` with each channel's part of them, combined with the gains; those of two waves are geometric series. The
waves of hundreds of candidates are never written out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.parameters import Term
from analysis.mismatch.problem import Rung
from analysis.mismatch.ring_downs.experiment import Segment
from analysis.mismatch.ring_downs.linear import LinearRig, linear_rigs
from analysis.mismatch.ring_downs.problem import RingDownFit
from sim_backend.arrangement import Arrangement
from sim_backend.arrays import Complex, Real
from sim_backend.mechanisms.kinds import AddedBody, Tones
from sim_backend.modal_response import waves

CHUNK = 256  # samples of a wave that are written out; what follows is the same, smaller


@dataclass(frozen=True, slots=True)
class Family:
    """Terms with as many poles of their own at a load, phase-locked or not.

    Attributes
    ----------
    numbers
        (t,) of the terms.
    poles, gains
        (t, k) poles, 1/s, that a term adds, and (t, c, k) their gains.
    left
        (t, k) what a unit impulse on the tapped body gives them.
    pole_changes, gain_changes
        (t, p) and (t, c, p): of the rig's own modes.
    phase_locked
        Whether the added poles have their phase from the tap.
    """

    numbers: NDArray[np.intp]
    poles: Complex
    gains: Complex
    left: Complex
    pole_changes: Complex
    gain_changes: Complex
    phase_locked: bool


def families(fitted: RingDownFit, terms: Sequence[Term], base: Sequence[LinearRig]) -> list[list[Family]]:
    """Return the families of terms at every load; ``base`` is the fitted rig there."""
    found: list[list[Family]] = [_tones(fitted, terms, rig) for rig in base]
    bodies = {i: t.mechanism for i, t in enumerate(terms) if isinstance(t.mechanism, AddedBody)}
    rigs: dict[int, list[LinearRig]] = {}
    by_structure: dict[object, list[tuple[int, Arrangement]]] = {}
    for i, mechanism in bodies.items():
        rig = mechanism.extend(fitted.arrangement, terms[i].values, terms[i].place)
        names = tuple(p.name for p in rig.parameters)
        key = (rig.bodies, rig.masses, rig.elements, rig.sensors, rig.tapped, names)
        by_structure.setdefault(key, []).append((i, rig))
    for alike in by_structure.values():
        rigs |= _rigs(fitted, alike)
    tapped = fitted.arrangement.bodies.index(fitted.arrangement.tapped)
    for g, own in enumerate(found):
        kinds: dict[tuple[int, bool], list[int]] = {}
        for i in bodies:
            kinds.setdefault((rigs[i][g].poles.size, terms[i].phase_locked), []).append(i)
        own += [_family(at, [rigs[i][g] for i in at], base[g], tapped, locked) for (_, locked), at in kinds.items()]
    return found


def _rigs(fitted: RingDownFit, alike: Sequence[tuple[int, Arrangement]]) -> dict[int, list[LinearRig]]:
    """Return by term the rig with it at every load, of terms that extend it in the same way."""
    experiment, groups = fitted.problem.experiment, len(fitted.constants.load)
    declared = [rig.declared() for _, rig in alike]
    values = {name: np.repeat([one[name] for one in declared], groups) for name in declared[0]}
    values |= {name: np.tile(at, len(alike)) for name, at in fitted.constants.stacked().items()}
    rate = experiment.sample_rate_hz
    solved = linear_rigs(alike[0][1], values, fitted.problem.analog, experiment.noise, rate)
    return {i: solved[k * groups : (k + 1) * groups] for k, (i, _) in enumerate(alike)}


def _family(numbers: Sequence[int], rigs: Sequence[LinearRig], base: LinearRig, tapped: int, locked: bool) -> Family:
    """Return what bodies add to a rig and change of it: each of its modes becomes the nearest one left."""
    poles, gains = np.stack([r.poles for r in rigs]), np.stack([r.gains for r in rigs])
    left = np.stack([r.left[tapped] for r in rigs])
    rows, modes = np.arange(len(rigs)), base.poles.size
    away = np.abs(poles[:, None] - base.poles[:, None])
    taken = np.empty((rows.size, modes), np.intp)
    for j in range(modes):
        taken[:, j] = np.argmin(away[:, j], axis=1)
        away[rows, :, taken[:, j]] = np.inf
    free = np.ones(poles.shape, bool)
    free[rows[:, None], taken] = False
    rest = np.nonzero(free)[1].reshape(rows.size, -1)
    return Family(
        np.array(numbers, np.intp),
        np.take_along_axis(poles, rest, axis=1),
        np.take_along_axis(gains, rest[:, None], axis=2),
        np.take_along_axis(left, rest, axis=1),
        np.take_along_axis(poles, taken, axis=1) - base.poles,
        np.take_along_axis(gains, taken[:, None], axis=2) - base.gains,
        locked,
    )


def _tones(fitted: RingDownFit, terms: Sequence[Term], base: LinearRig) -> list[Family]:
    """Return each term that is tones as a family of its own."""
    experiment = fitted.problem.experiment
    found = []
    for i, term in enumerate(terms):
        if isinstance(term.mechanism, Tones):
            poles = np.array([term.mechanism.lines(term.values)], np.complex128).reshape(1, -1)
            poles *= 2j * np.pi
            gains = np.stack([m.gain(poles, experiment.sample_rate_hz) for m in experiment.noise], axis=1)
            none = np.zeros((1, *base.gains.shape), np.complex128)
            found.append(Family(np.array([i]), poles, gains, 0 * poles, none[:, 0], none, False))
    return found


def rung(
    own: Sequence[Family], base: LinearRig, segment: Segment, amplitudes: Complex, columns: Real, rate: float
) -> list[Rung]:
    """Return the products of a segment's families with columns (c n, m), and of each term's waves with each other.

    Parameters
    ----------
    amplitudes
        (p,) of the rig's modes in the segment.
    rate
        Samples per second.
    """
    n, channels, width = segment.y.shape[1], len(segment.y), columns.shape[1]
    moving = waves(base.poles, 1 / rate, n) * (base.weight * amplitudes)
    moving = np.concatenate([moving, moving * (np.arange(n) / rate)[:, None]], axis=1)
    columns = columns.reshape(channels, n, width)
    seen: Complex = (moving.T @ columns.astype(np.complex128)).swapaxes(0, 1)  # (2 p, c, m)
    by_channel = columns.swapaxes(0, 1).reshape(n, -1)
    wide = np.concatenate([by_channel, moving.real, moving.imag], axis=1)
    poles = np.concatenate([np.zeros(0, np.complex128), *(f.poles.ravel() for f in own)])
    products = wave_products(poles, 1 / rate, wide)
    squares = moving.T @ moving, moving.T @ moving.conj()
    found: list[Rung] = []
    at = 0
    for family in own:
        mine = products[at : at + family.poles.size].reshape(*family.poles.shape, wide.shape[1])
        at += family.poles.size
        shown = mine[..., : by_channel.shape[1]].reshape(*family.poles.shape, channels, width)
        crossed = mine[..., by_channel.shape[1] :].reshape(*family.poles.shape, 2, moving.shape[1])
        changes = np.concatenate([family.gain_changes, base.gains * family.pole_changes[:, None]], axis=2)
        # the product of waves a and b is half of both a b and a conj(b), which it takes from here
        beside = crossed[..., 0, :] + 1j * crossed[..., 1, :], crossed[..., 0, :] - 1j * crossed[..., 1, :]
        gains = family.gains
        if family.phase_locked:
            begun = family.left / base.drive[0]
            late = np.exp((family.poles - base.poles[0]) * segment.since_tap_s)
            gains = gains * (2 * amplitudes[0] * begun * late)[:, None]
        found.append(_products(family, gains, changes, (seen, shown), (squares, beside), (n, 1 / rate)))
    return found


def _products(
    family: Family,
    gains: Complex,
    changes: Complex,
    with_columns: tuple[Complex, Complex],
    with_waves: tuple[tuple[Complex, Complex], tuple[Complex, Complex]],
    times: tuple[int, float],
) -> Rung:
    """Return the products of a family; see `rung` for what its own are made of."""
    (seen, shown), (squares, beside) = with_columns, with_waves
    t, k = family.poles.shape
    rest = np.einsum("tcq,qcm->tm", changes, seen).real
    alone = np.einsum("tcq,tcr,qr->t", changes, changes, squares[0])
    alone = 0.5 * (alone + np.einsum("tcq,tcr,qr->t", changes, changes.conj(), squares[1])).real
    mine = np.einsum("tck,tkcm->tkm", gains, shown)
    both = 0.5 * np.einsum("tck,tcq,tkq->tk", gains, changes, beside[0])
    both += 0.5 * np.einsum("tck,tcq,tkq->tk", gains, changes.conj(), beside[1])
    same = _geometric(family.poles[:, :, None] + family.poles[:, None], *times)
    mirrored = _geometric(family.poles[:, :, None] + family.poles[:, None].conj(), *times)
    same = same * np.einsum("tck,tcl->tkl", gains, gains)
    mirrored = mirrored * np.einsum("tck,tcl->tkl", gains, gains.conj())
    if family.phase_locked:
        rest += mine.sum(axis=1).real
        alone += 2 * both.sum(axis=1).real + 0.5 * (same + mirrored).sum(axis=(1, 2)).real
        return Rung(family.numbers, rest[:, None], alone[:, None, None])
    gram = np.empty((t, 2 * k + 1, 2 * k + 1))
    cosines, sines = slice(0, 2 * k, 2), slice(1, 2 * k, 2)
    gram[:, cosines, cosines], gram[:, sines, sines] = 0.5 * (same + mirrored).real, 0.5 * (mirrored - same).real
    gram[:, cosines, sines] = 0.5 * (same - mirrored).imag
    gram[:, sines, cosines] = gram[:, cosines, sines].swapaxes(1, 2)
    gram[:, -1, cosines] = gram[:, cosines, -1] = both.real
    gram[:, -1, sines] = gram[:, sines, -1] = both.imag
    gram[:, -1, -1] = alone
    products = np.stack([mine.real, mine.imag], axis=2).reshape(t, 2 * k, rest.shape[1])
    return Rung(family.numbers, np.concatenate([products, rest[:, None]], axis=1), gram)


def _geometric(poles: Complex, n: int, h: float) -> Complex:
    """Return the sum of ``exp(s h i)`` over n samples."""
    z = poles * h
    nothing = z == 0
    return np.where(nothing, n, np.expm1(n * z) / np.expm1(np.where(nothing, 1.0, z)))


def wave_products(poles: Complex, h: float, columns: Real) -> Complex:
    """Return (poles, m) the sums of ``exp(s h i)`` times columns (n, m), for poles, 1/s, and a time step h, s."""
    n, m = columns.shape
    chunks = -(-n // CHUNK)
    padded = np.zeros((chunks * CHUNK, m))
    padded[:n] = columns
    beside = padded.reshape(chunks, CHUNK, m).swapaxes(0, 1).reshape(CHUNK, -1)
    wave = waves(poles, h, CHUNK).T
    parts = np.empty((poles.size, chunks * m), np.complex128)
    parts.real, parts.imag = wave.real @ beside, wave.imag @ beside
    lead = np.exp(np.multiply.outer(poles, np.arange(chunks) * (CHUNK * h)))
    return np.asarray((lead[:, None] @ parts.reshape(-1, chunks, m))[:, 0])
