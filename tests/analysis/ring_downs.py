"""Sessions of known ring-downs for tests: any mechanisms in the contact, the recorder's filter, white noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.diagnosis import Diagnosis, diagnose_sessions
from analysis.mismatch.ring_downs.fit import RingDowns
from analysis.mismatch.ring_downs.sessions import ring_downs
from daq.records import Impact, RigDescription, Session
from mesotap.configuration.declared import header_uncertainty
from mesotap.configuration.rig_files import tester_rig
from rig.settings import Filter
from sim_backend.adopted import adopted
from sim_backend.mechanisms.kinds import Mechanism
from sim_backend.propagate import Clock, Rigs, laws_of, propagate
from sim_backend.pulses import Pulse, half_sine
from sim_backend.recorder import analog_filter
from sim_backend.ring_down import RingDown, ring_down_linear
from sim_backend.twin import given_pulse, twin_record
from sim_backend.two_mass import TwoMass, contact_damping

RATE_HZ, PRETRIGGER, SAMPLES = 25000.0, 250, 2500
ONSET_S = PRETRIGGER / RATE_HZ
RIG = tester_rig()
"""The two-mass tester as the program ships its description."""
SUBSTEPS = 16  # of a sample
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
    unit = ring_down_linear(rig, half_sine(1.0, 3e-4), 0.0, 200, 2e5)
    return half_sine(ratio * load_n / float(np.abs(unit.contact_force).max()), 3e-4)


def exact(rig: TwoMass, load_n: float, pulse: Pulse, *laws: str) -> RingDown:
    """Ring-down with these mechanisms, which are force laws without parameters, in the contact."""
    if not laws:
        return ring_down_linear(rig, pulse, ONSET_S, SAMPLES, RATE_HZ, analog_filter(FILTER))
    found = [adopted(name, {}) for name in laws]
    seen = twin_record(rig, load_n, found, pulse, ONSET_S, SAMPLES, RATE_HZ, analog_filter(FILTER))
    h, steps = 1 / RATE_HZ / SUBSTEPS, (SAMPLES - 1) * SUBSTEPS
    matrix = rig.state_matrix()
    mass = np.array([rig.m1, rig.m2])
    damping, stiffness = -mass[:, None] * matrix[2:, 2:], -mass[:, None] * matrix[2:, :2]
    rigs = Rigs(mass[None], damping[None], stiffness[None], np.array([[[1.0, -1.0]]]), np.array([[[1.0], [0.0]]]))
    rest = np.array([load_n, rig.kc, rig.cc, h])
    packed = laws_of([(a.mechanism.law, 0) for a in found], [[rest] * len(found)])
    clock = Clock(np.array([-ONSET_S]), h, steps, SUBSTEPS)
    motion = propagate(rigs, packed, np.zeros((1, 4)), clock, given_pulse(pulse, ONSET_S, h, steps))
    x, v = motion.states[0, :, :2].T, motion.states[0, :, 2:].T
    approach, rate = x[0] - x[1], v[0] - v[1]
    force = rig.kc * approach + rig.cc * rate + motion.forces[0, 0, ::SUBSTEPS]
    return RingDown(RATE_HZ, seen[0][0], seen[1], force, approach, rate)


def with_law(*laws: str) -> Record:
    def record(rig: TwoMass, load_n: float, pulse: Pulse) -> NDArray[np.float64]:
        found = exact(rig, load_n, pulse, *laws)
        return np.stack([found.acceleration, found.acceleration])

    return record


def session_of(record: Record, noise: float = 0.005, seed: int = 1, ratios: tuple[float, ...] = RATIOS) -> Session:
    """A session with an impact of every ratio at every load."""
    rng = np.random.default_rng(seed)
    impacts = []
    for load_set, load in enumerate(LOADS_N):
        rig = two_mass(load)
        for ratio in ratios:
            y = record(rig, load, pulse_of(rig, load, ratio))
            impacts.append(
                Impact(
                    len(impacts),
                    load_set,
                    1e3 * load,
                    1e3 * load,
                    1e3 * load,
                    f"2026-01-01T00:00:{len(impacts):02d}Z",
                    RATE_HZ,
                    PRETRIGGER,
                    y[:, :SAMPLES] + noise * rng.standard_normal((2, SAMPLES)),
                    True,
                )
            )
    return Session(
        "2026-01-01T00:00:00Z",
        RigDescription(M1, M2, K1, K2, RATE_HZ, 10.0, 1, 10000.0, 4, "butterworth", 100.0, 16),
        tuple(impacts),
        source="made",
        complete=True,
    )


def problem_of(*sessions: Session) -> RingDowns:
    return ring_downs(sessions, RIG, header_uncertainty(sessions[0]))


def diagnosed(sessions: Sequence[Session], known: Sequence[Mechanism], learn: bool = False) -> Diagnosis:
    return diagnose_sessions(sessions, RIG, header_uncertainty(sessions[0]), known, learn=learn)
