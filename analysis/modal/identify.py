"""Modes of any sampled ring-down: ERA over a range of orders, a stabilisation diagram, then maximum likelihood."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from analysis.modal.clipping import clipped_samples
from analysis.modal.faint_impact import Begun, begun_in_noise, begun_with
from analysis.modal.free_start import decay_start, from_the_impact_on
from analysis.modal.likelihood_interval import spread_along, widened, widening
from analysis.modal.model_order import groups, modes_of
from analysis.modal.modes import ModeEstimate, mode_from_sampled_pole
from analysis.modal.noise import NoiseModel, noise_model
from analysis.modal.realised_modes import realised_modes
from analysis.modal.ring_down_model import Model, Record, fitted, unresolved, without_modes, without_weak
from analysis.modal.stabilisation import COLUMNS, StablePole, realisations, stable_poles

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

LARGEST_ORDER = 60
ITERATIONS = 300  # of the fit to a whole long record
GUARD = 8  # samples before the onset that may already belong to the impact
LEAST_QUIET = 200  # samples before the impact from which the colour of the noise is told
NO_GROWTH = 3.0  # standard errors by which a mode that does not decay may seem to grow


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
    method
        ``"ml"`` or ``"era"``: what the modes and their intervals come from.
    """

    modes: tuple[ModeEstimate, ...]
    diagram: tuple[StablePole, ...]
    start: int
    residual_share: float
    notes: tuple[str, ...] = ()
    method: str = "ml"


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
        First sample of the free decay; by default found: after the impact, or the first one where there is none.
    largest_order
        Highest order of the stabilisation diagram; 0 leaves it out, which maximum likelihood does not need.
    method
        ``"ml"``: maximum likelihood, the number of modes by likelihood ratio; ``"era"``: the stable poles of ERA.

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
    moving = np.ptp(y, axis=1) > 0
    if moving.any() and not moving.all():  # what never changes has no noise to be weighed by, and tells nothing
        return _among(moving, identify_ring_down(y[moving], sample_rate_hz, start, largest_order, method))
    clipped = clipped_samples(y)
    y = y - y.mean(axis=1, keepdims=True)
    impact = decay_start(y, sample_rate_hz) if start is None else None
    first = start if start is not None else 0 if impact is None else impact[1]
    notes: list[str] = []
    if clipped.size:
        notes.append(f"{clipped.size} samples are clipped; they are left out")
    realised = realisations(y[:, first:], largest_order) if largest_order >= 2 else []
    diagram, chosen = stable_poles(realised, y.shape[1] - first, sample_rate_hz)
    if method == "ml":
        quiet = [c[: 0 if impact is None else max(0, impact[0] - GUARD)] for c in y]
        white = _whitened(y, [[q] for q in quiet], clipped)
        first, model, told = _counted(white, first, impact, sample_rate_hz)
        begun = None
        if impact is None and start is None:
            begun = begun_in_noise(_record(white.y, 0, white.clipped), model, sample_rate_hz)
        rest = None if impact is None else without_weak(_record(white.y, first, white.clipped), model)
        if rest is not None and impact is not None:
            # weak modes may be the colour of a noise of which too little was heard before the impact
            bare = _unfiltered(white, rest)
            white = _whitened(y, [[q, r] for q, r in zip(quiet, bare, strict=True)], clipped)
            first, model, told = _counted(white, impact[1], impact, sample_rate_hz)
        begun = begun or begun_with(first, model, told)
        notes += begun.notes
        begun = replace(begun, model=_over_all(white.y, begun.start, white.clipped, begun.model))
        found = _likely(white, begun, diagram, sample_rate_hz, notes)
        if found is not None:
            return found
        first, model = begun.start, begun.model
        if model.fit is not None:
            notes.append("the modes are those of ERA: least squares did not settle")
    modes, share, lost = realised_modes(y[:, first:], chosen, realised, sample_rate_hz, largest_order)
    if not modes:
        told = lost or ["no mode stands out of the noise"]
        return RingDownModes((), diagram, first, 1.0, (*notes, *told), method)
    return RingDownModes(modes, diagram, first, share, (*notes, *lost), "era")


def _among(moving: NDArray[np.bool_], found: RingDownModes) -> RingDownModes:
    """Return the modes of some channels as those of all, the others at rest."""
    modes = []
    for mode in found.modes:
        amplitude = np.zeros(moving.size, np.complex128)
        amplitude[moving] = mode.amplitude
        modes.append(replace(mode, amplitude=amplitude))
    return replace(found, modes=tuple(modes))


@dataclass(frozen=True, slots=True)
class _Whitened:
    """A record whose noise is white in each channel, of the length that it had; its first samples are not filtered."""

    y: Real
    clipped: NDArray[np.int64]
    filters: tuple[NoiseModel, ...]

    def amplitudes(self, amplitudes: Complex, pole: complex) -> Complex:
        """Amplitudes that a mode had before whitening."""
        passed = [np.polyval(f.coefficients[::-1], 1 / pole) for f in self.filters]
        return amplitudes / np.array(passed)


def _counted(
    white: _Whitened, first: int, impact: tuple[int, int] | None, sample_rate_hz: float
) -> tuple[int, Model, list[str]]:
    """First sample used, the modes of a whitened record from there on, and sentences for the reader."""
    if impact is None:
        return first, modes_of(_record(white.y, first, white.clipped)), []
    return from_the_impact_on(white.y, *impact, white.clipped, sample_rate_hz, COLUMNS)


def _unfiltered(white: _Whitened, rest: Real) -> Real:
    """A residual of the whitened record as it was before whitening."""
    undone = [signal.lfilter([1.0], f.coefficients, row) for f, row in zip(white.filters, rest, strict=True)]
    return np.array(undone, np.float64)


def _whitened(y: Real, noise: list[list[Real]], clipped: NDArray[np.int64]) -> _Whitened:
    """Whiten each channel by the autoregressive model of stretches that hold its noise, if they are long enough."""
    enough = [sum(map(len, stretches)) >= LEAST_QUIET for stretches in noise]
    filters = tuple(
        noise_model(stretches) if e else NoiseModel(np.ones(1), float("nan"))
        for stretches, e in zip(noise, enough, strict=True)
    )
    order = max(f.order for f in filters)
    if order == 0:
        return _Whitened(y, clipped, filters)
    white = np.array([signal.lfilter(f.coefficients, [1.0], row) for f, row in zip(filters, y, strict=True)])
    spoiled = np.unique((clipped[:, None] + np.arange(order + 1)).ravel())
    return _Whitened(white, spoiled[spoiled < y.shape[1]], filters)


def _record(y: Real, first: int, clipped: NDArray[np.int64], longest: int | None = COLUMNS) -> Record:
    """The record from a sample on, without clipped samples."""
    last = y.shape[1] if longest is None else min(y.shape[1], first + longest)
    missing = clipped[(clipped >= first) & (clipped < last)] - first
    stretch = y[:, first:last].copy()
    stretch[:, missing] = 0.0
    return Record(stretch, missing=missing)


def _over_all(y: Real, first: int, clipped: NDArray[np.int64], model: Model) -> Model:
    """The same modes, fitted to the whole record where they were counted in its first part."""
    if model.fit is None or y.shape[1] - first <= COLUMNS:
        return model
    whole = _record(y, first, clipped, None)
    return fitted(whole, model.poles, without_modes(whole), ITERATIONS) or Model(None, whole.y, model.left)


def _likely(
    white: _Whitened, begun: Begun, diagram: tuple[StablePole, ...], sample_rate_hz: float, notes: list[str]
) -> RingDownModes | None:
    """Modes of a model with their intervals; None if it has none that decays."""
    first, model = begun.start, begun.model
    if model.fit is None:
        return None
    fit = model.fit
    record = _record(white.y, first, white.clipped, None)
    spread = spread_along(record, fit)
    wider = widening(record.y, fit, record.known, record.missing)
    overlapping = [g for g in groups(fit.poles, record.y.shape[1]) if len(g) > 1]
    modes: list[ModeEstimate] = []
    for i in np.argsort(np.abs(np.log(fit.poles))):
        with np.errstate(invalid="ignore"):  # a record without noise has no interval: no spread, wider without end
            covariance = widened(fit.log_pole_covariance[i], wider[i]) * spread[i] + begun.scatter[i]
        z = complex(fit.poles[i] * np.exp(begun.shift[i]))
        growth = np.log(abs(z)) / np.sqrt(max(covariance[0, 0], 1e-300))
        if growth > NO_GROWTH:
            f = np.angle(z) * sample_rate_hz / (2 * np.pi)
            notes.append(f"an oscillation at {f:.5g} Hz grows: it is no mode of a free decay and is left out")
            continue
        if growth > 0:
            z /= abs(z)
        modes.append(mode_from_sampled_pole(z, covariance, white.amplitudes(fit.amplitudes[:, i], z), sample_rate_hz))
    if modes:
        notes.append(_unresolved_note(unresolved(record, model), fit.poles, sample_rate_hz))
    for group in overlapping:
        told = ", ".join(f"{abs(np.log(fit.poles[i])) * sample_rate_hz / (2 * np.pi):.5g}" for i in group)
        notes.append(f"the modes at {told} Hz lie within each other's width")
    share = float(model.left.sum() / max((record.y**2).sum(), 1e-300))
    return RingDownModes(tuple(modes), diagram, first, share, tuple(notes)) if modes else None


def _unresolved_note(apart: Real, poles: Complex, sample_rate_hz: float) -> str:
    """Sentence about what this record could not have told apart."""
    s = np.log(poles)
    each = [
        f"{d * sample_rate_hz / (2 * np.pi):.2g} Hz at {abs(own) * sample_rate_hz / (2 * np.pi):.5g} Hz"
        for own, d in sorted(zip(s, apart, strict=True), key=lambda pair: abs(pair[0]))
    ]
    return f"two modes of like strength and shape may count as one where they are closer than {', '.join(each)}"
