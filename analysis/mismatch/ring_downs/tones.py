"""How loud the steady tones are that a fit holds in every segment."""

from __future__ import annotations

import math

import numpy as np

from analysis.mismatch.ring_downs.added_response import lines_of
from analysis.mismatch.ring_downs.modes import Nuisance
from analysis.mismatch.ring_downs.problem import RingDownFit


def tone_amplitude(fit: RingDownFit) -> tuple[float, float]:
    """Return the amplitude (m/s2) of the loudest tone, over all segments and channels, and its standard error.

    What noise alone would show as a tone is taken off.
    """
    problem = fit.problem
    experiment = problem.experiment
    lines = lines_of(fit.terms)
    nuisance = Nuisance(experiment, np.append(problem.slow, 2j * np.pi * np.array(lines)))
    square = np.zeros((len(lines), len(experiment.segments), len(experiment.noise)))
    for i, (segment, coefficients) in enumerate(zip(experiment.segments, fit.coefficients, strict=True)):
        for c, found in enumerate(nuisance.rung(fit.modes[segment.group], coefficients)):
            for k, hz in enumerate(lines):
                gain = abs(experiment.noise[c].gain(np.array([2j * np.pi * hz]), experiment.sample_rate_hz)[0])
                by_chance = 4 / segment.y.shape[1]
                square[k, i, c] = (abs(found[problem.slow.size + k]) ** 2 - by_chance) / gain**2
    loudest = square[int(np.argmax(square.mean(axis=(1, 2))))]
    mean, error = float(loudest.mean()), float(loudest.std(ddof=1)) / math.sqrt(loudest.size)
    amplitude = math.sqrt(max(mean, 0.0))
    return amplitude, error / (2 * amplitude) if amplitude > 0 else math.sqrt(error)
