"""How loud a steady tone is in recordings."""

from __future__ import annotations

import math

import numpy as np

from analysis.mismatch.recordings.fit import SimulatedFit
from sim_backend.arrays import Real


def loudest_tone(fitted: SimulatedFit) -> tuple[float, float, str]:
    """Return amplitude, standard error and unit of the loudest tone: over the recordings and the channels of its unit.

    What noise alone would show as a tone is taken off. The loudest is the one that stands out most of its noise.
    """
    square, noise = [], []
    for number, own in enumerate(fitted.own):
        noise.append(_variance(fitted, number))
        square.append(own.tones[:, ::2] ** 2 + own.tones[:, 1::2] ** 2 - 2 * noise[-1])
    squares, variances = np.array(square), np.array(noise)  # (recordings, channels, lines)
    units = [seen.unit for seen in fitted.problem.rig.seen]
    best, found = -math.inf, (0.0, 0.0, "")
    for unit in dict.fromkeys(units):
        alike = np.array([u == unit for u in units])
        for line in range(squares.shape[2]):
            power, of_noise = squares[:, alike, line].ravel(), variances[:, alike, line].ravel()
            mean = float(power.mean())
            if mean <= best * of_noise.mean():
                continue
            best, amplitude = mean / float(of_noise.mean()), math.sqrt(max(mean, 0.0))
            error = math.sqrt(float(np.maximum(power, of_noise) @ of_noise)) / power.size
            found = amplitude, error / amplitude if amplitude > 0 else math.sqrt(error), unit
    return found


def _variance(fitted: SimulatedFit, number: int) -> Real:
    """Return (channels, lines) the variance of a tone's cosine and sine, in noise as loud as it is at its frequency."""
    recorded, noise = fitted.problem.recordings[number], fitted.noise(number)
    off, at = fitted.off(number)
    used = np.isin(recorded.part[at], fitted.parts)
    left = float(np.mean(noise.white(off)[:, used] ** 2))
    waves = fitted.simulation.waves(number, at)[::2]
    found = np.empty((len(off), len(waves)))
    for channel, unit in enumerate(recorded.unit):
        for line, wave in enumerate(waves):
            rows = np.zeros_like(off)
            rows[channel] = wave / unit
            found[channel, line] = left / np.sum(noise.white(rows)[:, used] ** 2)
    return found
