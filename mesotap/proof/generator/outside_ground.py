"""Effects between a mass and the ground that no list of mechanisms holds: in a tube spring, at a guide."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from mesotap.proof.generator.effect import Character, Effect
from mesotap.proof.generator.laws import MEMORY, Law
from mesotap.proof.generator.nature import Nature, at, of_powers
from mesotap.proof.generator.outside import SPRINGS, at_a_mass, in_the_contact, sizes, spread, swing
from mesotap.proof.generator.plan import Plan
from mesotap.proof.generator.unlisted_laws import Unlisted

Real = NDArray[np.float64]

GUIDE = ("guide", "upper mass", "upper tube spring", "lower tube spring")
BRISTLE_DAMPING = 0.3  # of bristles, over the square root of their stiffness times the mass
STEADY = 1e-3  # of the typical rate, below which sliding friction is rounded off
FRACTIONAL_HZ = (10.0, 10_000.0)
"""Between which branches stand for a fractional derivative."""
BRANCHES_BEYOND = 8.0  # factor by which their frequencies reach beyond; with it they are right within 2 %


def _of_springs(c: Character) -> tuple[str, ...]:
    return SPRINGS


def _draw_spring(rng: np.random.Generator, plan: Plan) -> Character:
    """One of the tube springs: that of the upper (0) or the lower (1) mass."""
    mass = int(rng.integers(2))
    return {**swing(plan), "mass": mass, "stiffness": plan.springs[mass]}


def _draw_friction(rng: np.random.Generator, plan: Plan) -> Character:
    """Friction that falls by a third to two thirds within the rates of a decay."""
    typical = swing(plan)
    return {
        **typical,
        "mass": 0,
        "force": plan.springs[0] * typical["place"],
        "more_at_rest": float(rng.uniform(0.5, 2.0)),
        "stribeck_rate": spread(rng, 0.15, 0.6) * typical["rate"],
        "rising": float(rng.uniform(0.1, 0.4)),
        "presliding": spread(rng, 0.03, 0.2) * typical["place"],
        "felt_kg": plan.masses[0],
    }


def _stribeck(s: float, c: Character) -> list[Any]:
    slides = s * c["force"]
    own = [slides, c["more_at_rest"] * slides, c["stribeck_rate"]]
    return [0.0, 0.0, *own, STEADY * c["rate"], c["rising"] * slides / c["rate"]]


def _lugre(s: float, c: Character) -> list[Any]:
    slides = s * c["force"]
    bristles = slides / c["presliding"]
    damping = BRISTLE_DAMPING * math.sqrt(bristles * c["felt_kg"])
    return [0.0, 0.0, slides, c["more_at_rest"] * slides, c["stribeck_rate"], bristles, damping]


def _tell(law: Callable[[float, Character], list[Any]], *names: str) -> Callable[[Plan, float, Character], Any]:
    """Tell the numbers of a law from p[3] on by their names."""
    return lambda plan, s, c: dict(zip(names, law(s, c)[2:], strict=True))


def _draw_maxwell(rng: np.random.Generator, plan: Plan) -> Character:
    """A branch that relaxes within about a radian of the mode in which both masses move together."""
    spring = _draw_spring(rng, plan)
    return {**spring, "time_s": spread(rng, 0.3, 3.0) / spring["angular"]}


def _maxwell(s: float, c: Character) -> list[Any]:
    return [0.0, 0.0, 1.0, s * c["stiffness"], c["time_s"]]


def fractional_branches(order: float) -> tuple[Real, Real]:
    """Return stiffness (N/m) and time (s) of leaking springs that together have the stiffness (i w)^order.

    Their least relative error within `FRACTIONAL_HZ`; w in rad/s.
    """
    low, high = FRACTIONAL_HZ
    rates = 2 * math.pi * np.geomspace(low / BRANCHES_BEYOND, high * BRANCHES_BEYOND, MEMORY)
    w = 2 * math.pi * np.geomspace(low, high, 200)
    share = 1j * w[:, None] / (1j * w[:, None] + rates[None, :])
    true = (1j * w) ** order
    relative = share / true[:, None]
    columns = np.vstack([relative.real, relative.imag])
    size = np.linalg.norm(columns, axis=0)
    found = nnls(columns / size, np.r_[np.ones(w.size), np.zeros(w.size)])[0]
    return np.asarray(found / size), 1 / rates


def _fractional(s: float, c: Character) -> list[Any]:
    """Force q d^a x / dt^a, of the size s k x at the typical frequency."""
    stiffness, times = fractional_branches(c["order"])
    own = np.column_stack([_coefficient(s, c) * stiffness, times]).ravel()
    return [0.0, 0.0, float(MEMORY), *own.tolist()]


def _coefficient(s: float, c: Character) -> float:
    return float(s * c["stiffness"] / c["angular"] ** c["order"])


def _tell_fractional(plan: Plan, s: float, c: Character) -> dict[str, Any]:
    told = {"coefficient_n_s_per_m_to_the_order": _coefficient(s, c), "order": c["order"]}
    return told | ({"mass": c["mass"]} if "mass" in c else {})


def _draw_order(rng: np.random.Generator) -> dict[str, float]:
    return {"order": float(rng.uniform(0.2, 0.8))}


def _draw_fractional_contact(rng: np.random.Generator, plan: Plan) -> Character:
    angular = float(np.median(np.sqrt((plan.springs[1] + 2 * plan.kc) / plan.masses[1])))
    return {**sizes(plan), **_draw_order(rng), "angular": angular}


ABSORBED = (
    Effect(
        "fractional_contact_damping", "contact", 0.02, 0.1, _tell_fractional, draw=_draw_fractional_contact,
        machined=in_the_contact(Law.LEAKING, _fractional), listed=False,
        nature=Nature(
            "memory", at("contact"), conservative=False,
            absorbed="a decay shows the contact at one frequency for each load, where it adds to k_c and c_c",
        ),
    ),
)  # fmt: skip
"""Effects that a free decay hides."""

GROUND = (
    Effect(
        "bilinear_spring", "tube springs", 0.01, 0.5,
        lambda p, s, c: {"pressed_n_per_m": s * c["stiffness"], "mass": c["mass"]}, draw=_draw_spring,
        machined=at_a_mass(Law.BILINEAR, lambda s, c: [c["stiffness"], 0.0, s]), listed=False,
        nature=Nature(
            "static", _of_springs, conservative=True, same=("end_stop",),
            why="a stop without a gap is another stiffness from rest on",
        ),
    ),
    Effect(
        "drifting_spring", "tube springs", 0.002, 0.3,
        lambda p, s, c: {"drift_n_per_m": s * c["stiffness"], "time_s": c["time_s"], "mass": c["mass"]},
        draw=lambda rng, plan: {**_draw_spring(rng, plan), "time_s": spread(rng, 5e-3, 40e-3)},
        machined=at_a_mass(Law.DRIFTING, lambda s, c: [c["stiffness"], 0.0, s, c["time_s"]]), listed=False,
        nature=Nature(
            "time", _of_springs, of_powers(deflection=1.0, load=0.0), same=("contact_creep",),
            why="without a preload its stiffness and damping settle exponentially with time",
        ),
    ),
    Effect(
        "stribeck_friction", "upper mass", 1e-3, 1.0,
        _tell(_stribeck, "sliding_n", "more_at_rest_n", "stribeck_rate_m_per_s", "rounded_m_per_s", "rising_n_s_per_m"),
        draw=_draw_friction, machined=at_a_mass(Unlisted.STRIBECK, _stribeck), listed=False,
        nature=Nature("rate", at(*GUIDE), components=("tube springs",), conservative=False),
    ),
    Effect(
        "lugre_friction", "upper mass", 1e-3, 1.0,
        _tell(
            _lugre, "sliding_n", "more_at_rest_n", "stribeck_rate_m_per_s", "bristles_n_per_m", "bristles_n_s_per_m"
        ),
        draw=_draw_friction, machined=at_a_mass(Unlisted.LUGRE, _lugre), listed=False,
        nature=Nature("memory", at(*GUIDE), components=("tube springs",), conservative=False),
    ),
    Effect(
        "maxwell_branch", "upper mass", 0.003, 0.5,
        lambda p, s, c: {"branch_n_per_m": s * c["stiffness"], "time_s": c["time_s"], "mass": c["mass"]},
        draw=_draw_maxwell, machined=at_a_mass(Law.LEAKING, _maxwell), listed=False,
        nature=Nature(
            "memory", at("upper mass", "lower mass", "guide", *SPRINGS), components=("lower mass", "tube springs"),
            conservative=False, same=("relaxation",),
            why="a branch to the ground lies beside a tube spring, and relaxation is this branch",
        ),
    ),
    Effect(
        "standard_linear_spring", "tube springs", 0.003, 0.5,
        lambda p, s, c: {"branch_n_per_m": s * c["stiffness"], "time_s": c["time_s"], "mass": c["mass"]},
        draw=_draw_maxwell, machined=at_a_mass(Law.LEAKING, _maxwell), listed=False,
        nature=Nature(
            "memory", _of_springs, conservative=False, same=("relaxation",),
            why="relaxation is this model",
        ),
    ),
    Effect(
        "fractional_damping", "tube springs", 0.003, 0.3, _tell_fractional,
        draw=lambda rng, plan: {**_draw_spring(rng, plan), **_draw_order(rng)},
        machined=at_a_mass(Law.LEAKING, _fractional), listed=False,
        nature=Nature("memory", _of_springs, conservative=False),
    ),
)  # fmt: skip
"""Effects between a mass and the ground."""
