"""Frequency and damping of one mode against its amplitude, read from the analytic signal of a free decay."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from scipy import signal

from analysis.mismatch.answer import AtAmplitude
from analysis.mismatch.recordings.recorded import Recorded
from sim_backend.arrays import Real

AMPLITUDES = 12  # at which frequency and damping of a decay are read
FADED = 0.02  # of the largest amplitude, below which they are not
LEAST_PER_POINT = 2.0  # periods
FEWEST = 8  # samples of a point


def decay_of(recorded: Recorded, row: Real) -> tuple[AtAmplitude, ...]:
    """Return frequency and damping along a decay (n,)."""
    z = signal.hilbert(row - row.mean())
    inside = slice(max(recorded.edge, 1), row.size - max(recorded.edge, 1))
    size, phase = np.abs(z)[inside], np.unwrap(np.angle(z))[inside]
    t = recorded.start_s + np.arange(row.size)[inside] / recorded.rate_hz
    faded = np.flatnonzero(size < FADED * size.max())
    last = int(faded[0]) if faded.size else size.size
    logs = np.log(size[:last])
    marks = np.linspace(logs[: max(last // 50, 1)].max(), logs[-max(last // 50, 1) :].min(), AMPLITUDES + 1)
    edges = [int(np.argmax(logs <= m)) if np.any(logs <= m) else last for m in marks]
    found = []
    for a, b in itertools.pairwise(edges):
        if b - a < FEWEST or (phase[b - 1] - phase[a]) < LEAST_PER_POINT * 2 * math.pi:
            continue
        w = float(np.polyfit(t[a:b], phase[a:b], 1)[0])
        sigma = -float(np.polyfit(t[a:b], np.log(size[a:b]), 1)[0])
        found.append(AtAmplitude(float(t[a:b].mean()), float(size[a:b].mean()), w / (2 * math.pi), sigma / w))
    return tuple(found)


def along_words(decay: Sequence[AtAmplitude], unit: str) -> str:
    """Say how frequency and damping go along a decay, as a further sentence; nothing of none."""
    if not decay:
        return ""
    first, last = decay[0], decay[-1]
    to = f"{last.amplitude:.3g} {unit}".rstrip()
    return (
        f" Along the decay from {first.amplitude:.3g} to {to} the frequency goes from "
        f"{first.frequency_hz:.5g} to {last.frequency_hz:.5g} Hz and the damping ratio from "
        f"{100 * first.damping_ratio:.3g} to {100 * last.damping_ratio:.3g} %."
    )
