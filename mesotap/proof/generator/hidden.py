"""What Eq. 9 lacks and a free decay does not show: sessions with one of these are no different from sound ones.

Each has a strength drawn once, as strong as a laboratory may meet it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesotap.proof.generator.bodies import held
from mesotap.proof.generator.effect import Character, Effect, in_contact
from mesotap.proof.generator.integration import Machine
from mesotap.proof.generator.laws import Law
from mesotap.proof.generator.plan import Plan

Real = NDArray[np.float64]

AIR_PA, AIR_PA_S = 1.013e5, 1.83e-5
ORDERS = 4  # squares of odd orders of the film's pressure that are kept; what is faster has gone


def _yielding(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return in_contact(machine, plan, Law.YIELDING, s)


def _leaking(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return in_contact(machine, plan, Law.LEAKING, 1.0, s * plan.of_each_impact(plan.kc), c["time_s"])


def film_modes(side_m: float, gap_m: float) -> list[tuple[float, float]]:
    """Return stiffness (N/m) and time (s) of the pressure modes of air between square flats, by odd orders m and n.

    The pressure p = cos(m pi x / L) cos(n pi y / L) of the isothermal Reynolds equation, linear in gap and pressure,
    leaks through the gap h with the rate p_a h^2 pi^2 (m^2 + n^2) / (12 mu L^2); a plate that closes in by d raises
    it by p_a d / h times the mode's share 16 / (pi^2 m n) of a uniform pressure, and bears its mean, 4 / (pi^2 m n).
    """
    found = []
    for m in range(1, 2 * ORDERS, 2):
        for n in range(1, 2 * ORDERS, 2):
            rate = AIR_PA * gap_m**2 * math.pi**2 * (m**2 + n**2) / (12 * AIR_PA_S * side_m**2)
            borne = 16 / (math.pi**2 * m * n) * 4 / (math.pi**2 * m * n)
            found.append((borne * AIR_PA * side_m**2 / gap_m, 1 / rate))
    return found


def _film(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    for stiffness, time in film_modes(c["film_side_m"], s):
        if time > 4 * plan.step_s:
            machine = in_contact(machine, plan, Law.LEAKING, 1.0, stiffness, time)
    return machine


def _jittered(y: Real, plan: Plan, s: float, c: Character) -> Real:
    """Sample times that scatter by s of a sample, alike in both channels: the slope times the error of the time."""
    late = s * np.random.default_rng(c["clock"]).standard_normal((y.shape[0], 1, y.shape[2]))
    return np.asarray(y + late * np.gradient(y, axis=2))


def _tell(name: str) -> Any:
    return lambda plan, s, c: {name: s, **c}


HIDDEN = {
    e.id: e
    for e in (
        Effect(
            "holder_compliance", "contact", 0.02, 0.5, _tell("holder_share"), machined=held,
            draw=lambda rng, plan: {"specimen_kg": float(rng.uniform(3e-4, 2e-3))},
        ),
        Effect(
            "air_film", "contact", 0.8e-6, 3e-6, _tell("film_gap_m"), machined=_film,
            draw=lambda rng, plan: {"film_side_m": 1.35e-3},
        ),
        Effect(
            "sampling_jitter", "sensor chain", 1e-4, 1e-3, _tell("jitter_samples"), sensed=_jittered,
            draw=lambda rng, plan: {"clock": int(rng.integers(2**31))},
        ),
        Effect("plastic_loading", "contact", 0.05, 0.6, _tell("yielding_share"), machined=_yielding),
        Effect(
            "contact_relaxation", "contact", 0.01, 0.1, _tell("relaxing_share"), machined=_leaking,
            draw=lambda rng, plan: {"time_s": math.exp(rng.uniform(math.log(2e-5), math.log(2e-3)))},
        ),
    )
}  # fmt: skip
"""By id; the strength is drawn between ``first`` and ``largest``."""
