"""How many modes a ring-down holds, by likelihood: one more as long as the record speaks for it.

From no mode on, the exponential that explains most of what is left is found on a map over frequency and decay, fitted
together with all that are there, and kept if the likelihood rises by more than chance would make it rise anywhere on
that map. Where nothing stands apart any more, each mode is tried as two. Two that lie within each other's width are
believed only if with them nothing is left: a mode that changes along its decay is no sum of a few exponentials, and
slices of it are not modes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from analysis.modal.exponentials import subtracted
from analysis.modal.ring_down_model import (
    LEAST_LEFT,
    SPLIT_CHANCE,
    Model,
    Record,
    fitted,
    gain,
    without_modes,
    worth_of,
)

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

CHANCE = 1e-3  # of one mode too many in a record of white noise
UNDECIDED = 1e-2  # chance of a residual around a mode, below which it may be two
WHITE = 1e-4  # chance of what is left around modes, below which they do not explain it
LARGEST_GROUP = 3  # overlapping modes beyond which a group is not tried with one more
MORE_AT_ONCE = 2  # modes that may have to be added together before they explain what is left
LAGS = 12  # of the residual's correlation
ONE_FREQUENCY = 0.2  # of the narrower half-width, within which two modes are of one frequency
SAME_SHAPE = 0.9  # modal assurance criterion of slices
MOST = 20  # modes: the strongest of a structure that has more
LARGEST_DECAY = 1.0  # per sample, of the map
APART = 3.0  # half-widths between two modes that are surely not slices of one
HIGHEST = 0.48  # of the sampling rate
BATCH = 6  # modes that may be added at once
NO_SHADOW = 0.2  # of the highest peak of the map, below which another may be its side lobe
SIDE_LOBE = 0.02  # of what is left at a mode, below which a peak elsewhere may come from there


def _decaying(poles: Complex) -> bool:
    """Whether all poles decay or could, within what the shortest record tells."""
    return bool((np.abs(poles) < 1 + 1e-3).all() and (np.angle(poles) < 2 * np.pi * HIGHEST).all())


def _map_peaks(residual: Real, weight: Real, there: Complex, price: float) -> list[complex]:
    """Poles whose exponentials explain most of a residual by themselves: peaks over frequency and decay.

    The first is the highest; others follow as long as they would be worth their price and are no shadows of it. What
    lies within the width of a mode that is there, or looks like a side lobe of what that mode leaves, does not count.
    """
    n = residual.shape[1]
    octaves = int(np.ceil(np.log2(LARGEST_DECAY * 3 * n)))
    peaks: list[tuple[float, complex]] = []
    for decay in LARGEST_DECAY * 2.0 ** -np.arange(octaves + 1):
        length = int(min(n, np.ceil(8 / decay) + 1))
        window = np.exp(-decay * np.arange(length))
        size = 2 * 2 ** int(np.ceil(np.log2(max(length, 16))))
        spectrum = np.fft.rfft(residual[:, :length] * window, size)
        power = (weight[:, None] * np.abs(spectrum) ** 2).sum(axis=0) * 2 / (window**2).sum()
        top = int(HIGHEST * size)
        inner = power[1:top]
        local = np.flatnonzero((inner >= power[0 : top - 1]) & (inner > power[2 : top + 1])) + 1
        for index in local[np.argsort(-power[local])[:BATCH]]:
            peaks.append((float(power[index]), complex(np.exp(-decay + 2j * np.pi * index / size))))
    peaks.sort(key=lambda p: -p[0])
    chosen: list[tuple[float, complex]] = []
    old, leaked = np.log(there), 0.0
    for power, z in peaks:
        s = np.log(z)
        width = np.maximum(np.maximum(-old.real, min(-s.real, abs(s.imag))), 2 * np.pi / n)
        if (np.abs(s.imag - old.imag) < APART * width).any():
            leaked = max(leaked, power)
            continue
        if power < SIDE_LOBE * leaked:
            break
        if len(chosen) == BATCH or (chosen and power < max(2 * price, NO_SHADOW * chosen[0][0])):
            break
        room = [5 * max(-s.real, -np.log(o).real, 2 * np.pi / n) for _, o in chosen]
        if all(abs(s.imag - np.log(o).imag) > r for (_, o), r in zip(chosen, room, strict=True)):
            chosen.append((power, z))
    return [z for _, z in chosen]


def _with_more(record: Record, model: Model, price: float) -> Model | None:
    """The model with the next modes; None if none of them is worth its price."""
    weight = record.samples / np.maximum(model.left, model.left.max() * 1e-9 + 1e-300)
    starts = []
    for z in _map_peaks(model.residual, weight, model.poles, price):
        own = fitted(Record(model.residual, record.known, record.missing), np.array([z]), model)
        start = z if own is None or not _decaying(own.poles) else complex(own.poles[0])
        starts.append(start / max(1.0, abs(start) / (1 - 1e-7)))
    for count in sorted({len(starts), 1}, reverse=True):
        more = fitted(record, np.append(model.poles, starts[:count]), model) if starts else None
        if more is not None and _decaying(more.poles) and gain(record, model, more) > count * price:
            return more
    return None


def _width(s: Complex, samples: int) -> Real:
    """Half-widths of modes, radians a sample: of their decay, or of the record where that is shorter."""
    return np.maximum(-s.real, 1.0 / samples)


def groups(poles: Complex, samples: int) -> list[list[int]]:
    """Modes that lie within each other's width, together; most groups are of one."""
    s = np.log(poles)
    width = _width(s, samples)
    found: list[list[int]] = []
    for i in np.argsort(s.imag):
        near = [g for g in found if any(abs(s[i].imag - s[j].imag) < APART * max(width[i], width[j]) for j in g)]
        found = [g for g in found if g not in near] + [sorted([int(i), *(j for g in near for j in g)])]
    return found


def around(record: Record, model: Model, group: list[int]) -> float:
    """Chance of what a model leaves around some of its modes, if these are all there is: a score test.

    The columns of the test are those by which a sum of exponentials near a mode differs from the mode: k z^k, k^2 z^k.
    """
    n = record.y.shape[1]
    t = np.arange(n)
    present = np.ones(n)
    present[record.missing] = 0.0
    own: list[Real] = [(z**t).real for z in record.known]
    more: list[Real] = []
    for z in model.poles[group]:
        wave = z**t
        own += [wave.real, wave.imag]
        scale = max(1.0, min(n, 1 / max(1 - abs(z), 1e-12)))
        more += [(t / scale) ** p * part for p in (1, 2) for part in (wave.real, wave.imag)]
    design = np.array([*own, *more]) * present
    design /= np.linalg.norm(design, axis=1, keepdims=True) + 1e-300
    q, r = np.linalg.qr(design.T)
    free = np.abs(np.diagonal(r)) > 1e-6
    free[: len(own)] = False
    variance = np.maximum(model.left / record.samples, 1e-300)
    score = float((((model.residual @ q[:, free]) ** 2).sum(axis=1) / variance).sum())
    return float(stats.chi2.sf(score, max(1, record.y.shape[0] * int(free.sum()) - 2 * len(group))))


def _parted(s: Complex, samples: int) -> list[Complex]:
    """Starting poles of a group with one mode more: each of its modes as two, apart in frequency or in decay."""
    starts = []
    for i in range(s.size):
        width = float(_width(s[i : i + 1], samples)[0])
        for apart in (1j * width, 3j * width, 0.6 * width):
            pair = np.exp(np.array([s[i] - apart, s[i] + apart]))
            pair /= np.maximum(1.0, np.abs(pair) / (1 - 1e-7))
            if (pair.imag > 0).all():
                starts.append(np.append(np.exp(np.delete(s, i)), pair))
    return starts


def _alone(record: Record, model: Model, group: list[int]) -> tuple[Record, Model]:
    """What a group of modes is, with what is left: the record without all others, and the model of the group."""
    some = model.modes.amplitudes[:, group]
    none = np.zeros((record.y.shape[0], 0))
    own = subtracted(model.residual, -some, model.poles[group], none, np.zeros(0, np.complex128))
    own[:, record.missing] = 0.0
    part = Record(own, record.known, record.missing)
    return part, fitted(part, model.poles[group], model) or model


def _divided(record: Record, model: Model, group: list[int]) -> tuple[Complex | None, bool]:
    """Poles of a group with more modes, where that leaves nothing around it; and whether something is left as it is."""
    c, n = record.y.shape
    chance = around(record, model, group)
    if chance > UNDECIDED:
        return None, False
    part, now = _alone(record, model, group)
    price = float(stats.chi2.isf(SPLIT_CHANCE, 2 + 2 * c))
    for _ in range(MORE_AT_ONCE if len(group) < LARGEST_GROUP else 0):
        tried = [m for s in _parted(np.log(now.poles), n) if (m := fitted(part, s, now)) and _decaying(m.poles)]
        best = min(tried, key=lambda m: float(np.log(np.maximum(m.left, 1e-300)).sum()), default=None)
        if best is None or gain(part, now, best) < price:
            break
        if around(part, best, list(range(best.poles.size))) > WHITE:
            return best.poles, False
        now = best
    return None, chance < WHITE


def _collapsed(record: Record, model: Model, group: list[int]) -> Model:
    """One mode for a group of slices: the one that explains most of what all of them were, fitted to it."""
    part, now = _alone(record, model, group)
    alone = [m for i in group if (m := fitted(part, model.poles[[i]], now)) and _decaying(m.poles)]
    best = min(alone, key=lambda m: float(np.log(np.maximum(m.left, 1e-300)).sum()), default=None)
    pole = model.poles[group[0]] if best is None else best.poles[0]
    rest = [i for i in range(model.poles.size) if i not in group]
    return fitted(record, np.append(model.poles[rest], pole), model) or model


def _pruned(record: Record, model: Model, price: float) -> Model:
    """Drop modes that, with all others there, are not worth their price."""
    for _ in range(model.poles.size):
        if model.fit is None:
            break
        n = record.y.shape[1]
        worth = worth_of(record, model)
        together = {i for g in groups(model.poles, n) if len(g) > 1 for i in g}
        suspects = [i for i in np.argsort(worth) if worth[i] < 3 * price or i in together]
        for i in suspects:
            rest = np.delete(model.poles, i)
            less = fitted(record, rest, model) if rest.size else without_modes(record)
            if less is not None and _decaying(less.poles) and gain(record, less, model) < price:
                model = less
                break
        else:
            break
    return model


def price_of_a_mode(channels: int, samples: int) -> float:
    """Twice the rise of the log-likelihood that one mode more has to bring, wherever it is sought."""
    return float(stats.chi2.isf(CHANCE / (samples * 4), 2 + 2 * channels))


def modes_of(record: Record, start: Model | None = None) -> Model:
    """Find how many modes a record holds, from a model with some of them on if there is one, and fit them.

    Examples
    --------
    >>> import numpy as np
    >>> k = np.arange(3000)
    >>> y = 0.998**k * np.cos(0.3 * k) + 0.99**k * np.cos(0.7 * k)
    >>> y += 0.01 * np.random.default_rng(1).standard_normal(k.size)
    >>> np.round(np.sort(np.angle(modes_of(Record(y[None])).poles)), 2)
    array([0.3, 0.7])
    """
    c, n = record.y.shape
    price = price_of_a_mode(c, n)
    model = _apart(record, start or without_modes(record), price)
    if model.poles.size < MOST:
        model = _with_pairs(record, _pruned(record, model, price), price)
    return without_slices(record, model, white=is_white(record, model))


def is_white(record: Record, model: Model) -> bool:
    """Whether what a model leaves has the correlations of white noise (Ljung and Box 1978)."""
    return is_white_noise(model.residual, record.samples) or _rounding_left(record, model)


def is_white_noise(residual: Real, samples: int | None = None) -> bool:
    """Whether (c, n) residuals have the correlations of white noise (Ljung and Box 1978); of so many samples."""
    n = samples or residual.shape[1]
    lagged = np.array([(residual[:, :-lag] * residual[:, lag:]).sum(axis=1) for lag in range(1, LAGS + 1)])
    correlation = lagged / np.maximum((residual**2).sum(axis=1), 1e-300)
    score = float(n * (correlation**2).sum())
    return bool(stats.chi2.sf(score, residual.shape[0] * LAGS) > WHITE)


def without_slices(record: Record, model: Model, white: bool) -> Model:
    """One mode for slices of one: modes of one shape that overlap, and

    - in a record that exponentials explain, are of one frequency: what differs in decay alone is one mode that changes;
    - in one that they do not explain, all that overlap.
    """
    for _ in range(model.poles.size):
        if model.fit is None:
            break
        group = next(
            (g for g in groups(model.poles, record.y.shape[1]) if len(g) > 1 and _slices(model, g, white)), None
        )
        if group is None:
            break
        model = _collapsed(record, model, _slices(model, group, white))
    return model


def _slices(model: Model, group: list[int], white: bool) -> list[int]:
    """Modes of a group that are slices of the narrowest of them that has any."""
    shapes = model.modes.amplitudes[:, group] / np.sqrt(np.maximum(model.modes.noise_variance, 1e-300))[:, None]
    shapes = shapes / np.linalg.norm(shapes, axis=0)
    s = np.log(model.poles[group])
    alike = np.abs(shapes.conj().T @ shapes) ** 2 > SAME_SHAPE
    apart = np.abs(s.imag[:, None] - s.imag)
    if white:
        alike &= apart < ONE_FREQUENCY * np.abs(np.minimum(*np.meshgrid(-s.real, -s.real)))
    else:  # one that is broad overlaps with modes that do not with each other
        width = _width(s, model.residual.shape[1])
        alike &= apart < APART * np.maximum(*np.meshgrid(width, width))
    for row in alike[np.argsort(-s.real)]:
        if row.sum() > 1:
            return [g for g, a in zip(group, row, strict=True) if a]
    return []


def _with_pairs(record: Record, model: Model, price: float) -> Model:
    """Take modes for two and more where that leaves nothing around them."""
    n = record.y.shape[1]
    kept: list[complex] = []  # groups that stay as they are
    for _ in range(MOST):
        if model.fit is None or _rounding_left(record, model):
            break
        open_groups = [
            g for g in groups(model.poles, n) if all(abs(model.poles[i] - z) > 1e-9 for i in g for z in kept)
        ]
        divided = None
        for group in open_groups:
            poles, left = _divided(record, model, group)
            if poles is not None:
                rest = [i for i in range(model.poles.size) if i not in group]
                divided = fitted(record, np.append(model.poles[rest], poles), model)
                if divided is not None and _decaying(divided.poles):
                    break
                divided = None
            elif left and (slices := _slices(model, group, white=False)):
                divided = _collapsed(record, model, slices)
                kept = [complex(z) for z in _nearest(divided.poles, np.append(kept, model.poles[slices][:1]))]
                break
            kept += [complex(model.poles[i]) for i in group]
        if divided is None:
            return model
        before = model.poles.size
        model = _apart(record, divided, price) if divided.poles.size > before else divided
        kept = [complex(z) for z in _nearest(model.poles, np.array(kept, np.complex128))]
    return model


def _nearest(poles: Complex, to: Complex) -> Complex:
    return poles[[int(np.argmin(np.abs(poles - z))) for z in to]] if poles.size else poles


def _rounding_left(record: Record, model: Model) -> bool:
    energy = (record.y**2).sum(axis=1)
    return bool((model.left <= LEAST_LEFT * np.maximum(energy, energy.max() * 1e-12)).all())


def _apart(record: Record, model: Model, price: float) -> Model:
    """Add modes as long as the map of what is left shows any."""
    while model.poles.size < MOST and not _rounding_left(record, model):
        more = _with_more(record, model, price)
        if more is None:
            break
        model = more
    return model
