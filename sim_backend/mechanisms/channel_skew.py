"""One channel is sampled later than the other."""

from __future__ import annotations

import numpy as np

from sim_backend.mechanisms.mechanism import Mechanism, Quantity, Real, Values

NAME = "delay_of_b_samples"
TAPS = np.arange(-5, 6)


def distort(y: Real, values: Values, sample_rate_hz: float) -> Real:
    """Delay the last channel by a part of a sample: Lagrange's interpolation through eleven samples."""
    out = y.copy()
    delay = values[NAME]
    whole = round(delay)
    at = -(delay - whole)
    weights = np.array([np.prod([(at - k) / (j - k) for k in TAPS if k != j]) for j in TAPS])
    reach = abs(whole) + TAPS.size // 2
    shifted = np.pad(y[-1], reach, mode="edge")[abs(whole) - whole :][: out.shape[1] + TAPS.size - 1]
    out[-1] = np.convolve(shifted, weights[::-1], mode="valid")
    return out


MECHANISM = Mechanism(
    id="channel_skew",
    component="sensor chain",
    summary="one channel is sampled later than the other",
    source="multiplexed converter",
    parameters=(Quantity(NAME, "samples", -5.0, 5.0, "delay of B after A"),),
    strength=NAME,
    trials=lambda scale: [{NAME: 1e-2}],
    distort=distort,
    one_signed=False,
    statement=lambda values: f"Channel B is sampled {values[NAME]:.3g} samples later than channel A.",
)
