"""The record of a tap as pages draw it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mesotap.console.frames import Message, frame


def record_frame(message: Message, numbers: bytes) -> bytes:
    """Return what a page draws of a tap, float32: accelerations A and B, the spectrum of their mean, and of a hammer's
    force itself and its spectrum (N/Hz, as many lines), where there is one."""
    rows = np.frombuffer(numbers, dtype=np.float64).reshape(-1, message["samples"])
    acceleration, forces = rows[:2], rows[2:]
    spectrum = amplitude_spectrum(acceleration.mean(axis=0)[message["pretrigger"] :], message["rate_hz"])
    told: Message = {
        "part": "record",
        **{k: v for k, v in message.items() if k != "kind"},
        "bins": len(spectrum),
        "forces": len(forces),
        "bin_hz": message["rate_hz"] / max(1, message["samples"] - message["pretrigger"]),
    }
    drawn = np.concatenate([acceleration.ravel(), spectrum, *(_force_drawn(f, message, len(spectrum)) for f in forces)])
    drawn = drawn.astype("<f4")
    return frame(told, drawn.tobytes())


def _force_drawn(force: NDArray[np.float64], message: Message, bins: int) -> NDArray[np.float64]:
    """Return a force and its spectrum, over as long as that of the accelerations, so that they have the same lines."""
    at_rest = force - np.median(force)
    length = max(1, force.size - message["pretrigger"])
    pulse = int(np.argmax(np.abs(at_rest)))
    first = min(max(0, pulse - message["pretrigger"]), force.size - length)
    return np.concatenate([at_rest, amplitude_spectrum(at_rest[first : first + length], message["rate_hz"])[:bins]])


def amplitude_spectrum(y: NDArray[np.float64], rate_hz: float) -> NDArray[np.float64]:
    """Amplitude spectrum, m/s2 per Hz, of a transient from its trigger on (Fig. 6b)."""
    return np.abs(np.fft.rfft(y)) / rate_hz if y.size else np.zeros(0)
