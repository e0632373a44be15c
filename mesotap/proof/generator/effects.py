"""What can be concealed in a session: the contract's mechanisms that leave a trace, and some outside its list.

An effect has a strength, graded by what survives the refit, and a character: its other constants, drawn once. It acts
on the machine, on the sampled channels, or on both. `parameters` gives the true parameters as a truth file states them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from mesotap.proof.generator.bodies import BODIES
from mesotap.proof.generator.effect import (
    Character,
    Effect,
    approach,
    in_contact,
    in_spring,
    largest_approach,
    typical_rate,
    typical_ratio,
    with_law,
)
from mesotap.proof.generator.integration import Machine
from mesotap.proof.generator.laws import Law
from mesotap.proof.generator.outside import CONTACT
from mesotap.proof.generator.outside_chain import CHAIN, OTHERS
from mesotap.proof.generator.outside_ground import ABSORBED, GROUND
from mesotap.proof.generator.plan import PRETRIGGER, RATE_HZ, Plan

Real = NDArray[np.float64]

STEADY_RATE = 1e-8  # m/s below which dry friction is rounded off: a thousandth of the motion at the record's end


def _hertz(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return in_contact(machine, plan, Law.HERTZ)


def _exponential(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return in_contact(machine, plan, Law.EXPONENTIAL)


def _parting(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return in_contact(machine, plan, Law.PARTING)


def _growing_damping(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return in_contact(machine, plan, Law.GROWING_DAMPING, s)


def _sliders(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    reach = c["reach_share"] * plan.of_each_impact(plan.static)
    return in_contact(machine, plan, Law.SLIDERS, s * plan.of_each_impact(plan.kc), reach, c["sliders"])


def _draw_sliders(rng: np.random.Generator, plan: Plan) -> Character:
    count = 1 if rng.uniform() < 0.7 else 6
    return {
        "sliders": count,
        "reach_share": float(rng.uniform(0.2, 0.6) * typical_ratio(plan)) * (1 if count == 1 else 2),
    }


def _tell_sliders(plan: Plan, s: float, c: Character) -> dict[str, Any]:
    if c["sliders"] != 1:
        return {"sliders": c["sliders"]}
    return {
        "slip_stiffness_n_per_m": (s * plan.kc).tolist(),
        "slip_force_n": (s * c["reach_share"] * plan.loads).tolist(),
    }


def _drag(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return in_contact(machine, plan, Law.DRAG, s / typical_rate(plan) * plan.of_each_impact(plan.cc))


def _film(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return in_contact(machine, plan, Law.FILM, s * plan.of_each_impact(plan.cc), c["film_height_m"])


def _draw_film(rng: np.random.Generator, plan: Plan) -> Character:
    return {"film_height_m": float(rng.uniform(1.2, 3.0)) * largest_approach(plan)}


def _meniscus(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    force = s * plan.of_each_impact(plan.loads)
    reach = c["range_share"] * plan.of_each_impact(plan.static)
    return in_contact(machine, plan, Law.MENISCUS, force, reach, c["setting_in"] * typical_rate(plan))


def _draw_menisci(rng: np.random.Generator, plan: Plan) -> Character:
    setting_in = math.exp(rng.uniform(math.log(0.3), math.log(1.5)))
    return {"range_share": float(rng.uniform(0.2, 1.0)), "setting_in": setting_in}


def _attraction(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    reach = c["range_share"] * plan.of_each_impact(plan.static)
    return in_contact(machine, plan, Law.ATTRACTION, s * plan.of_each_impact(plan.loads), reach)


def _creep(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return in_contact(machine, plan, Law.CREEP, s, c["creep_time_s"])


def _guide(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    direction = np.zeros(machine.mass.size)
    direction[0] = 1.0
    return with_law(machine, Law.DRY_FRICTION, direction, np.array([0.0, 0.0, 0.0, s, STEADY_RATE]))


def _spring_damping(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return in_spring(in_spring(machine, plan, 0, Law.DASHPOT, s), plan, 1, Law.DASHPOT, s)


def _spring_cubic(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    cubic = s * plan.springs[1] / c["place_m"] ** 2
    return in_spring(in_spring(machine, plan, 0, Law.CUBED_DEFORMATION, cubic), plan, 1, Law.CUBED_DEFORMATION, cubic)


def _draw_spring_place(rng: np.random.Generator, plan: Plan) -> Character:
    """Typical deflection of the tube springs: both masses together under half the tap's impulse."""
    angular = math.sqrt(plan.springs[1] / plan.masses[1])
    contact = np.sqrt((plan.springs[1] + 2 * plan.kc) / plan.masses[1])
    return {"place_m": float(np.median(approach(plan) * plan.of_each_impact(contact))) / 2 / angular}


def _double_hit(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    second = machine.pulses[:, :1].copy()
    second[:, 0, 0] = c["delays_s"]
    second[:, 0, 2] *= s
    return replace(machine, pulses=np.concatenate([machine.pulses, second], axis=1))


def _gain(y: Real, plan: Plan, s: float, c: Character) -> Real:
    return y * np.array([1.0, 1.0 + c["sign"] * s])[:, None]


def _draw_sign(rng: np.random.Generator, plan: Plan) -> Character:
    return {"sign": float(rng.choice([-1.0, 1.0]))}


def _clipped(y: Real, plan: Plan, s: float, c: Character) -> Real:
    level = (1 - s) * float(np.abs(y).max())
    return np.clip(y, -level, level)


def _stepped_scale(y: Real, plan: Plan, s: float, c: Character) -> Real:
    """A step at zero, of 100 s times the noise, in one channel's scale: its mean over the noise, which blurs it."""
    out = y.copy()
    own = out[:, c["channel"]]
    own += 50 * s * c["sign"] * plan.noise.rms * erf(own / (math.sqrt(2) * plan.noise.rms))
    return out


def _hum(y: Real, plan: Plan, s: float, c: Character) -> Real:
    """Mains picked up after the amplifier: the fundamental and three harmonics, at any phase in each record."""
    t = np.arange(-PRETRIGGER, y.shape[2] - PRETRIGGER) / RATE_HZ
    lines = sum(
        share * np.sin(2 * np.pi * k * (c["mains_hz"] * t[None, :] + turn[:, None]) + phase)
        for k, share, phase in zip((1, 2, 3, 5), c["shares"], c["phases"], strict=True)
        for turn in (c["turns"],)
    )
    return np.asarray(y + s * lines[:, None, :])


def _draw_hum(rng: np.random.Generator, plan: Plan) -> Character:
    return {
        "mains_hz": float(rng.choice([50.0, 60.0])),
        "shares": [1.0, *rng.uniform(0.0, 0.6, 3).tolist()],
        "phases": rng.uniform(0, 2 * np.pi, 4).tolist(),
        "turns": rng.uniform(0, 1, plan.group.size),
    }


_LISTED = (
    Effect(
        "hertz_stiffness", "contact", 0.5, 2.5, lambda p, s, c: {"force_exponent": 1.5},
        machined=_hertz, fixed=True, exponent=1 / 3,
    ),
    Effect(
        "rough_surface_stiffness", "contact", 0.5, 2.0, lambda p, s, c: {"exponential_law": 1.0},
        machined=_exponential, fixed=True, exponent=1.0,
    ),
    Effect("contact_loss", "contact", 3.0, 12.0, lambda p, s, c: {"unilateral": 1.0}, machined=_parting, fixed=True),
    Effect(
        "hunt_crossley_damping", "contact", 0.3, 6.0, lambda p, s, c: {"damping_growth_per_relative_approach": s},
        machined=_growing_damping,
    ),
    Effect("micro_slip", "contact", 0.01, 0.6, _tell_sliders, draw=_draw_sliders, machined=_sliders),
    Effect(
        "quadratic_damping", "contact", 0.1, 1.5,
        lambda p, s, c: {"quadratic_damping_n_s2_per_m2": (s / typical_rate(p) * p.cc).tolist()}, machined=_drag,
    ),
    Effect(
        "squeeze_film", "contact", 0.1, 1.0,
        lambda p, s, c: {"film_damping_n_s_per_m": (s * p.cc).tolist(), "film_height_m": c["film_height_m"]},
        draw=_draw_film, machined=_film,
    ),
    Effect(
        "adhesion", "contact", 0.01, 0.6,
        lambda p, s, c: {
            "adhesion_force_n": (s * p.loads).tolist(), "adhesion_range_m": (c["range_share"] * p.static).tolist()
        },
        draw=lambda rng, plan: {"range_share": float(rng.uniform(0.1, 0.6)) * typical_ratio(plan)},
        machined=_attraction,
    ),
    Effect(
        "menisci", "contact", 0.01, 0.4,
        lambda p, s, c: {
            "meniscus_force_n": (s * p.loads).tolist(), "meniscus_range_m": (c["range_share"] * p.static).tolist()
        },
        draw=_draw_menisci, machined=_meniscus,
    ),
    Effect(
        "contact_creep", "contact", 0.003, 0.4,
        lambda p, s, c: {"creep_per_e_fold": s, "creep_time_s": c["creep_time_s"]},
        draw=lambda rng, plan: {"creep_time_s": float(np.exp(rng.uniform(math.log(3e-3), math.log(20e-3))))},
        machined=_creep,
    ),
    Effect("guide_friction", "upper mass", 1e-4, 0.1, lambda p, s, c: {"friction_force_n": s}, machined=_guide),
    Effect(
        "tube_spring_damping", "tube springs", 0.03, 30.0, lambda p, s, c: {"c1_n_s_per_m": s, "c2_n_s_per_m": s},
        machined=_spring_damping,
    ),
    Effect(
        "tube_spring_cubic", "tube springs", 0.01, 0.5,
        lambda p, s, c: {"cubic_stiffness_n_per_m3": s * p.springs[1] / c["place_m"] ** 2},
        draw=_draw_spring_place, machined=_spring_cubic,
    ),
    *BODIES,
    Effect(
        "double_hit", "impactor", 0.02, 0.6, lambda p, s, c: {"second_impulse_fraction": s},
        draw=lambda rng, plan: {"delays_s": rng.uniform(2.5e-3, 12e-3, plan.group.size)}, machined=_double_hit,
    ),
    Effect(
        "converter_step", "sensor chain", 0.01, 0.5,
        lambda p, s, c: {"step_m_s2": c["sign"] * s * p.noise.rms * 100, "channel": "AB"[c["channel"]]},
        draw=lambda rng, plan: {"sign": float(rng.choice([-1.0, 1.0])), "channel": int(rng.integers(2))},
        sensed=_stepped_scale,
    ),
    Effect(
        "channel_gain", "sensor chain", 3e-3, 0.5, lambda p, s, c: {"gain_of_b": 1 + c["sign"] * s},
        draw=_draw_sign, sensed=_gain,
    ),
    Effect(
        "channel_skew", "sensor chain", 0.01, 1.0, lambda p, s, c: {"delay_of_b_samples": c["sign"] * s},
        draw=_draw_sign, delay=lambda plan, s, c: c["sign"] * s,
    ),
    Effect(
        "clipping", "sensor chain", 0.1, 0.8,
        lambda p, s, c: {"clip_at_fraction_of_record_peak": 1 - s}, sensed=_clipped,
    ),
    Effect(
        "mains_hum", "sensor chain", 1e-3, 1.0,
        lambda p, s, c: {"amplitude_m_s2": s, "mains_hz": c["mains_hz"]}, draw=_draw_hum, sensed=_hum,
    ),
)  # fmt: skip

LISTED = {e.id: e for e in _LISTED}
OUTSIDE = {e.id: e for e in (*CONTACT, *GROUND, *CHAIN, *OTHERS)}
HIDING = {e.id: e for e in ABSORBED}
"""Outside the list, and hidden by a free decay: not drawn."""
