"""Effects that are forces in an element."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mesotap.proof.rigs import laws
from mesotap.proof.rigs.description import Element
from mesotap.proof.rigs.draw import Wants
from mesotap.proof.rigs.effects import Effect, Hidden, Rng, Scale, chosen, scale_of, span, together, with_law
from mesotap.proof.rigs.plant import Law
from mesotap.proof.rigs.trial import Trial

ALL = ("spring", "joint", "contact", "pendulum", "slide")
STIFF = ("spring", "joint", "contact", "pendulum")
GUIDED = ("slide", "pendulum", "spring", "joint")


@dataclass(frozen=True, slots=True)
class Drawn:
    """Constants of a law at a strength, and the parameters by which an answer names them."""

    constants: Callable[[float], Sequence[float]]
    parameters: Callable[[float], Mapping[str, float]] = lambda s: {}
    preload: Callable[[float], float] | None = None
    start: float = 0.01
    most: float = 1.0


@dataclass(frozen=True, slots=True)
class Setting:
    """Where a law is drawn: the element's scale, its stiffness and damping, the span of a recording."""

    scale: Scale
    k: float
    c: float
    span: float
    rng: Rng

    def between(self, low: float, high: float) -> float:
        """Return a number between two."""
        return float(self.rng.uniform(low, high))

    def sign(self) -> float:
        """Return 1 or -1."""
        return float(self.rng.choice([-1.0, 1.0]))


def _force(
    name: str, code: int, wants: Wants, sections: tuple[str, ...], draw: Callable[[Setting], Drawn]
) -> Effect:  # fmt: skip
    """Return the effect of one law; an element of a preloaded contact is the contact."""

    def fits(e: Element) -> bool:
        return not wants.preload or e.section == "contact"

    def drawn(trial: Trial, rng: Rng) -> Hidden | None:
        rig = trial.rig
        i = chosen(rig, ("contact",) if wants.preload else sections, rng, fits)
        if i is None:
            return None
        e, scale = rig.elements[i], scale_of(trial, i)
        k = e.stiffness.true if e.stiffness else scale.f / scale.d
        c = e.damping.true if e.damping else 0.0
        found = draw(Setting(scale, k, c, span(trial), rng))
        shape = rig.shape(e)
        preload = (i, found.preload) if found.preload else None
        return Hidden(
            name,
            together(rig, i),
            "contact" if wants.preload else e.section,
            lambda altered, s: with_law(altered, Law(code, shape, tuple(found.constants(s)))),
            found.parameters,
            preload,
            found.start,
            found.most,
            code in laws.KINKED,
        )

    return Effect(name, wants, drawn)


def _power(label: str, d: int, v: int, signed: bool) -> Callable[[Setting], Drawn]:
    """Return a law whose constant times d^i v^j is a share of the element's force."""

    def draw(at: Setting) -> Drawn:
        factor = (at.sign() if signed else 1.0) * at.scale.f / at.scale.d**d / at.scale.v**v
        return Drawn(lambda s: (s * factor,), lambda s: {label: s * factor} if label else {})

    return draw


def _stop(at: Setting) -> Drawn:
    gap = at.between(0.3, 0.8) * at.scale.d
    return Drawn(
        lambda s: (s * at.k, gap), lambda s: {"stop_stiffness_n_per_m": s * at.k, "gap_m": gap}, start=0.02, most=30.0
    )


def _swing(at: Setting) -> Drawn:
    def angle(s: float) -> float:  # over the deflection
        return float(np.sqrt(s)) / at.scale.d

    return Drawn(lambda s: (at.k, angle(s)), lambda s: {"arc_curvature_per_m2": angle(s) ** 2}, start=0.02, most=3.0)


def _slip(at: Setting) -> Drawn:
    reach, spread = at.between(1.1, 4.0) * at.scale.d, at.between(-0.5, 0.5)
    return Drawn(lambda s: (s * at.k, reach, spread), most=0.9)


def _settling(at: Setting) -> Drawn:
    time, more = at.between(0.1, 0.5) * at.span, at.between(-1.0, 1.0)
    return Drawn(
        lambda s: (s * at.k, s * more * at.c, time),
        lambda s: {
            "stiffness_change_n_per_m": s * at.k,
            "damping_change_n_s_per_m": s * more * at.c,
            "settling_time_s": time,
        },
        start=1e-3,
    )


def _dwelling(at: Setting) -> Drawn:
    time, load = at.between(0.01, 0.2) * at.span, at.between(1.5, 4.0) * at.scale.f
    return Drawn(
        lambda s: (at.k, s, time), lambda s: {"creep_per_e_fold": s, "creep_time_s": time}, lambda s: load, 1e-3, 0.3
    )


def _hertz(at: Setting) -> Drawn:
    return Drawn(lambda s: (at.scale.f / s, at.k), preload=lambda s: at.scale.f / s, start=0.05, most=0.95)


def _parting(at: Setting) -> Drawn:
    return Drawn(
        lambda s: (at.scale.f / (1 + s), at.k, at.c), preload=lambda s: at.scale.f / (1 + s), start=0.1, most=4.0
    )


def _approach_damping(at: Setting) -> Drawn:
    load = at.between(1.5, 4.0) * at.scale.f
    return Drawn(
        lambda s: (at.c * s, load / at.k),
        lambda s: {"damping_growth_per_relative_approach": s},
        lambda s: load,
        0.1,
        load / at.scale.f,
    )


def _film(at: Setting) -> Drawn:
    load, height = at.between(1.5, 4.0) * at.scale.f, at.between(1.3, 3.0) * at.scale.d
    return Drawn(
        lambda s: (at.c * s, height), lambda s: {"film_share_of_c_c": s, "film_height_m": height}, lambda s: load, 0.05
    )


def _meniscus(at: Setting) -> Drawn:
    load, reach = at.between(1.5, 4.0) * at.scale.f, at.between(0.2, 1.0)
    return Drawn(
        lambda s: (s * at.scale.f, reach * load / at.k, 0.03 * at.scale.v),
        lambda s: {"meniscus_force_share": s * at.scale.f / load, "meniscus_range_share": reach},
        lambda s: load,
    )


def _loaded(draw: Callable[[Setting], Drawn], label: str = "") -> Callable[[Setting], Drawn]:
    """Return a law in a contact under a preload that it does not depend on; ``label`` is its constant over c."""

    def drawn(at: Setting) -> Drawn:
        load, found = at.between(1.5, 4.0) * at.scale.f, draw(at)
        parameters = (lambda s: {label: found.constants(s)[0] / at.c}) if label and at.c else (lambda s: {})
        return Drawn(found.constants, parameters, lambda s: load, found.start, found.most)

    return drawn


def _shaken(at: Setting) -> Drawn:
    rate, phase = 2 * np.pi * at.between(3.0, 40.0) / at.span, at.between(0.0, 2 * np.pi)
    return Drawn(lambda s: (s * at.k, rate, phase), start=1e-3)


ANY, LOADED = Wants(), Wants(preload=True)
OVER_TIME, LOADED_OVER_TIME = Wants(excited="several"), Wants(preload=True, excited="several")

FORCES = (
    _force("tube_spring_cubic", laws.CUBIC, ANY, STIFF, _power("cubic_stiffness_n_per_m3", 3, 0, True)),
    _force("guide_friction", laws.FRICTION, ANY, GUIDED, _power("friction_force_n", 0, 0, False)),
    _force("quadratic_damping", laws.RATE_SQUARED, ANY, ALL, _power("quadratic_damping_n_s2_per_m2", 0, 2, False)),
    _force("spring_asymmetry", laws.SQUARE, ANY, STIFF, _power("quadratic_stiffness_n_per_m2", 2, 0, True)),
    _force("end_stop", laws.STOP, ANY, ("contact", "spring"), _stop),
    _force("large_swing", laws.SWING, ANY, ("pendulum",), _swing),
    _force("micro_slip", laws.SLIP, ANY, ("joint", "contact", "spring"), _slip),
    _force("contact_creep", laws.SETTLING, OVER_TIME, STIFF, _settling),
    _force("hertz_stiffness", laws.HERTZ, LOADED, (), _hertz),
    _force("contact_loss", laws.PARTING, LOADED, (), _parting),
    _force("hunt_crossley_damping", laws.APPROACH_DAMPING, LOADED, (), _approach_damping),
    _force("squeeze_film", laws.FILM, LOADED, (), _film),
    _force("menisci", laws.MENISCUS, LOADED, (), _meniscus),
    _force("rough_surface_stiffness", laws.ROUGH, LOADED, (), _hertz),
    _force("contact_creep", laws.LOG_CREEP, LOADED_OVER_TIME, (), _dwelling),
    _force("micro_slip", laws.SLIP, LOADED, (), _loaded(_slip)),
    _force(
        "quadratic_damping", laws.RATE_SQUARED, LOADED, (),
        _loaded(_power("", 0, 2, False), "quadratic_damping_per_c_c"),
    ),
)  # fmt: skip
UNLISTED_FORCES = (
    _force("cubed_rate_damping", laws.RATE_CUBED, ANY, ALL, _power("", 0, 3, False)),
    _force("friction_of_deflection", laws.REID, ANY, STIFF, _power("", 1, 0, False)),
    _force("damping_of_squared_deflection", laws.VAN_DER_POL, ANY, STIFF, _power("", 2, 1, False)),
    _force("shaken_stiffness", laws.SHAKEN, OVER_TIME, STIFF, _shaken),
)
