"""System and contact mode of each impact of one load of the two-mass tester.

The impacts of a load are searched together, because they share what is hard to find (which peak is the contact
resonance, a heavily damped one beside the system mode), and fitted one by one, because averaging records whose
frequencies scatter would read as damping.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import stats

from analysis.modal.clipping import clipped_samples
from analysis.modal.era import Realisation, hankel_svd, realise
from analysis.modal.exponentials import ExponentialFit, FitFailure, exponentials, fit_exponentials, subtracted
from analysis.modal.further import Decay, with_further_modes
from analysis.modal.modes import ModeEstimate, mode_from_sampled_pole, sampled_pole
from analysis.modal.noise import NoiseModel
from analysis.modal.onset import onset_of
from analysis.modal.pulse_end import ROUNDING, innovations, samples_before
from daq.records import RigDescription

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]
Method = Literal["ml", "era"]

SAFE_START_MS = 1.2  # after the trigger: any tap of the paper's impactor is over, a 17 % mode still rings
LATER_STARTS = 3  # that are tried, each twice as late, where the pulse is not over by then
BACK = 0.15  # share of the way to the trigger by which fits have to be continued backwards
GROWN_CHANCE = 1e-4  # chance of a fit's scores, below which the residual is not noise and the interval grows
FEIGNED = 1e-3  # chance that noise alone passes for the contact mode of a load
PARAMETERS = 4  # of a mode in one tap
CHECK_LAGS = 80  # of ERA beside maximum likelihood; ERA by itself has more
HEAD = 200  # first samples of a decay
COMPLETE = 1.3  # their residual over the noise's variance, up to which the first poles that fit are the ones
STRETCHES = 8  # of equal energy, of which each has a score
HEAVY_DAMPING = (0.02, 0.05, 0.1, 0.18)  # what a spectral peak or a noisy realisation can miss
GRID_SAMPLES = 1000  # a heavily damped mode is over by then
CONTACT_MODE_ABOVE = 1.25  # the contact resonance lies at least this factor above the system resonance
HIGHEST_SHARE = 0.4  # of the sampling rate: no contact resonance is looked for above
DISAGREEMENT = 5.0  # standard errors (of ERA) between ERA and maximum likelihood that are flagged
UNSURE_FREQUENCY, UNSURE_DAMPING = 0.05, 0.5  # relative standard errors beyond which no estimate is given
LEAST_DAMPING_ERROR = 1e-3  # standard error of a damping ratio that is always good enough
NUMERICAL = 1e-6  # relative difference of two methods that is theirs and not the data's
OCTAVE = 0.05  # within which a further mode counts as twice the contact resonance


@dataclass(frozen=True, slots=True)
class ImpactModes:
    """The two modes of one impact, or why there are none.

    Attributes
    ----------
    system, contact
        The modes, None if the data cannot carry them.
    start
        First sample of the record used.
    residual_ratio
        Residual variance over the variance of the noise before the trigger: 1 where the model is complete.
    notes
        Sentences for the reader of the result.
    """

    system: ModeEstimate | None
    contact: ModeEstimate | None
    start: int
    residual_ratio: float
    notes: tuple[str, ...] = ()


def filter_poles(rig: RigDescription, sample_rate_hz: float) -> Complex:
    """Sampled poles of the declared high-pass, which ring on in every record; the low-pass dies within samples.

    Without a declared filter an offset is allowed for (a pole at 1).
    """
    if rig.filter_family != "butterworth" or not np.isfinite(rig.highpass_hz) or rig.highpass_order < 1:
        return np.ones(1, np.complex128)
    n = rig.highpass_order
    angles = np.pi * (2 * np.arange(n) + n + 1) / (2 * n)
    s = 2 * np.pi * rig.highpass_hz * np.exp(1j * angles)
    z: Complex = np.exp(s / sample_rate_hz)
    real = np.abs(s.imag) < 1e-9 * np.abs(s)
    z[real] = z[real].real
    return z


def system_resonance_hz(rig: RigDescription) -> float:
    """Where Eq. 10 puts the system mode for a stiff contact, Hz."""
    return float(np.sqrt((rig.k1_n_per_m + rig.k2_n_per_m) / (rig.m1_kg + rig.m2_kg)) / (2 * np.pi))


def identify_impacts(
    records: Sequence[Real],
    pretrigger: Sequence[int],
    sample_rate_hz: float,
    rig: RigDescription,
    noise: NoiseModel,
    method: Method = "ml",
    clipped: Sequence[NDArray[np.int64]] | None = None,
) -> list[ImpactModes]:
    """Identify both modes of every impact of one load.

    Parameters
    ----------
    records
        One-dimensional mean acceleration of A and B of each impact, m/s2.
    pretrigger
        Number of samples before the trigger in each.
    noise
        Model of the noise of that mean.
    method
        ``"ml"``: maximum likelihood, checked by ERA; ``"era"``: ERA.
    clipped
        Samples of each record at which A or B was at the end of its range; by default those that the mean shows.

    Returns
    -------
    list of ImpactModes
        One for each record, in order.

    Examples
    --------
    >>> from analysis.modal.tester import identify_impacts  # doctest: +SKIP
    >>> taps = [impact.acceleration.mean(axis=0) for impact in session.impacts]  # doctest: +SKIP
    >>> starts = [impact.pretrigger for impact in session.impacts]  # doctest: +SKIP
    >>> [m.contact for m in identify_impacts(taps, starts, 25e3, rig, noise)]  # doctest: +SKIP
    """
    known = filter_poles(rig, sample_rate_hz)
    white = [noise.whiten(np.asarray(r, np.float64)) for r in records]
    lost = [clipped_samples(r) for r in records] if clipped is None else clipped
    onsets = [onset_of(r, p, c, sample_rate_hz, noise) for r, p, c in zip(records, pretrigger, lost, strict=True)]
    begun = _begun_safely(white, [o.usable - noise.order for o in onsets], sample_rate_hz, rig, noise)
    if begun is None:
        reason = "no system and contact mode can be told from the noise"
        delay = int(SAFE_START_MS * 1e-3 * sample_rate_hz)
        return [ImpactModes(None, None, o.usable + delay, float("nan"), (reason,)) for o in onsets]
    found, safe, late, decays = begun
    if not _told_from_noise(late, noise):
        reason = "the contact mode cannot be told from the noise: all taps together show no more than noise does"
        return [ImpactModes(None, None, s, float("nan"), (reason,)) for s in safe]
    triggers = {i: onsets[i].usable - noise.order for i in late}
    carried, added = with_further_modes(list(decays.values()), known) if decays else ([], found[:0])
    if added.size:
        # what two modes left over looked like the pulse: its end is found anew with all modes
        again = {i: _begun_at(d, safe[i], known) for i, d in zip(decays, carried, strict=True)}
        whole = {i: d for i, d in again.items() if d is not None}
        if len(whole) == len(again):
            carried = list(_from_the_pulse_on(whole, triggers, noise, known).values())
    contact = [abs(np.log(d.fit.poles[1])) for d in carried]
    notes = [_further_note(complex(z), float(np.median(contact)), sample_rate_hz) for z in added]
    fitted = dict(zip(decays, carried, strict=True))
    return [
        _modes_of(fitted[i], noise, sample_rate_hz, method, [*notes, *onsets[i].notes], known)
        if i in fitted
        else ImpactModes(None, None, s, float("nan"), ("this record cannot carry a fit of two modes",))
        for i, s in enumerate(safe)
    ]


def _begun_safely(
    white: list[Real], triggers: Sequence[int], sample_rate_hz: float, rig: RigDescription, noise: NoiseModel
) -> tuple[Complex, list[int], dict[int, Decay], dict[int, Decay]] | None:
    """Modes from after the pulse on: their poles, safe starts, fits from there, and fits from where the pulse ended.

    If the fits cannot be continued backwards at all the pulse was not over, and twice as late a start is tried.
    """
    known = filter_poles(rig, sample_rate_hz)
    first: tuple[Complex, list[int], dict[int, Decay], dict[int, Decay]] | None = None
    for rung in range(LATER_STARTS):
        delay = int(SAFE_START_MS * 1e-3 * sample_rate_hz) * 2**rung
        safe = [t + delay for t in triggers]
        found = _consensus(white, safe, sample_rate_hz, rig, noise)
        if found is None:
            break
        late = _late_decays(white, safe, known, found)
        decays = _from_the_pulse_on(late, {i: triggers[i] for i in late}, noise, known)
        first = first or (found, safe, late, decays)
        reached = [late[i].start - decays[i].start for i in late]
        if reached and np.median(reached) >= BACK * delay:
            return found, safe, late, decays
    return first


def _told_from_noise(late: dict[int, Decay], noise: NoiseModel) -> bool:
    """Whether the contact mode has more energy in all taps together than the best fit to noise reaches anywhere."""
    if not late:
        return True  # there is nothing to refuse
    worth = 0.0
    for d in late.values():
        variance = float(d.fit.noise_variance[0])
        if noise.variance > 0:
            variance = max(variance, noise.variance)
        z = complex(d.fit.poles[1])
        rate = max(-2 * np.log(abs(z)), 1e-12)
        lasts = -np.expm1(-rate * (d.y.size - d.start)) / rate
        worth += 2 * abs(d.fit.amplitudes[0, 1]) ** 2 * float(lasts) / max(variance, 1e-300)
    longest = max(d.y.size for d in late.values())
    return worth > float(stats.chi2.isf(FEIGNED / longest, PARAMETERS * len(late)))


def _late_decays(white: Sequence[Real], safe: Sequence[int], known: Complex, poles: Complex) -> dict[int, Decay]:
    """Fits of the whitened records from surely after the pulse; without those that do not carry two modes."""
    decays = {}
    for i, (y, start) in enumerate(zip(white, safe, strict=True)):
        fit = _fit(y, start, poles, known)
        if fit is not None and abs(np.angle(fit.poles[1])) >= abs(np.angle(fit.poles[0])):
            decays[i] = Decay(y, start, fit)
    return decays


def _begun_at(decay: Decay, start: int, known: Complex) -> Decay | None:
    """Fit the same modes from another sample on; None if that fails."""
    fit = _fit(decay.y, start, decay.fit.poles, known)
    return None if fit is None else Decay(decay.y, start, fit)


def _from_the_pulse_on(
    late: dict[int, Decay], triggers: dict[int, int], noise: NoiseModel, known: Complex
) -> dict[int, Decay]:
    """Begin late decays where the pulse has ended instead."""

    def refit(y: Real, start: int, poles: Complex) -> ExponentialFit | None:
        return _fit(y, start, poles, known)

    scores = [innovations(d.y, triggers[i], d.start, d.fit, known, noise.variance, refit) for i, d in late.items()]
    ahead = max((d.start - triggers[i] for i, d in late.items()), default=0)
    earlier = {
        i: _begun_at(d, d.start - before, known)
        for (i, d), before in zip(late.items(), samples_before(scores, ahead), strict=True)
    }
    return {i: earlier[i] or d for i, d in late.items()}


def _further_note(z: complex, contact: float, sample_rate_hz: float) -> str:
    """Sentence about a further mode; ``contact`` is the size of the contact mode's log pole."""
    s = np.log(z)
    frequency, damping = abs(s) * sample_rate_hz / (2 * np.pi), -s.real / abs(s)
    octave = abs(abs(s) / (2 * contact) - 1) < OCTAVE
    twice = ", twice the contact resonance, as a nonlinear contact makes it," if octave else ""
    return (
        f"a further mode at {frequency:.0f} Hz with damping {100 * damping:.2g} %{twice} is in the records, fitted too"
    )


def _fit(y: Real, start: int, poles: Complex, known: Complex) -> ExponentialFit | None:
    try:
        fit = fit_exponentials(y[start:], poles, known)
    except FitFailure:
        return None
    # system mode before contact mode; further ones keep their places
    order = np.append(np.argsort(np.abs(np.log(fit.poles[:2]))), np.arange(2, fit.poles.size))
    return ExponentialFit(
        fit.poles[order],
        fit.amplitudes[:, order],
        fit.fixed_amplitudes,
        fit.noise_variance,
        fit.log_pole_covariance[order],
        fit.residual_sum,
        fit.dof,
    )


def _consensus(
    white: list[Real], starts: list[int], sample_rate_hz: float, rig: RigDescription, noise: NoiseModel
) -> Complex | None:
    """Poles (system, contact) that fit all impacts of a load best, started from ERA and from a grid.

    The first that leave the strongest impacts nothing but their noise, from the first sample on, are taken.
    """
    known = filter_poles(rig, sample_rate_hz)
    expected = system_resonance_hz(rig)
    rings = [i for i in range(len(white)) if starts[i] < white[i].size]  # the others end before their pulse does
    strongest = sorted(rings, key=lambda i: -float(np.std(white[i][starts[i] :])))[:3]
    best: tuple[float, Complex] | None = None
    for i in strongest:
        tail = white[i][starts[i] :]
        for candidate in _candidates(tail, expected, sample_rate_hz, known, grid=i == strongest[0]):
            fit = _fit(white[i], starts[i], candidate, known)
            if fit is None or not _plausible(fit.poles, expected, sample_rate_hz):
                continue
            # the same poles must serve the other impacts, each with its own amplitudes
            total, served = 0.0, {}
            for j in strongest:
                other = _fit(white[j], starts[j], fit.poles, known)
                square = float(np.dot(white[j][starts[j] :], white[j][starts[j] :]))
                total += 1.0 if other is None else other.residual_sum / max(square, 1e-300)
                if other is not None:
                    served[j] = Decay(white[j], starts[j], other)
            if best is None or total < best[0] * (1 - 1e-9):
                best = total, fit.poles
            if len(served) == len(strongest) and _complete(served, noise, known):
                return fit.poles
    return None if best is None else best[1]


def _complete(decays: dict[int, Decay], noise: NoiseModel, known: Complex) -> bool:
    """Whether two modes leave nothing but noise where a decay begins, and the contact mode stands out of it."""
    if not noise.variance > 0 or not _told_from_noise(decays, noise):
        return False
    k = np.arange(HEAD)
    return all(
        d.y.size - d.start > HEAD
        and float(np.mean((d.y[d.start : d.start + HEAD] - exponentials(d.fit, k, known)[0]) ** 2))
        < COMPLETE * noise.variance
        for d in decays.values()
    )


def _plausible(poles: Complex, expected_hz: float, sample_rate_hz: float) -> bool:
    """Whether a pair of poles can be the system and the contact mode."""
    s = np.log(poles) * sample_rate_hz
    f = np.abs(s) / (2 * np.pi)
    zeta = -s.real / np.abs(s)
    return bool(
        0.8 * expected_hz < f[0] < 1.2 * expected_hz
        and f[1] > CONTACT_MODE_ABOVE * f[0]
        and -0.02 < zeta[0] < 0.2
        and -LEAST_DAMPING_ERROR < zeta[1] < 0.6
    )


def _candidates(y: Real, expected_hz: float, sample_rate_hz: float, known: Complex, grid: bool) -> Iterator[Complex]:
    """Starting poles: the system mode at its spectral peak, the contact mode from ERA, the spectrum and a grid."""
    n = y.size
    padded = 2 ** int(np.ceil(np.log2(8 * n)))
    spectrum = np.abs(np.fft.rfft(y * np.hanning(2 * n)[n:], padded))
    frequency = np.fft.rfftfreq(padded, 1 / sample_rate_hz)
    near = np.flatnonzero((frequency > 0.9 * expected_hz) & (frequency < 1.1 * expected_hz))
    above = np.flatnonzero(
        (frequency > CONTACT_MODE_ABOVE * expected_hz) & (frequency < HIGHEST_SHARE * sample_rate_hz)
    )
    if not near.size or not above.size:
        return  # the sampling rate leaves no room for these modes
    system = sampled_pole(float(frequency[near[np.argmax(spectrum[near])]]), 0.002, sample_rate_hz)
    highest = HIGHEST_SHARE * sample_rate_hz
    for lags in (CHECK_LAGS, None):
        try:
            decomposed = hankel_svd(y, lags)
        except FitFailure:
            continue
        for order in (4, 6, 10):
            for z in _contact_poles(realise(decomposed, order), expected_hz, sample_rate_hz):
                yield np.array([system, z])
    peak = float(frequency[above[np.argmax(spectrum[above])]])
    for zeta in (0.001, 0.005, 0.02):
        yield np.array([system, sampled_pole(peak, zeta, sample_rate_hz)])
    if grid:
        for z in _heavy_grid(y, system, expected_hz, highest, sample_rate_hz, known):
            yield np.array([system, z])


def _contact_poles(realised: Realisation, expected_hz: float, sample_rate_hz: float) -> list[complex]:
    """Return the strongest pole above the system mode, if there is one."""
    s = np.log(realised.poles) * sample_rate_hz
    f = np.abs(s) / (2 * np.pi)
    zeta = -s.real / np.abs(s)
    usable = np.flatnonzero(
        (f > CONTACT_MODE_ABOVE * expected_hz) & (f < HIGHEST_SHARE * sample_rate_hz) & (zeta > 0) & (zeta < 0.5)
    )
    if not usable.size:
        return []
    # energy of a mode: amplitude squared over decay
    energy = np.abs(realised.shapes[0, usable]) ** 2 / np.maximum(-s.real[usable], 1.0)
    return [complex(realised.poles[usable[np.argmax(energy)]])]


def _heavy_grid(
    y: Real, system: complex, expected_hz: float, highest_hz: float, sample_rate_hz: float, known: Complex
) -> list[complex]:
    """Best heavily damped second mode on a grid: least squares with both modes' amplitudes free."""
    length = min(y.size, GRID_SAMPLES)
    k = np.arange(length)
    frequencies = np.geomspace(CONTACT_MODE_ABOVE * expected_hz, highest_hz, 60)
    first = np.concatenate([(np.array([system])[:, None] ** k), (known[:, None] ** k)])
    base = np.concatenate([first.real, first[:1].imag])
    q, _ = np.linalg.qr(base.T)
    rest = y[:length] - q @ (q.T @ y[:length])
    best: tuple[float, complex] | None = None
    for zeta in HEAVY_DAMPING:
        for f in frequencies:
            z = sampled_pole(float(f), zeta, sample_rate_hz)
            column = z**k
            pair = np.stack([column.real, column.imag], axis=1)
            pair -= q @ (q.T @ pair)
            amplitude, *_ = np.linalg.lstsq(pair, rest, rcond=None)
            gain = float(rest @ (pair @ amplitude))
            if best is None or gain > best[0]:
                best = gain, z
    return [] if best is None else [best[1]]


def _modes_of(
    decay: Decay, noise: NoiseModel, sample_rate_hz: float, method: Method, further: Sequence[str], known: Complex
) -> ImpactModes:
    """Both modes of one fitted record, with ERA of the same stretch beside them."""
    grown = spread_of_scores(decay.y[decay.start :], decay.fit, known)
    fit, first = decay.fit, decay.start + noise.order
    ratio = float(fit.noise_variance[0] / noise.variance) if noise.variance > 0 else float("nan")
    likely = [
        mode_from_sampled_pole(
            complex(fit.poles[i]), fit.log_pole_covariance[i] * grown[i], fit.amplitudes[:, i], sample_rate_hz
        )
        for i in range(2)
    ]
    lags = CHECK_LAGS if method == "ml" and decay.y.size - decay.start > 4 * CHECK_LAGS else None
    realised = _era_modes(decay.y[decay.start :], fit, sample_rate_hz, lags)
    notes = list(further)
    if realised is None:
        notes.append("ERA alone does not find both modes in this record")
    else:
        notes += _disagreements(likely, realised)
    if method == "era":
        system, contact = (None, None) if realised is None else (realised[0], realised[1])
    else:
        system, contact = likely[0], likely[1]
    if contact is not None and not _determined(contact):
        notes.append("this record does not determine the contact mode: its uncertainty is as large as its damping")
        contact = None
    if contact is not None and not contact.damping_ratio.value > 0:
        notes.append("the contact mode seems to grow: what was fitted is no free decay")
        contact = None
    if grown[1] > 1:
        notes.append(
            f"the residual is not noise: the interval of the contact mode is {np.sqrt(grown[1]):.2g} times as wide"
        )
    return ImpactModes(system, contact, first, ratio, tuple(notes))


def spread_of_scores(y: Real, fit: ExponentialFit, known: Complex) -> Real:
    """Factors (2,) by which the covariances of both modes grow: 1 where the residual can be white noise.

    The score of each stretch of equal energy is compared with what white noise makes of it.
    """
    none = np.zeros((1, 0))
    fixed = fit.fixed_amplitudes if known.size else none
    residual = subtracted(y[None], fit.amplitudes, fit.poles, fixed, known)[0]
    variance = float(fit.noise_variance[0])
    factors = np.ones(2)
    if not variance > ROUNDING * float(np.dot(y, y)) / y.size:
        return factors
    for m in range(2):
        ratio = _scatter(residual, complex(fit.poles[m]), STRETCHES) / variance
        if stats.chi2.sf(2 * STRETCHES * ratio, 2 * STRETCHES) < GROWN_CHANCE:
            factors[m] = ratio
    return factors


@njit(cache=True)
def _scatter(residual: Real, pole: complex, stretches: int) -> float:
    """Sum of the squared scores of stretches of equal energy over that energy: the variance of white noise."""
    n = residual.shape[0]
    size, total = 1.0, 0.0
    decay = np.abs(pole) ** 2
    for k in range(n):
        total += k * k * size
        size *= decay
    power, size, energy, score, squares = 1.0 + 0j, 1.0, 0.0, 0j, 0.0
    edge = total / stretches
    for k in range(n):
        score += residual[k] * k * np.conj(power)
        energy += k * k * size
        power *= pole
        size *= decay
        if energy >= edge or k == n - 1:
            squares += np.abs(score) ** 2
            score = 0j
            edge += total / stretches
    return squares / total


def _determined(mode: ModeEstimate) -> bool:
    """Whether a mode's uncertainty leaves anything to say."""
    f, zeta = mode.frequency_hz, mode.damping_ratio
    return f.standard_error < UNSURE_FREQUENCY * f.value and zeta.standard_error < max(
        UNSURE_DAMPING * abs(zeta.value), LEAST_DAMPING_ERROR
    )


def _era_modes(y: Real, fit: ExponentialFit, sample_rate_hz: float, lags: int | None) -> list[ModeEstimate] | None:
    """ERA of the same stretch; its order is the number of singular values above the noise's largest."""
    try:
        decomposed = hankel_svd(y, lags)
    except FitFailure:
        return None
    variance = float(fit.noise_variance[0])
    edge = np.sqrt(variance) * (np.sqrt(decomposed.lags) + np.sqrt(decomposed.columns))
    order = int(np.clip(np.count_nonzero(decomposed.singular_values > 1.02 * edge), 4, 12))
    for tried in (order, order + 1, order + 2, 4):
        realised = realise(decomposed, tried, variance)
        if realised.poles.size < 2:
            continue
        picked = [int(np.argmin(np.abs(np.log(realised.poles) - np.log(z)))) for z in fit.poles[:2]]
        # twice the same pole, or one far from where the likelihood puts it: not found at this order
        far = [
            abs(np.log(realised.poles[i] / z)) > 0.5 * abs(np.log(z))
            for i, z in zip(picked, fit.poles[:2], strict=True)
        ]
        if picked[0] != picked[1] and not any(far):
            return [
                mode_from_sampled_pole(
                    complex(realised.poles[i]), realised.log_pole_covariance[i], realised.shapes[:, i], sample_rate_hz
                )
                for i in picked
            ]
    return None


def _disagreements(likely: list[ModeEstimate], realised: list[ModeEstimate]) -> list[str]:
    """Sentences where ERA and maximum likelihood differ beyond their uncertainties."""
    notes = []
    for name, a, b in zip(("system", "contact"), likely, realised, strict=True):
        for what, x, y in (
            ("frequency", a.frequency_hz, b.frequency_hz),
            ("damping", a.damping_ratio, b.damping_ratio),
        ):
            allowed = DISAGREEMENT * np.hypot(x.standard_error, y.standard_error) + NUMERICAL * abs(x.value)
            if abs(x.value - y.value) > allowed:
                notes.append(
                    f"ERA and maximum likelihood disagree on the {what} of the {name} mode: "
                    f"{y.value:.6g} and {x.value:.6g}"
                )
    return notes
