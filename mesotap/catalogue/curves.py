"""k_c and zeta over load of a session, each number with the sources of its uncertainty, and which of them others share.

Two sessions of one tester have the same masses, springs, weights and recorder: by how much these are off is the same in
both, and cancels in a ratio. Which they share is what their configurations say alike.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calibration.budget import Budget, Contribution
from daq.errors import RecordingError
from mesotap.catalogue.answers_beside import read_answer, result_files
from mesotap.configuration.config import Config

SHARED: dict[str, tuple[str, ...]] = {
    "mass m1": ("rig.masses", "rig.springs"),
    "mass m2": ("rig.masses", "rig.springs"),
    "what both masses have in common": ("rig.masses", "rig.springs"),
    "tube spring k1": ("rig.springs",),
    "tube spring k2": ("rig.springs",),
    "how the tube springs' sum splits": ("rig.springs",),
    "clock of the recorder": ("rig.wiring", "rig.parts"),
    "local gravity": ("calibration",),
    "buoyancy of the air": ("calibration",),
    "weights, each by itself": ("calibration",),
}
"""Sources that two sessions share if these parts of their configurations are alike, by how the source's name begins."""

OF_SESSION = ("f1, for the tube springs", "scatter of the calibration's readings", "drift of the", "hysteresis")
"""Sources that all loads of one session share, by how their names begin; any other is of one load alone."""

STIFFNESS, DAMPING = "contact_stiffness_n_per_m", "zeta2"
QUANTITIES = (STIFFNESS, DAMPING)
SLOPE_UNSURE = 0.5
"""Standard uncertainty of d ln k_c / d ln P between two neighbouring loads, and relative one of d zeta / d ln P: the
slopes between neighbouring loads of the paper's Table 5 have a standard deviation of 0.43."""

USUAL_SLOPE = 0.6  # d ln k_c / d ln P of a session of one load: between Hertz (1/3) and a rough surface (up to 1)


@dataclass(frozen=True, slots=True)
class Point:
    """One number at one load: ``parts`` are its sources, by what identifies each; ``value`` is ln k_c, or zeta."""

    load_mn: float
    target_mn: float
    value: float
    parts: dict[str, Contribution]
    slope: float
    load_half_mn: float = 0.0


@dataclass(frozen=True, slots=True)
class Curve:
    """One quantity of a session over load, in ascending order of load."""

    quantity: str
    points: tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class Compared:
    """A session as it is compared: its name, the curves, whether its gauge drifted, scatter of its taps."""

    name: str
    path: str
    curves: dict[str, Curve]
    drifted: bool
    taps: dict[str, list[float]]
    loads: list[dict[str, Any]]


def read_compared(session: Path, config: Config, name: str = "") -> Compared:
    """Return a session with its results, which are read where they lie beside it.

    Parameters
    ----------
    config
        That the session was run with.

    Raises
    ------
    RecordingError
        It has no results, or they hold nothing to compare.
    """
    files = result_files(session)
    if not files:
        raise RecordingError(f"{session}: has no results yet; 'mesotap report {session}' makes them")
    return compared_from(read_answer(files[0], "the results of a session"), config, str(session), name or session.name)


def compared_from(results: dict[str, Any], config: Config, path: str, name: str) -> Compared:
    """Return a session from its results as JSON; raises as `read_compared`."""
    digests = {part: _digest(config, part) for parts in SHARED.values() for part in parts}
    try:
        curves = {quantity: _curve(results, quantity, path, digests) for quantity in QUANTITIES}
        taps = {quantity: _tap_scatter(results, quantity) for quantity in QUANTITIES}
        drifted = bool((results.get("calibration") or {}).get("drifted"))
        loads = [load for load in results["loads"] if load["load_mn"] and load[STIFFNESS] and load[DAMPING]]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise RecordingError(f"{path}: its results.json is not the results of a session") from error
    if not any(curve.points for curve in curves.values()):
        raise RecordingError(f"{path}: its results hold no load with a contact stiffness and a budget of it")
    return Compared(name, path, curves, drifted, taps, loads)


def merged(points: Sequence[tuple[float, Point]], value: float, quantity: str) -> Budget:
    """Return the budget of a weighted sum of points, what they share counted once.

    Parameters
    ----------
    points
        Weight and point.
    value
        Of the sum.
    """
    found: dict[str, Contribution] = {}
    for weight, point in points:
        for key, part in point.parts.items():
            before = found.get(key)
            add = weight * part.sensitivity
            found[key] = replace(part, sensitivity=add) if before is None else _added(before, part, add)
    return Budget(quantity, "1", value, tuple(found.values()))


def _added(before: Contribution, part: Contribution, add: float) -> Contribution:
    """Add the effect of the same source; where its size was stated otherwise, by that size."""
    scale = part.standard_uncertainty / before.standard_uncertainty if before.standard_uncertainty > 0 else 1.0
    return replace(before, sensitivity=before.sensitivity + add * scale)


def _curve(results: dict[str, Any], quantity: str, path: str, digests: dict[str, str]) -> Curve:
    usable = [
        load
        for load in results["loads"]
        if load["load_mn"] and load[quantity] and load["load_mn"]["value"] > 0 and "load_mn" in load.get("budgets", {})
        and quantity in load["budgets"] and (quantity != STIFFNESS or load[quantity]["value"] > 0)
    ]  # fmt: skip
    usable.sort(key=lambda load: load["load_mn"]["value"])
    logs = np.log([load["load_mn"]["value"] for load in usable])
    values = np.array([_scaled(load[quantity]["value"], quantity) for load in usable])
    slopes = _slopes(logs, values, quantity)
    return Curve(
        quantity,
        tuple(_point(load, quantity, v, s, path, digests) for load, v, s in zip(usable, values, slopes, strict=True)),
    )


def _scaled(value: float, quantity: str) -> float:
    return math.log(value) if quantity == STIFFNESS else float(value)


def _slopes(logs: Any, values: Any, quantity: str) -> list[float]:
    if len(logs) < 2 or np.min(np.diff(logs)) <= 0:
        return [USUAL_SLOPE if quantity == STIFFNESS else 0.0] * len(logs)
    return [float(s) for s in np.gradient(values, logs)]


def _point(
    load: dict[str, Any], quantity: str, value: float, slope: float, path: str, digests: dict[str, str]
) -> Point:
    number, target = load["load_set"], load.get("target_load_mn") or load["load_mn"]["value"]
    own, of_load = load["budgets"][quantity], load["budgets"]["load_mn"]
    per = 1 / load[quantity]["value"] if quantity == STIFFNESS else 1.0
    parts = {}
    for said, factor, of in ((own, per, ""), (of_load, -slope / load["load_mn"]["value"], "load: ")):
        for part in said["contributions"]:
            key = f"{of}{part['source']} @ {_scope(part['source'], path, number, digests)}"
            made = _contribution(part, factor)
            if made.standard_uncertainty > 0:
                parts[key] = made
    half = (load["load_mn"]["high"] - load["load_mn"]["low"]) / 2
    return Point(load["load_mn"]["value"], float(target), float(value), parts, slope, half)


def _contribution(part: dict[str, Any], factor: float) -> Contribution:
    dof = part["degrees_of_freedom"]
    return Contribution(
        part["source"],
        math.nan,
        part["input_unit"],
        float(part["input_standard_uncertainty"]),
        factor * float(part["sensitivity"]),
        math.inf if dof is None else float(dof),
        part["distribution"],
    )


def _scope(source: str, path: str, load_set: int, digests: dict[str, str]) -> str:
    for name, parts in SHARED.items():
        if source.startswith(name):
            return " ".join(digests[part] for part in parts)
    return path if source.startswith(OF_SESSION) else f"{path} {load_set}"


def _digest(config: Config, part: str) -> str:
    said: Any = config.model_dump(mode="json")
    for name in part.split("."):
        said = said[name]
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()[:12]


def _tap_scatter(results: dict[str, Any], quantity: str) -> list[float]:
    """Relative variance of the accepted taps of each load that has several."""
    by_load: dict[int, list[float]] = {}
    for impact in results.get("impacts") or ():
        if impact["accepted"] and impact.get(quantity):
            by_load.setdefault(impact["load_set"], []).append(impact[quantity]["value"])
    several = [values for values in by_load.values() if len(values) > 1 and np.mean(values) > 0]
    return [float(np.var(values, ddof=1) / np.mean(values) ** 2) for values in several]
