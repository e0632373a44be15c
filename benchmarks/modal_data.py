"""Ring-downs whose modes are known, over the range the papers publish, and the Cramer-Rao bounds on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from cramer_rao import bounds, frequency_and_damping
from numpy.typing import NDArray

from analysis.modal.modes import sampled_pole
from analysis.stiffness import contact_from_pole, pole
from daq.records import RigDescription
from rig.settings import Filter
from sim_backend.pulses import half_sine
from sim_backend.recorder import analog_filter
from sim_backend.ring_down import ring_down_linear
from sim_backend.two_mass import TwoMass

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

RATE_HZ = 25_000.0
IMPACTS, CHANNELS, SAMPLES = 8, 2, 5000
ZETA1 = (0.001, 0.005)
M1_KG, M2_KG = 0.107, 0.108
PRETRIGGER = 250
PULSE_S = 0.3e-3


@dataclass(frozen=True, slots=True)
class Case:
    """One combination of the published range."""

    f1_hz: float
    f2_hz: float
    zeta2: float
    snr_db: float

    def poles(self, zeta1: float) -> Complex:
        """Sampled poles of both modes."""
        return np.array([sampled_pole(self.f1_hz, zeta1, RATE_HZ), sampled_pole(self.f2_hz, self.zeta2, RATE_HZ)])


def published_range(*snr_db: float) -> list[Case]:
    """Every combination of specimen, f2, zeta2 and signal-to-noise ratio."""
    flat = [(356.0, f2, z) for f2 in (1410.0, 1925.0, 2234.0) for z in (0.0016, 0.005, 0.02, 0.08)]
    sphere = [(281.0, f2, z) for f2 in (598.0, 733.0, 955.0) for z in (0.03, 0.08, 0.17)]
    return [Case(*c, snr) for c in (*flat, *sphere) for snr in snr_db]


def truth(poles: Complex) -> Real:
    """(f1, f2, zeta1, zeta2) of two sampled poles."""
    s = np.log(poles) * RATE_HZ
    return np.concatenate([np.abs(s) / (2 * np.pi), -s.real / np.abs(s)])


def bound(poles: Complex, amplitudes: Complex, samples: int, sigma: float) -> Real:
    """Cramer-Rao bounds on (f1, f2, zeta1, zeta2)."""
    covariance = bounds(poles, amplitudes, samples, sigma)
    each = np.array(
        [frequency_and_damping(complex(np.log(z)), c, RATE_HZ) for z, c in zip(poles, covariance, strict=True)]
    )
    return each.T.ravel()


def free_decays(
    case: Case, rng: np.random.Generator, samples: int = SAMPLES, scatter: float = 0.0, alike: bool = False
) -> tuple[Real, list[Complex], list[Complex], list[float]]:
    """Eight impacts, seen alike by two channels, with white noise: (8, 2, n), poles, amplitudes, noise of a channel.

    ``scatter`` is the relative standard deviation of f2 from impact to impact; with ``alike`` all impacts have the
    same amplitudes and phases, as averaging needs.
    """
    zeta1 = rng.uniform(*ZETA1)
    y = np.empty((IMPACTS, CHANNELS, samples))
    k = np.arange(samples)
    poles, amplitudes, sigmas = [], [], []
    drawn = 0.5 * rng.uniform(0.7, 1.3, (IMPACTS, 2)) * np.exp(2j * np.pi * rng.uniform(size=(IMPACTS, 2)))
    for i in range(IMPACTS):
        z = case.poles(zeta1)
        if scatter:
            z[1] = sampled_pole(case.f2_hz * (1 + scatter * rng.standard_normal()), case.zeta2, RATE_HZ)
        a = drawn[0] if alike else drawn[i]
        clean = 2 * sum((aj * np.exp(np.log(zj) * k)).real for aj, zj in zip(a, z, strict=True))
        sigma = float(np.abs(clean).max()) * 10 ** (-case.snr_db / 20)
        y[i] = clean + sigma * rng.standard_normal((CHANNELS, samples))
        poles.append(z)
        amplitudes.append(a)
        sigmas.append(sigma)
    return y, poles, amplitudes, sigmas


def free_decay_bounds(poles: list[Complex], amplitudes: list[Complex], sigmas: list[float], samples: int) -> Real:
    """(8, 4) bounds of each impact; two channels that see the same motion are one with half the noise variance."""
    each = zip(poles, amplitudes, sigmas, strict=True)
    return np.array([bound(z, a, samples, s / np.sqrt(CHANNELS)) for z, a, s in each])


def tester_of(case: Case, zeta1: float) -> TwoMass:
    """The tester whose free modes are (nearly) those of the case; its own poles are the truth."""
    k = (M1_KG + M2_KG) / 2 * (2 * np.pi * case.f1_hz) ** 2
    stiffness, damping = contact_from_pole(pole(case.f2_hz, case.zeta2), M1_KG, M2_KG, k, k)
    c = 2 * zeta1 * np.sqrt(k * (M1_KG + M2_KG) / 2)
    return TwoMass(M1_KG, M2_KG, k, k, stiffness, damping, c, c)


def taps(case: Case, rng: np.random.Generator) -> tuple[list[Real], Real, Real, float, TwoMass]:
    """Eight whole taps of a load through the declared band-pass: records, truth, bounds, noise, tester.

    The bounds are those of the unfiltered free decay from the first sample after the pulse.
    """
    tester = tester_of(case, rng.uniform(*ZETA1))
    s = tester.poles()
    s = s[s.imag > 0]
    poles = np.exp(s[np.argsort(np.abs(s))] / RATE_HZ)
    band_pass = analog_filter(Filter())
    pulse = half_sine(1.0, PULSE_S)
    records, least = [], []
    sigma = 0.0
    for i in range(IMPACTS):
        onset = PRETRIGGER + rng.uniform()
        seen = ring_down_linear(tester, pulse, onset / RATE_HZ, SAMPLES, RATE_HZ, band_pass).acceleration
        bare = ring_down_linear(tester, pulse, onset / RATE_HZ, SAMPLES, RATE_HZ).acceleration
        if i == 0:
            sigma = float(np.abs(seen).max()) * 10 ** (-case.snr_db / 20)
        end = int(np.ceil(onset + PULSE_S * RATE_HZ))
        waves = np.exp(np.log(poles)[:, None] * np.arange(SAMPLES - end))
        columns = np.concatenate([2 * waves.real, -2 * waves.imag]).T
        parts = np.linalg.lstsq(columns, bare[end:], rcond=None)[0]
        least.append(bound(poles, parts[:2] + 1j * parts[2:], SAMPLES - end, sigma))
        records.append(seen + sigma * rng.standard_normal(SAMPLES))
    return records, truth(poles), np.array(least), sigma, tester


def declared_rig(tester: TwoMass) -> RigDescription:
    """Return what a session's header says of this tester and its recorder."""
    declared = Filter()
    return RigDescription(
        m1_kg=tester.m1,
        m2_kg=tester.m2,
        k1_n_per_m=tester.k1,
        k2_n_per_m=tester.k2,
        sample_rate_hz=RATE_HZ,
        highpass_hz=declared.highpass_hz,
        highpass_order=declared.highpass_order,
        lowpass_hz=declared.lowpass_hz,
        lowpass_order=declared.lowpass_order,
        filter_family=declared.family,
    )
