"""A learned law of a diagnosis as a mechanism's file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from daq.errors import RecordingError, one_line
from mesotap.answers.adoption import FORMAT, diagnosis_in, finite_number
from sim_backend.arrangement import Arrangement
from sim_backend.learned.families import form_named
from sim_backend.learned.forms import FORM
from sim_backend.mechanisms.catalogue import catalogue, variants
from sim_backend.mechanisms.conformance import benches, effect
from sim_backend.mechanisms.kinds import ForceLaw, Mechanism

NAME = re.compile(r"[a-z][a-z0-9_]{1,60}")
WIDER = 1.5  # times the interval: how far a further fit may move what is no strength
STRONGER = 1e3  # times the value: how far it may move the strength
THE_SAME = 1e-3  # of a listed law's force along a motion: what is nearer is that law


@dataclass(frozen=True, slots=True)
class KeptLaw:
    """A learned law as it is kept.

    Attributes
    ----------
    element
        Name of the element in its rig; None of a channel's or body's law.
    values, free
        All numbers, and the ranges of those that stay free.
    files
        SHA-256 of each recording, by name.
    """

    family: str
    component: str
    element: str | None
    formula: str
    values: Mapping[str, float]
    free: Mapping[str, tuple[float, float]]
    files: Mapping[str, str]
    software: str


def read_law(path: Path) -> KeptLaw:
    """Read the learned law of a diagnosis.

    Raises
    ------
    RecordingError
        A sentence: the file is no diagnosis, or none that learned a law with a formula or a curve.
    """
    content = diagnosis_in(path)
    if content["version"] != 2:
        raise RecordingError(f"{path}: is not a {FORMAT} 2, which alone tells of learned laws")
    try:
        learned = [m for m in content["mechanisms"] if m["learned"]]
        if not learned:
            said = one_line(str(content.get("verdict")))
            raise RecordingError(f"{path}: no law was learned (verdict {said!r}), so there is nothing to keep")
        if not learned[0]["law"]["formulas"] and "curve" not in learned[0]["law"]:
            raise RecordingError(
                f"{path}: its law has no formula that loses nothing against a force of any shape, so it cannot be kept "
                "as one; record more impacts of different strength"
            )
        return _kept(content, learned[0])
    except RecordingError:
        raise
    except (LookupError, TypeError, AttributeError, ValueError, OverflowError) as error:
        what = f"{FORMAT} 2 ({type(error).__name__}: {error})"
        raise RecordingError(f"{path}: is not a complete {what}") from error


def _kept(content: Mapping[str, Any], m: Mapping[str, Any]) -> KeptLaw:
    formula = m["law"]["formulas"][0] if m["law"]["formulas"] else _curve(m)
    form = form_named(str(formula["family"]))
    values = {str(k): finite_number(v) for k, v in formula["values"].items()}
    base = form.mechanisms[0]
    free = {}
    for name, known in formula["parameters"].items():
        value, low, high = (finite_number(known[k]) for k in ("value", "low", "high"))
        values[name] = value
        middle, half = (low + high) / 2, WIDER * (high - low) / 2
        if name == base.strength:
            free[name] = (0.0, STRONGER * value) if value > 0 else (STRONGER * value, 0.0)
        else:
            free[name] = (middle - half, middle + half)
    files = {Path(one_line(str(r["file"]))).name: one_line(str(r["sha256"])) for r in content["recordings"]}
    element = None if m["element"] is None else str(m["element"])
    software = one_line(str(content["software"]["mesotap"]))
    return KeptLaw(form.key, str(m["where"]), element, one_line(str(formula["text"])), values, free, files, software)


def _curve(m: Mapping[str, Any]) -> dict[str, Any]:
    """Return a learned curve as a formula all of whose numbers stay as they are."""
    values = {**m["fixed"], **{name: known["value"] for name, known in m["parameters"].items()}}
    form, own = form_named(str(m["law"]["curve"])), {k: v for k, v in values.items() if k != FORM}
    return {"family": form.key, "text": form.name, "parameters": {}, "values": own}


def file_text(law: KeptLaw, name: str, rig: Arrangement) -> str:
    """Return the Python file of a kept law.

    Parameters
    ----------
    rig
        In which it was learned.

    Raises
    ------
    RecordingError
        The name is none for a mechanism, or is taken.
    """
    if not NAME.fullmatch(name):
        raise RecordingError(f"{one_line(name)!r}: a name has small letters, digits and _, and begins with a letter")
    if name in catalogue():
        raise RecordingError(f"{name!r} is a mechanism's name already; choose another with --name")
    element = next((e for e in rig.elements if law.element in (e.name, e.alike)), None)
    is_force = isinstance(form_named(law.family).mechanisms[0], ForceLaw)
    if is_force and element is None:
        raise RecordingError(f"the rig has no element {law.element!r}: give the rig it was learned in with --rig")
    acts_in = element.role if is_force and element is not None else None
    preloaded = bool(is_force and element is not None and element.preload)
    lines = [
        f'"""A law learned by mesotap {law.software}: {law.formula}."""',
        "",
        "from sim_backend.learned.kept import kept_law",
        "",
        "MECHANISM = kept_law(",
        f"    {name!r},",
        f"    {law.family!r},",
        f"    acts_in={acts_in!r},",
        f"    preloaded={preloaded!r},",
        f"    component={law.component!r},",
        *_mapping("values", {k: repr(v) for k, v in law.values.items()}),
        *_mapping("free", {k: repr(v) for k, v in law.free.items()}),
        *_mapping("learned_from", {k: repr(v) for k, v in law.files.items()}),
        ")",
        "",
    ]
    return "\n".join(lines)


def _mapping(name: str, content: Mapping[str, str]) -> list[str]:
    return [f"    {name}={{", *(f"        {k!r}: {v}," for k, v in content.items()), "    },"]


def listed_twin(law: Mechanism) -> str | None:
    """Return the id of a listed mechanism that is the same law; None where there is none.

    Both are moved along a sine; the listed one has one number only, which is scaled to fit best.
    """
    if not isinstance(law, ForceLaw):
        return None
    for bench in benches():
        for place in law.places(bench.rig)[:1]:
            own = effect(law, law.trials(bench.scale)[0], bench, place)
            for other in variants(catalogue()):
                if not isinstance(other, ForceLaw) or place not in other.places(bench.rig) or other.hidden:
                    continue
                if len(other.parameters) == 1 and _same(own, effect(other, other.trials(bench.scale)[0], bench, place)):
                    return other.id
    return None


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return size > 0 and abs(abs(float(a @ b)) / size - 1) < THE_SAME**2
