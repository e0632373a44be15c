"""From a diagnosis to a configuration: the simulated rig becomes the twin of the one that was diagnosed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from analysis.mismatch.answer import LOAD_CELL, TESTER
from daq.errors import RecordingError, one_line
from daq.json_text import GivenTwice, parsed_once
from daq.regular import read_regular
from mesotap.configuration.config import Config, ConfigError, effective_text, validated
from mesotap.configuration.yaml_text import sentence
from sim_backend.arrangement import LOWER, UPPER

FORMAT, VERSIONS = "mesotap-diagnosis", (1, 2)
FITTED = {1: "adopted", 2: "fitted"}  # key of the fitted rig, by version
CONSTANTS = ("m1", "m2", "k1", "k2")
LARGEST_FILE = 1 << 24  # bytes; a diagnosis has a few thousand


@dataclass(frozen=True, slots=True)
class AdoptedLoad:
    """Contact at one load as the diagnosis fitted it: mN, N/m, damping ratio."""

    load_mn: float
    stiffness_n_per_m: float
    damping_ratio: float


@dataclass(frozen=True, slots=True)
class AdoptedModel:
    """What of a diagnosis a model needs.

    Attributes
    ----------
    mechanisms
        Values of each by its id: the fitted ones and those that stayed fixed.
    loads
        Contact at each load, ascending; empty where the file has none.
    rig
        m1, m2 (kg), k1, k2 (N/m) as fitted, by name; empty where the file has none.
    off
        Declared uncertainties by which the fit moved some of them far.
    at
        Body that a mechanism acts on, by its id, of those that the diagnosis found on one of several.
    """

    source: str
    mechanisms: dict[str, dict[str, float]]
    loads: tuple[AdoptedLoad, ...]
    rig: dict[str, float]
    off: dict[str, float] = field(default_factory=dict)
    at: dict[str, str] = field(default_factory=dict)


def read_diagnosis(path: Path) -> AdoptedModel:
    """Read what is adopted from the JSON of a diagnosis.

    Raises
    ------
    RecordingError
        A sentence: the file is none, or names nothing that could be adopted.
    """
    content = diagnosis_in(path)
    if _version(content) == 2 and content.get("rig") != TESTER:
        raise RecordingError(f"{path}: is of another rig than the {TESTER}, which alone can be simulated with it")
    try:
        acting = [m for m in content["mechanisms"] if m.get("where") != LOAD_CELL]
        if any(m.get("learned") for m in acting):
            raise RecordingError(
                f"{path}: holds a law that was learned, which has no name yet: keep it with 'mesotap learn {path} "
                "--name NAME', name its folder in the configuration, diagnose the session again and adopt that answer"
            )
        found = {
            str(m["id"]): {k: finite_number(v["value"]) for k, v in m["parameters"].items()}
            | {k: finite_number(v) for k, v in m.get("fixed", {}).items()}
            for m in acting
        }
        at = {str(m["id"]): str(m["element"]) for m in acting if m.get("element") in (UPPER, LOWER)}
        augmented = content.get(FITTED[content["version"]]) or {"loads": [], "rig": {}}
        loads = [_load(entry) for entry in augmented["loads"]]
        rig = {name: finite_number(known["value"]) for name, known in augmented["rig"].items()}
        off = {str(name): finite_number(by) for name, by in augmented.get("off_declared", {}).items()}
    except RecordingError:
        raise
    except (LookupError, TypeError, AttributeError, ValueError, OverflowError) as error:
        what = f"{FORMAT} {content['version']} ({type(error).__name__}: {error})"
        raise RecordingError(f"{path}: is not a complete {what}") from error
    if len(found) < len(acting):
        twice = next(name for name, count in Counter(str(m["id"]) for m in acting).items() if count > 1)
        raise RecordingError(f"{path}: names {one_line(twice)} twice; diagnose the session again")
    _refuse_impossible(loads, path)
    if not found:
        raise RecordingError(
            f"{path}: names no mechanism that acts in a ring-down (verdict {content.get('verdict')!r}), so there is "
            "nothing to adopt"
        )
    return AdoptedModel(str(path), found, tuple(sorted(loads, key=lambda p: p.load_mn)), rig, off, at)


def diagnosis_in(path: Path) -> dict[str, Any]:
    """Return the JSON of a diagnosis, of either version.

    Raises
    ------
    RecordingError
        A sentence: the file is none.
    """
    try:
        content = parsed_once(read_regular(path, LARGEST_FILE, "a diagnosis"))
    except RecordingError:
        raise
    except GivenTwice as error:
        raise RecordingError(f"{path}: {error}; it is ambiguous which one counts") from error
    except (ValueError, RecursionError) as error:
        raise RecordingError(f"{path}: is not JSON") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT or _version(content) is None:
        raise RecordingError(f"{path}: is not a {FORMAT} 1 or 2")
    return content


def _version(content: Mapping[str, Any]) -> int | None:
    """Return the version of the contract; None where it is none that can be read."""
    version = content.get("version")
    return version if version in VERSIONS and isinstance(version, int) and not isinstance(version, bool) else None


def _refuse_impossible(loads: Sequence[AdoptedLoad], path: Path) -> None:
    """Refuse loads of which no diagnosis tells: none at all or less, or one twice."""
    for load, count in Counter(p.load_mn for p in loads).items():
        if load <= 0:
            raise RecordingError(f"{path}: tells of a load of {load:g} mN, and loads are above 0; diagnose again")
        if count > 1:
            raise RecordingError(f"{path}: tells of the load {load:g} mN twice; diagnose the session again")


def finite_number(value: Any) -> float:
    """Return a number of a file.

    Raises
    ------
    ValueError
        It is none, or not finite.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{value!r} is not a number")
    return float(value)


def _load(entry: Mapping[str, Any]) -> AdoptedLoad:
    return AdoptedLoad(
        finite_number(entry["load_mn"]),
        finite_number(entry["contact_stiffness_n_per_m"]["value"]),
        finite_number(entry["damping_ratio"]["value"]),
    )


TUBE_MODE_MASS = "mt"  # constant of a fitted rig; see `analysis.mismatch.ring_downs.sessions`


def with_model(config: Config, model: AdoptedModel) -> Config:
    """Return a configuration whose simulated rig has the mechanisms, and contact and springs as they were fitted.

    The load plan becomes that of the diagnosed session, as far as the rig's limit allows.

    Raises
    ------
    ConfigError
        A mechanism that is none, or a value out of its range; a sentence each.
    """
    content = config.model_dump(mode="json")
    simulated = content["sim_backend"]
    simulated["mechanisms"] = [{"id": k, "at": model.at.get(k), "parameters": v} for k, v in model.mechanisms.items()]
    # the fitted model has no scatter from impact to impact, no dampers beside the springs
    scatter = {"stiffness_scatter_percent": 0.0, "damping_scatter_percent": 0.0}
    simulated["contact"] |= scatter
    simulated |= {"parameter_errors": False, "tube_damping_ratio": 0.0}
    loads = _distinct(model.loads)
    if len(loads) > 1:
        simulated["contact"] |= {
            "stiffness": "table",
            "load_mn": [p.load_mn for p in loads],
            "contact_stiffness_n_per_um": [1e-6 * p.stiffness_n_per_m for p in loads],
            "damping_ratio": [p.damping_ratio for p in loads],
        }
        most = config.rig.limits.load_mn - config.mesotap.load_tolerance_mn
        plan = [p.load_mn for p in loads if p.load_mn <= most]
        content["mesotap"]["load_plan_mn"] = plan or content["mesotap"]["load_plan_mn"]
    if set(CONSTANTS) <= set(model.rig):
        m1, m2, k1, k2 = (model.rig[name] for name in CONSTANTS)
        # fitted without what rides on the blocks as the tubes' own mode; declared without anything of the tubes
        inertia = config.rig.springs.inertia()
        tubes = 0.0 if inertia is None else inertia.added_kg - model.rig.get(TUBE_MODE_MASS, 0.0)
        content["rig"]["masses"] |= {"m1_kg": m1 - tubes, "m2_kg": m2 - tubes}
        content["rig"]["springs"] |= {"system_resonance_hz": None, "k1_n_per_m": k1, "k2_n_per_m": k2}
    try:
        return validated(content)
    except ValidationError as error:
        said = "; ".join(sentence(fault, Config) for fault in error.errors())
        raise ConfigError(f"{model.source}: {said}") from error


def _distinct(loads: tuple[AdoptedLoad, ...]) -> list[AdoptedLoad]:
    """Leave out loads that another one before is too close to, and those with a damping that no table can hold."""
    kept: list[AdoptedLoad] = []
    for load in loads:
        apart = not kept or load.load_mn > 1.001 * kept[-1].load_mn
        if apart and load.load_mn > 0 and load.stiffness_n_per_m > 0 and load.damping_ratio > 0:
            kept.append(load)
    return kept


def write_adopted(path: Path, config: Config) -> None:
    """Write a configuration to a new file.

    Raises
    ------
    ConfigError
        The file is there already.
    """
    try:
        with path.open("x", encoding="utf-8") as new:
            new.write(effective_text(config))
    except FileExistsError:
        raise ConfigError(f"{path}: exists already and is left as it is; name another with --output") from None
