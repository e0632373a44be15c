"""The competitor that names nothing: forces of any shape in the elements, and any small change of a channel.

A few dozen terms span what a force can depend on (deformation, its rate, momentary amplitude, time since the start).
Where they take away much that the best named mechanism leaves, something else is at work.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from numba import njit

from analysis.mismatch.parameters import Term
from sim_backend.arrangement import Arrangement, Element
from sim_backend.force_law import REST
from sim_backend.learned.forms import AT_LOAD, IN_LOAD, LOAD_EXPONENT, by_load
from sim_backend.mechanisms.kinds import ChannelDistortion, ForceLaw, Quantity, Real, Scale, Values, law

SHARE = 1e-4  # of the element's force: small enough for a first-order effect
EARLY, LATE = 0.03, 0.2  # of the duration: times with which forces fade
SHARP = 10.0  # steepness of a rounded step
SHAPES = (
    "d2", "d3", "abs_d_d", "abs_d", "d_v", "v2", "d2_v", "d_v2", "abs_v_v", "v3", "sign_v", "a_d", "a_v", "a2_d",
    "a2_v", "d_small", "v_small", "d_early", "v_early", "d_late", "v_late", "d5", "v",
)  # fmt: skip
"""Of deformation d, rate v and momentary amplitude a, each over its scale, and of time."""
OF_JOINTS = SHAPES[:21]  # where bodies meet; d5 and v are more of the same there
OF_SPRINGS = ("v", "d2", "d3", "abs_v_v", "sign_v", "a_d")
JOINTLY = ("d2", "d3", "d5", "a_d", "a_v", "d_v", "abs_v_v", "v3", "d2_v", "sign_v", "d_late", "v_late")
"""Those that are fitted together."""
STATIC = ("d2", "d3", "abs_d_d", "abs_d", "d5", "d_small")
RATE = ("v2", "v3", "abs_v_v", "sign_v", "v_small", "d_v", "d2_v", "a_v")
"""Those that a static law, and one of the rate, is made of where no formula is known."""
SCALES = ("deformation", "rate", "duration")
WEIGHTS, AT_SCALES = REST, REST + len(SHAPES)
GAIN_AND_DELAY, CURVED = (0, 1), (2, 3)  # powers of a channel's change; 0 is its slope


@njit(cache=True)
def _shape(i, u, w, t):  # type: ignore[no-untyped-def]
    """Value of one of `SHAPES`."""
    a = math.sqrt(u * u + w * w)
    if i < 8:
        return (u * u, u * u * u, abs(u) * u, abs(u), u * w, w * w, u * u * w, u * w * w)[i]
    if i < 15:
        if i == 10:
            return math.tanh(SHARP * w)
        return (abs(w) * w, w * w * w, 0.0, a * u, a * w, a * a * u, a * a * w)[i - 8]
    if i < 17:
        return (u if i == 15 else w) / (1.0 + SHARP * a)
    if i < 21:
        fading = math.exp(-t / (EARLY if i < 19 else LATE))
        return (u if i in (17, 19) else w) * fading
    return u * u * u * u * u if i == 21 else w


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """Sum of the shapes, each with a weight (N), of deformation, rate and time over their scales."""
    u, w, s = d / p[AT_SCALES], v / p[AT_SCALES + 1], t / p[AT_SCALES + 2]
    total = 0.0
    for i in range(len(SHAPES)):
        if p[WEIGHTS + i] != 0.0:
            total += p[WEIGHTS + i] * _shape(i, u, w, s)
    return force + total


def _any_force(component: str, names: Sequence[str], loaded: bool = False) -> ForceLaw:
    """Return a force of these shapes; ``loaded``: they grow with a power of the load together."""
    quantities = tuple(Quantity(name, "N", -1e25, 1e25, "share of this shape") for name in names)
    return ForceLaw(
        id="free_force",
        component=component,
        summary="a force of any smooth shape",
        source="restoring force surface",
        parameters=(*quantities, LOAD_EXPONENT) if loaded else quantities,
        strength=None,
        trials=lambda scale: [],
        statement=lambda values, name: "",
        law=force_law,
        constants=lambda values, rest: (
            *(values.get(name, 0.0) * (by_load(values, rest.preload) if loaded else 1.0) for name in SHAPES),
            *(values.get(name, 0.0) for name in SCALES),
        ),
        fits=(),
        one_signed=False,
    )


def _channel(channel: int, power: int) -> ChannelDistortion:
    """Return a change of one channel, as a power of it or (0) in proportion to its slope."""

    def distort(rows: Real, values: Values, sample_rate_hz: float) -> Real:
        out = rows.copy()
        if power:
            out += values["strength"] * rows**power / max(abs(values["peak"]), 1e-300) ** (power - 1)
        else:
            out[:, 1:] += values["strength"] * (rows[:, 1:] - rows[:, :-1])
        return out

    return ChannelDistortion(
        id=f"free_channel_{power}",
        component="sensor chain",
        summary="a change of one channel",
        source="free form",
        parameters=(Quantity("strength", "1", -1e9, 1e9, "of the change"),),
        strength="strength",
        trials=lambda scale: [{"strength": SHARE}],
        statement=lambda values, name: "",
        distort=distort,
        at=lambda rig: [(channel,)],
        one_signed=False,
    )


def free_places(rig: Arrangement) -> list[int]:
    """Return elements, one for each deformation, that forces of any shape are tried in."""
    rows: dict[object, int] = {}
    for i, element in enumerate(rig.elements):
        if element.role != "body":
            rows.setdefault(element.row, i)
    return list(rows.values())


def free_trials(rig: Arrangement, place: int, scale: Scale) -> list[Term]:
    """Return a small force of each shape in an element, one term each."""
    element = rig.elements[place]
    names = OF_JOINTS if _joins(element) else OF_SPRINGS
    scales = {"deformation": scale.deformation, "rate": scale.rate, "duration": scale.duration_s}
    return [
        Term(_any_force(element.component, (name,)), {name: SHARE * scale.force, **scales}, (place,)) for name in names
    ]


def joint_term(rig: Arrangement, place: int, scale: Scale) -> Term:
    """Return the force of any shape in an element whose weights are fitted together."""
    scales = {"deformation": scale.deformation, "rate": scale.rate, "duration": scale.duration_s}
    mechanism = _any_force(rig.elements[place].component, JOINTLY)
    return Term(mechanism, dict.fromkeys(JOINTLY, SHARE * scale.force) | scales, (place,))


def free_law(term: Term, rig: Arrangement, scale: Scale, names: Sequence[str]) -> Term:
    """Return the force of any shape in the place of a learned law, small, with its dependence on the load."""
    loaded = rig.elements[term.place[0]].preload
    scales = {"deformation": scale.deformation, "rate": scale.rate, "duration": scale.duration_s}
    load = {AT_LOAD: term.values[AT_LOAD], IN_LOAD: term.values.get(IN_LOAD, 0.0)} if loaded else {}
    of_load = bool(loaded) and any(q.name == IN_LOAD for q in term.mechanism.parameters)
    mechanism = _any_force(rig.elements[term.place[0]].component, names, of_load)
    return Term(mechanism, dict.fromkeys(names, SHARE * scale.force) | scales | load, term.place)


def channel_trials(channels: int) -> list[Term]:
    """Return small changes of each channel; of the last one of several against the others too."""
    found = [(channels - 1, power) for power in GAIN_AND_DELAY] if channels > 1 else []
    found += [(c, power) for c in range(channels) for power in CURVED]
    return [Term(_channel(c, power), {"strength": SHARE}, (c,)) for c, power in found]


def _joins(element: Element) -> bool:
    """Whether bodies meet in an element."""
    return element.role in ("contact", "joint")
