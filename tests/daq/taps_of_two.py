"""Signals of two accelerometers at a tap, without the simulated rig: closed forms, oversampled and band-limited."""

from __future__ import annotations

import numpy as np
from scipy import signal

RATE = 25_000.0
FINE = 16
TRIGGER = 25_250
AFTER = 3_000
PULSE_S = 3e-4
LOWPASS = signal.butter(4, 10_000.0, fs=RATE * FINE, output="sos")


def motion(peak=1.0, delay_samples=0.0, modes=((356.0, 0.005, 0.4),)):
    """A push, and the decaying swings that it leaves, at the accelerometer: (n,) at RATE, the onset at TRIGGER."""
    n = TRIGGER + AFTER
    t = (np.arange((AFTER + 400) * FINE) / FINE - 200 - delay_samples) / RATE
    pushed = np.where((t > 0) & (t < PULSE_S), np.sin(np.pi * t / PULSE_S), 0.0)
    late = np.maximum(t, 0.0)
    for hz, zeta, share in modes:
        pushed = pushed - share * np.exp(-2 * np.pi * hz * zeta * late) * np.sin(2 * np.pi * hz * late)
    seen = signal.sosfilt(LOWPASS, pushed)[::FINE]
    out = np.zeros(n)
    out[TRIGGER - 200 :] = peak * seen[: AFTER + 200]
    return out


def rocking(peak, hz=4000.0, zeta=0.02):
    """A rotation that dies within milliseconds."""
    t = np.arange(TRIGGER + AFTER) / RATE - TRIGGER / RATE
    late = np.maximum(t, 0.0)
    return peak * np.exp(-2 * np.pi * hz * zeta * late) * np.sin(2 * np.pi * hz * late)


def noise(rng, rms=0.001, coloured_share=0.3, corner_hz=500.0):
    """White noise and a low-passed share, (2, n)."""
    n = TRIGGER + AFTER
    pole = np.exp(-2 * np.pi * corner_hz / RATE)
    slow = signal.lfilter([np.sqrt(1 - pole**2)], [1.0, -pole], rng.standard_normal((2, n + 4000)))[:, 4000:]
    return rms * (np.sqrt(coloured_share) * slow + np.sqrt(1 - coloured_share) * rng.standard_normal((2, n)))
