"""The stabilisation diagram: which poles of ERA come back from order to order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.modal.era import Realisation, hankel_svd, realise

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

LARGEST_DAMPING = 0.7
SAME_FREQUENCY = 0.01  # relative, between neighbouring orders
SAME_DAMPING = 0.3
SAME_SHAPE = 0.9  # modal assurance criterion
SMALLEST_SHARE = 0.5  # of the orders from its first sight on, in which a mode has to come back
SMALLEST_EMAC = 0.5
WEAKEST = 1e-3  # of the strongest mode's energy, for ERA alone
COLUMNS = 10_000  # samples of the record by which the modes are counted; the likelihood sees them all


@dataclass(frozen=True, slots=True)
class StablePole:
    """One pole of the stabilisation diagram, with its extended modal amplitude coherence and phase collinearity."""

    order: int
    frequency_hz: float
    damping_ratio: float
    stable: bool
    emac: float = float("nan")
    mpc: float = float("nan")


def indicators(diagram: Sequence[StablePole], frequency_hz: float) -> tuple[float, float]:
    """Medians of EMAC and MPC over the stable poles of the mode at a frequency; NaN without any."""
    own = [p for p in diagram if p.stable and abs(p.frequency_hz / frequency_hz - 1) < SAME_FREQUENCY]
    if not own:
        return float("nan"), float("nan")
    return float(np.median([p.emac for p in own])), float(np.median([p.mpc for p in own]))


def lags_of(tail: Real) -> int:
    """Block rows of the Hankel matrix of a free decay (c, n)."""
    return int(np.clip(min(tail.shape[1], COLUMNS) // 4, 8, max(8, 600 // tail.shape[0])))


def realisations(tail: Real, largest_order: int) -> list[Realisation]:
    """Realise a free decay (c, n) with every even order."""
    stretch = tail[:, :COLUMNS]
    lags = lags_of(tail)
    decomposed = hankel_svd(stretch, lags)
    top = min(largest_order, lags * tail.shape[0] // 2)
    return [realise(decomposed, order) for order in range(2, top + 1, 2)]


def stable_poles(
    realised: list[Realisation], samples: int, sample_rate_hz: float
) -> tuple[tuple[StablePole, ...], Complex]:
    """Stabilisation diagram, and one pole for each mode that comes back from order to order."""
    diagram: list[StablePole] = []
    tracks: list[list[tuple[int, complex, float, float]]] = []  # order index, pole, energy, emac
    for index, now in enumerate(realised):
        before = realised[index - 1] if index else None
        for m, z in enumerate(now.poles):
            s = np.log(z) * sample_rate_hz
            f, zeta = abs(s) / (2 * np.pi), -s.real / abs(s)
            if not 0 < zeta < LARGEST_DAMPING or f > 0.48 * sample_rate_hz:
                continue
            stable = before is not None and _has_partner(now, m, before)
            diagram.append(StablePole(now.order, float(f), float(zeta), stable, float(now.emac[m]), float(now.mpc[m])))
            if stable:
                # in what was recorded: a mode that hardly decays has no more than that
                rate = 2 * max(-s.real, 1e-12) / sample_rate_hz
                energy = float((np.abs(now.shapes[:, m]) ** 2).sum() * -np.expm1(-rate * samples) / rate)
                _track(tracks, index, complex(z), energy, float(now.emac[m]))
    last = len(realised) - 1
    strongest = max((max(t[2] for t in track) for track in tracks), default=0.0)
    chosen = []
    for track in tracks:
        share = len(track) / max(1, last - track[0][0] + 1)
        energy = float(np.median([t[2] for t in track]))
        emac = float(np.median([t[3] for t in track]))
        if len(track) >= 3 and share >= SMALLEST_SHARE and energy > WEAKEST * strongest and emac > SMALLEST_EMAC:
            half = track[len(track) // 2 :]
            chosen.append(half[int(np.argmax([t[3] for t in half]))][1])
    return tuple(diagram), np.array(chosen, np.complex128)


def _has_partner(now: Realisation, m: int, before: Realisation) -> bool:
    if before.poles.size == 0:
        return False
    own, others = np.log(now.poles[m]), np.log(before.poles)
    close = np.abs(np.abs(others) / abs(own) - 1) < SAME_FREQUENCY
    damping, other_damping = -own.real / abs(own), -others.real / np.abs(others)
    close &= np.abs(other_damping - damping) < SAME_DAMPING * max(damping, 1e-4)
    shape = now.shapes[:, m]
    norms = np.linalg.norm(before.shapes, axis=0) * np.linalg.norm(shape)
    mac = np.abs(shape.conj() @ before.shapes) ** 2 / np.maximum(norms**2, 1e-300)
    return bool((close & (mac > SAME_SHAPE)).any())


def _track(
    tracks: list[list[tuple[int, complex, float, float]]], index: int, z: complex, energy: float, emac: float
) -> None:
    """Add a stable pole to the track of its mode, or begin one; one pole an order."""
    own = abs(np.log(z))
    best, distance = None, SAME_FREQUENCY
    for track in tracks:
        gap = abs(abs(np.log(track[-1][1])) / own - 1)
        if gap < distance:
            best, distance = track, gap
    if best is None:
        tracks.append([(index, z, energy, emac)])
    elif best[-1][0] == index:
        if energy > best[-1][2]:
            best[-1] = (index, z, energy, emac)
    else:
        best.append((index, z, energy, emac))
