"""Which loads a stage that moves in steps can set: through the springs each step is a step of load.

The springs are in series (Sec. 3.2), so a step of s um changes the load by at most ``s k1 k2 / (k1 + k2)``; the contact
between them makes it less. Loads between two steps cannot be set, so no load can be had closer than half a step.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

STIFFNESS_MARGIN = 1.03  # by which the springs may be stiffer than declared


def largest_mn_per_um(spring_stiffness: tuple[float, float]) -> float:
    """Return the load that a micrometre of travel can make at most, mN, from k1 and k2 in N/m."""
    k1, k2 = spring_stiffness
    return STIFFNESS_MARGIN * k1 * k2 / (k1 + k2) * 1e-3  # N/m times 1e-3 is mN/um


def load_step_mn(step_um: float, spring_stiffness: tuple[float, float]) -> float:
    """Return what one step of the stage changes the load by at most, mN."""
    return step_um * largest_mn_per_um(spring_stiffness)


def finest_tolerance_mn(step_um: float, spring_stiffness: tuple[float, float]) -> float:
    """Return how near to any load a stage of this step is sure to come, mN: half a step of load."""
    return load_step_mn(step_um, spring_stiffness) / 2


def whole_steps(travel_um: float, step_um: float) -> float:
    """Return the whole steps that fit into a travel; the travel itself where the step is not known (0)."""
    return math.floor(travel_um / step_um * (1 + 1e-9)) * step_um if step_um else travel_um


def too_fine(tolerance_mn: float, step_um: float, spring_stiffness: tuple[float, float]) -> str:
    """Return why this tolerance cannot be held, and what can be done about it; empty if it can."""
    finest = finest_tolerance_mn(step_um, spring_stiffness)
    if tolerance_mn >= finest:
        return ""
    share = tolerance_mn / finest
    k1, k2 = spring_stiffness
    return (
        f"mesotap.load_tolerance_mn of {tolerance_mn:g} cannot be held: a step of the stage, {step_um:g} um, is up to "
        f"{2 * finest:.3g} mN with springs of {k1 * 1e-3:.0f} and {k2 * 1e-3:.0f} kN/m, so that loads come out within "
        f"{finest:.3g} mN; give at least {_up(finest):g}, take an actuator with steps of {step_um * share:.2g} um, or "
        f"springs of {k1 * share * 1e-3:.0f} and {k2 * share * 1e-3:.0f} kN/m"
    )


def what_can_be_set(
    plan_mn: Sequence[float], tolerance_mn: float, step_um: float, spring_stiffness: tuple[float, float]
) -> list[str]:
    """Return in sentences to what the loads of a plan can be set, and which of them may come out as one."""
    step = load_step_mn(step_um, spring_stiffness)
    loads = ", ".join(f"{load:g}" for load in plan_mn)
    said = [
        f"loads: {loads} mN can be set to +-{step / 2:.2g} mN (a step of {step_um:g} um is up to {step:.3g} mN); "
        f"asked for are +-{tolerance_mn:g} mN"
    ]
    rising = sorted(set(plan_mn))
    near = [f"{low:g} and {high:g}" for low, high in itertools.pairwise(rising) if high - low < step]
    if near:
        said.append(f"loads: {', '.join(near)} mN are less than a step apart: they may come out as the same load")
    return said


def _up(value: float) -> float:
    """Return the next tenth, or the next whole number of a value above 10."""
    digits = 1 if value < 10 else 0
    rounded = round(value, digits)
    return rounded if rounded >= value else round(rounded + 10.0**-digits, digits)
