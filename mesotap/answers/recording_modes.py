"""Modes of a recording that is no session of the tester."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.budgets import with_clock
from analysis.modal.amplitude import along_the_decay
from analysis.modal.exponentials import FitFailure
from analysis.modal.identify import decay_begins, identify_ring_down
from analysis.modal.shapes import scaled
from analysis.modal.stabilisation import indicators
from analysis.results import Mode, RecordingModes
from daq.exchange import Recording
from mesotap.configuration.usual_recordings import ANY_UNIT
from rig.settings import Wiring

ONE_CHANNEL = "there is one channel: shapes and MPC, which are between channels, say nothing"


def modes_of(recording: Recording, method: str, wiring: Wiring | None = None) -> RecordingModes:
    """Modes of a recording that is not a session of the tester.

    Parameters
    ----------
    recording, method
        What is analysed, and how.
    wiring
        Accuracy of the recorder's clock, which counts towards every frequency; None: the default.
    """
    wiring = wiring or Wiring()
    moving = np.ptp(recording.data, axis=1) > 0
    if not moving.any():
        raise FitFailure(f"{recording.source}: no channel ever changes its value: there is no ring-down in it")
    scale = _far_scale(recording.data)
    data = recording.data / scale
    try:
        start = decay_begins(recording.decay_from_s, data.shape[1], recording.rate_hz)
        found = identify_ring_down(data, recording.rate_hz, start, method=method)
    except FitFailure as error:
        raise FitFailure(f"{recording.source}: {error}") from error
    poles = np.array([np.exp(m.pole / recording.rate_hz) for m in found.modes], np.complex128)
    one = () if len(recording.data) > 1 else (ONE_CHANNEL,)
    decay = (data[:, found.start :] - data.mean(axis=1, keepdims=True))[moving]
    return RecordingModes(
        source=recording.source,
        method=found.method,
        modes=tuple(
            Mode(
                with_clock(m.frequency_hz, wiring),
                m.damping_ratio,
                tuple(2 * scale * float(a) for a in np.abs(m.amplitude)),
                tuple(
                    replace(p, amplitude=scale * p.amplitude)
                    for p in along_the_decay(decay, recording.rate_hz, poles, i)
                ),
                *indicators(found.diagram, m.frequency_hz.value),
                tuple(complex(a) for a in scaled(m.amplitude)),
            )
            for i, m in enumerate(found.modes)
        ),
        notes=(
            *found.notes,
            *one,
            f"{100 * found.residual_share:.2g} % of the energy after the impact is not in the modes: it is noise, "
            "and what they do not explain",
            *([_of_the_clock(wiring)] if found.modes else []),
        ),
        diagram=found.diagram,
        channels=tuple(zip(recording.names, recording.units or [recording.unit] * len(recording.names), strict=True)),
    )


def _of_the_clock(wiring: Wiring) -> str:
    default = Wiring().clock_accuracy_ppm
    assumed = ", as an NI 9234's is and any other's is assumed to be" if wiring.clock_accuracy_ppm == default else ""
    return (
        f"the intervals of the frequencies contain a clock of the recorder that is right to within "
        f"{wiring.clock_accuracy_ppm:g} ppm{assumed} (--clock-ppm, rig.wiring.clock_accuracy_ppm)"
    )


def _far_scale(data: NDArray[np.float64]) -> float:
    """Return a power of two that brings numbers far from 1 near it, so that no sum of them overflows; else 1."""
    largest = float(np.max(np.abs(data)))
    return 1.0 if ANY_UNIT.least <= largest <= ANY_UNIT.most else float(2.0 ** round(math.log2(largest)))
