"""Modes of any sampled ring-down: ERA over a range of orders, a stabilisation diagram, then maximum likelihood."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.modal.era import Realisation, hankel_svd, realise
from analysis.modal.exponentials import ExponentialFit, FitFailure, fit_exponentials
from analysis.modal.modes import ModeEstimate, mode_from_sampled_pole

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

LARGEST_ORDER = 60
LARGEST_DAMPING = 0.3
SAME_FREQUENCY = 0.01  # relative, between neighbouring orders
SAME_DAMPING = 0.3
SAME_SHAPE = 0.9  # modal assurance criterion
SMALLEST_SHARE = 0.5  # of the orders from its first sight on, in which a mode has to come back
SMALLEST_EMAC = 0.5
WEAKEST = 1e-3  # of the strongest mode's energy
COLUMNS = 20_000  # samples of the record that the realisation looks at; the likelihood sees them all
REFINEMENTS = 15  # steps of least squares: from stable poles it settles at once or not at all
SWEEPS = 3
TOGETHER = 5  # modes up to which least squares takes all of them at once
REPEATS = 8  # stretches of the record over which the scatter of a fit's score is taken


@dataclass(frozen=True, slots=True)
class StablePole:
    """One pole of the stabilisation diagram, with its extended modal amplitude coherence and phase collinearity."""

    order: int
    frequency_hz: float
    damping_ratio: float
    stable: bool
    emac: float = float("nan")
    mpc: float = float("nan")


@dataclass(frozen=True, slots=True)
class RingDownModes:
    """Modes of a ring-down.

    Attributes
    ----------
    modes
        Ascending in frequency.
    diagram
        Every pole at every order, and whether it was stable there.
    start
        First sample used.
    residual_share
        Share of the record's energy that the modes leave over.
    notes
        Sentences for the reader.
    """

    modes: tuple[ModeEstimate, ...]
    diagram: tuple[StablePole, ...]
    start: int
    residual_share: float
    notes: tuple[str, ...] = ()


def identify_ring_down(
    y: Real,
    sample_rate_hz: float,
    start: int | None = None,
    largest_order: int = LARGEST_ORDER,
    method: str = "ml",
) -> RingDownModes:
    """Find the modes in a ring-down without knowing how many there are.

    Parameters
    ----------
    y
        (c, n) free decay in c channels, any unit.
    sample_rate_hz
        Samples a second.
    start
        First sample of the free decay; by default shortly after the largest one.
    largest_order
        Highest order of the stabilisation diagram.
    method
        ``"ml"`` refines the stable poles together by least squares, ``"era"`` leaves them as realised.

    Raises
    ------
    FitFailure
        If the record is too short, or empty.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(2000) / 1e4
    >>> y = np.exp(-20 * t) * np.sin(2 * np.pi * 300 * t)
    >>> found = identify_ring_down(y[None], 1e4, start=0)
    >>> [round(m.frequency_hz.value) for m in found.modes]
    [300]
    """
    y = np.atleast_2d(np.asarray(y, np.float64))
    y = y - y.mean(axis=1, keepdims=True)
    first = decay_start(y, sample_rate_hz) if start is None else start
    tail = y[:, first:]
    realised = _realisations(tail, largest_order)
    diagram, chosen = _stable(realised, sample_rate_hz)
    notes: list[str] = []
    if chosen.size == 0:
        return RingDownModes((), diagram, first, 1.0, ("no mode is the same from one model order to the next",))
    fit: ExponentialFit | None = None
    if method == "ml":
        fit = _refine(tail, chosen, notes)
    if fit is None:
        return _as_realised(tail, chosen, realised, diagram, first, sample_rate_hz, notes)
    order = np.argsort(np.abs(np.log(fit.poles)))
    spread = _robust_spread(tail, fit)
    modes = tuple(
        mode_from_sampled_pole(
            complex(fit.poles[i]), fit.log_pole_covariance[i] * spread[i], fit.amplitudes[:, i], sample_rate_hz
        )
        for i in order
    )
    share = float((fit.noise_variance * tail.shape[1]).sum() / max((tail**2).sum(), 1e-300))
    return RingDownModes(modes, diagram, first, share, tuple(notes))


def indicators(diagram: Sequence[StablePole], frequency_hz: float) -> tuple[float, float]:
    """Medians of EMAC and MPC over the stable poles of the mode at a frequency; NaN without any."""
    own = [p for p in diagram if p.stable and abs(p.frequency_hz / frequency_hz - 1) < SAME_FREQUENCY]
    if not own:
        return float("nan"), float("nan")
    return float(np.median([p.emac for p in own])), float(np.median([p.mpc for p in own]))


def decay_start(y: Real, sample_rate_hz: float) -> int:
    """First sample after the impact: where the running energy is largest, and a millisecond or two periods on."""
    energy = (y**2 / np.maximum((y**2).mean(axis=1, keepdims=True), 1e-300)).sum(axis=0)
    peak = int(np.argmax(energy))
    later = peak + max(2, int(1e-3 * sample_rate_hz))
    return min(later, max(0, y.shape[1] - 64))


def _realisations(tail: Real, largest_order: int) -> list[Realisation]:
    stretch = tail[:, :COLUMNS]
    lags = int(np.clip(stretch.shape[1] // 4, 8, 600 // tail.shape[0]))
    decomposed = hankel_svd(stretch, lags)
    top = min(largest_order, lags * tail.shape[0] // 2)
    return [realise(decomposed, order) for order in range(2, top + 1, 2)]


def _stable(realised: list[Realisation], sample_rate_hz: float) -> tuple[tuple[StablePole, ...], Complex]:
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
                energy = float((np.abs(now.shapes[:, m]) ** 2).sum() / max(-s.real, 1e-12))
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


def _refine(tail: Real, poles: Complex, notes: list[str]) -> ExponentialFit | None:
    """Least squares from the stable poles: all modes together where they are few, else one after another."""
    variance = tail.var(axis=1)
    floor = np.maximum(variance, variance.max() * 1e-9)
    try:
        if poles.size > TOGETHER:
            return _refine_in_turn(tail, poles, floor)
        fit = fit_exponentials(tail, poles, noise_variance=floor, iterations=REFINEMENTS)
    except FitFailure as error:
        notes.append(f"the modes are as ERA realised them: {error}")
        return None
    if _strayed(fit.poles, poles).any():
        notes.append("the modes are as ERA realised them: least squares drifts off to other ones")
        return None
    return fit


def _strayed(poles: Complex, start: Complex) -> NDArray[np.bool_]:
    """Which poles left the mode that they were started at."""
    moved = np.abs(np.abs(np.log(poles)) / np.abs(np.log(start)) - 1)
    strayed: NDArray[np.bool_] = (moved > SAME_FREQUENCY) | (np.abs(poles) >= 1)
    return strayed


def _refine_in_turn(tail: Real, start: Complex, floor: Real) -> ExponentialFit:
    """Fit each mode to what the others leave, a few times round; one that never holds its own is dropped."""
    c, n = tail.shape
    k = np.arange(n)
    poles = start.copy()
    covariance = np.zeros((poles.size, 2, 2))
    for _ in range(SWEEPS):
        columns = poles[:, None] ** k[None, :]
        amplitudes = _amplitudes(tail, columns)
        rest = tail - 2.0 * (amplitudes @ columns).real
        for m in range(poles.size):
            own = rest + 2.0 * (amplitudes[:, m : m + 1] * columns[m]).real
            try:
                fit = fit_exponentials(own, poles[m : m + 1], noise_variance=floor, iterations=REFINEMENTS)
            except FitFailure:
                continue
            if not _strayed(fit.poles, start[m : m + 1])[0]:
                poles[m], covariance[m] = fit.poles[0], fit.log_pole_covariance[0]
    found = covariance.any(axis=(1, 2))
    if not found.any():
        raise FitFailure("no mode can be refined by itself")
    poles, covariance = poles[found], covariance[found]
    columns = poles[:, None] ** k[None, :]
    amplitudes = _amplitudes(tail, columns)
    rest = tail - 2.0 * (amplitudes @ columns).real
    return ExponentialFit(
        poles=poles,
        amplitudes=amplitudes,
        fixed_amplitudes=np.zeros((c, 0)),
        noise_variance=(rest**2).mean(axis=1),
        log_pole_covariance=covariance,
        residual_sum=float((rest**2 / floor[:, None]).sum()),
        dof=c * n - 2 * poles.size * (c + 1),
    )


def _amplitudes(tail: Real, columns: Complex) -> Complex:
    """Complex amplitudes (c, J) of given poles' columns (J, n) by least squares over the modes and their conjugates."""
    both = np.concatenate([columns, columns.conj()])
    gram = both.conj() @ both.T
    solved = np.linalg.solve(gram, both.conj() @ tail.T)
    out: Complex = np.ascontiguousarray(solved[: columns.shape[0]].T)
    return out


def _robust_spread(tail: Real, fit: ExponentialFit) -> Real:
    """Factor by which the fit's covariances grow when the residual is not white: from stretches of the record.

    A mode whose frequency or damping changes along the ring-down leaves a residual that hangs together; the
    score of each stretch then scatters more than independent noise would make it.
    """
    n = tail.shape[1]
    k = np.arange(n)
    columns = fit.poles[:, None] ** k[None, :]
    model = 2.0 * (fit.amplitudes @ columns).real
    residual = tail - model
    weight = 1.0 / fit.noise_variance
    edges = np.linspace(0, n, REPEATS + 1).astype(int)
    factors = np.ones(fit.poles.size)
    for m in range(fit.poles.size):
        slope = k * columns[m]
        score = np.array(
            [
                (
                    weight[:, None]
                    * residual[:, a:b]
                    * (fit.amplitudes[:, m].conj()[:, None] * slope[None, a:b].conj())
                ).sum()
                for a, b in itertools.pairwise(edges)
            ]
        )
        expected = sum(
            float((weight * np.abs(fit.amplitudes[:, m]) ** 2).sum() * (np.abs(slope[a:b]) ** 2).sum())
            for a, b in itertools.pairwise(edges)
        )
        factors[m] = max(1.0, float((np.abs(score) ** 2).sum()) / max(expected, 1e-300))
    return factors


def _as_realised(
    tail: Real,
    chosen: Complex,
    realised: list[Realisation],
    diagram: tuple[StablePole, ...],
    first: int,
    sample_rate_hz: float,
    notes: list[str],
) -> RingDownModes:
    """Poles of ERA with their scatter over the orders as uncertainty."""
    modes = []
    k = np.arange(tail.shape[1])
    columns = np.concatenate([chosen[:, None] ** k, chosen.conj()[:, None] ** k])
    amplitudes, *_ = np.linalg.lstsq(columns.T, tail.T.astype(np.complex128), rcond=None)
    for i, z in enumerate(chosen):
        near = [
            np.log(p) - np.log(z)
            for r in realised[1:]
            for p in r.poles
            if abs(abs(np.log(p)) / abs(np.log(z)) - 1) < SAME_FREQUENCY
        ]
        if len(near) < 3:
            continue
        covariance = np.cov(np.array([[d.real, d.imag] for d in near]).T)
        modes.append(mode_from_sampled_pole(complex(z), covariance, amplitudes[i], sample_rate_hz))
    modes.sort(key=lambda mode: abs(mode.pole))
    model = (amplitudes.T @ columns).real
    share = float(((tail - model) ** 2).sum() / max((tail**2).sum(), 1e-300))
    return RingDownModes(tuple(modes), diagram, first, share, tuple(notes))
