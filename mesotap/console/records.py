"""The record of a tap as pages draw it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mesotap.console.frames import Message, frame


def record_frame(message: Message, numbers: bytes) -> bytes:
    """Return what a page draws of a tap: accelerations A and B and the spectrum of their mean, float32."""
    acceleration = np.frombuffer(numbers, dtype=np.float64).reshape(2, message["samples"])
    spectrum = amplitude_spectrum(acceleration.mean(axis=0)[message["pretrigger"] :], message["rate_hz"])
    told: Message = {
        "part": "record",
        **{k: v for k, v in message.items() if k != "kind"},
        "bins": len(spectrum),
        "bin_hz": message["rate_hz"] / max(1, message["samples"] - message["pretrigger"]),
    }
    drawn = np.concatenate([acceleration.ravel(), spectrum]).astype("<f4")
    return frame(told, drawn.tobytes())


def amplitude_spectrum(y: NDArray[np.float64], rate_hz: float) -> NDArray[np.float64]:
    """Amplitude spectrum, m/s2 per Hz, of a transient from its trigger on (Fig. 6b)."""
    return np.abs(np.fft.rfft(y)) / rate_hz if y.size else np.zeros(0)
