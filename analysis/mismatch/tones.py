"""How loud the steady tones are that a fit holds in every record."""

from __future__ import annotations

import math

import numpy as np

from analysis.mismatch.baseline import Nuisance
from analysis.mismatch.fit import Fit


def tone_amplitude(fit: Fit) -> tuple[float, float]:
    """Return the amplitude (m/s2) of the loudest tone, over all records and channels, and its standard error.

    What noise alone would show as a tone is taken off.
    """
    problem = fit.problem
    recordings = problem.recordings
    lines = [hz for t in fit.terms if t.mechanism.lines is not None for hz in t.mechanism.lines(t.values)]
    nuisance = Nuisance(recordings, np.append(problem.slow, 2j * np.pi * np.array(lines)))
    square = np.zeros((len(lines), len(recordings.records), len(recordings.noise)))
    for i, (record, coefficients) in enumerate(zip(recordings.records, fit.coefficients, strict=True)):
        for c, found in enumerate(nuisance.rung(fit.modes[record.group], coefficients)):
            for k, hz in enumerate(lines):
                gain = abs(recordings.noise[c].gain(np.array([2j * np.pi * hz]), recordings.sample_rate_hz)[0])
                by_chance = 4 / record.y.shape[1]
                square[k, i, c] = (abs(found[problem.slow.size + k]) ** 2 - by_chance) / gain**2
    loudest = square[int(np.argmax(square.mean(axis=(1, 2))))]
    mean, error = float(loudest.mean()), float(loudest.std(ddof=1)) / math.sqrt(loudest.size)
    amplitude = math.sqrt(max(mean, 0.0))
    return amplitude, error / (2 * amplitude) if amplitude > 0 else math.sqrt(error)
