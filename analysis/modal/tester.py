"""System and contact mode of each impact of one load of the two-mass tester.

The impacts of a load are searched together, because they share what is hard to find (which peak is the contact
resonance, a heavily damped one beside the system mode), and fitted one by one, because averaging records whose
frequencies scatter would read as damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from analysis.modal.checks import disagreements, era_modes, spread_of_scores
from analysis.modal.clipping import clipped_samples
from analysis.modal.consensus import (
    LEAST_DAMPING_ERROR,
    consensus,
    fit_from,
    stands_out,
    told_from_noise,
    with_the_others,
)
from analysis.modal.further import Decay, with_further_modes
from analysis.modal.likelihood_interval import widened, widening
from analysis.modal.modes import ModeEstimate, mode_from_sampled_pole
from analysis.modal.noise import NoiseModel
from analysis.modal.onset import onset_of
from analysis.modal.pulse_end import innovations, samples_before
from daq.records import RigDescription

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]
Method = Literal["ml", "era"]

SAFE_START_MS = 1.2  # after the trigger: any tap of the paper's impactor is over, a 17 % mode still rings
LATER_STARTS = 3  # that are tried, each twice as late, where the pulse is not over by then
BACK = 0.15  # share of the way to the trigger by which fits have to be continued backwards
UNSURE_FREQUENCY, UNSURE_DAMPING = 0.05, 0.5  # relative standard errors beyond which no estimate is given
ABOVE = 1.1  # times the system mode of the load, by which the contact mode of each tap has to lie above it at least
SURE = 1.5  # times the evidence of a contact mode that noise may feign, below which each tap has to show it by itself
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
    evidence = told_from_noise(late, noise, known)
    if evidence <= 1:
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
    fitted = with_the_others(dict(zip(decays, carried, strict=True)), known)
    lines = {i for i, d in fitted.items() if evidence < SURE and not stands_out(d, noise, known)}
    return [
        ImpactModes(None, None, s, float("nan"), ("the contact mode cannot be told from a line of this tap's noise",))
        if i in lines
        else _modes_of(fitted[i], noise, sample_rate_hz, method, [*notes, *onsets[i].notes], known)
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
        agreed = consensus(white, safe, sample_rate_hz, system_resonance_hz(rig), known, noise)
        if agreed is None:
            break
        found, served = agreed
        late = _late_decays(white, safe, known, found, served)
        decays = _from_the_pulse_on(late, {i: triggers[i] for i in late}, noise, known)
        first = first or (found, safe, late, decays)
        reached = [late[i].start - decays[i].start for i in late]
        if reached and np.median(reached) >= BACK * delay:
            return found, safe, late, decays
    return first


def _late_decays(
    white: Sequence[Real], safe: Sequence[int], known: Complex, poles: Complex, there: dict[int, Decay]
) -> dict[int, Decay]:
    """Fits of the whitened records from surely after the pulse; without those that do not carry two modes.

    Of some of them the fit is there already.
    """
    decays = {}
    for i, (y, start) in enumerate(zip(white, safe, strict=True)):
        fit = there[i].fit if i in there else fit_from(y, start, poles, known)
        # whose second mode is the system mode has found something else below it
        above = fit is not None and abs(np.log(fit.poles[1])) > ABOVE * abs(np.log(poles[0]))
        if fit is not None and above and abs(np.angle(fit.poles[1])) >= abs(np.angle(fit.poles[0])):
            decays[i] = Decay(y, start, fit)
    return decays


def _begun_at(decay: Decay, start: int, known: Complex) -> Decay | None:
    """Fit the same modes from another sample on; None if that fails."""
    fit = fit_from(decay.y, start, decay.fit.poles, known)
    return None if fit is None else Decay(decay.y, start, fit)


def _from_the_pulse_on(
    late: dict[int, Decay], triggers: dict[int, int], noise: NoiseModel, known: Complex
) -> dict[int, Decay]:
    """Begin late decays where the pulse has ended instead."""
    scores = [innovations(d.y, triggers[i], d.start, d.fit, known, noise.variance) for i, d in late.items()]
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


def _modes_of(
    decay: Decay, noise: NoiseModel, sample_rate_hz: float, method: Method, further: Sequence[str], known: Complex
) -> ImpactModes:
    """Both modes of one fitted record, with ERA of the same stretch beside them."""
    grown = spread_of_scores(decay.y[decay.start :], decay.fit, known)
    fit, first = decay.fit, decay.start + noise.order
    ratio = float(fit.noise_variance[0] / noise.variance) if noise.variance > 0 else float("nan")
    wider = widening(decay.y[None, decay.start :], fit, known)
    likely = [
        mode_from_sampled_pole(
            complex(fit.poles[i]),
            widened(fit.log_pole_covariance[i], wider[i]) * grown[i],
            fit.amplitudes[:, i],
            sample_rate_hz,
        )
        for i in range(2)
    ]
    realised = era_modes(decay.y[decay.start :], fit, sample_rate_hz, thorough=method == "era")
    notes = list(further)
    if realised is None:
        notes.append("ERA alone does not find both modes in this record")
    else:
        notes += disagreements(likely, realised)
    if method == "era":
        system, contact = (None, None) if realised is None else (realised[0], realised[1])
    else:
        system, contact = likely[0], likely[1]
    by_curvature = mode_from_sampled_pole(
        complex(fit.poles[1]), fit.log_pole_covariance[1], fit.amplitudes[:, 1], sample_rate_hz
    )
    if contact is not None and not _determined(contact if method == "era" else by_curvature):
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


def _determined(mode: ModeEstimate) -> bool:
    """Whether a mode's uncertainty leaves anything to say."""
    f, zeta = mode.frequency_hz, mode.damping_ratio
    return f.standard_error < UNSURE_FREQUENCY * f.value and zeta.standard_error < max(
        UNSURE_DAMPING * abs(zeta.value), LEAST_DAMPING_ERROR
    )
