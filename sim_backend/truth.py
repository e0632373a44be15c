"""What the simulated rig really is: its parameters as drawn from the seed, its contact, its modes at each load."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rig.settings import RigSettings
from rig.tube import OwnMode
from sim_backend.settings import SimBackendSettings
from sim_backend.static import ContactTable, StaticEquilibrium
from sim_backend.two_mass import TwoMass, contact_damping, tube_damping

SENSITIVITY_STD = 0.015
ASYMMETRY_STD, LARGEST_ASYMMETRY = 0.0015, 0.005  # of k1 / k2, against the declared ratio


@dataclass(frozen=True, slots=True)
class TrueParameters:
    """Masses (kg), tube springs (N/m), their dampers (N s/m) and the gauge's sensitivity (mV/mN).

    The masses hold what moves of the tube springs at rest; their own mode is a mass (kg) and a frequency (Hz), 0 where
    none is declared.
    """

    m1: float
    m2: float
    k1: float
    k2: float
    c1: float
    c2: float
    sensitivity_mv_per_mn: float
    tube_mode_kg: float = 0.0
    tube_mode_hz: float = 0.0

    @property
    def tube_mode(self) -> OwnMode | None:
        """Own mode of the tube springs."""
        return OwnMode(self.tube_mode_kg, self.tube_mode_hz) if self.tube_mode_hz else None


def draw_parameters(rig: RigSettings, settings: SimBackendSettings, seed: int) -> TrueParameters:
    """Return what the declared values turn out to be for this seed; exactly those without parameter errors."""
    inertia = rig.springs.inertia()
    masses = np.array([rig.masses.m1_kg, rig.masses.m2_kg])
    springs = np.array(rig.spring_stiffness())
    sensitivity = rig.gauge_sensitivity_mv_per_mn
    if settings.parameter_errors:
        rng = np.random.default_rng([seed, 0])
        masses = masses + rig.masses.uncertainty_kg * rng.standard_normal(2)
        spread = rig.springs.uncertainty_percent / 100
        common = 1 + spread * rng.standard_normal()
        limit = min(LARGEST_ASYMMETRY, spread)
        asymmetry = float(np.clip(min(ASYMMETRY_STD, spread) * rng.standard_normal(), -limit, limit))
        springs = springs * common * np.array([1 + asymmetry / 2, 1 - asymmetry / 2])
        sensitivity *= 1 + SENSITIVITY_STD * float(rng.standard_normal())
        if inertia is not None:
            masses = masses + inertia.added_kg + inertia.uncertainty_kg * rng.standard_normal()
    elif inertia is not None:
        masses = masses + inertia.added_kg
    m1, m2, k1, k2 = map(float, (*masses, *springs))
    c = tube_damping(settings.tube_damping_ratio, m1, m2, k1, k2)
    own = None if inertia is None else inertia.own_mode
    of_tubes = (0.0, 0.0) if own is None else (own.mass_kg, own.frequency_hz)
    return TrueParameters(m1, m2, k1, k2, c, c, sensitivity, *of_tubes)


class TrueRig:
    """True parameters and contact: static equilibrium, and Eq. 9 at every load."""

    def __init__(
        self, parameters: TrueParameters, table: ContactTable, contact_stiffness: Callable[[float], float] | None
    ):
        self.parameters = parameters
        self.contact_stiffness = table.stiffness if contact_stiffness is None else contact_stiffness
        self.damping_ratio = table.damping_ratio
        k1, k2 = parameters.k1, parameters.k2
        if contact_stiffness is None:
            self.equilibrium = StaticEquilibrium.of_table(table, k1, k2)
        else:
            self.equilibrium = StaticEquilibrium.of_function(contact_stiffness, k1, k2)

    def tester(self, load_n: float, stiffness_factor: float = 1.0, damping_factor: float = 1.0) -> TwoMass:
        """Return Eq. 9 at a load, N; without a contact when the load is zero.

        The factors multiply k_c and c_c, each by itself.
        """
        p = self.parameters
        kc = cc = 0.0
        if load_n > 0:
            kc = self.contact_stiffness(load_n)
            cc = contact_damping(kc, self.damping_ratio(load_n), p.m1, p.m2)
        return TwoMass(p.m1, p.m2, p.k1, p.k2, kc * stiffness_factor, cc * damping_factor, p.c1, p.c2, p.tube_mode)

    def at_load(self, load_n: float) -> dict[str, float]:
        """Return contact and modes at a load, N, without scatter."""
        tester = self.tester(load_n)
        f1, zeta1, f2, zeta2 = tester.modes()
        return {
            "load_mn": load_n * 1e3,
            "contact_stiffness_n_per_m": tester.kc,
            "contact_damping_n_s_per_m": tester.cc,
            "f1_hz": f1,
            "f2_hz": f2,
            "zeta1": zeta1,
            "zeta2": zeta2,
        }
