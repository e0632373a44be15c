"""A tap as it was made, and the record that it leaves: plain numbers, so that a tap can be kept and made again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from sim_backend.pulses import SHAPES, Pulse
from sim_backend.ring_down import ring_down_linear
from sim_backend.settings import SimulatedPulse
from sim_backend.state_space import StateSpace, exact_response
from sim_backend.truth import TrueRig
from sim_backend.two_mass import UPPER

if TYPE_CHECKING:
    from sim_backend.acting import Acting

RECORD_S = 0.6  # afterwards nobody looks any more
FIRST_MOMENTS_S = 1e-3  # in which rotation of the lower mass is judged (Sec. 3.3)


@dataclass(frozen=True, slots=True)
class Rocking:
    """Rotation of the lower mass after an off-centre tap: +r on accelerometer A, -r on B.

    Attributes
    ----------
    frequency_hz, damping_ratio
        Of the rocking mode.
    share
        Its peak in the first millisecond over that of the acceleration common to both.
    """

    frequency_hz: float
    damping_ratio: float
    share: float


@dataclass(frozen=True, slots=True)
class Tap:
    """One tap.

    Attributes
    ----------
    onset_s
        Rig time of the first touch, s.
    preload_n
        True load when it was made, N; 0 with the surfaces apart.
    stiffness_factor, damping_factor
        Scatter of k_c and c_c of this impact.
    peaks_n, delays_s
        Peak force and delay of each impact; one unless the impactor bounced.
    rocking
        Rotation that it caused, or None.
    kinds
        What went wrong, named like the settings of bad taps; empty for a good tap.
    struck
        Which mass.
    """

    onset_s: float
    preload_n: float
    stiffness_factor: float
    damping_factor: float
    peaks_n: tuple[float, ...]
    delays_s: tuple[float, ...]
    rocking: Rocking | None = None
    kinds: tuple[str, ...] = ()
    struck: int = UPPER

    def to_json(self) -> dict[str, Any]:
        """Return the tap as JSON types."""
        tap = asdict(self)
        return {key: list(value) if isinstance(value, tuple) else value for key, value in tap.items()}

    @classmethod
    def from_json(cls, state: dict[str, Any]) -> Self:
        """Return the tap that `to_json` described."""
        lists = {key: tuple(state[key]) for key in ("peaks_n", "delays_s", "kinds")}
        rocking = None if state["rocking"] is None else Rocking(**state["rocking"])
        return cls(**{**state, **lists, "rocking": rocking})


def tap_pulse(tap: Tap, settings: SimulatedPulse) -> Pulse:
    """Return the force of a tap, from its onset."""
    make = SHAPES[settings.shape]
    duration = settings.duration_ms * 1e-3
    pulse = make(tap.peaks_n[0], duration)
    for peak, delay in zip(tap.peaks_n[1:], tap.delays_s[1:], strict=True):
        pulse = pulse.followed_by(make(peak, duration), delay)
    return pulse


def tap_force(
    tap: Tap, settings: SimulatedPulse, onset_s: float, sample_rate_hz: float, analog: StateSpace | None
) -> NDArray[np.float64]:
    """Return the force of a tap, N, (n,), over as long as `tap_record`, after the filter where it passes one."""
    samples = round(RECORD_S * sample_rate_hz)
    pulse = tap_pulse(tap, settings)
    if analog is None:
        return pulse(np.arange(samples) / sample_rate_hz - onset_s)
    return np.asarray(exact_response(analog, pulse, onset_s, samples, sample_rate_hz)[0], np.float64)


def rocking_response(
    rocking: Rocking,
    pulse: Pulse,
    onset_s: float,
    samples: int,
    sample_rate_hz: float,
    analog: StateSpace,
    struck: int = UPPER,
) -> NDArray[np.float64]:
    """Return the shape of the rotation, (samples,), after the filter, in arbitrary units.

    A mass that is struck itself turns at once, the way it is struck.
    """
    omega = 2 * np.pi * rocking.frequency_hz
    a = np.array([[0.0, omega], [-omega, -2 * rocking.damping_ratio * omega]])
    mode = StateSpace(a, np.array([0.0, omega]), a[1:], np.array([0.0 if struck == UPPER else omega]))
    return exact_response(mode.then(analog), pulse, onset_s, samples, sample_rate_hz)[0]


def tap_record(
    tap: Tap,
    rig: TrueRig,
    settings: SimulatedPulse,
    onset_s: float,
    sample_rate_hz: float,
    analog: StateSpace,
    mechanisms: Sequence[Acting] = (),
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return accelerations A and B after the filter, (2, n), and the lower spring's dynamic load, mN, (n,).

    ``onset_s`` is the onset after the first sample of the record.
    """
    samples = round(RECORD_S * sample_rate_hz)
    pulse = tap_pulse(tap, settings)
    tester = rig.tester(tap.preload_n, tap.stiffness_factor, tap.damping_factor)
    if mechanisms and tap.preload_n > 0 and tap.struck == UPPER:
        from sim_backend.twin import twin_record  # compiles force laws: only where there are any

        acceleration, lower = twin_record(
            tester, tap.preload_n, mechanisms, pulse, onset_s, samples, sample_rate_hz, analog
        )
    else:
        response = ring_down_linear(tester, pulse, onset_s, samples, sample_rate_hz, analog, tap.struck)
        acceleration = np.vstack([response.acceleration, response.acceleration])
        lower = response.lower_displacement
    if tap.rocking is not None:
        shape = rocking_response(tap.rocking, pulse, onset_s, samples, sample_rate_hz, analog, tap.struck)
        first = slice(0, int((onset_s + settings.duration_ms * 1e-3 + FIRST_MOMENTS_S) * sample_rate_hz) + 1)
        common, rotation = np.max(np.abs(acceleration[0, first])), np.max(np.abs(shape[first]))
        acceleration += np.array([[1.0], [-1.0]]) * shape * (tap.rocking.share * common / rotation)
    return acceleration, tester.k2 * lower * 1e3
