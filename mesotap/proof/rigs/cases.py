"""Cases of a blind validation: what is concealed in which, made to a strength, and written down."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from mesotap.proof.rigs.additions import ADDITIONS, UNLISTED_ADDITIONS
from mesotap.proof.rigs.chain import CHAIN
from mesotap.proof.rigs.draw import Wants, draw_trial
from mesotap.proof.rigs.effects import Effect, Hidden
from mesotap.proof.rigs.forces import FORCES, UNLISTED_FORCES
from mesotap.proof.rigs.refit import Refit
from mesotap.proof.rigs.trial import Altered, Trial, recorded

Array = NDArray[np.float64]
KINDS = ("null", "single", "two", "excluded", "outside")
MIXTURE = ("single", "null", "single", "two", "single", "outside", "single", "null", "single", "excluded")
GRADES = (3.0, 10.0, 30.0, 100.0, 300.0)
LISTED: tuple[Effect, ...] = (*FORCES, *ADDITIONS, *CHAIN)
UNLISTED: tuple[Effect, ...] = (*UNLISTED_FORCES, *UNLISTED_ADDITIONS)
ATTEMPTS = 25  # rigs, until the effect can be that strong in one
SEARCH = 14  # strengths
NEAR = 0.03  # relative distance from the d that is asked for
RUNNING_AWAY = 5.0  # times as large as without the effect
FURTHEST = 30.0  # factor between two strengths
CLASSES = {"pendulum": "joint"}  # of components, as answers call them (diagnosis.md): the rig files' others are theirs
DECLARED_WRONG = 2  # every so many nulls have constants that are declared slightly wrong
LOADED_NULLS = 0.3  # share that has a contact with a preload


@dataclass(frozen=True, slots=True)
class Scenario:
    """A case to be made: numbers of its effects in `LISTED` or `UNLISTED`, and the size that each is to have."""

    number: int
    kind: str
    effects: tuple[int, ...]
    grade: float
    wrong: bool

    @property
    def name(self) -> str:
        """Name of the case."""
        return f"case-{self.number:04d}"


class Unreachable(Exception):
    """An effect cannot be that strong in this rig."""


def draw_scenarios(seed: int, count: int, only: str | None) -> list[Scenario]:
    """Draw what is concealed in each of ``count`` cases; effects are cycled through, and so are their sizes."""
    rng = np.random.default_rng([seed, 0xCA5E])
    orders = {kind: rng.permutation(len(UNLISTED if kind == "outside" else LISTED)) for kind in KINDS}
    grades = {kind: rng.permutation(GRADES if kind == "single" else GRADES[2:]) for kind in KINDS}
    made = dict.fromkeys(KINDS, 0)
    out = []
    for number in range(count):
        kind = only or MIXTURE[number % len(MIXTURE)]
        i, order = made[kind], orders[kind]
        made[kind] += 1
        effects: tuple[int, ...] = () if kind == "null" else (int(order[i % order.size]),)
        if kind == "two":
            effects = _pair(int(order[2 * i % order.size]), rng)
        # a cycle of sizes that moves on with every cycle of effects
        grade = float(grades[kind][(i + i // order.size) % len(grades[kind])]) if effects else 0.0
        out.append(Scenario(number, kind, effects, grade, kind == "null" and i % DECLARED_WRONG == 1))
    return out


def _pair(first: int, rng: np.random.Generator) -> tuple[int, int]:
    """Return an effect and one that the same rig can have."""
    while True:
        second = int(rng.integers(len(LISTED)))
        a, b = LISTED[first], LISTED[second]
        # the preload of one would be that of the other
        if a.id != b.id and not (a.wants.preload and b.wants.preload) and _both(a.wants, b.wants):
            return first, second


def _both(a: Wants, b: Wants) -> Wants | None:
    """What two effects need of one rig; None where they exclude each other."""
    excited = {a.excited, b.excited} - {""}
    if excited == {"free", "forced"}:
        return None
    return Wants(
        preload=a.preload or b.preload,
        excited="free" if "free" in excited else "forced" if "forced" in excited else next(iter(excited), ""),
        sensors=max(a.sensors, b.sensors),
        twins=a.twins or b.twins,
        undamped=a.undamped or b.undamped,
        shows=max(a.shows, b.shows),
        fastest=max(a.fastest, b.fastest),
    )


def make(seed: int, scenario: Scenario, folder: Path) -> dict[str, Any]:
    """Make a case, write its recordings and the description of its rig into a folder of its name, return its truth."""
    rng = np.random.default_rng([seed, 0xF0, scenario.number])
    effects = [(UNLISTED if scenario.kind == "outside" else LISTED)[i] for i in scenario.effects]
    grade = scenario.grade
    for attempt in range(1, 3 * ATTEMPTS):
        try:
            made = _concealed(effects, grade, scenario, rng)
        except Unreachable:
            # an effect that is never that strong is concealed weaker
            grade = grade if attempt % ATTEMPTS else GRADES[max(GRADES.index(grade) - 1, 0)]
            continue
        break
    else:
        made = _concealed([], 0.0, scenario, rng)
    write(folder / scenario.name, made.trial, made.channels, rng)
    return {**made.truth(scenario), "asked_d": scenario.grade}


@dataclass(frozen=True, slots=True)
class Made:
    """A trial with effects concealed in it: noise-free channels, strengths, and the size of each and of all."""

    trial: Trial
    channels: list[Array]
    hidden: tuple[Hidden, ...]
    strengths: tuple[float, ...]
    sizes: tuple[float, ...]
    d: float

    def truth(self, scenario: Scenario) -> dict[str, Any]:
        """Return what is sealed."""
        rig, first = self.trial.rig, self.trial.records[0]
        noise = self.trial.noises[0]
        told: dict[str, Any] = {
            "kind": scenario.kind,
            "kinds": [h.id for h in self.hidden],
            "components": [place for h in self.hidden for place in h.places],
            "classes": [CLASSES.get(h.component, h.component) for h in self.hidden],
            "strengths": self.strengths,
            "d": self.d,
            "d_of_each": self.sizes,
            "without": self.hidden[0].id if scenario.kind == "excluded" and self.hidden else None,
            "parameters": {h.id: dict(h.parameters(s)) for h, s in zip(self.hidden, self.strengths, strict=True)},
            "declared_wrong": scenario.wrong,
            "bodies": len(rig.masses),
            "modes_hz": rig.plant(rig.true_values()).modes_hz().tolist(),
            "rate_hz": rig.rate,
            "samples": [r.count for r in self.trial.records],
            "input": first.drive.kind,
            "on_base": rig.input is not None and rig.input.body < 0,
            "hold": first.drive.hold,
            "shows": [s.shows for s in rig.sensors],
            "noise": {"sigma": noise.sigma, "ar": noise.ar, "slope": noise.slope, "step": noise.step},
            "constants": {f"{name} {i}": value for (name, i), value in rig.true_values().items()},
        }
        if len(rig.sensors) == 1:
            told["knowing_rms"] = noise.rms(first.count)
        return told


def _concealed(
    effects: Sequence[Effect], grade: float, scenario: Scenario, rng: np.random.Generator
) -> Made:  # fmt: skip
    """Draw a rig and conceal the effects in it, each of a size ``grade``."""
    wants = Wants(preload=not effects and rng.random() < LOADED_NULLS, uncertain=scenario.wrong)
    for i, effect in enumerate(effects):
        joint = _both(wants, effect.wants) if i else effect.wants
        if joint is None:
            raise Unreachable
        wants = joint
    trial = draw_trial(wants, rng)
    hidden = tuple(_drawn(effect, trial, rng) for effect in effects)
    if sum(h.jumps for h in hidden) > 1:
        raise Unreachable
    linear = Altered(trial.rig.plant(trial.rig.true_values()))
    if not hidden:
        trial = _loaded_at_random(trial, rng) if wants.preload else trial
        return Made(trial, recorded(trial, linear), (), (), (), 0.0)
    refit = Refit(trial)
    found = [_strength(trial, refit, linear, h, grade) for h in hidden]
    altered = linear
    for h, (s, _) in zip(hidden, found, strict=True):
        altered = h.add(altered, s)
        trial = _loaded(trial, h, s)
    channels = recorded(trial, altered)
    strengths, sizes = tuple(s for s, _ in found), tuple(d for _, d in found)
    return Made(trial, channels, hidden, strengths, sizes, refit(channels).d if len(hidden) > 1 else sizes[0])


def _drawn(effect: Effect, trial: Trial, rng: np.random.Generator) -> Hidden:
    found = effect.draw(trial, rng)
    if found is None:
        raise Unreachable
    return found


def _loaded(trial: Trial, hidden: Hidden, strength: float) -> Trial:
    """Return the trial with the preload declared that the effect needs."""
    if hidden.preload is None:
        return trial
    number, load = hidden.preload
    elements = list(trial.rig.elements)
    elements[number] = replace(elements[number], preload=float(f"{load(strength):.8g}"))
    return replace(trial, rig=replace(trial.rig, elements=tuple(elements)))


def _loaded_at_random(trial: Trial, rng: np.random.Generator) -> Trial:
    """Return a null with a contact under a preload that is far above the force in it."""
    from mesotap.proof.rigs.effects import scale_of

    number = next(i for i, e in enumerate(trial.rig.elements) if e.section == "contact")
    load = scale_of(trial, number).f * float(rng.uniform(1.5, 5.0))
    elements = list(trial.rig.elements)
    elements[number] = replace(elements[number], preload=float(f"{load:.6g}"))
    return replace(trial, rig=replace(trial.rig, elements=tuple(elements)))


def size_of(
    trial: Trial, refit: Refit, linear: Altered, hidden: Hidden, strength: float, followed: bool = True
) -> float:
    """Return d of an effect at a strength; infinite where it lets the rig run away. See `Refit` for ``followed``."""
    with np.errstate(over="ignore", invalid="ignore"):
        channels = recorded(trial, hidden.add(linear, strength))
    loudest = max(float(np.max(np.abs(c))) for c in channels)
    usual = max(float(np.max(np.abs(c))) for c in recorded(trial, linear))
    return refit(channels, followed).d if loudest < RUNNING_AWAY * usual else math.inf


def _strength(trial: Trial, refit: Refit, linear: Altered, hidden: Hidden, d: float) -> tuple[float, float]:
    """Return the strength at which an effect has the size ``d``, and its size there, by secants of the logarithms."""
    s = min(hidden.start, 0.5 * hidden.most)
    low, high = 0.0, math.inf
    earlier: tuple[float, float] | None = None
    followed = False
    for _ in range(SEARCH):
        found = size_of(trial, refit, linear, hidden, s, followed)
        if abs(found / d - 1) < NEAR and not followed:
            found, followed = size_of(trial, refit, linear, hidden, s), True
        if abs(found / d - 1) < NEAR:
            return s, found
        low, high = (s, high) if found < d else (low, s)
        if low >= hidden.most:
            raise Unreachable
        power = 1.0
        if earlier and found > 0 and math.isfinite(found) and abs(math.log(earlier[0] / s)) > 1e-6:
            power = math.log(earlier[1] / found) / math.log(earlier[0] / s)
        factor = (
            (d / found) ** (1 / min(max(power, 0.4), 4.0))
            if 0 < found < math.inf
            else (FURTHEST if found == 0 else 0.1)
        )
        if 0 < found < math.inf:
            earlier = (s, found)
        s = min(s * min(max(factor, 1 / FURTHEST), FURTHEST), hidden.most)
        if low > 0 and math.isfinite(high) and not low < s < high:
            s = math.sqrt(low * high)
    raise Unreachable


def write(folder: Path, trial: Trial, channels: Sequence[Array], rng: np.random.Generator) -> None:
    """Write ``rig.yaml`` and one ``recording-N.csv`` for each recording, with noise, into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    rig = trial.rig
    (folder / "rig.yaml").write_text(yaml.safe_dump(rig.described(), sort_keys=False), encoding="utf-8")
    for number, (record, clean) in enumerate(zip(trial.records, channels, strict=True), start=1):
        columns, names = [np.arange(record.count) / rig.rate], ["time"]
        if rig.input:
            told = record.size * record.drive.samples() / rig.input.gain.true - rig.input.offset.true
            columns.append(told)
            names.append(rig.input.channel)
        for i, (sensor, noise) in enumerate(zip(rig.sensors, trial.noises, strict=True)):
            x = clean[:, i] + noise.draw(record.count, rng)
            columns.append(np.round(x / noise.step) * noise.step if noise.step else x)
            names.append(sensor.channel)
        table = np.stack(columns, axis=1)
        np.savetxt(
            folder / f"recording-{number}.csv", table, "%.10g", delimiter=",", header=",".join(names), comments=""
        )
