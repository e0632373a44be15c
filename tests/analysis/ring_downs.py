"""Sessions of exactly known ring-downs for tests: any contact law, the recorder's filter, white noise."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from daq.records import RigDescription, Session, Shot
from rig.settings import Filter
from sim_backend.contact_laws import ContactLaw
from sim_backend.integrator import ring_down
from sim_backend.pulses import Pulse, half_sine
from sim_backend.recorder import analog_filter
from sim_backend.ring_down import RingDown
from sim_backend.two_mass import TwoMass, contact_damping

RATE_HZ, PRETRIGGER, SAMPLES = 25000.0, 250, 2500
ONSET_S = PRETRIGGER / RATE_HZ
M1, M2, K1, K2 = 0.107, 0.108, 4.6e5, 4.7e5
FILTER = Filter(family="butterworth", highpass_hz=10.0, highpass_order=1, lowpass_hz=10000.0, lowpass_order=4)
LOADS_N = (0.2, 0.4, 0.8)
RATIOS = (0.35, 0.5, 0.65, 0.8)  # of the peak of the contact force over the preload, of the impacts of a load

Record = Callable[[TwoMass, float, Pulse], NDArray[np.float64]]
"""Two-mass rig, preload (N) and pulse to accelerations (2, n), m/s2."""


def two_mass(load_n: float) -> TwoMass:
    kc = 8e6 * (load_n / 0.4) ** (1 / 3)
    return TwoMass(M1, M2, K1, K2, kc, contact_damping(kc, 0.006, M1, M2))


def pulse_of(rig: TwoMass, load_n: float, ratio: float) -> Pulse:
    """Pulse after which the contact force of the linear rig peaks at this share of the load."""
    unit = ring_down(rig, ContactLaw("linear", load_n), half_sine(1.0, 3e-4), 0.0, 200, 2e5)
    return half_sine(ratio * load_n / float(np.abs(unit.contact_force).max()), 3e-4)


def exact(rig: TwoMass, load_n: float, pulse: Pulse, law: ContactLaw) -> RingDown:
    return ring_down(rig, law, pulse, ONSET_S, SAMPLES, RATE_HZ, analog_filter(FILTER), tolerance=1e-9)


def with_law(kind: str, can_part: bool = False) -> Record:
    def record(rig: TwoMass, load_n: float, pulse: Pulse) -> NDArray[np.float64]:
        found = exact(rig, load_n, pulse, ContactLaw(kind, load_n, can_part))  # type: ignore[arg-type]
        return np.stack([found.acceleration, found.acceleration])

    return record


def session_of(record: Record, noise: float = 0.005, seed: int = 1, ratios: tuple[float, ...] = RATIOS) -> Session:
    """A session with an impact of every ratio at every load."""
    rng = np.random.default_rng(seed)
    shots = []
    for load_set, load in enumerate(LOADS_N):
        rig = two_mass(load)
        for ratio in ratios:
            y = record(rig, load, pulse_of(rig, load, ratio))
            shots.append(
                Shot(
                    len(shots),
                    load_set,
                    1e3 * load,
                    1e3 * load,
                    1e3 * load,
                    f"2026-01-01T00:00:{len(shots):02d}Z",
                    RATE_HZ,
                    PRETRIGGER,
                    y[:, :SAMPLES] + noise * rng.standard_normal((2, SAMPLES)),
                    True,
                )
            )
    return Session(
        "2026-01-01T00:00:00Z",
        RigDescription(M1, M2, K1, K2, RATE_HZ, 10.0, 1, 10000.0, 4, "butterworth", 100.0, 16),
        tuple(shots),
        source="made",
        complete=True,
    )


def peak_ratio(force: NDArray[np.float64], load_n: float) -> float:
    return float(np.abs(force).max()) / load_n if load_n else math.nan
