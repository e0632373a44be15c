"""From records of a force and its responses to averaged frequency responses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from analysis.frequency_response.estimators import (
    ForceError,
    FrequencyResponse,
    Spectra,
    averaged,
    laplace,
    transforms,
)
from analysis.frequency_response.hits import SECOND_SHARE, Hit, faults_of, hits_in, is_lasting
from analysis.frequency_response.windows import LEAD_SAMPLES, BandPass, decay_needed, faded, gated

Real = NDArray[np.float64]
Window = Literal["auto", "impact", "none", "hann"]

FEWEST_LINES = 64
"""Samples after a hit below which there is no spectrum to speak of."""

DOUBLE_S = 0.05
"""Within which after a hit another one is the same hammer bouncing, s: nobody taps twenty times a second."""

RINGING_SHARE = 0.01
"""Of the response at a hit, left of the one before, from which it is told: H is wrong by about as much near a mode."""

OVERLAP = 0.5
STRETCHES = 16
"""Stretches that a lasting force is cut into where nobody says how long they are to be."""


@dataclass(frozen=True, slots=True)
class HitRecord:
    """One record with one hit: ``force`` (n,) in N, ``response`` (c, n), and what it is called in notes."""

    force: Real
    response: Real
    name: str


@dataclass(frozen=True, slots=True)
class Measured:
    """Averaged frequency responses, the transforms behind them, and the hits that were used, in order."""

    response: FrequencyResponse
    spectra: Spectra
    used: tuple[str, ...]


def of_hits(
    records: Sequence[HitRecord],
    rate_hz: float,
    channels: Sequence[str],
    unit: str = "m/s2/N",
    band: BandPass | None = None,
    largest_force: float = math.inf,
    windows: bool = True,
    at_rest: bool = True,
) -> Measured:
    """Average the hits of one state of a rig.

    Parameters
    ----------
    records
        One hit each, of any length; cut to the shortest.
    rate_hz
        Sampling rate of all, Hz.
    channels, unit
        Name of each response, and unit of response over force.
    band
        Analog band-pass ahead of the recorder; None: nothing is known of any.
    largest_force
        What transducer, tip and recorder can hold, N; a hit that reaches it is left out.
    windows
        Whether force and exponential windows are applied; without, the samples are taken as they are.
    at_rest
        Whether the rig is at rest before each hit, so that a response's zero can be taken from there.

    Raises
    ------
    ForceError
        No hit is left; the sentence says why.
    """
    taken: list[tuple[HitRecord, Hit]] = []
    notes: list[str] = []
    pushed = []
    for record in records:
        try:
            hits = hits_in(record.force, rate_hz, f"{record.name}: the hammer's channel", SECOND_SHARE)
        except ForceError as error:
            notes.append(f"{error}; it is left out")
            continue
        if fault := faults_of(record.force, hits, largest_force):
            notes.append(f"{record.name}: {fault}; it is left out")
            continue
        hit = max(hits, key=lambda h: abs(h.peak))
        start = max(0, hit.first - LEAD_SAMPLES)
        if record.force.size - start < FEWEST_LINES:
            notes.append(f"{record.name}: only {record.force.size - start} samples follow the hit; it is left out")
            continue
        taken.append((record, hit))
        pushed.append(hit.peak > 0)
    if not taken:
        raise ForceError("no hit can be used: " + "; ".join(notes[:3]) + (" and more" if len(notes) > 3 else ""))
    if not all(pushed):
        notes.append(
            f"the hammer pulls in {len(pushed) - sum(pushed)} of {len(pushed)} hits, which none can: its sign is "
            "reversed (its polarity, or the program that wrote it, counts a push negative); it is taken as a push"
        )
    force, response, decay = _stretches(taken, rate_hz, band, windows, at_rest and windows)
    spectra = transforms(force, response)
    frequency = np.asarray(np.fft.rfftfreq(force.shape[1], 1 / rate_hz)[1:], np.float64)
    if band is not None:
        gain = band.of_response(laplace(frequency, decay))
        spectra = Spectra(spectra.force, spectra.response / gain)
    said = _window_said(decay, band, windows)
    found = averaged(spectra, frequency, 1 / rate_hz, len(taken), channels, unit, said, decay, notes)
    return Measured(found, spectra, tuple(record.name for record, _ in taken))


def _stretches(
    taken: Sequence[tuple[HitRecord, Hit]], rate_hz: float, band: BandPass | None, windows: bool, at_rest: bool
) -> tuple[Real, Real, float]:
    """Return windowed force (d, n) and response (d, c, n) from just before each hit on, and the window's decay, 1/s."""
    starts = [max(0, hit.first - LEAD_SAMPLES) for _, hit in taken]
    length = min(record.force.size - start for (record, _), start in zip(taken, starts, strict=True))
    forces, responses = [], []
    for (record, hit), start in zip(taken, starts, strict=True):
        f = math.copysign(1.0, hit.peak) * (gated(record.force, hit, rate_hz, band) if windows else record.force)
        x = record.response
        if at_rest and start >= LEAD_SAMPLES:
            x = x - x[:, :start].mean(axis=1, keepdims=True)
        forces.append(f[start : start + length])
        responses.append(x[:, start : start + length])
    force, response = np.array(forces), np.array(responses)
    decay = decay_needed(response, rate_hz) if windows else 0.0
    return faded(force, decay, rate_hz), faded(response, decay, rate_hz), decay


def _window_said(decay: float, band: BandPass | None, windows: bool) -> str:
    if not windows:
        return "no window"
    text = "force window: zero beyond the pulse"
    if band is not None and (band.highpass_order or band.lowpass_order):
        text += ", the declared filter taken out" if not band.on_force else ", the declared high-pass taken out"
    if decay:
        return (
            f"{text}; exponential window of {decay:.3g}/s on force and response, which widens each peak by "
            f"{decay / math.pi:.2g} Hz (a model is fitted with it, damping read off the figure is not)"
        )
    return f"{text}; no exponential window: the response has died away"


def of_recording(
    force: Real,
    response: Real,
    rate_hz: float,
    channels: Sequence[str],
    unit: str,
    window: Window = "auto",
    segment_s: float | None = None,
) -> FrequencyResponse:
    """Return the frequency responses of one recording with any number of hits, or with a lasting force.

    Parameters
    ----------
    force, response
        (n,) and (c, n) samples.
    rate_hz
        Sampling rate, Hz.
    channels, unit
        Name of each response, and unit of response over force.
    window
        ``"impact"``: force and exponential windows, an average a hit; ``"none"``: the same stretches as they are;
        ``"hann"``: stretches with half overlap and a Hann window, for a lasting force; ``"auto"``: the first or the
        last by what the force looks like.
    segment_s
        Length of a stretch, s; by default up to the next hit, or an eighth of the recording.

    Raises
    ------
    ForceError
        The force is dead, or no hit can be used.
    """
    if window not in get_args(Window):
        raise ForceError(f"window {window!r:.40} is not known: {', '.join(get_args(Window))} are")
    if response.ndim != 2 or force.ndim != 1 or response.shape[1] != force.size or not len(response):
        raise ForceError(
            f"a force of shape {force.shape} and responses of shape {response.shape} are no (n,) and (c, n)"
        )
    if not (np.isfinite(force).all() and np.isfinite(response).all()):
        raise ForceError("force or response holds a value that is not a number")
    if segment_s is not None and not (math.isfinite(segment_s) and segment_s * rate_hz >= FEWEST_LINES):
        raise ForceError(f"a stretch of {segment_s:g} s holds fewer than {FEWEST_LINES} samples: take a longer one")
    if window == "hann" or (window == "auto" and is_lasting(force)):
        return _of_lasting(force, response, rate_hz, channels, unit, segment_s)
    return of_each_hit(force, response, rate_hz, channels, unit, window != "none", segment_s).response


def of_each_hit(
    force: Real,
    response: Real,
    rate_hz: float,
    channels: Sequence[str],
    unit: str,
    windows: bool = True,
    segment_s: float | None = None,
) -> Measured:
    """Return the responses of one recording with any number of hits, with their transforms; see `of_recording`."""
    parts = after_each_hit(force, rate_hz)
    if windows and parts[0].start >= LEAD_SAMPLES:  # later ones come while the rig may ring
        response = response - response[:, : parts[0].start].mean(axis=1, keepdims=True)
    longest = None if segment_s is None else round(segment_s * rate_hz) + 2 * LEAD_SAMPLES
    records = []
    for number, whole in enumerate(parts):
        begin = whole.start
        part = slice(begin, whole.stop if longest is None else min(whole.stop, begin + longest))
        records.append(HitRecord(force[part], response[:, part], f"hit {number + 1} at {begin / rate_hz:.3g} s"))
    found = of_hits(_of_one_length(records), rate_hz, channels, unit, windows=windows, at_rest=False)
    return replace(found, response=with_notes(found.response, _still_ringing(response, parts)))


def after_each_hit(force: Real, rate_hz: float) -> list[slice]:
    """Return where each hit of a force (n,) begins, a little before its pulse, and the next one or the end is.

    Raises
    ------
    ForceError
        The force is dead, or shows no hit.
    """
    hits = _first_of_each(hits_in(force, rate_hz), rate_hz)
    begins = [max(0, hit.first - 2 * LEAD_SAMPLES) for hit in hits]
    return [slice(begin, end) for begin, end in zip(begins, [*begins[1:], force.size], strict=True)]


def _still_ringing(response: Real, parts: Sequence[slice]) -> list[str]:
    """Say where a response (c, n) had not died away when the next hit came: what was left is taken for its answer."""
    before = response[:, : parts[0].start]
    noise = np.mean(before**2, axis=1) if before.shape[1] >= LEAD_SAMPLES else np.zeros(len(response))
    worst = 0.0
    for earlier, part in pairwise(parts):
        width = max(2, (earlier.stop - earlier.start) // 10)
        left = np.mean(response[:, earlier.stop - width : earlier.stop] ** 2, axis=1) - noise
        begun = np.mean(response[:, part.start : part.start + width] ** 2, axis=1)
        share = np.sqrt(np.maximum(left, 0.0) / np.maximum(begun, np.finfo(float).tiny))
        worst = max(worst, float(share.max()))
    if worst < RINGING_SHARE:
        return []
    return [
        f"{worst:.0%} of the response was left of one hit when the next one came: near a mode that rings so long, and "
        "below it, the responses are wrong by about as much, which their random error does not hold; wait longer "
        "between hits"
    ]


def _first_of_each(hits: Sequence[Hit], rate_hz: float) -> list[Hit]:
    """Return the hits without those that are a hammer bouncing; they stay in the record of the one before."""
    first = [hits[0]]
    for hit in hits[1:]:
        if hit.first - first[-1].last > DOUBLE_S * rate_hz:
            first.append(hit)
    return first


def _of_one_length(records: Sequence[HitRecord]) -> list[HitRecord]:
    """Leave out the last hit where the recording ends so soon after it that all others would be cut to that."""
    lengths = [record.force.size for record in records]
    if len(records) > 1 and lengths[-1] < min(lengths[:-1]) / 2:
        return list(records[:-1])
    return list(records)


def _of_lasting(
    force: Real, response: Real, rate_hz: float, channels: Sequence[str], unit: str, segment_s: float | None
) -> FrequencyResponse:
    """Welch's method: Hann windows, half overlap."""
    if not np.ptp(force) > 0:
        raise ForceError(f"the force never changes (it reads {force[0] if force.size else 0.0:g} throughout)")
    length = force.size // STRETCHES * 2 if segment_s is None else round(segment_s * rate_hz)
    length = min(force.size, max(FEWEST_LINES, length))
    step = max(1, round(length * (1 - OVERLAP)))
    starts = range(0, force.size - length + 1, step)
    hann = signal.get_window("hann", length)
    cut = [slice(start, start + length) for start in starts]
    f = np.array([(force[c] - force[c].mean()) * hann for c in cut])
    x = np.array([(response[:, c] - response[:, c].mean(axis=1, keepdims=True)) * hann for c in cut])
    count = len(cut)
    # the stretches overlap by half: Welch (1967), the correlation of neighbours is 1/6 for the Hann window
    independent = count / (1 + 2 / 36 * (count - 1) / count)
    frequency = np.asarray(np.fft.rfftfreq(length, 1 / rate_hz)[1:], np.float64)
    scale = math.sqrt(2 / (rate_hz * float((hann**2).sum())))
    said = f"Hann windows of {length / rate_hz:.3g} s with half overlap, for a force that lasts"
    return averaged(transforms(f, x), frequency, scale, independent, channels, unit, said)


def with_notes(found: FrequencyResponse, notes: Sequence[str]) -> FrequencyResponse:
    """Return the same with more notes in front."""
    return replace(found, notes=(*notes, *found.notes))
