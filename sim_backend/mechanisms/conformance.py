"""Conformance checks of a mechanism file, for anyone who writes a mechanism of their own."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rig.plugins import Check, PluginError
from sim_backend.arrangement import DERIVATIVES, Arrangement, Element, Parameter, Sensor, tester
from sim_backend.arrays import Complex
from sim_backend.force_law import MEMORY
from sim_backend.mechanisms.catalogue import catalogue, load_file, load_installed
from sim_backend.mechanisms.kinds import (
    AddedBody,
    AtRest,
    ChannelDistortion,
    ForceLaw,
    Mechanism,
    Real,
    Scale,
    SecondImpact,
    Tones,
    Values,
)
from sim_backend.mechanisms.places import Place

SYMBOLS = {"m", "s", "N", "kg", "Hz", "rad", "V", "mV", "K", "samples"}
UNIT = re.compile(r"1|(?:1|[A-Za-z]+\d*(?: [A-Za-z]+\d*)*)(?:/[A-Za-z]+\d*(?: [A-Za-z]+\d*)*)?")
CYCLES, POINTS = 6, 400  # of the motion that a law is tried along
STEPS = 0.05, 0.1  # of the trial's strength: the second is twice the first
SLOPES = 1e-2  # by which the slopes of the two may differ
LEAST = 1e-6  # strength, over the trial's, that stands for none where none is not allowed
PASSIVE = 1e-6  # of the work done on a spring, that a cycle may deliver by rounding and by the step size
SAME = 1e-9
RATE_HZ = 25000.0


@dataclass(frozen=True, slots=True)
class Bench:
    """A rig that mechanisms are tried in, with the scale of its motion and its element's preload (N)."""

    name: str
    rig: Arrangement
    scale: Scale
    preload: float


def benches() -> tuple[Bench, Bench]:
    """Return the tester, and a small described rig: two bodies, every kind of element, two sensors, one input."""
    constants = {"m": 1.0, "m'": 2.0, "k": 1e3, "k'": 1e3, "c": 2.0, "c'": 1.0}
    small = Arrangement(
        ("mass", "other mass"),
        ("m", "m'"),
        (
            Element("spring", "spring", "tube springs", (("mass", 1.0),), "k"),
            Element("damper", "damper", "upper mass", (("other mass", 1.0),), damping="c"),
            Element("joint", "joint", "contact", (("mass", 1.0), ("other mass", -1.0)), "k'", "c'"),
            Element("contact", "contact", "contact", (("other mass", -1.0),), "k", "c"),
            Element("slide", "guide", "upper mass", (("mass", 1.0),)),
            Element("pendulum", "pendulum", "upper mass", (("other mass", 1.0),), "k'", "c'"),
        ),
        (Sensor("sensor 1", (("mass", 1.0),), "displacement"), Sensor("sensor 2", (("other mass", 1.0),))),
        tuple(Parameter(name, "", value, 0.0) for name, value in constants.items()),
        "mass",
        inputs=1,
    )
    eq_9 = tester(0.107, 0.108, 5.3e5, 5.3e5, 8e6, 5.0, mass_uncertainty=0.0, spring_uncertainty=0.0)
    return (
        Bench("the tester", eq_9, Scale(1e-8, 1e-4, 5e-8, 0.08, (350.0, 2000.0), 0.1, 0.108), 0.4),
        Bench("a described rig", small, Scale(1e-2, 0.3, 0.0, 10.0, (3.0, 8.0), 20.0, 1.0), 0.0),
    )


def conformance(file: Path) -> list[Check]:
    """Check a mechanism's file, or the mechanism that an installed package offers under this name.

    It can be imported; its id is free; its units are units; it has places in the tester or in a described rig, no two
    variants the same; trials have all parameters, within their ranges; without strength, and with all else zero that
    may be, there is no effect, which grows in proportion to a small strength; a compiled law is the Python that it was
    written as. An element with a law that does not change with time, or a rig with an added body, never delivers net
    work over a closed cycle: for a law, with the linear spring and damper it acts beside, moved as a sine with the
    trial's strength, and with the opposite one where both signs are allowed.
    """
    try:
        installed = file.suffix != ".py" and not file.exists()
        family = load_installed(str(file)) if installed else load_file(file)
    except PluginError as error:
        return [Check("the file holds a mechanism", False, str(error))]
    found = [
        Check("the file holds a mechanism", True, f"{family[0].id}, {len(family)} variant(s)"),
        _free_id(file, family, installed),
    ]
    found += [_units(family), _places(family)]
    for mechanism in family:
        for bench in benches():
            places = mechanism.places(bench.rig)
            if places:
                found += _tried(mechanism, bench, places[0])
    return found


def _tried(mechanism: Mechanism, bench: Bench, place: Place) -> list[Check]:
    """Check a mechanism in a place of a rig."""
    checks: list[Callable[[Mechanism, Bench, Place], Check]] = [_ranges, _sentence, _nothing, _slope]
    if isinstance(mechanism, ForceLaw):
        checks.append(_compiled)
    if isinstance(mechanism, ForceLaw | AddedBody):
        checks.append(_energy)
    found = []
    for check in checks:
        try:
            found.append(check(mechanism, bench, place))
        except Exception as error:
            name = check.__name__.strip("_")
            found.append(Check(f"{name} in {bench.name}", False, f"{type(error).__name__}: {error}"))
    return found


def _free_id(file: Path, family: Sequence[Mechanism], installed: bool) -> Check:
    own = installed or file.resolve().parent == Path(__file__).resolve().parent
    try:
        taken = family[0].id in catalogue() and not own
    except PluginError as error:  # of an installed package: this one, if its id is another mechanism's
        return Check("its id is free", False, str(error))
    return Check("its id is free", not taken, f"{family[0].id} is another mechanism's" if taken else "")


def _units(family: Sequence[Mechanism]) -> Check:
    units = {q.unit for m in family for q in m.parameters} | {d.unit for m in family for d in m.derived}
    wrong = sorted(unit for unit in units if not is_unit(unit))
    return Check(
        "its units are units", not wrong, f"{', '.join(map(repr, wrong))}; write N s/m or m/s2" if wrong else ""
    )


def is_unit(unit: str) -> bool:
    """Whether a text is 1 or a product of symbols with whole exponents, over another: ``N s2/m2``."""
    return bool(UNIT.fullmatch(unit)) and set(re.findall(r"[A-Za-z]+", unit)) <= SYMBOLS


def _places(family: Sequence[Mechanism]) -> Check:
    said = []
    for bench in benches():
        every = [place for m in family for place in m.places(bench.rig)]
        if len(set(every)) < len(every):
            return Check("it has places", False, f"two variants, or one twice, in the same place of {bench.name}")
        named = [m.named(bench.rig, place) for m in family for place in m.places(bench.rig)]
        said.append(f"{bench.name}: {', '.join(named) or 'none'}")
    of_gauge = all(isinstance(m, ChannelDistortion) and m.of == "load cell" for m in family)
    somewhere = of_gauge or any(m.places(bench.rig) for m in family for bench in benches())
    return Check("it has places", somewhere, "; ".join(said))


def _ranges(mechanism: Mechanism, bench: Bench, place: Place) -> Check:
    name = f"trials lie within the parameters' ranges in {bench.name}"
    for values in mechanism.trials(bench.scale):
        for q in mechanism.parameters:
            if q.name not in values:
                return Check(name, False, f"a trial has no {q.name}")
            if not (math.isfinite(values[q.name]) and q.low <= values[q.name] <= q.high):
                return Check(name, False, f"{q.name} is {values[q.name]:g}, allowed are {q.low:g} to {q.high:g}")
    known = mechanism.strength is None or mechanism.strength in {q.name for q in mechanism.parameters}
    return Check(name, known, "" if known else f"its strength {mechanism.strength} is not a parameter")


def _sentence(mechanism: Mechanism, bench: Bench, place: Place) -> Check:
    said = mechanism.statement(mechanism.trials(bench.scale)[0], mechanism.named(bench.rig, place))
    return Check(f"its statement is a sentence in {bench.name}", said[:1].isupper() or said[:1].isdigit(), said)


def _nothing(mechanism: Mechanism, bench: Bench, place: Place) -> Check:
    name = f"without strength there is no effect in {bench.name}"
    if mechanism.strength is None:
        return Check(name, True, "it has no strength: it is there or not")
    values = mechanism.trials(bench.scale)[0]
    share = LEAST if _by_factors(mechanism) else 0.0
    none = {q.name: 0.0 for q in mechanism.parameters if not q.log and q.low <= 0.0 <= q.high}
    left = _size(effect(mechanism, scaled(mechanism, values | none, share), bench, place))
    whole = _size(effect(mechanism, values, bench, place))
    return Check(name, left <= 2 * share * whole + SAME * whole, f"{left:.3g} of {whole:.3g}")


def _slope(mechanism: Mechanism, bench: Bench, place: Place) -> Check:
    name = f"its effect is differentiable in the strength in {bench.name}"
    if mechanism.strength is None:
        return Check(name, True, "it has no strength: it is there or not")
    worst = 0.0
    for values in mechanism.trials(bench.scale):
        least = LEAST if _by_factors(mechanism) else 0.0
        none, half, whole = (effect(mechanism, scaled(mechanism, values, f), bench, place) for f in (least, *STEPS))
        if _size(whole - none) > 0:
            worst = max(worst, _size((whole - none) - 2 * (half - none)) / _size(whole - none))
    return Check(name, worst < SLOPES, f"slopes from a step and from half of it differ by {100 * worst:.2g} %")


def _compiled(mechanism: Mechanism, bench: Bench, place: Place) -> Check:
    assert isinstance(mechanism, ForceLaw)  # noqa: S101
    off = 0.0
    for values in mechanism.trials(bench.scale):
        d, v, h = _motion(bench.scale)
        p = _constants(mechanism, values, bench, place, h)
        base = p[1] * d + p[2] * v
        pair = [_along(f, p, d, v, h, base) for f in (mechanism.law, mechanism.law.py_func)]
        off = max(off, _size(pair[0] - pair[1]) / max(_size(pair[1]), 1e-300))
    return Check(f"the compiled law is its Python in {bench.name}", off < SAME, f"they differ by {off:.2g}")


def _energy(mechanism: Mechanism, bench: Bench, place: Place) -> Check:
    name = f"it delivers no net work over a closed cycle in {bench.name}"
    least = math.inf
    for values in mechanism.trials(bench.scale):
        if isinstance(mechanism, AddedBody):
            least = min(least, _least_eigenvalue(mechanism, values, bench, place))
            continue
        if not isinstance(mechanism, ForceLaw) or mechanism.with_time:
            return Check(name, True, "it changes with time, which may do work")
        signs = (1.0,) if mechanism.one_signed or mechanism.strength is None else (1.0, -1.0)
        for sign in signs:
            d, v, h = _motion(bench.scale)
            p = _constants(mechanism, scaled(mechanism, values, sign), bench, place, h)
            force = _along(mechanism.law, p, d, v, h, p[1] * d + p[2] * v)[-POINTS - 1 :]
            cycle = d[-POINTS - 1 :]
            least = min(least, float(np.trapezoid(force, cycle) / max(np.ptp(force) * np.ptp(cycle), 1e-300)))
    return Check(name, least > -PASSIVE, f"it takes at least {least:.2g} of the largest force times the way")


def _least_eigenvalue(mechanism: AddedBody, values: Values, bench: Bench, place: Place) -> float:
    """Return the least eigenvalue of damping and stiffness, over the largest of each."""
    extended = mechanism.extend(bench.rig, values, place)
    _, *both = extended.matrices(extended.declared())
    spectra = [np.linalg.eigvalsh(matrix) for matrix in both]
    return float(min(s[0] / max(abs(s[-1]), 1e-300) for s in spectra))


def _by_factors(mechanism: Mechanism) -> bool:
    """Whether the strength cannot be zero, as it is fitted as its logarithm."""
    return any(q.log for q in mechanism.parameters if q.name == mechanism.strength)


def scaled(mechanism: Mechanism, values: Mapping[str, float], factor: float) -> dict[str, float]:
    """Return values with the strength so many times as large; of an added body mass, stiffness and damping together."""
    quantities = {q.name: q for q in mechanism.parameters}
    strength = mechanism.strength
    if strength is None:
        return dict(values)
    together = isinstance(mechanism, AddedBody) and quantities[strength].log
    return {k: v * factor if k == strength or (together and k in quantities) else v for k, v in values.items()}


def effect(mechanism: Mechanism, values: Values, bench: Bench, place: Place) -> Real:
    """Return what a mechanism adds: a force along a sine, a channel's change, or a rig's frequency response."""
    if isinstance(mechanism, ForceLaw):
        d, v, h = _motion(bench.scale)
        p = _constants(mechanism, values, bench, place, h)
        base = p[1] * d + p[2] * v
        added = _along(mechanism.law, p, d, v, h, base) - base
        return added if _size(added) > SAME * _size(base) else 0.0 * added  # what rounding leaves is nothing
    if isinstance(mechanism, ChannelDistortion):
        t = np.arange(2000) / RATE_HZ
        rows = np.array([np.exp(-30 * t) * np.sin(2000 * t + i) for i in range(len(place))])
        return mechanism.distort(rows, {**values, "peak": float(np.abs(rows).max())}, RATE_HZ) - rows
    if isinstance(mechanism, AddedBody):
        added = _frequency_response(mechanism.extend(bench.rig, values, place), bench.scale)
        return added - _frequency_response(bench.rig, bench.scale)
    if isinstance(mechanism, Tones | SecondImpact):
        return np.array([values[mechanism.parameters[0].name]])
    raise TypeError(f"{type(mechanism).__name__} is not a kind of mechanism")


def _motion(scale: Scale) -> tuple[Real, Real, float]:
    """Return deformation and rate of a sine of the scale's amplitudes (its phase such that it starts at rest), step."""
    phase = 2 * np.pi * np.arange(CYCLES * POINTS + 1) / POINTS
    omega = scale.rate / scale.deformation
    return scale.deformation * np.sin(phase), scale.rate * np.cos(phase), 2 * math.pi / POINTS / omega


def _constants(mechanism: ForceLaw, values: Values, bench: Bench, place: Place, h: float) -> Real:
    rest = AtRest.of(bench.rig.elements[place[0]], bench.rig.declared(), bench.preload)
    return mechanism.packed(values, rest, h)


def _along(law: Any, p: Real, d: Real, v: Real, h: float, base: Real) -> Real:
    before, after = np.zeros(MEMORY), np.zeros(MEMORY)
    out = np.empty_like(d)
    for i in range(d.size):
        out[i] = law(float(base[i]), float(d[i]), float(v[i]), i * h, p, before, after)
        before[:] = after
    return out


def _frequency_response(rig: Arrangement, scale: Scale) -> Real:
    """Return real and imaginary parts of what the sensors show for a unit force on the tapped body."""
    values = rig.declared()
    mass, damping, stiffness = rig.matrices(values)
    push = np.array([1.0 if body == rig.tapped else 0.0 for body in rig.bodies])
    found = []
    for omega in 2 * np.pi * np.geomspace(0.2 * scale.frequency_hz[0], 5 * scale.frequency_hz[1], 40):
        rows = np.array([_shown(rig, s, values, 1j * omega) for s in rig.sensors])
        found.append(rows @ np.linalg.solve(stiffness + 1j * omega * damping - omega**2 * np.diag(mass), push))
    return np.concatenate([np.real(found).ravel(), np.imag(found).ravel()])


def _shown(rig: Arrangement, sensor: Sensor, values: Values, s: complex) -> Complex:
    """Return (bodies,) what a sensor shows of displacements that grow as exp(s t), over their derivative it shows."""
    displaced, moved = rig.strain(sensor, values)
    return rig.vector(sensor.row, values) + (displaced + s * moved) / s ** DERIVATIVES[sensor.quantity]


def _size(x: Real) -> float:
    return float(np.sqrt(np.mean(x**2)))
