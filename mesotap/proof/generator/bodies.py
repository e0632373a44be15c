"""Bodies beside those of Eq. 9: a part on a mount, what the tubes stand on, masses that turn or move sideways."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from mesotap.proof.generator.effect import Character, Effect, with_body
from mesotap.proof.generator.integration import Machine
from mesotap.proof.generator.plan import Plan
from mesotap.proof.generator.tubes import tell_walls, walls_ring


def attached(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    """A part of s kg stands on a mount of ``c["frequency_hz"]`` and ``c["zeta"]`` on the lower mass."""
    angular = 2 * math.pi * c["frequency_hz"]
    direction = np.zeros(machine.mass.size + 1)
    direction[1], direction[-1] = -1.0, 1.0
    return with_body(machine, s, direction, s * angular**2, 2 * c["zeta"] * s * angular)


def _tell_attached(plan: Plan, s: float, c: Character) -> dict[str, Any]:
    angular = 2 * math.pi * c["frequency_hz"]
    return {
        "attached_mass_kg": s,
        "mount_stiffness_n_per_m": s * angular**2,
        "mount_damping_n_s_per_m": 2 * c["zeta"] * s * angular,
    }


def _on_feet(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    """The tube springs of ``c["feet"]`` (0 upper, 1 lower) stand on a mass of 1/s kg that itself is sprung."""
    mass, stiffness, damping = _foot_numbers(s, c)
    ground = np.zeros(machine.mass.size + 1)
    ground[-1] = 1.0
    machine = with_body(machine, mass, ground, stiffness, damping)
    coupled = machine.stiffness.copy()
    for i in c["feet"]:
        coupled[:, i, -1] -= plan.springs[i]
        coupled[:, -1, i] -= plan.springs[i]
        coupled[:, -1, -1] += plan.springs[i]
    return replace(machine, stiffness=coupled)


def _foot_numbers(s: float, c: Character) -> tuple[float, float, float]:
    angular = 2 * math.pi * c["frequency_hz"]
    return 1 / s, angular**2 / s, 2 * c["zeta"] * angular / s


def _tell_feet(of: str) -> Callable[[Plan, float, Character], dict[str, Any]]:
    def tell(plan: Plan, s: float, c: Character) -> dict[str, Any]:
        mass, stiffness, damping = _foot_numbers(s, c)
        numbers = {f"{of}_mass_kg": mass, f"{of}_stiffness_n_per_m": stiffness, f"{of}_damping_n_s_per_m": damping}
        return {**numbers, "feet": list(c["feet"])}

    return tell


def _draw_feet(*choices: tuple[int, ...]) -> Callable[[np.random.Generator, Plan], Character]:
    return lambda rng, plan: {
        "frequency_hz": float(rng.uniform(90, 200)),
        "zeta": float(rng.uniform(0.01, 0.04)),
        "feet": choices[int(rng.integers(len(choices)))],
    }


def _across(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    """The contact, a little inclined, pushes the lower mass across the axis too; one channel shows s of that motion."""
    angular = 2 * math.pi * c["frequency_hz"]
    mass = plan.masses[1]
    machine = driven_by_the_contact(machine, mass, c["inclination"], mass * angular**2, 2 * c["zeta"] * mass * angular)
    seen = machine.seen if len(machine.seen) > 1 else np.repeat(machine.seen, 2, axis=0)
    seen = seen.copy()
    seen[c["channel"], -1] = s
    return replace(machine, seen=seen)


def _tell_across(plan: Plan, s: float, c: Character) -> dict[str, Any]:
    angular, mass = 2 * math.pi * c["frequency_hz"], plan.masses[1]
    return {
        "transverse_sensitivity": s,
        "inclination": c["inclination"],
        "lateral_stiffness_n_per_m": mass * angular**2,
        "lateral_damping_n_s_per_m": 2 * c["zeta"] * mass * angular,
        "channel": "AB"[c["channel"]],
    }


def _draw_across(rng: np.random.Generator, plan: Plan) -> Character:
    return {
        "frequency_hz": float(rng.uniform(700, 4500)),
        "zeta": float(rng.uniform(0.005, 0.03)),
        "inclination": float(rng.choice([-1.0, 1.0]) * rng.uniform(0.004, 0.012)),
        "channel": int(rng.integers(2)),
    }


def _rolling(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    """The upper mass turns, as the contact touches it off its axis by s of its radius of gyration."""
    angular, inertia = 2 * math.pi * c["frequency_hz"], plan.masses[0]
    return driven_by_the_contact(machine, inertia, s, inertia * angular**2, 2 * c["zeta"] * inertia * angular)


def _tell_rolling(plan: Plan, s: float, c: Character) -> dict[str, Any]:
    angular, felt = 2 * math.pi * c["frequency_hz"], plan.masses[0] / s**2
    return {
        "offset_over_gyration": s,
        "roll_mass_kg": felt,
        "roll_stiffness_n_per_m": felt * angular**2,
        "roll_damping_n_s_per_m": 2 * c["zeta"] * felt * angular,
    }


def _sideways(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    """The contact, inclined by s, pushes the lower mass sideways too, which no channel shows."""
    angular, mass = 2 * math.pi * c["frequency_hz"], plan.masses[1]
    return driven_by_the_contact(machine, mass, s, mass * angular**2, 2 * c["zeta"] * mass * angular)


def _draw_turning(rng: np.random.Generator, plan: Plan) -> Character:
    return {"frequency_hz": float(rng.uniform(900, 4500)), "zeta": float(rng.uniform(0.005, 0.03))}


def _strained(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    """One channel shows, besides, the contact's force: m2 a2 + k2 x2 by Newton's law for the lower mass."""
    seen = machine.seen if len(machine.seen) > 1 else np.repeat(machine.seen, 2, axis=0)
    seen, places = seen.copy(), np.zeros((2, machine.mass.size))
    seen[c["channel"], 1] += s
    places[c["channel"], 1] = s * plan.springs[1] / plan.masses[1]
    return replace(machine, seen=seen, placed=places)


def _dragged(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    """A damper holds the lower mass back."""
    damping = machine.damping.copy()
    damping[:, 1, 1] += s
    return replace(machine, damping=damping)


def held(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    """The specimen, a body of its own, stands on a holder on the lower mass; s is the holder's compliance over 1/k_c.

    That of the contact is so much less that both in series have the plan's at rest; the specimen is part of m2.
    """
    b = machine.mass.size
    kc, cc = machine.contact_line[:, 0], machine.contact_line[:, 1]
    holder = float(np.max(kc)) / s
    contact = 1 / (1 / kc - 1 / holder)
    direction = np.zeros(b + 1)
    direction[1], direction[-1] = -1.0, 1.0
    machine = with_body(machine, c["specimen_kg"], direction, holder, 0.0)
    machine.mass[1] -= c["specimen_kg"]
    before = machine.contact
    after = before.copy()
    after[1], after[-1] = 0.0, before[1]
    line = np.column_stack([contact, cc * (contact / kc) ** 2])
    change = line[:, :, None, None] * np.outer(after, after)
    change -= machine.contact_line[:, :, None, None] * np.outer(before, before)
    return replace(
        machine,
        contact=after,
        contact_line=line,
        stiffness=machine.stiffness + change[:, 0],
        damping=machine.damping + change[:, 1],
    )


def driven_by_the_contact(machine: Machine, mass: float, arm: float, stiffness: float, damping: float) -> Machine:
    """Return the machine with one more body on a spring of its own, whose motion times ``arm`` opens the contact."""
    own = np.zeros(machine.mass.size + 1)
    own[-1] = 1.0
    machine = with_body(machine, mass, own, stiffness, damping)
    before = machine.contact
    after = before.copy()
    after[-1] = -arm
    change = np.outer(after, after) - np.outer(before, before)
    line = machine.contact_line
    return replace(
        machine,
        contact=after,
        stiffness=machine.stiffness + line[:, 0, None, None] * change,
        damping=machine.damping + line[:, 1, None, None] * change,
        acting=tuple(replace(a, direction=after) if np.array_equal(a.direction, before) else a for a in machine.acting),
    )


def _rocking(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    """The lower mass turns: A sees x2 + u, B x2 - u, u being the turning times their distance r from the axis.

    The contact lies off the axis by s r, so it also feels - s u.
    """
    angular = 2 * math.pi * c["frequency_hz"]
    mass = c["inertia_kg_m2"] / c["arm_m"] ** 2
    machine = driven_by_the_contact(machine, mass, s, mass * angular**2, 2 * c["zeta"] * mass * angular)
    seen = np.repeat(machine.seen[:1], 2, axis=0)
    seen[:, -1] = (1.0, -1.0)
    return replace(machine, seen=seen)


def _tell_rocking(plan: Plan, s: float, c: Character) -> dict[str, Any]:
    angular = 2 * math.pi * c["frequency_hz"]
    return {
        "rocking_inertia_kg_m2": c["inertia_kg_m2"],
        "rocking_stiffness_n_m": c["inertia_kg_m2"] * angular**2,
        "rocking_damping_n_m_s": 2 * c["zeta"] * c["inertia_kg_m2"] * angular,
        "contact_offset_m": s * c["arm_m"],
        "accelerometer_arm_m": c["arm_m"],
    }


BODIES = (
    Effect(
        "attached_mass", "lower mass", 5e-4, 0.02, _tell_attached,
        draw=lambda rng, plan: {"frequency_hz": float(rng.uniform(1500, 4500)), "zeta": float(rng.uniform(0.01, 0.04))},
        machined=attached,
    ),
    Effect(
        "frame_compliance", "frame", 0.05, 1.0, _tell_feet("frame"), draw=_draw_feet((0,), (1,)), machined=_on_feet,
    ),
    Effect(
        "rocking", "lower mass", 0.02, 0.5, _tell_rocking,
        draw=lambda rng, plan: {
            "inertia_kg_m2": float(rng.uniform(0.8e-5, 2e-5)), "arm_m": float(rng.uniform(0.009, 0.014)),
            "frequency_hz": float(rng.uniform(2200, 6000)), "zeta": float(rng.uniform(0.005, 0.02)),
        },
        machined=_rocking,
    ),
    Effect(
        "base_motion", "frame", 0.05, 1.0, _tell_feet("base"), draw=_draw_feet((0, 1)), machined=_on_feet,
    ),
    Effect(
        "cross_axis_sensitivity", "sensor chain", 0.02, 0.3, _tell_across, draw=_draw_across, machined=_across,
    ),
    Effect(
        "upper_roll", "upper mass", 0.05, 0.6, _tell_rolling, machined=_rolling, draw=_draw_turning,
    ),
    Effect(
        "normal_tangential_coupling", "contact", 0.05, 0.6,
        lambda p, s, c: {"inclination": s, **c}, machined=_sideways, draw=_draw_turning,
    ),
    Effect(
        "base_strain", "sensor chain", 3e-3, 0.3,
        lambda p, s, c: {
            "base_strain_m_s2_per_n": c["sign"] * s / p.masses[1], "channel": "AB"[c["channel"]]
        },
        machined=lambda machine, plan, s, c: _strained(machine, plan, c["sign"] * s, c),
        draw=lambda rng, plan: {"sign": float(rng.choice([-1.0, 1.0])), "channel": int(rng.integers(2))},
    ),
    Effect(
        "tube_mode", "tube springs", 4e-3, 9e-3, tell_walls, machined=walls_ring,
        draw=lambda rng, plan: {"zeta": float(rng.uniform(0.001, 0.01))},
    ),
    Effect(
        "cable_drag", "lower mass", 0.06, 30.0, lambda p, s, c: {"cable_damping_n_s_per_m": s}, machined=_dragged,
    ),
)  # fmt: skip
"""Effects that are bodies."""
