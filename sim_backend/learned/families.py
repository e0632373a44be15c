"""The families that laws are learned from: what the force of an element, or a channel, may look like in general.

A family has a few numbers, exponents among them. Where the element carries the load its force may go with a power of
it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from sim_backend.arrangement import Role
from sim_backend.learned import laws
from sim_backend.learned.curves import curve_forms
from sim_backend.learned.forms import (
    AT_DEFLECTION,
    AT_RATE,
    FORCE,
    FORM,
    IN_DEFLECTION,
    IN_RATE,
    LEARNED,
    TIME,
    Form,
    Kind,
    LearnedForce,
    Symmetry,
    at_one_load,
    number,
    over,
    power_text,
    references,
    times_load,
)
from sim_backend.mechanisms import attached_mass
from sim_backend.mechanisms.kinds import ChannelDistortion, Mechanism, Quantity, Real, Scale, Values
from sim_backend.mechanisms.places import channels_that_differ, each_channel

BEND, WAY, PLAY, FALLING, FALLING_RATE = "bend", "way", "play", "falling_share", "falling_rate"
REACH, CORNER, ASYMMETRY, DAMPING_FORCE = "reach", "corner_exponent", "asymmetry", "damping_force_n"
SHARE, IN_SIGNAL, AHEAD = "share_of_peak", "signal_exponent", "clock_ahead"

TOUCHING = 1.1  # an exponent nearer to one cannot be told from the linear element
LARGEST = 7.0  # exponent
STEEPEST = 12.0  # exponent of an approach: beyond, it is an exponential
BENT = (0.02, 40.0)  # exponent of an exponential: with a smaller one it is a square
ABOVE, BELOW, ANY = (TOUCHING, LARGEST), (0.1, 1 / TOUCHING), (0.3, LARGEST)
JOINTS: tuple[Role, ...] = ("contact", "joint")
OF_DEFLECTION: tuple[Role, ...] = (*JOINTS, "spring", "pendulum", "damper", "guide")
OF_RATE: tuple[Role, ...] = (*JOINTS, "guide", "damper", "spring", "pendulum")

Made = Callable[[int], Form]


def _product(
    key: str,
    name: str,
    kind: Kind,
    odd: tuple[bool, bool],
    ranges: Mapping[str, tuple[float, float]],
    begins: Sequence[tuple[float, ...]],
    fixed: Mapping[str, float] | None = None,
) -> Made:
    """Return a family of products of powers; ``ranges`` of the exponents that are free, ``begins`` of these."""
    constant = {IN_DEFLECTION: 0.0, IN_RATE: 0.0, **(fixed or {})}
    own = [Quantity(k, "1", *r, f"{k.replace('_', ' ')} of the force") for k, r in ranges.items()]
    tried = [{**constant, **dict(zip(ranges, b, strict=True))} for b in begins]
    symmetry: Symmetry = "odd" if odd[0] != odd[1] else "even" if not any(odd) else "none"
    used = {*ranges, *(k for k, v in (fixed or {}).items() if v)}
    exponents = {v: k for v, k in (("deflection", IN_DEFLECTION), ("rate", IN_RATE)) if k in used}

    def numbers(values: Values) -> tuple[float, ...]:
        powers = values.get(IN_DEFLECTION, 0.0), values.get(IN_RATE, 0.0)
        return (*powers, values[AT_DEFLECTION], values[AT_RATE], float(odd[0]), float(odd[1]))

    def text(values: Values) -> str:
        factors = [f"{number(values[FORCE])} N"]
        if "deflection" in exponents:
            factors.append(power_text("d", values[AT_DEFLECTION], "m", values[IN_DEFLECTION], odd[0]))
        if "rate" in exponents:
            factors.append(power_text("v", values[AT_RATE], "m/s", values[IN_RATE], odd[1]))
        return " * ".join(factors) + times_load(values)

    def made(place: int) -> Form:
        form = Form(
            number=place, key=key, name=name, kind=kind, symmetry=symmetry, conservative=kind == "static", text=text,
            exponents=exponents,
        )  # fmt: skip
        roles = OF_DEFLECTION if kind == "static" else OF_RATE
        return form.with_forces(laws.product_of_powers, own, tried, numbers, roles)

    return made


def _exponential(place: int) -> Form:
    def text(v: Values) -> str:
        return (
            f"{number(2 * v[FORCE] / v[BEND] ** 2)} N * (exp(x) - 1 - x){times_load(v)}, "
            f"x = {number(v[WAY] * v[BEND])} * {over('d', v[AT_DEFLECTION], 'm')}"
        )

    form = Form(
        number=place, key="exponential", name="an exponential of the deflection", kind="static", symmetry="none",
        conservative=True, text=text,
    )  # fmt: skip
    own = (Quantity(BEND, "1", *BENT, "exponent at the reference", log=True),)
    begins = [{BEND: 1.0, WAY: -1.0}, {BEND: 1.0, WAY: 1.0}]
    return form.with_forces(
        laws.exponential, own, begins, lambda v: (v[WAY] * v[BEND], 0.0, v[AT_DEFLECTION]), OF_DEFLECTION
    )


def _power_of_approach(place: int) -> Form:
    def text(v: Values) -> str:
        n = number(v[IN_DEFLECTION])
        return f"P * (max(1 + k * d / ({n} * P), 0)**{n} - 1) - k * d, k the stiffness under the load P"

    form = Form(
        number=place, key="power_of_approach", name="a power of the approach under load", kind="static",
        symmetry="none", conservative=True, text=text, exponents={"deflection": IN_DEFLECTION},
    )  # fmt: skip
    exponent = Quantity(IN_DEFLECTION, "1", TOUCHING, STEEPEST, "exponent of the approach", log=True)

    def trials(scale: Scale) -> list[dict[str, float]]:
        return [{FORM: float(place), **references(scale), IN_DEFLECTION: n} for n in (1.25, 2.0, 3.0)]

    law = LearnedForce(
        id="learned_static", component="", summary=f"a law learned from recordings: {form.name}", source=LEARNED,
        parameters=(exponent,), strength=None, trials=trials, statement=form.statement,
        law=laws.power_of_approach, constants=lambda values, rest: (values[IN_DEFLECTION],), fits=JOINTS,
        preloaded=True,
    )  # fmt: skip
    return replace(form, loaded=law)


def _dead_zone(place: int) -> Form:
    def text(v: Values) -> str:
        beyond = f"max(abs({over('d', v[AT_DEFLECTION], 'm')}) - {number(v[PLAY])}, 0)"
        return f"{number(v[FORCE])} N * sign(d) * {beyond}{times_load(v)}"

    form = Form(
        number=place, key="dead_zone", name="a stiffness that sets in beyond a play", kind="static", symmetry="odd",
        conservative=True, text=text,
    )  # fmt: skip
    own = (Quantity(PLAY, "1", 1e-3, 10.0, "play, over the reference", log=True),)
    begins = [{PLAY: 0.25}, {PLAY: 0.6}]
    return form.with_forces(laws.dead_zone, own, begins, lambda v: (v[PLAY], 0.0, v[AT_DEFLECTION]), OF_DEFLECTION)


def _friction(place: int) -> Form:
    def text(v: Values) -> str:
        falls = f"exp(-(v / {v[FALLING_RATE] * v[AT_RATE]:.4g} m/s)**2)"
        return f"{number(v[FORCE])} N * sign(v) * (1 + {number(v[FALLING])} * {falls}){times_load(v)}"

    form = Form(
        number=place, key="friction", name="dry friction that changes with the rate", kind="rate", symmetry="odd",
        conservative=False, text=text,
    )  # fmt: skip
    own = (
        Quantity(FALLING, "1", -5.0, 20.0, "how much larger it is at rest"),
        Quantity(FALLING_RATE, "1", 0.03, 10.0, "rate at which it falls, over the reference", log=True),
    )
    begins = [{FALLING: 0.0, FALLING_RATE: 0.5}, {FALLING: 1.0, FALLING_RATE: 0.25}]
    return form.with_forces(
        laws.friction, own, begins, lambda v: (v[FALLING], v[FALLING_RATE], v[AT_DEFLECTION], v[AT_RATE]), OF_RATE,
        jumps=True,
    )  # fmt: skip


def _growing_friction(place: int) -> Form:
    def text(v: Values) -> str:
        grown = power_text("d", v[AT_DEFLECTION], "m", v[IN_DEFLECTION], False)
        return f"{number(v[FORCE])} N * {grown} * sign(v){times_load(v)}"

    form = Form(
        number=place, key="growing_friction", name="a friction that grows with the deflection", kind="rate",
        symmetry="odd", conservative=False, text=text, exponents={"deflection": IN_DEFLECTION},
    )  # fmt: skip
    own = (Quantity(IN_DEFLECTION, "1", *ANY, "deflection exponent of the force"),)
    begins = [{IN_DEFLECTION: 1.0}]
    return form.with_forces(
        laws.growing_friction, own, begins, lambda v: (v[IN_DEFLECTION], 0.0, v[AT_DEFLECTION], v[AT_RATE]), OF_RATE,
        jumps=True,
    )  # fmt: skip


def _hysteresis(place: int) -> Form:
    def text(v: Values) -> str:
        yields = f"abs(z)**{number(v[CORNER])} * ({number(1 - v[ASYMMETRY])} + {number(v[ASYMMETRY])} * sign(z * v))"
        reach = f"D = {v[AT_DEFLECTION] * v[REACH]:.4g} m"
        return f"{number(v[FORCE])} N * (z - d / D){times_load(v)}, D * z' = v * (1 - {yields}), {reach}"

    form = Form(
        number=place, key="hysteresis", name="hysteresis that does not depend on the rate", kind="memory",
        symmetry="odd", conservative=False, text=text,
    )  # fmt: skip
    own = (
        Quantity(REACH, "1", 0.01, 30.0, "deflection at which it yields, over the reference", log=True),
        Quantity(CORNER, "1", 0.3, 8.0, "how abruptly it yields", log=True),
        Quantity(ASYMMETRY, "1", -1.0, 2.0, "share of the yielding that goes with the way"),
    )
    begins = [{REACH: r, CORNER: 1.0, ASYMMETRY: b} for r in (0.3, 1.0) for b in (0.5, 0.9)]
    return form.with_forces(
        laws.hysteresis, own, begins, lambda v: (v[CORNER], v[ASYMMETRY], v[AT_DEFLECTION] * v[REACH]), OF_DEFLECTION
    )


def _timed(key: str, name: str, law: Any, shape: str, shares: Sequence[float], roles: tuple[Role, ...]) -> Made:
    own = (
        Quantity(DAMPING_FORCE, "N", -1e25, 1e25, "of the rate, at the reference"),
        Quantity(TIME, "s", 1e-6, 1e9, "time it takes", log=True),
    )

    def text(v: Values) -> str:
        stiff = f"{number(v[FORCE])} N * {over('d', v[AT_DEFLECTION], 'm')}"
        damped = f"{number(v[DAMPING_FORCE])} N * {over('v', v[AT_RATE], 'm/s')}"
        return f"({stiff} + {damped}) * {shape}{times_load(v)}, T = {v[TIME]:.4g} s"

    def made(place: int) -> Form:
        form = Form(
            number=place, key=key, name=name, kind="time", symmetry="odd", conservative=None, text=text
        )  # fmt: skip
        begins = [{DAMPING_FORCE: 0.0, TIME: share} for share in shares]
        return form.with_forces(
            law, own, begins, lambda v: (v[DAMPING_FORCE], v[TIME], v[AT_DEFLECTION], v[AT_RATE]), roles
        )

    return made


def _curved(key: str, name: str, odd: bool) -> Made:
    def distort(rows: Real, values: Values, sample_rate_hz: float) -> Real:
        peak = max(abs(values["peak"]), 1e-300)
        grown = values[SHARE] * peak * (np.abs(rows) / peak) ** values[IN_SIGNAL]
        return np.asarray(rows + (np.sign(rows) * grown if odd else grown))

    def text(v: Values) -> str:
        return f"{number(v[SHARE])} * peak * {'sign(y) * ' if odd else ''}abs(y / peak)**{number(v[IN_SIGNAL])}"

    def made(place: int) -> Form:
        mechanism = ChannelDistortion(
            id="learned_sensor",
            component="sensor chain",
            summary="a bent scale of a channel",
            source=LEARNED,
            parameters=(
                Quantity(SHARE, "1", -2.0, 2.0, "of the peak, there"),
                Quantity(IN_SIGNAL, "1", TOUCHING, LARGEST, "exponent of the signal"),
            ),
            strength=SHARE,
            trials=lambda scale: [{FORM: float(place), SHARE: 1e-3, IN_SIGNAL: n} for n in (2.0, 3.0, 5.0)],
            statement=lambda values, where: (
                f"The scale of {where} is bent: {name}, {text(values)} beside the signal y."
            ),
            distort=distort,
            at=each_channel,
            one_signed=False,
        )
        return Form(
            number=place, key=key, name=name, kind="sensor", symmetry="odd" if odd else "even", conservative=None,
            text=text, exponents={"signal": IN_SIGNAL}, mechanism=mechanism,
        )  # fmt: skip

    return made


def _clock(place: int) -> Form:
    def distort(rows: Real, values: Values, sample_rate_hz: float) -> Real:
        late = values[AHEAD] * np.arange(rows.shape[1])  # samples
        return np.asarray(rows + late * np.gradient(rows, axis=1))

    mechanism = ChannelDistortion(
        id="learned_clock",
        component="sensor chain",
        summary="a channel with a clock of its own",
        source=LEARNED,
        parameters=(Quantity(AHEAD, "1", -1e-2, 1e-2, "by how much its clock is slow"),),
        strength=AHEAD,
        trials=lambda scale: [{FORM: float(place), AHEAD: 1e-7}],
        statement=lambda values, where: f"The clock of {where} is slow by {1e6 * values[AHEAD]:.3g} ppm.",
        distort=distort,
        at=channels_that_differ,
        one_signed=False,
    )
    return Form(
        number=place, key="clock", name="a clock that is not the other channels'", kind="clock", symmetry="none",
        conservative=None, text=lambda v: f"y(t * (1 + {v[AHEAD]:.4g}))", mechanism=mechanism,
    )  # fmt: skip


def _resonance(place: int) -> Form:
    listed: Final = attached_mass.MECHANISM

    def text(v: Values) -> str:
        hz, ratio = attached_mass.frequency_hz(v), attached_mass.damping_ratio(v)
        return f"m = {v[attached_mass.MASS]:.4g} kg at {hz:.5g} Hz, damping ratio {ratio:.3g}"

    mechanism = replace(
        listed,
        id="learned_dynamics",
        summary="one more resonance at a body",
        source=LEARNED,
        trials=lambda scale: [{**values, FORM: float(place)} for values in listed.trials(scale)],
        statement=lambda values, where: f"The {where} carries a resonance that is not described, {text(values)}.",
    )
    return Form(
        number=place, key="resonance", name="one more resonance", kind="dynamics", symmetry="odd", conservative=None,
        text=text, mechanism=mechanism,
    )  # fmt: skip


_MADE: tuple[Made, ...] = (
    _product(
        "odd_power", "an odd power of the deflection", "static", (True, False), {IN_DEFLECTION: ABOVE},
        [(1.5,), (2.0,), (3.0,), (5.0,)],
    ),
    _product("odd_root", "an odd root of the deflection", "static", (True, False), {IN_DEFLECTION: BELOW}, [(0.5,)]),
    _product(
        "even_power", "an even power of the deflection", "static", (False, False), {IN_DEFLECTION: ANY},
        [(1.0,), (2.0,), (4.0,)],
    ),
    _exponential,
    _dead_zone,
    _product(
        "rate_power", "an odd power of the rate", "rate", (False, True), {IN_RATE: ABOVE},
        [(1.5,), (2.0,), (3.0,), (5.0,)],
    ),
    _product(
        "rate_root", "an odd root of the rate", "rate", (False, True), {IN_RATE: BELOW}, [(0.2,), (0.5,), (0.8,)]
    ),
    _product("even_rate", "an even power of the rate", "rate", (False, False), {IN_RATE: ANY}, [(1.0,), (2.0,)]),
    _friction,
    _product(
        "growing_damper", "a damper that grows with the deflection", "rate", (False, True), {IN_DEFLECTION: ANY},
        [(1.0,), (2.0,)], {IN_RATE: 1.0},
    ),
    _product(
        "one_sided_damper", "a damper that grows to one side", "rate", (True, True), {IN_DEFLECTION: ANY},
        [(1.0,), (2.0,)], {IN_RATE: 1.0},
    ),
    _hysteresis,
    _timed(
        "settling", "a stiffness or damping that settles", laws.fading, "(1 - exp(-t / T))", (0.03, 0.2, 1.0),
        OF_DEFLECTION,
    ),
    _timed(
        "letting_go", "something that lets go after the tap", laws.of_a_duration, "(t < T)", (0.02, 0.06), OF_RATE
    ),
    _curved("bent_alike", "a power of the signal, alike on both sides", odd=True),
    _curved("bent_aside", "a power of the signal, towards one side", odd=False),
    _clock,
    _resonance,
    _power_of_approach,
    _growing_friction,
)  # fmt: skip
CURVES: Final = curve_forms(len(_MADE))
FAMILIES: tuple[Form, ...] = (*(make(place) for place, make in enumerate(_MADE)), *CURVES)
"""All families, by their number; the curves come last."""
_ALL = tuple(m for form in FAMILIES if form.formula for m in form.mechanisms)
_AT_ONE_LOAD = tuple(map(at_one_load, _ALL))


def form_of(values: Values) -> Form:
    """Return the family that fixed values belong to."""
    return FAMILIES[round(values[FORM])]


def form_named(key: str) -> Form:
    """Return the family of this name.

    Raises
    ------
    KeyError
        There is none.
    """
    return {form.key: form for form in FAMILIES}[key]


def learned_mechanisms(one_load: bool = False) -> list[Mechanism]:
    """Return the mechanisms of all families with a formula; none that goes with a power of the load if ``one_load``."""
    return list(_AT_ONE_LOAD if one_load else _ALL)


def curves() -> list[Mechanism]:
    """Return the mechanisms of all curves."""
    return [m for form in CURVES for m in form.mechanisms]
