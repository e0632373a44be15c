"""Force laws that no list of mechanisms holds, as effects: none of their constants follows the load.

Coefficients are absolute. Their sizes are taken from the session that they are first put into and belong to the rig
from then on, so that another session of the same rig has the same law.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from mesotap.proof.generator.effect import Character, Effect, Machined, approach, typical_rate, with_law
from mesotap.proof.generator.integration import Machine
from mesotap.proof.generator.laws import Law
from mesotap.proof.generator.nature import Nature, at, of_powers
from mesotap.proof.generator.plan import Plan
from mesotap.proof.generator.unlisted_laws import Unlisted

Draw = Callable[[np.random.Generator, Plan], Character]

SMOOTH = 1e-4  # of the typical rate, below which a law of the rate is rounded off

SPRINGS = ("lower tube spring", "upper tube spring")


def sizes(plan: Plan) -> dict[str, float]:
    """Return the contact's typical stiffness (N/m), damping (N s/m), deflection (m) and rate (m/s) in a session."""
    return {
        "stiffness": float(np.median(plan.kc)),
        "damping": float(np.median(plan.cc)),
        "place": float(np.median(approach(plan))),
        "rate": typical_rate(plan),
    }


def swing(plan: Plan) -> dict[str, float]:
    """Return the typical deflection (m) and rate (m/s) of a mass in the mode in which both move together."""
    angular = math.sqrt(plan.springs[1] / plan.masses[1])
    contact = np.sqrt((plan.springs[1] + 2 * plan.kc) / plan.masses[1])
    rate = float(np.median(approach(plan) * plan.of_each_impact(contact))) / 2
    return {"place": rate / angular, "rate": rate, "angular": angular}


def spread(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw evenly on a logarithmic scale."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def in_the_contact(law: Law | Unlisted, numbers: Callable[[float, Character], list[Any]]) -> Machined:
    """Return what puts a law into the contact, by its numbers from p[1] on: stiffness, damping, then its own."""
    return lambda machine, plan, s, c: with_law(machine, law, machine.contact, _columns(plan, [0.0, *numbers(s, c)]))


def at_a_mass(law: Law | Unlisted, numbers: Callable[[float, Character], list[Any]]) -> Machined:
    """Return what puts a law between the mass ``c["mass"]`` (0 upper, 1 lower) and the ground."""

    def machined(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
        direction = np.zeros(machine.mass.size)
        direction[c.get("mass", 0)] = 1.0
        return with_law(machine, law, direction, _columns(plan, [0.0, *numbers(s, c)]))

    return machined


def _columns(plan: Plan, numbers: list[Any]) -> Any:
    return np.column_stack([np.broadcast_to(np.asarray(n, float), (plan.group.size,)) for n in numbers])


def _draw_sizes(rng: np.random.Generator, plan: Plan) -> Character:
    return {**sizes(plan), "sign": float(rng.choice([-1.0, 1.0]))}


def _cubic(s: float, c: Character) -> float:
    return c["sign"] * s * c["stiffness"] / c["place"] ** 2


def _quadratic(s: float, c: Character) -> float:
    return c["sign"] * s * c["stiffness"] / c["place"]


def _draw_reach(low: float, high: float) -> Draw:
    """Draw a length from ``low`` to ``high`` of the typical deflection."""
    return lambda rng, plan: {**sizes(plan), "reach": spread(rng, low, high) * sizes(plan)["place"]}


def _draw_power(rng: np.random.Generator, plan: Plan) -> Character:
    return {**sizes(plan), "power": float(rng.uniform(0.3, 0.7))}


def _power(s: float, c: Character) -> float:
    return s * c["damping"] * c["rate"] ** (1 - c["power"])


def _cubed_rate(s: float, c: Character) -> float:
    return s * c["damping"] / c["rate"] ** 2


def _draw_bouc_wen(rng: np.random.Generator, plan: Plan) -> Character:
    beta = float(rng.uniform(0.5, 1.0))
    own = {"exponent": float(rng.uniform(1.0, 3.0)), "beta": beta, "gamma": 1 - beta}
    return {**sizes(plan), "reach": spread(rng, 0.3, 1.0) * sizes(plan)["place"], **own}


def _bouc_wen(s: float, c: Character) -> list[Any]:
    return [0.0, 0.0, s * c["stiffness"], c["reach"], c["exponent"], c["beta"], c["gamma"]]


def _draw_times(low: float, high: float) -> Draw:
    return lambda rng, plan: {**sizes(plan), "time_s": spread(rng, low, high)}


def _shaken(low: float, high: float) -> Draw:
    """Draw a frequency, Hz, and a phase for each impact."""
    return lambda rng, plan: {
        **sizes(plan),
        "frequency_hz": float(rng.uniform(low, high)),
        "phases": rng.uniform(0, 2 * np.pi, plan.group.size),
    }


def _modulated(s: float, c: Character) -> list[Any]:
    return [c["stiffness"], 0.0, s, 2 * np.pi * c["frequency_hz"], c["phases"]]


_MODULATED = Nature("time", at("contact"), of_powers(deflection=1.0, load=0.0))


def _draw_of_load(rng: np.random.Generator, plan: Plan) -> Character:
    """A coefficient that is a power of the load, from falling to rising."""
    power = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.5))
    return {**_draw_sizes(rng, plan), "power": power, "load": float(np.median(plan.loads))}


def _cubic_of_load(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    coefficients = _cubic(s, c) * (plan.of_each_impact(plan.loads) / c["load"]) ** c["power"]
    numbers = _columns(plan, [0.0, 0.0, 0.0, coefficients])
    return with_law(machine, Law.CUBED_DEFORMATION, machine.contact, numbers)


CONTACT = (
    Effect(
        "contact_cubic", "contact", 0.03, 1.0, lambda p, s, c: {"cubic_n_per_m3": _cubic(s, c)},
        draw=_draw_sizes,
        machined=in_the_contact(Law.CUBED_DEFORMATION, lambda s, c: [0.0, 0.0, _cubic(s, c)]), listed=False,
        nature=Nature("static", at("contact"), of_powers(deflection=3.0, load=0.0), conservative=True),
    ),
    Effect(
        "loaded_cubic",
        "contact",
        0.03,
        1.0,
        lambda p, s, c: {"cubic_n_per_m3": _cubic(s, c), "at_load_n": c["load"], "power_of_load": c["power"]},
        draw=_draw_of_load,
        machined=_cubic_of_load,
        listed=False,
        nature=Nature(
            "static", at("contact"), lambda c: {"deflection": 3.0, "load": c["power"]}, conservative=True
        ),
    ),
    Effect(
        "contact_quadratic", "contact", 0.03, 0.5, lambda p, s, c: {"quadratic_n_per_m2": _quadratic(s, c)},
        draw=_draw_sizes,
        machined=in_the_contact(Unlisted.SQUARED_DEFORMATION, lambda s, c: [0.0, 0.0, _quadratic(s, c)]), listed=False,
        nature=Nature("static", at("contact"), of_powers(deflection=2.0, load=0.0), conservative=True),
    ),
    Effect(
        "contact_bilinear", "contact", 0.03, 0.8, lambda p, s, c: {"pressed_n_per_m": c["sign"] * s * c["stiffness"]},
        draw=_draw_sizes,
        machined=in_the_contact(Law.BILINEAR, lambda s, c: [c["stiffness"], 0.0, c["sign"] * s]), listed=False,
        nature=Nature("static", at("contact"), conservative=True),
    ),
    Effect(
        "contact_dead_zone", "contact", 0.05, 2.0,
        lambda p, s, c: {"met_stiffness_n_per_m": s * c["stiffness"], "clearance_m": c["reach"]},
        draw=_draw_reach(0.2, 0.6),
        machined=in_the_contact(Unlisted.DEAD_ZONE, lambda s, c: [0.0, 0.0, s * c["stiffness"], c["reach"]]),
        listed=False, nature=Nature("static", at("contact"), conservative=True),
    ),
    Effect(
        "contact_exponential", "contact", 0.05, 1.0,
        lambda p, s, c: {"exponential_stiffness_n_per_m": s * c["stiffness"], "range_m": c["reach"]},
        draw=_draw_reach(0.5, 2.0),
        machined=in_the_contact(Unlisted.EXPONENTIAL_RANGE, lambda s, c: [0.0, 0.0, s * c["stiffness"], c["reach"]]),
        listed=False, nature=Nature("static", at("contact"), conservative=True),
    ),
    Effect(
        "cubed_rate_damping", "contact", 0.1, 1.5, lambda p, s, c: {"cubed_rate_n_s3_per_m3": _cubed_rate(s, c)},
        draw=lambda rng, plan: sizes(plan),
        machined=in_the_contact(Law.CUBED_RATE, lambda s, c: [0.0, 0.0, _cubed_rate(s, c)]), listed=False,
        nature=Nature("rate", at("contact"), of_powers(rate=3.0, load=0.0), conservative=False),
    ),
    Effect(
        "fractional_rate_damping", "contact", 0.05, 3.0,
        lambda p, s, c: {"coefficient_n_s_per_m_to_the_power": _power(s, c), "power": c["power"]}, draw=_draw_power,
        machined=in_the_contact(
            Unlisted.POWER_OF_RATE, lambda s, c: [0.0, 0.0, _power(s, c), c["power"], SMOOTH * c["rate"]]
        ),
        listed=False,
        nature=Nature("rate", at("contact"), lambda c: {"rate": c["power"], "load": 0.0}, conservative=False),
    ),
    Effect(
        "bouc_wen", "contact", 0.01, 0.6,
        lambda p, s, c: {
            "hysteretic_stiffness_n_per_m": s * c["stiffness"], "reach_m": c["reach"],
            "exponent": c["exponent"], "beta": c["beta"], "gamma": c["gamma"],
        },
        draw=_draw_bouc_wen, machined=in_the_contact(Unlisted.BOUC_WEN, _bouc_wen), listed=False,
        nature=Nature("memory", at("contact"), conservative=False),
    ),
    Effect(
        "stiffness_step", "contact", 0.002, 0.2, lambda p, s, c: {"step_n_per_m": s * c["stiffness"]},
        draw=lambda rng, plan: {**sizes(plan), "times_s": rng.uniform(5e-3, 25e-3, plan.group.size)},
        machined=in_the_contact(Law.STEP, lambda s, c: [c["stiffness"], 0.0, s, c["times_s"]]), listed=False,
        nature=Nature("time", at("contact"), of_powers(deflection=1.0, load=0.0)),
    ),
    Effect(
        "drifting_contact", "contact", 0.002, 0.3,
        lambda p, s, c: {"drift_n_per_m": s * c["stiffness"], "time_s": c["time_s"]}, draw=_draw_times(5e-3, 40e-3),
        machined=in_the_contact(Law.DRIFTING, lambda s, c: [c["stiffness"], 0.0, s, c["time_s"]]), listed=False,
        nature=Nature("time", at("contact"), of_powers(deflection=1.0, load=0.0)),
    ),
    Effect(
        "shaken_contact", "contact", 0.003, 0.3,
        lambda p, s, c: {"amplitude_n_per_m": s * c["stiffness"], "frequency_hz": c["frequency_hz"]},
        draw=_shaken(70.0, 250.0), machined=in_the_contact(Law.MODULATED, _modulated), listed=False,
        nature=_MODULATED,
    ),
    Effect(
        "modulated_contact", "contact", 0.003, 0.5,
        lambda p, s, c: {"amplitude_n_per_m": s * c["stiffness"], "frequency_hz": c["frequency_hz"]},
        draw=_shaken(37.0, 37.0), machined=in_the_contact(Law.MODULATED, _modulated), listed=False,
        nature=_MODULATED,
    ),
)  # fmt: skip
"""Effects in the contact."""
