"""Modes of any sampled ring-down: ERA over a range of orders, a stabilisation diagram, then maximum likelihood."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.modal.changing_modes import changes_of
from analysis.modal.clipping import clipped_samples
from analysis.modal.converter_steps import dithered
from analysis.modal.distortion import perhaps_distorted
from analysis.modal.exponentials import NONE_MISSING, FitFailure
from analysis.modal.faint_impact import begun_in_noise, is_loud
from analysis.modal.free_start import FreeDecay, decay_with, from_the_impact_on
from analysis.modal.impact_onset import decays_before, impact_onset
from analysis.modal.likelihood_interval import spread_along, widened, widening
from analysis.modal.model_order import groups, is_white, modes_of
from analysis.modal.modes import ModeEstimate, mode_from_sampled_pole
from analysis.modal.no_modes import modes_alone
from analysis.modal.realised_modes import realised_modes
from analysis.modal.ring_down_model import Model, Record, Recorded, fitted, strong, unresolved, without_modes, worth_of
from analysis.modal.stabilisation import COLUMNS, StablePole, realisations, stable_poles
from analysis.modal.steady import perhaps_lasting
from analysis.modal.whitening import (
    COLOURED,
    Whitened,
    colour_after_an_impact,
    colour_without_an_impact,
    whitened,
)

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

LARGEST_ORDER = 60
ITERATIONS = 300  # of the fit to a whole long record
GUARD = 8  # samples before the onset that may already belong to the impact
LEAST_BEFORE = 96  # samples before the loudest onset, of which a decay is asked for
ROUNDED = 1e-6  # samples by which a time may be rounded
MANY = 5  # modes, all weak in what is not white: 13 of 14 such bursts of noise have as many, 1 / f up to three
MOSTLY_LEFT = (
    0.65  # of the energy, by modes that are others from every sample: 5 of 5 bursts of noise leave as much that
)
# are not many weak modes, none of 14 taps on structures does
HEARD = 0.9  # of the energy of modes, until which what they leave is compared with it
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
    settled
        Whether the modes are the same however late one begins.
    """

    modes: tuple[ModeEstimate, ...]
    diagram: tuple[StablePole, ...]
    start: int
    residual_share: float
    notes: tuple[str, ...] = ()
    method: str = "ml"
    settled: bool = True


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
    y = y - y.mean(axis=1, keepdims=True)
    impact = _impact(y, sample_rate_hz) if start is None else None
    if impact is not None and impact - GUARD >= LEAST_BEFORE and decays_before(y[:, : impact - GUARD]):
        # what is loudest may be no tap, but something that fell later; and what is ahead of it is no noise
        before = identify_ring_down(y[:, : impact - GUARD], sample_rate_hz, None, largest_order, method)
        after = identify_ring_down(y[:, impact - GUARD :], sample_rate_hz, None, largest_order, method)
        after = replace(after, start=after.start + impact - GUARD)
        louder = SOMETHING_LOUDER.format(1e3 * impact / sample_rate_hz)
        return after if _told_by(after) > _told_by(before) else replace(before, notes=(*before.notes, louder))
    found = _identified(y, sample_rate_hz, start, impact, largest_order, method)
    quiet = y[:, : max(0, (impact or 0) - GUARD)]
    modes, told = modes_alone(found.modes, quiet, (y.shape[1] - found.start) / sample_rate_hz, sample_rate_hz)
    told += [*perhaps_lasting(modes, quiet, sample_rate_hz), *perhaps_distorted(modes)]
    return replace(found, modes=modes, notes=(*found.notes, *told))


SOMETHING_LOUDER = "the modes are those of a decay that something louder ends {:.3g} ms into the record"


def _told_by(found: RingDownModes) -> tuple[bool, float]:
    """Whether modes are the same along a decay, and how well their damping is told: e-folds of relative precision."""
    told = [m.damping_ratio.value / max(m.damping_ratio.standard_error, 1e-300) for m in found.modes]
    return found.settled and bool(told), float(np.log(np.maximum(told, 1.0)).sum())


def _impact(y: Real, sample_rate_hz: float) -> int | None:
    """Onset of the impact in a record about its mean, beside something slow, too; None if there is none."""
    seen = impact_onset(y, sample_rate_hz)
    if seen is not None:
        return seen
    settling = Recorded(y, NONE_MISSING, slow=True).stretch(0)
    return impact_onset(without_modes(settling).residual, sample_rate_hz)


def decay_begins(time_s: float | None, samples: int, sample_rate_hz: float) -> int | None:
    """First sample of a free decay that is said to begin at a time; None where nothing is said.

    Raises
    ------
    FitFailure
        If that is before or after the record.

    Examples
    --------
    >>> decay_begins(0.02, 5000, 25e3)
    500
    """
    if time_s is None:
        return None
    if not 0 <= time_s * sample_rate_hz < samples:
        raise FitFailure(
            f"the free decay cannot begin at {time_s:g} s: the recording is {samples / sample_rate_hz:.4g} s long"
        )
    return min(samples - 1, int(np.ceil(time_s * sample_rate_hz - ROUNDED)))


def _identified(
    y: Real, sample_rate_hz: float, start: int | None, impact: int | None, largest_order: int, method: str
) -> RingDownModes:
    """As `identify_ring_down`, of a record about its mean whose impact begins at a sample, if there is one."""
    clipped = clipped_samples(y)
    notes: list[str] = []
    if clipped.size:
        notes.append(f"{clipped.size} samples are clipped; they are left out")
    y = dithered(y)
    quiet = [c[: 0 if impact is None else max(0, impact - GUARD)] for c in y]
    white = whitened(y, [[q] for q in quiet], clipped)
    begun = _begun(white, start, impact, sample_rate_hz)
    record, colour = begun.recorded.stretch(begun.start, COLUMNS), None
    if impact is not None:
        colour = colour_after_an_impact(white, record, begun.model)
    elif start is None:
        colour = colour_without_an_impact(record, begun.model)
    if colour is not None:
        white = whitened(y, [[q, r] for q, r in zip(quiet, colour, strict=True)], clipped)
        begun = _begun(white, start, impact, sample_rate_hz)
        if impact is None:
            notes.append(COLOURED)
    begun, told = _weak_ones(begun, sample_rate_hz)
    notes += [*begun.notes, *told]
    if told and begun.model.fit is None:
        return RingDownModes((), (), begun.start, 1.0, tuple(notes), method)
    first = begun.start
    tail = begun.recorded.y[:, first:]
    realised = realisations(tail, largest_order) if largest_order >= 2 else []
    diagram, chosen = stable_poles(realised, tail.shape[1], sample_rate_hz)
    if method == "ml":
        scatter, changing = changes_of(begun.recorded, begun.counted, sample_rate_hz) if begun.model.fit else (0.0, [])
        notes += changing
        begun = replace(begun, scatter=begun.scatter + scatter)
        begun = replace(begun, model=_over_all(begun))
        found = _likely(white, begun, diagram, sample_rate_hz, notes)
        if found is not None:
            return found
        if begun.model.fit is not None:
            notes.append("the modes are those of ERA: least squares did not settle")
    modes, share, lost = realised_modes(tail, chosen, realised, sample_rate_hz, largest_order)
    modes = tuple(replace(m, amplitude=white.amplitudes(m.amplitude, np.exp(m.pole / sample_rate_hz))) for m in modes)
    if not modes:
        told = lost or ["no mode stands out of the noise"]
        return RingDownModes((), diagram, first, 1.0, (*notes, *told), method)
    return RingDownModes(modes, diagram, first, share, (*notes, *lost), "era", begun.settled)


def _weak_ones(begun: FreeDecay, sample_rate_hz: float) -> tuple[FreeDecay, list[str]]:
    """The same without modes that are many and all weak in what is not white; and a sentence about weak modes there."""
    record = begun.recorded.stretch(begun.start, COLUMNS)
    if begun.model.fit is None:
        return begun, []
    if not begun.settled and _left_while_heard(record, begun.model) > MOSTLY_LEFT:
        return begun.with_model(without_modes(record)), [NO_RING_DOWN]
    if is_white(record, begun.model):
        return begun, []
    weak = worth_of(record, begun.model) < strong(record)
    if not weak.any():
        return begun, []
    found = np.sort(np.abs(np.log(begun.model.poles[weak]))) * sample_rate_hz / (2 * np.pi)
    told = ", ".join(f"{f:.5g}" for f in found)
    if weak.all() and weak.size >= MANY:
        said = f"{weak.size} oscillations, none of them strong, and more is left: a noise that changes is no ring-down"
        return begun.with_model(without_modes(record)), [said]
    return begun, [f"what the modes leave is not white noise: those that are weak, at {told} Hz, may be part of it"]


def _left_while_heard(record: Record, model: Model) -> float:
    """Share of the energy that modes leave, while most of their own is there."""
    own = np.cumsum(((record.y - model.residual) ** 2).sum(axis=0))
    heard = 1 + int(np.searchsorted(own, HEARD * own[-1]))
    total = (record.y[:, :heard] ** 2).sum()
    return float((model.residual[:, :heard] ** 2).sum() / max(total, 1e-300))


NO_RING_DOWN = (
    "no part of the record is like another, and oscillations leave most of it: a noise that changes is no ring-down"
)


def _among(moving: NDArray[np.bool_], found: RingDownModes) -> RingDownModes:
    """Return the modes of some channels as those of all, the others at rest."""
    modes = []
    for mode in found.modes:
        amplitude = np.zeros(moving.size, np.complex128)
        amplitude[moving] = mode.amplitude
        modes.append(replace(mode, amplitude=amplitude))
    return replace(found, modes=tuple(modes))


def _begun(white: Whitened, start: int | None, impact: int | None, sample_rate_hz: float) -> FreeDecay:
    """The modes of a whitened record, from where they begin on."""
    recorded = Recorded(white.y, white.clipped)
    if start is not None:
        return replace(decay_with(recorded, start, modes_of(recorded.stretch(start, COLUMNS))), settled=True)
    first = white.order
    if impact is None:
        whole = recorded.stretch(first, COLUMNS)
        in_noise = None if is_loud(whole.y) else begun_in_noise(whole, modes_of(whole), sample_rate_hz)
        if in_noise is not None:
            begins, model, shift, scatter, told = in_noise
            return FreeDecay(recorded, begins + first, model, scatter, shift, settled=True, notes=told)
    if impact is None:
        return from_the_impact_on(recorded, first, sample_rate_hz, COLUMNS, unseen=True)
    return from_the_impact_on(recorded, impact, sample_rate_hz, COLUMNS)


def _over_all(begun: FreeDecay) -> Model:
    """The same modes, fitted to the whole record where they were counted in its first part."""
    model = begun.model
    if model.fit is None or begun.recorded.y.shape[1] - begun.start <= COLUMNS:
        return model
    whole = begun.recorded.stretch(begun.start)
    return fitted(whole, model.poles, without_modes(whole), ITERATIONS) or Model(None, whole.y, model.left)


def _likely(
    white: Whitened, begun: FreeDecay, diagram: tuple[StablePole, ...], sample_rate_hz: float, notes: list[str]
) -> RingDownModes | None:
    """Modes of a model with their intervals; None if it has none that decays."""
    first, model = begun.start, begun.model
    if model.fit is None:
        return None
    fit = model.fit
    record = begun.recorded.stretch(first)
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
    return RingDownModes(tuple(modes), diagram, first, share, tuple(notes), settled=begun.settled) if modes else None


def _unresolved_note(apart: Real, poles: Complex, sample_rate_hz: float) -> str:
    """Sentence about what this record could not have told apart."""
    s = np.log(poles)
    each = [
        f"{d * sample_rate_hz / (2 * np.pi):.2g} Hz at {abs(own) * sample_rate_hz / (2 * np.pi):.5g} Hz"
        for own, d in sorted(zip(s, apart, strict=True), key=lambda pair: abs(pair[0]))
    ]
    return f"two modes of like strength and shape may count as one where they are closer than {', '.join(each)}"
