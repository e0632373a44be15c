"""From what a truth file says of an effect to the parameters by which a diagnosis reports it.

Only where both mean the same quantity; what a truth file holds besides is not scored. Rocking is not: its parameters
depend on the inertia that is taken for granted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

Truth = Mapping[str, Any]

EVEN = 0.02  # relative spread over the loads up to which a ratio counts as one number

_SAME = {
    "attached_mass": ("attached_mass_kg", "mount_stiffness_n_per_m", "mount_damping_n_s_per_m"),
    "converter_step": ("step_m_s2",),
    "upper_roll": ("roll_mass_kg", "roll_stiffness_n_per_m", "roll_damping_n_s_per_m"),
    "channel_skew": ("delay_of_b_samples",),
    "clipping": ("clip_at_fraction_of_peak",),
    "contact_creep": ("creep_per_e_fold", "creep_time_s"),
    "double_hit": ("second_impulse_fraction",),
    "frame_compliance": ("frame_mass_kg", "frame_stiffness_n_per_m", "frame_damping_n_s_per_m"),
    "guide_friction": ("friction_force_n",),
    "knock": ("knock_impulse_n_s",),
    "hunt_crossley_damping": ("damping_growth_per_relative_approach",),
    "mains_hum": ("amplitude_m_s2",),
    "squeeze_film": ("film_height_m",),
    "tube_mode": ("tube_mode_mass_kg", "tube_mode_stiffness_n_per_m", "tube_mode_damping_n_s_per_m"),
    "tube_spring_cubic": ("cubic_stiffness_n_per_m3",),
}


def _ratio(numerator: Any, denominator: Any) -> float | None:
    """One number for all loads, None where it differs from load to load."""
    ratio = np.asarray(numerator, float) / np.asarray(denominator, float)
    middle = float(np.median(ratio))
    return middle if float(np.ptp(ratio)) <= EVEN * abs(middle) else None


def _static(t: Truth) -> Any:
    return np.asarray(t["loads_n"], float) / np.asarray(t["kc"], float)


def _reach(t: Truth) -> Any:
    effect = t["effect"]
    return np.asarray(effect["slip_force_n"], float) / np.asarray(effect["slip_stiffness_n_per_m"], float)


def _film_share(t: Truth) -> float | None:
    """The film's share of all damping at rest: in this program's truths c_c holds it, in others it comes on top."""
    film, other = np.asarray(t["effect"]["film_damping_n_s_per_m"], float), np.asarray(t["cc"], float)
    return _ratio(film, other if "kind" in t else other + film)


def _mount(t: Truth, body: str = "attached_mass") -> tuple[float, float]:
    """Resonance (Hz) and damping ratio of a part on a mount."""
    mass, stiffness, damping = (float(t["effect"][name]) for name in _SAME[body])
    return math.sqrt(stiffness / mass) / (2 * math.pi), damping / 2 / math.sqrt(stiffness * mass)


def _of_b(t: Truth) -> float:
    """Base strain of B over A; where A has it, A takes the motion itself for larger as well."""
    own, mass = float(t["effect"]["base_strain_m_s2_per_n"]), float(t["masses_kg"][1])
    return own if t["effect"]["channel"] == "B" else -own / (1 + own * mass)


_DERIVED: dict[str, dict[str, Callable[[Truth], float | None]]] = {
    "adhesion": {
        "adhesion_force_share": lambda t: _ratio(t["effect"]["adhesion_force_n"], t["loads_n"]),
        "adhesion_range_share": lambda t: _ratio(t["effect"]["adhesion_range_m"], _static(t)),
    },
    "base_strain": {"base_strain_m_s2_per_n": _of_b},
    "cross_axis_sensitivity": {
        "cross_axis_share": lambda t: -t["effect"]["transverse_sensitivity"] * t["effect"]["inclination"]
    },
    "menisci": {
        "meniscus_force_share": lambda t: _ratio(t["effect"]["meniscus_force_n"], t["loads_n"]),
        "meniscus_range_share": lambda t: _ratio(t["effect"]["meniscus_range_m"], _static(t)),
    },
    "attached_mass": {
        "mount_frequency_hz": lambda t: _mount(t)[0],
        "mount_damping_ratio": lambda t: _mount(t)[1],
    },
    "frame_compliance": {"frame_compliance_m_per_n": lambda t: 1 / float(t["effect"]["frame_stiffness_n_per_m"])},
    "channel_gain": {"gain_error_of_b": lambda t: float(t["effect"]["gain_of_b"]) - 1.0},
    "micro_slip": {
        "slip_stiffness_share": lambda t: _ratio(t["effect"]["slip_stiffness_n_per_m"], t["kc"]),
        "slip_reach_share": lambda t: _ratio(_reach(t), _static(t)),
    },
    "quadratic_damping": {
        "quadratic_damping_per_c_c": lambda t: _ratio(t["effect"]["quadratic_damping_n_s2_per_m2"], t["cc"])
    },
    "squeeze_film": {"film_share_of_c_c": _film_share},
    "tube_mode": {
        "tube_mode_frequency_hz": lambda t: _mount(t, "tube_mode")[0],
        "tube_mode_damping_ratio": lambda t: _mount(t, "tube_mode")[1],
    },
    "tube_spring_damping": {
        "c_n_s_per_m": lambda t: (
            _ratio(t["effect"]["c1_n_s_per_m"], t["effect"]["c2_n_s_per_m"]) and float(t["effect"]["c1_n_s_per_m"])
        )
    },
}


def true_parameters(truth: Truth, mechanism: str) -> dict[str, float]:
    """Return the true parameters of a mechanism that the truth states, by the names of `mesotap mechanisms`."""
    if "parameters" in truth:
        return dict(truth["parameters"].get(mechanism, {}))
    effect = truth.get("effect", {})
    found = {
        name: float(effect[name]) for name in _SAME.get(mechanism, ()) if isinstance(effect.get(name), int | float)
    }
    for name, derive in _DERIVED.get(mechanism, {}).items():
        try:
            value = derive(truth)
        except KeyError:
            continue
        if value is not None:
            found[name] = float(value)
    return found
