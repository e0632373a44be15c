"""What can be concealed in a session: the contract's mechanisms that leave a trace, and some outside its list.

An effect has a strength, graded by what survives the refit, and a character: its other constants, drawn once. It acts
on the machine, on the sampled channels, or on both. `parameters` gives the true parameters as a truth file states them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesotap.proof.generator.integration import Acting, Machine
from mesotap.proof.generator.laws import Law
from mesotap.proof.generator.plan import PRETRIGGER, RATE_HZ, Plan

Real = NDArray[np.float64]
Character = Mapping[str, Any]
Machined = Callable[[Machine, Plan, float, Character], Machine]
Sensed = Callable[[Real, Plan, float, Character], Real]

STEADY_RATE = 1e-8  # m/s below which dry friction is rounded off: a thousandth of the motion at the record's end
FULL = 1.0  # strength of an effect that is there or not


@dataclass(frozen=True, slots=True)
class Effect:
    """One effect.

    Attributes
    ----------
    id, component
        The contract's names; an effect outside the list has a name of its own.
    listed
        Whether the contract lists it.
    first, largest
        Strength to try first, and the largest that makes sense, in the effect's own unit.
    draw
        Character.
    machined
        The machine with the effect.
    sensed
        The (n, 2, samples) channels with the effect.
    delay
        Delay of channel B, samples.
    parameters
        Parameters for the truth file.
    fixed
        An effect without a strength of its own: the taps are graded instead.
    exponent
        Of k_c against the load, where the effect asks for one.
    """

    id: str
    component: str
    first: float
    largest: float
    parameters: Callable[[Plan, float, Character], dict[str, Any]]
    draw: Callable[[np.random.Generator, Plan], Character] = lambda rng, plan: {}
    machined: Machined | None = None
    sensed: Sensed | None = None
    delay: Callable[[float, Character], float] | None = None
    listed: bool = True
    fixed: bool = False
    exponent: float | None = None


def typical_ratio(plan: Plan) -> float:
    """Median over the loads of the largest approach over the static one, as the taps were drawn."""
    return float(np.median(_approach(plan) / plan.of_each_impact(plan.static)))


def _approach(plan: Plan) -> Real:
    """(n,) amplitude of the contact's deformation after each tap, m: of its own mode under the tap's impulse."""
    shape = np.sin(np.pi * (np.arange(50) + 0.5)[None, :] / 50) ** plan.pulses[:, 0, 3][:, None]
    impulse = plan.pulses[:, 0, 2] * plan.pulses[:, 0, 1] * shape.mean(axis=1)
    angular = np.sqrt((plan.springs[1] + 2 * plan.kc) / plan.masses[1])
    return np.asarray(impulse / plan.masses[0] / plan.of_each_impact(angular))


def _largest_approach(plan: Plan) -> float:
    return float(_approach(plan).max())


def _rate(plan: Plan) -> float:
    angular = np.sqrt((plan.springs[1] + 2 * plan.kc) / plan.masses[1])
    return float(np.median(_approach(plan) * plan.of_each_impact(angular)))


def with_law(machine: Machine, law: Law, direction: Real, numbers: Real) -> Machine:
    """Return the machine with one more law; ``numbers`` (n, k) or (k,)."""
    count = machine.stiffness.shape[0]
    acting = Acting(int(law), direction, np.broadcast_to(numbers, (count, np.shape(numbers)[-1])).copy())
    return replace(machine, acting=(*machine.acting, acting))


def _in_contact(machine: Machine, plan: Plan, law: Law, *own: Any) -> Machine:
    """Add a law in the contact; each of its ``own`` numbers for all impacts or (n,)."""
    count = plan.group.size
    columns = [plan.of_each_impact(plan.loads), plan.of_each_impact(plan.kc), plan.of_each_impact(plan.cc)]
    columns += [np.broadcast_to(np.asarray(o, float), (count,)) for o in own]
    return with_law(machine, law, machine.contact, np.column_stack(columns))


def _in_spring(machine: Machine, plan: Plan, which: int, law: Law, *own: float) -> Machine:
    """Add a law in the upper (0) or lower (1) tube spring."""
    direction = np.zeros(machine.mass.size)
    direction[which] = 1.0
    return with_law(machine, law, direction, np.array([0.0, plan.springs[which], 0.0, *own]))


def with_body(machine: Machine, mass: float, direction: Real, stiffness: float, damping: float) -> Machine:
    """Return the machine with one more body, on a spring and damper along ``direction`` (b + 1,)."""
    b = machine.mass.size
    wider = ((0, 0), (0, 1), (0, 1))
    both = np.outer(direction, direction)
    return replace(
        machine,
        mass=np.append(machine.mass, mass),
        stiffness=np.pad(machine.stiffness, wider) + stiffness * both,
        damping=np.pad(machine.damping, wider) + damping * both,
        contact=np.append(machine.contact, 0.0),
        seen=np.pad(machine.seen, ((0, 0), (0, 1))),
        acting=tuple(
            replace(a, direction=np.append(a.direction, np.zeros(b + 1 - a.direction.size))) for a in machine.acting
        ),
    )


def _hertz(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return _in_contact(machine, plan, Law.HERTZ)


def _exponential(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return _in_contact(machine, plan, Law.EXPONENTIAL)


def _parting(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return _in_contact(machine, plan, Law.PARTING)


def _growing_damping(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return _in_contact(machine, plan, Law.GROWING_DAMPING, s)


def _sliders(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    reach = c["reach_share"] * plan.of_each_impact(plan.static)
    return _in_contact(machine, plan, Law.SLIDERS, s * plan.of_each_impact(plan.kc), reach, c["sliders"])


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
    return _in_contact(machine, plan, Law.DRAG, s / _rate(plan) * plan.of_each_impact(plan.cc))


def _film(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return _in_contact(machine, plan, Law.FILM, s * plan.of_each_impact(plan.cc), c["film_height_m"])


def _draw_film(rng: np.random.Generator, plan: Plan) -> Character:
    return {"film_height_m": float(rng.uniform(1.2, 3.0)) * _largest_approach(plan)}


def _meniscus(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    force = s * plan.of_each_impact(plan.loads)
    reach = c["range_share"] * plan.of_each_impact(plan.static)
    return _in_contact(machine, plan, Law.MENISCUS, force, reach, c["setting_in"] * _rate(plan))


def _draw_menisci(rng: np.random.Generator, plan: Plan) -> Character:
    setting_in = math.exp(rng.uniform(math.log(0.3), math.log(1.5)))
    return {"range_share": float(rng.uniform(0.2, 1.0)), "setting_in": setting_in}


def _creep(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return _in_contact(machine, plan, Law.CREEP, s, c["creep_time_s"])


def _guide(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    direction = np.zeros(machine.mass.size)
    direction[0] = 1.0
    return with_law(machine, Law.DRY_FRICTION, direction, np.array([0.0, 0.0, 0.0, s, STEADY_RATE]))


def _spring_damping(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return _in_spring(_in_spring(machine, plan, 0, Law.DASHPOT, s), plan, 1, Law.DASHPOT, s)


def _spring_cubic(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    cubic = s * plan.springs[1] / c["place_m"] ** 2
    return _in_spring(_in_spring(machine, plan, 0, Law.CUBED_DEFORMATION, cubic), plan, 1, Law.CUBED_DEFORMATION, cubic)


def _draw_spring_place(rng: np.random.Generator, plan: Plan) -> Character:
    """Typical deflection of the tube springs: both masses together under half the tap's impulse."""
    angular = math.sqrt(plan.springs[1] / plan.masses[1])
    contact = np.sqrt((plan.springs[1] + 2 * plan.kc) / plan.masses[1])
    return {"place_m": float(np.median(_approach(plan) * plan.of_each_impact(contact))) / 2 / angular}


def _attached(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
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


def _frame(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    """The lower tube spring stands on a mass of 1/s kg that itself is sprung."""
    mass, stiffness, damping = _frame_numbers(s, c)
    ground = np.zeros(machine.mass.size + 1)
    ground[-1] = 1.0
    machine = with_body(machine, mass, ground, stiffness, damping)
    k2 = plan.springs[1]
    coupled = machine.stiffness.copy()
    coupled[:, 1, -1] -= k2
    coupled[:, -1, 1] -= k2
    coupled[:, -1, -1] += k2
    return replace(machine, stiffness=coupled)


def _frame_numbers(s: float, c: Character) -> tuple[float, float, float]:
    angular = 2 * math.pi * c["frequency_hz"]
    return 1 / s, angular**2 / s, 2 * c["zeta"] * angular / s


def _tell_frame(plan: Plan, s: float, c: Character) -> dict[str, Any]:
    mass, stiffness, damping = _frame_numbers(s, c)
    return {"frame_mass_kg": mass, "frame_stiffness_n_per_m": stiffness, "frame_damping_n_s_per_m": damping}


def _rocking(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    """The lower mass turns: A sees x2 + u, B x2 - u, u being the turning times their distance r from the axis.

    The contact lies off the axis by s r, so it also feels - s u.
    """
    angular = 2 * math.pi * c["frequency_hz"]
    mass = c["inertia_kg_m2"] / c["arm_m"] ** 2
    own = np.zeros(machine.mass.size + 1)
    own[-1] = 1.0
    machine = with_body(machine, mass, own, mass * angular**2, 2 * c["zeta"] * mass * angular)
    before = machine.contact
    after = before.copy()
    after[-1] = -s
    change = np.outer(after, after) - np.outer(before, before)
    line = machine.contact_line
    seen = np.repeat(machine.seen[:1], 2, axis=0)
    seen[:, -1] = (1.0, -1.0)
    return replace(
        machine,
        contact=after,
        stiffness=machine.stiffness + line[:, 0, None, None] * change,
        damping=machine.damping + line[:, 1, None, None] * change,
        seen=seen,
        acting=tuple(replace(a, direction=after) if np.array_equal(a.direction, before) else a for a in machine.acting),
    )


def _tell_rocking(plan: Plan, s: float, c: Character) -> dict[str, Any]:
    angular = 2 * math.pi * c["frequency_hz"]
    return {
        "rocking_inertia_kg_m2": c["inertia_kg_m2"],
        "rocking_stiffness_n_m": c["inertia_kg_m2"] * angular**2,
        "rocking_damping_n_m_s": 2 * c["zeta"] * c["inertia_kg_m2"] * angular,
        "contact_offset_m": s * c["arm_m"],
        "accelerometer_arm_m": c["arm_m"],
    }


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


def _bilinear(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return _in_spring(machine, plan, 1, Law.BILINEAR, s)


def _drifting(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return _in_spring(machine, plan, 1, Law.DRIFTING, s, c["time_s"])


def _cubed_rate(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return _in_contact(machine, plan, Law.CUBED_RATE, s / _rate(plan) ** 2 * plan.of_each_impact(plan.cc))


def _modulated(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return _in_contact(machine, plan, Law.MODULATED, s, 2 * np.pi * c["frequency_hz"], c["phases"])


def _stepped(machine: Machine, plan: Plan, s: float, c: Character) -> Machine:
    return _in_contact(machine, plan, Law.STEP, s, c["times_s"])


def _curved_sensors(y: Real, plan: Plan, s: float, c: Character) -> Real:
    return np.asarray(y + s * y**2 / float(np.abs(y).max()))


def _times(low: float, high: float) -> Callable[[np.random.Generator, Plan], Character]:
    return lambda rng, plan: {"time_s": float(np.exp(rng.uniform(math.log(low), math.log(high))))}


def _strength_only(plan: Plan, s: float, c: Character) -> dict[str, Any]:
    return {"strength": s, **{k: v for k, v in c.items() if np.isscalar(v)}}


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
        lambda p, s, c: {"quadratic_damping_n_s2_per_m2": (s / _rate(p) * p.cc).tolist()}, machined=_drag,
    ),
    Effect(
        "squeeze_film", "contact", 0.1, 1.0,
        lambda p, s, c: {"film_damping_n_s_per_m": (s * p.cc).tolist(), "film_height_m": c["film_height_m"]},
        draw=_draw_film, machined=_film,
    ),
    Effect(
        "adhesion", "contact", 0.01, 0.4,
        lambda p, s, c: {
            "adhesion_force_n": (s * p.loads).tolist(), "adhesion_range_m": (c["range_share"] * p.static).tolist()
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
    Effect(
        "attached_mass", "lower mass", 5e-4, 0.02, _tell_attached,
        draw=lambda rng, plan: {"frequency_hz": float(rng.uniform(1500, 4500)), "zeta": float(rng.uniform(0.01, 0.04))},
        machined=_attached,
    ),
    Effect(
        "frame_compliance", "frame", 0.05, 1.0, _tell_frame,
        draw=lambda rng, plan: {"frequency_hz": float(rng.uniform(90, 200)), "zeta": float(rng.uniform(0.01, 0.04))},
        machined=_frame,
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
        "double_hit", "impactor", 0.02, 0.6, lambda p, s, c: {"second_impulse_fraction": s},
        draw=lambda rng, plan: {"delays_s": rng.uniform(2.5e-3, 12e-3, plan.group.size)}, machined=_double_hit,
    ),
    Effect(
        "channel_gain", "sensor chain", 3e-3, 0.5, lambda p, s, c: {"gain_of_b": 1 + c["sign"] * s},
        draw=_draw_sign, sensed=_gain,
    ),
    Effect(
        "channel_skew", "sensor chain", 0.01, 1.0, lambda p, s, c: {"delay_of_b_samples": c["sign"] * s},
        draw=_draw_sign, delay=lambda s, c: c["sign"] * s,
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

_OUTSIDE = (
    Effect("bilinear_spring", "tube springs", 0.01, 0.5, _strength_only, machined=_bilinear, listed=False),
    Effect(
        "drifting_spring", "tube springs", 0.002, 0.3, _strength_only,
        draw=_times(5e-3, 40e-3), machined=_drifting, listed=False,
    ),
    Effect("cubed_rate_damping", "contact", 0.1, 1.5, _strength_only, machined=_cubed_rate, listed=False),
    Effect(
        "shaken_contact", "contact", 0.003, 0.3, _strength_only, machined=_modulated, listed=False,
        draw=lambda rng, plan: {
            "frequency_hz": float(rng.uniform(70, 250)), "phases": rng.uniform(0, 2 * np.pi, plan.group.size)
        },
    ),
    Effect("curved_sensors", "sensor chain", 0.01, 0.5, _strength_only, sensed=_curved_sensors, listed=False),
    Effect(
        "stiffness_step", "contact", 0.002, 0.2, _strength_only, machined=_stepped, listed=False,
        draw=lambda rng, plan: {"times_s": rng.uniform(5e-3, 25e-3, plan.group.size)},
    ),
)  # fmt: skip

LISTED = {e.id: e for e in _LISTED}
OUTSIDE = {e.id: e for e in _OUTSIDE}
