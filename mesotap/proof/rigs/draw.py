"""Rigs at random, and what they are excited by."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mesotap.proof.rigs import drives
from mesotap.proof.rigs.description import GROUND, Constant, Element, Input, Rig, Sensor, known
from mesotap.proof.rigs.drives import Drive
from mesotap.proof.rigs.noise import Noise
from mesotap.proof.rigs.trial import Altered, Record, Trial, recorded

Array = NDArray[np.float64]
Rng = np.random.Generator
RATES = (100.0, 25_000.0)  # Hz
COUNTS = (2_000, 20_000)  # samples of all recordings together
PERIOD = (13.0, 28.0)  # samples, of the highest mode
DEFLECTIONS = (1e-6, 1e-3)  # m, the largest
BITS = 16
KINDS = ("multisine", "sweep", "steps", "hammer", "random")


@dataclass(frozen=True, slots=True)
class Wants:
    """What an effect needs of the rig that it is concealed in.

    ``preload``: a contact with one; ``excited``: ``free``, ``forced``, ``several`` free decays or forced, or any;
    ``sensors``: so many at least, two of them of one body where ``twins``; ``undamped``: a spring said to have no loss;
    ``shows``: derivatives that all sensors show, -1 for any; ``fastest``: the lowest rate; ``uncertain``: constants
    declared slightly wrong.
    """

    preload: bool = False
    excited: str = ""
    sensors: int = 1
    twins: bool = False
    undamped: bool = False
    shows: int = -1
    fastest: float = RATES[0]
    uncertain: bool = False


def draw_trial(wants: Wants, rng: Rng) -> Trial:
    """Draw a rig, its recordings and their noise."""
    several = wants.excited == "several"
    free = wants.excited == "free" or (wants.excited in ("", "several") and rng.random() < 0.4)
    number = int(rng.integers(2 if several else 1, 5)) if free else int(rng.integers(1, 3))
    total = float(np.exp(rng.uniform(*np.log(COUNTS))))
    count = max(int(total / number), COUNTS[0] // number)
    rate = float(np.exp(rng.uniform(np.log(max(RATES[0], wants.fastest)), np.log(RATES[1]))))
    rate = float(f"{rate:.3g}")
    rig = _rig(wants, free, count, rate, rng)
    records = _decays(rig, count, number, rng) if free else _forced(rig, count, number, rng)
    trial = _scaled(Trial(rig, tuple(records)), float(np.exp(rng.uniform(*np.log(DEFLECTIONS)))))
    trial = _with_offsets(trial, rng)
    return replace(trial, noises=_noises(trial, rng))


def _rig(wants: Wants, free: bool, count: int, rate: float, rng: Rng) -> Rig:
    least = 2 if wants.preload and rng.random() < 0.5 else 1
    bodies = max(least, int(rng.choice([1, 2, 3, 4], p=[0.35, 0.3, 0.2, 0.15])))
    masses = tuple(known(float(f"{m:.4g}")) for m in 10 ** rng.uniform(-1.5, 0.7) * 2 ** rng.uniform(-1, 1, bodies))
    elements = _elements(bodies, wants, rng)
    rig = Rig("rig", masses, tuple(elements), (), None, rate)
    modes = rig.plant(rig.true_values()).modes_hz()
    faster = (rate / rng.uniform(*PERIOD) / modes[-1]) ** 2
    lowest = modes[0] * np.sqrt(faster)
    span = count / rate
    decades = rng.uniform(3, 8) / (2 * np.pi * lowest * span) if free else 10 ** rng.uniform(-2.5, -1.4)
    ratio = float(np.clip(decades, 3e-4, 0.06))
    rig = replace(rig, elements=tuple(_valued(e, faster, ratio / (np.pi * lowest), rng) for e in elements))
    rig = replace(rig, sensors=_sensors(bodies, wants, rng), input=None if free else _input(bodies, rng))
    return _declared(rig, wants.uncertain, rng)


def _elements(bodies: int, wants: Wants, rng: Rng) -> list[Element]:
    """Draw a tree of elements from the ground, and sometimes a further one; stiffnesses are relative."""
    out: list[Element] = []
    chain = rng.random() < 0.5
    preloaded = int(rng.integers(bodies)) if wants.preload else -1
    undamped = int(rng.integers(bodies)) if wants.undamped else -1
    for i in range(bodies):
        parent = GROUND if i == 0 else i - 1 if chain else int(rng.integers(i))
        if i == preloaded:
            section = "contact"
        elif i == undamped:
            section = "spring"
        else:
            section = str(
                rng.choice(["spring", "spring", "joint", "contact", "pendulum" if parent == GROUND else "spring"])
            )
        out.append(_element(section, i, parent, i == undamped, len(out), rng))
    if bodies > 1 and rng.random() < 0.4:
        out.append(_element("spring", int(rng.integers(1, bodies)), GROUND, False, len(out), rng))
    if rng.random() < 0.25:
        out.append(Element("slide 1", "slide", int(rng.integers(bodies)), GROUND, None, Constant(1.0)))
    return out


def _element(section: str, a: int, b: int, undamped: bool, number: int, rng: Rng) -> Element:
    stiffness = Constant(float(np.exp(rng.uniform(np.log(0.4), np.log(2.5)))))
    damping = None if undamped else Constant(1.0)
    return Element(f"{section} {number + 1}", section, a, b, stiffness, damping)


def _valued(e: Element, faster: float, loss_s: float, rng: Rng) -> Element:
    """Give an element its stiffness, and a damping of ``loss_s`` times it, more or less."""
    k = e.stiffness.true * faster if e.stiffness else faster
    share = 0.3 if e.stiffness is None else 1.0
    damping = Constant(float(share * loss_s * k * np.exp(0.4 * rng.standard_normal()))) if e.damping else None
    return replace(e, stiffness=Constant(float(k)) if e.stiffness else None, damping=damping)


def _sensors(bodies: int, wants: Wants, rng: Rng) -> tuple[Sensor, ...]:
    number = min(max(wants.sensors, int(rng.integers(1, bodies + 1))), max(bodies, wants.sensors))
    seen = [int(i) for i in rng.permutation(bodies)[:number]]
    if wants.twins:
        seen = [seen[0], *seen]
    while len(seen) < wants.sensors:
        seen.append(seen[0])
    same = int(rng.integers(3)) if wants.shows < 0 else wants.shows
    mixed = wants.shows < 0 and rng.random() < 0.25
    out: list[Sensor] = []
    for column, body in enumerate(seen):
        weights = np.zeros(bodies)
        weights[body] = 1.0
        if bodies > 1 and not wants.twins and wants.sensors == 1 and rng.random() < 0.1:
            weights[(body + 1) % bodies] = -1.0
        shows = int(rng.integers(3)) if mixed else same
        if wants.sensors > 1 and column and seen[column] == seen[0]:
            shows = out[0].shows
        out.append(Sensor(f"s{column + 1}", tuple(weights.tolist()), shows, known(1.0), Constant(0.0)))
    return tuple(out)


def _input(bodies: int, rng: Rng) -> Input:
    body = GROUND if rng.random() < 0.25 else int(rng.integers(bodies))
    return Input("u", body, known(1.0), Constant(0.0), "band-limited")


def _declared(rig: Rig, uncertain: bool, rng: Rng) -> Rig:
    """Declare some constants, with an error within their uncertainty where ``uncertain``."""

    def told(c: Constant, likely: float) -> Constant:
        if rng.random() >= likely:
            return c
        error = abs(c.true) * float(rng.uniform(0.005, 0.03))
        declared = c.true + (error * float(np.clip(rng.standard_normal(), -2, 2)) if uncertain else 0.0)
        return Constant(c.true, float(f"{declared:.6g}"), float(f"{error:.3g}"))

    masses = (rig.masses[0], *(told(m, 0.7 if uncertain else 0.15) for m in rig.masses[1:]))
    elements = [
        replace(e, stiffness=told(e.stiffness, 0.4 if uncertain else 0.1)) if e.stiffness else e for e in rig.elements
    ]
    if uncertain and not any(c.uncertainty for c in [*masses, *(e.stiffness for e in elements if e.stiffness)]):
        first = next(i for i, e in enumerate(elements) if e.stiffness)
        stiffness = elements[first].stiffness
        elements[first] = replace(elements[first], stiffness=told(stiffness, 1.0) if stiffness else None)
    return replace(rig, masses=masses, elements=tuple(elements))


def _decays(rig: Rig, count: int, number: int, rng: Rng) -> list[Record]:
    """Draw free decays after taps on one body, each weaker than the one before."""
    bodies = len(rig.masses)
    lowest = 2 * np.pi * float(rig.plant(rig.true_values()).modes_hz()[0])
    tapped = rng.integers(bodies)
    factor = float(rng.uniform(0.35, 0.8))
    out = []
    for i in range(number):
        start = np.concatenate([0.2 * rng.standard_normal(bodies) / lowest, np.zeros(bodies)])
        start[bodies + tapped] += 1.0
        out.append(Record(start * factor**i, drives.nothing(count), 0.0))
    return out


def _forced(rig: Rig, count: int, number: int, rng: Rng) -> list[Record]:
    modes = rig.plant(rig.true_values()).modes_hz() / rig.rate
    band = (float(0.4 * modes[0]), float(min(1.3 * modes[-1], 0.35)))
    kind = str(rng.choice(KINDS))
    hold = "band-limited"
    if kind == "steps" and rng.random() < 0.6:
        hold = "zero"
    elif kind in ("random", "multisine") and rng.random() < 0.25:
        hold = "first"
    factor = float(rng.uniform(0.3, 1.0))
    return [Record(np.zeros(2 * modes.size), _drive(kind, count, band, hold, rng), factor**i) for i in range(number)]


def _drive(kind: str, count: int, band: tuple[float, float], hold: str, rng: Rng) -> Drive:
    if kind in ("multisine", "random"):
        return drives.lines(kind, count, band, hold, rng)
    if kind == "sweep":
        return drives.sweep(count, band, hold)
    number = int(np.clip(count * band[0] / 8, 2, 40))
    if kind == "steps":
        return drives.steps(count, number, hold, rng)
    return drives.hammer(count, number, max(drives.SOFT, 0.15 / band[1]), rng)


def _scaled(trial: Trial, deflection: float) -> Trial:
    """Scale all recordings to a largest deflection of any body (m)."""
    rig = trial.rig
    bodies = len(rig.masses)
    weights = [tuple(np.eye(bodies)[i].tolist()) for i in range(bodies)]
    seen = tuple(Sensor(f"x{i}", w, 0, known(1.0), known(0.0)) for i, w in enumerate(weights))
    moved = recorded(replace(trial, rig=replace(rig, sensors=seen)), Altered(rig.plant(rig.true_values())))
    factor = deflection / max(float(np.max(np.abs(m))) for m in moved)
    records = tuple(replace(r, start=r.start * factor, size=r.size * factor) for r in trial.records)
    hold = trial.records[0].drive.hold
    declared = replace(rig.input, hold=hold) if rig.input else None
    return replace(trial, records=records, rig=replace(rig, input=declared))


def _with_offsets(trial: Trial, rng: Rng) -> Trial:
    """Give sensors offsets, and sometimes gains that nobody knows; the input an offset."""
    rig = trial.rig
    channels = recorded(trial, Altered(rig.plant(rig.true_values())))
    level = np.sqrt(np.mean(np.concatenate(channels) ** 2, axis=0))
    unknown_gain = len(rig.sensors) == 1 and rig.input is not None and rng.random() < 0.2
    sensors = []
    for sensor, rms in zip(rig.sensors, level, strict=True):
        offset = Constant(float(0.02 * rms * rng.standard_normal()))
        gain = Constant(float(rng.uniform(0.5, 2.0))) if unknown_gain else sensor.gain
        sensors.append(replace(sensor, offset=offset if rng.random() < 0.8 else known(0.0), gain=gain))
    declared = rig.input
    if declared:
        shift = Constant(float(0.01 * trial.records[0].size * rng.standard_normal()))
        declared = replace(declared, offset=shift if rng.random() < 0.8 else known(0.0))
    return replace(trial, rig=replace(rig, sensors=tuple(sensors), input=declared))


def _noises(trial: Trial, rng: Rng) -> tuple[Noise, ...]:
    """Draw the noise of every sensor: 40 to 66 dB below what it shows."""
    channels = recorded(trial, Altered(trial.rig.plant(trial.rig.true_values())))
    everything = np.concatenate(channels)
    level, peak = np.std(everything, axis=0), np.max(np.abs(everything), axis=0)
    share, kind = 10 ** rng.uniform(-3.3, -2.0), rng.choice(["white", "ar", "slope"], p=[0.5, 0.25, 0.25])
    quantised = rng.random() < 0.3
    out: list[Noise] = []
    for rms, largest in zip(level, peak, strict=True):
        sigma = float(share * rms * np.exp(0.3 * rng.standard_normal()))
        step = float(2.5 * largest / 2**BITS) if quantised else 0.0
        if kind == "white":
            # so much that what quantisation adds is as good as white
            out.append(Noise(max(sigma, step), step=step))
        elif kind == "ar":
            out.append(Noise(sigma, ar=float(rng.uniform(0.3, 0.95))))
        else:
            out.append(Noise(sigma, slope=float(rng.uniform(0.4, 1.2))))
    return tuple(out)
