"""What a concealed session is made of before anything is concealed: a rig, its loads, the taps and the recorder."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mesotap.proof.generator.integration import STEPS_PER_SAMPLE, Machine, integrate

Real = NDArray[np.float64]
Whole = NDArray[np.int64]

MASSES_KG = (0.107, 0.108)
MASS_ERROR = 5e-4  # standard deviation of what is declared against what is there, relative
SPRING_ERROR = 5e-3
RATE_HZ = 25_000.0
PRETRIGGER = 250
LONGEST_PULSE_S = 0.5e-3
SETTLED_S = 0.5e-3  # after the longest pulse, until the recorder's low-pass has rung out
SOFTEST_CONTACT = 0.8e6  # N/m: below it the contact mode lies at the system mode
AHEAD = 6  # samples that a clock may be ahead at the end of a record
LOUDEST_S = 8e-3  # after a tap: by then the contact has borne the most


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of a channel: white, and a slow part behind a first-order low-pass at ``corner_hz``.

    ``slow_share`` is the slow part's variance over that of all.
    """

    rms: float
    slow_share: float
    corner_hz: float


@dataclass(frozen=True, slots=True)
class Plan:
    """A rig of Eq. 9 as it is and as it is declared, its loads, and the taps; n impacts at L loads.

    Attributes
    ----------
    masses, springs
        As they are: m1, m2 (kg), k1, k2 (N/m).
    declared_masses, declared_springs
        As the session file has them.
    loads
        (L,) N, ascending.
    kc, cc
        (L,) N/m and N s/m.
    exponent
        Of k_c against the load.
    group
        (n,) load of each impact.
    pulses
        (n, 1, 5) see `Machine.pulses`.
    offset
        (n,) steps from the start of the tap to the next sample.
    samples
        After the tap, in each record.
    noise
        Of each channel.
    lowpass_hz, highpass_hz
        The declared Butterworth filter, fourth and first order.
    """

    masses: tuple[float, float]
    springs: tuple[float, float]
    declared_masses: tuple[float, float]
    declared_springs: tuple[float, float]
    loads: Real
    kc: Real
    cc: Real
    exponent: float
    group: Whole
    pulses: Real
    offset: Whole
    samples: int
    noise: Noise
    highpass_hz: float = 10.0
    lowpass_hz: float = 10_000.0

    @property
    def step_s(self) -> float:
        """Step of the integration, s."""
        return 1.0 / RATE_HZ / STEPS_PER_SAMPLE

    @property
    def steps(self) -> int:
        """Steps of a whole record, and of what a clock that is fast sees of the time after it."""
        return (self.samples + 1 + AHEAD) * STEPS_PER_SAMPLE

    @property
    def static(self) -> Real:
        """(L,) preload over contact stiffness, m."""
        return self.loads / self.kc

    @property
    def settled(self) -> int:
        """First sample after the tap at which every record is a free decay."""
        return math.ceil((LONGEST_PULSE_S + SETTLED_S) * RATE_HZ)

    def louder(self, factor: float) -> Plan:
        """Return the plan with all taps, and the noise with them, times ``factor``."""
        pulses = self.pulses.copy()
        pulses[:, :, 2] *= factor
        return replace(self, pulses=pulses, noise=replace(self.noise, rms=self.noise.rms * factor))

    def of_each_impact(self, values: Real) -> Real:
        """Spread (L,) values over the impacts, (n,)."""
        return np.asarray(values, float)[self.group]


def machine_of(plan: Plan) -> Machine:
    """Return the rig of Eq. 9 with the plan's taps."""
    (m1, m2), (k1, k2) = plan.masses, plan.springs
    kc, cc = plan.of_each_impact(plan.kc), plan.of_each_impact(plan.cc)
    contact = np.array([1.0, -1.0])
    both = np.outer(contact, contact)
    return Machine(
        mass=np.array([m1, m2]),
        stiffness=np.diag([k1, k2]) + kc[:, None, None] * both,
        damping=cc[:, None, None] * both,
        contact=contact,
        contact_line=np.column_stack([kc, cc]),
        seen=np.array([[0.0, 1.0]]),
        pulses=plan.pulses,
    )


def random_plan(
    rng: np.random.Generator,
    exponent: float | None = None,
    exact: bool = False,
    force_ratio: float | None = None,
    size: tuple[int, int] | None = None,
) -> Plan:
    """Draw a session.

    Parameters
    ----------
    exponent
        Of k_c against the load; drawn from 1/3 to 1 without.
    exact
        Whether the rig is as declared and its noise white.
    force_ratio
        Median peak of the dynamic contact force over the preload; drawn without.
    size
        How many loads and how many taps at each; drawn without, from 3 to 8 and from 4 to 8.
    """
    spring = rng.uniform(3.0e5, 5.0e5)
    declared_springs = (spring, spring * (1 + 0.005 * rng.standard_normal()))
    error = 0.0 if exact else 1.0
    masses = tuple(m * (1 + error * MASS_ERROR * rng.standard_normal()) for m in MASSES_KG)
    springs = tuple(k * (1 + error * SPRING_ERROR * rng.standard_normal()) for k in declared_springs)

    count, taps = (int(rng.integers(3, 9)), None) if size is None else size
    loads = _apart(rng, count)
    exponent = float(rng.uniform(1 / 3, 1.0)) if exponent is None else exponent
    highest = float(np.exp(rng.uniform(math.log(1200.0), math.log(4000.0))))
    stiffest = masses[1] * (2 * math.pi * highest) ** 2 / 2
    stiffest = max(stiffest, SOFTEST_CONTACT * (loads[-1] / loads[0]) ** exponent)
    kc = stiffest * (loads / loads[-1]) ** exponent * (1 + 0.004 * rng.standard_normal(count))
    zeta = np.exp(rng.uniform(math.log(0.003), math.log(0.1))) * (loads / loads[0]) ** -rng.uniform(0.0, 0.6)
    zeta = np.maximum(zeta, 0.0015) * (1 + 0.03 * rng.standard_normal(count))
    angular = np.sqrt((springs[1] + 2 * kc) / masses[1])
    cc = zeta * masses[1] * angular

    group = np.repeat(np.arange(count), int(rng.integers(4, 9)) if taps is None else taps)
    n = group.size
    pulses = np.zeros((n, 1, 5))
    pulses[:, 0, 1] = rng.uniform(0.2e-3, LONGEST_PULSE_S) * rng.uniform(0.85, 1.0, n)
    pulses[:, 0, 2] = 1.0
    pulses[:, 0, 3] = rng.uniform(1.0, 2.0)
    pulses[:, 0, 4] = rng.uniform(0.85, 1.15)
    rms = 1.0 / math.exp(rng.uniform(math.log(50.0), math.log(300.0)))  # of the median peak, see below
    slow = 0.0 if exact else float(rng.uniform(0.1, 0.6))
    plan = Plan(
        masses=(float(masses[0]), float(masses[1])),
        springs=(float(springs[0]), float(springs[1])),
        declared_masses=MASSES_KG,
        declared_springs=declared_springs,
        loads=loads,
        kc=kc,
        cc=cc,
        exponent=exponent,
        group=group,
        pulses=pulses,
        offset=rng.integers(0, STEPS_PER_SAMPLE, n),
        samples=int(rng.uniform(0.06, 0.1) * RATE_HZ) - PRETRIGGER,
        noise=Noise(rms, slow, float(np.exp(rng.uniform(math.log(100.0), math.log(800.0))))),
    )
    median = float(rng.uniform(0.12, 0.45)) if force_ratio is None else force_ratio
    strength = median * np.exp(0.35 * rng.standard_normal(n))
    return _tapped(plan, strength)


def _apart(rng: np.random.Generator, count: int) -> Real:
    """Draw loads from 70 to 1000 mN that differ by 8 % at least, N."""
    while True:
        loads = np.sort(np.exp(rng.uniform(math.log(0.07), math.log(1.0), count)))
        if np.all(np.diff(np.log(loads)) > 0.08) and (count == 1 or loads[-1] > 2 * loads[0]):
            return np.asarray(loads, float)


def _tapped(plan: Plan, ratio: Real) -> Plan:
    """Give the taps the forces at which the contact bears ``ratio`` (n,) times its preload, and the noise its rms."""
    steps = int(LOUDEST_S * RATE_HZ) * STEPS_PER_SAMPLE
    seen = integrate(machine_of(plan), steps, plan.step_s)[:, 0]
    borne = _contact_force(plan, seen)
    peak = ratio * plan.of_each_impact(plan.loads) / borne
    pulses = plan.pulses.copy()
    pulses[:, 0, 2] = peak
    loudest = np.abs(seen).max(axis=1) * peak
    return replace(plan, pulses=pulses, noise=replace(plan.noise, rms=plan.noise.rms * float(np.median(loudest))))


def _contact_force(plan: Plan, seen: Real) -> Real:
    """Largest dynamic contact force m2 a2 + k2 x2 of each impact, (n,) N."""
    h = plan.step_s
    place = np.cumsum(np.cumsum(seen, axis=1), axis=1) * h * h
    return np.asarray(np.abs(plan.masses[1] * seen + plan.springs[1] * place).max(axis=1))
