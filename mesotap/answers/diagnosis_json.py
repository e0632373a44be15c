"""A diagnosis as other programs read it: the contract ``mesotap-diagnosis``, versions 1 and 2."""

from __future__ import annotations

import hashlib
import math
import sys
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any, Literal

from analysis.mismatch.answer import (
    TESTER,
    Answer,
    FitSummary,
    FittedRig,
    Formula,
    Interval,
    Law,
    LawTable,
    Location,
    Named,
    NextExperiment,
    Remainder,
)
from mesotap import __version__

FORMAT = "mesotap-diagnosis"
CATALOGUE = "sim_backend.mechanisms"
Version = Literal[1, 2]


def diagnosis_json(answer: Answer, seconds: float, version: Version = 2) -> dict[str, Any]:
    """Return an answer as a mapping of finite numbers, text and None.

    Parameters
    ----------
    seconds
        That the diagnosis took.
    version
        Of the contract; 1 can say what the two-mass tester's answers say, and no learned law.

    Raises
    ------
    ValueError
        Version 1 of another rig's answer.
    """
    if version == 2:
        return _version_2(answer, seconds)
    if answer.rig != TESTER:
        raise ValueError("--contract 1 is for the two-mass tester; leave it out for a described rig")
    return _version_1(answer, seconds)


@cache
def catalogue_sha256() -> str:
    """Return the SHA-256 over names and contents of all files that describe mechanisms."""
    digest = hashlib.sha256()
    for name, content in sorted(_sources(files(CATALOGUE), "")):
        digest.update(name.encode() + b"\0" + hashlib.sha256(content).digest())
    return digest.hexdigest()


def _sources(folder: Traversable, within: str) -> list[tuple[str, bytes]]:
    found = []
    for entry in folder.iterdir():
        if entry.is_dir() and entry.name != "__pycache__":
            found += _sources(entry, f"{within}{entry.name}/")
        elif entry.name.endswith(".py"):
            found.append((within + entry.name, entry.read_bytes()))
    return found


def _version_2(answer: Answer, seconds: float) -> dict[str, Any]:
    said: dict[str, Any] = {
        "format": FORMAT,
        "version": 2,
        "recordings": [{"file": r.file, "sha256": r.sha256} for r in answer.recordings],
        "rig": answer.rig,
        "verdict": answer.verdict,
        "p_value": answer.p_value,
        "mechanisms": [
            {
                **_mechanism(m),
                "learned": m.learned,
                "element": m.element,
                "law": None if m.law is None else _law(m.law),
            }
            for m in answer.mechanisms
        ],
        "complete_probability": answer.complete_probability,
        "remainder": _remainder(answer.remainder),
        "upper_limits": [
            {"id": u.id, "parameter": u.parameter, "value": u.value, "unit": u.unit, "probability": u.probability}
            for u in answer.upper_limits
        ],
        "rivals": [
            {"ids": list(r.ids), "probability": r.probability, "heldout_rms": _number(r.heldout_rms), "why": r.why}
            for r in answer.rivals
        ],
        "location": _location(answer.location),
        "fit": _fit(answer.fit, answer.far_off),
        "next_experiment": _next(answer.next_experiment),
        "software": {"mesotap": __version__, "catalogue_sha256": catalogue_sha256()},
        "seconds": seconds,
        "fitted": None if answer.fitted is None else _fitted(answer.fitted),
    }
    if answer.worse_than_zero:
        said["fit"]["worse_than_zero"] = answer.worse_than_zero
    if answer.set_aside:
        said["set_aside"] = [{"segment": a.name, "group": a.group, "statement": a.statement} for a in answer.set_aside]
    if answer.decay:
        said["decay"] = [
            {
                "time_s": p.time_s,
                "amplitude": p.amplitude,
                "frequency_hz": p.frequency_hz,
                "damping_ratio": p.damping_ratio,
            }
            for p in answer.decay
        ]
    return said


def _mechanism(m: Named) -> dict[str, Any]:
    """Return what both versions say of a mechanism."""
    return {
        "id": m.id,
        "probability": m.probability,
        "where": m.where,
        "statement": m.statement,
        "parameters": {k: {**_interval(v), "unit": v.unit} for k, v in m.parameters.items()},
        "indistinguishable_from": list(m.indistinguishable_from),
        "fixed": dict(m.fixed),
    }


def _interval(v: Interval) -> dict[str, float]:
    """Return value and ends; an end that the data leave open becomes the largest number that JSON readers take."""
    low = v.low if math.isfinite(v.low) else -sys.float_info.max
    high = v.high if math.isfinite(v.high) else sys.float_info.max
    return {"value": v.value, "low": low, "high": high}


def _law(law: Law) -> dict[str, Any]:
    return {
        "kind": law.kind,
        "symmetry": law.symmetry,
        "conservative": law.conservative,
        "exponents": {k: None if v is None else _interval(v) for k, v in law.exponents.items()},
        "formulas": [_formula(f) for f in law.formulas],
        "valid": {k: list(v) for k, v in law.valid.items()},
        "table": None if law.table is None else _table(law.table),
        **({"curve": law.curve} if law.curve else {}),
    }


def _formula(formula: Formula) -> dict[str, Any]:
    parameters = {k: {**_interval(v), "unit": v.unit} for k, v in formula.parameters.items()}
    own = {"family": formula.family, "values": dict(formula.values)} if formula.family else {}
    return {"text": formula.text, "parameters": parameters, "evidence": formula.evidence, **own}


def _table(table: LawTable) -> dict[str, Any]:
    return {
        "axes": {k: v.tolist() for k, v in table.axes.items()},
        "force_n": table.force_n.tolist(),
        "low": table.low.tolist(),
        "high": table.high.tolist(),
    }


def _remainder(left: Remainder) -> dict[str, Any]:
    return {
        "share": left.share,
        "chi_squared": left.chi_squared,
        "p_value": left.p_value,
        "where": _location(left.where),
        "statement": left.statement,
    }


def _location(found: Location | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "component": found.component,
        "element": found.element,
        "channels": list(found.channels),
        "time_s": list(found.time_s),
        "frequency_hz": list(found.frequency_hz),
        "groups": list(found.groups),
        "why": found.why,
    }


def _fit(fit: FitSummary, far_off: bool) -> dict[str, Any]:
    said: dict[str, Any] = {
        "unit": fit.unit,
        "noise_rms": fit.noise_rms,
        "heldout_rms_before": _number(fit.heldout_rms_before) or 0.0,
        "heldout_rms_after": _number(fit.heldout_rms_after),
        "heldout_segments": fit.heldout_segments,
        "segments": fit.segments,
        "groups": fit.groups,
        "far_off": far_off,
    }
    if fit.channels:
        said["channels"] = [
            {
                "channel": c.channel,
                "unit": c.unit,
                "noise_rms": c.noise_rms,
                "heldout_rms_before": _number(c.heldout_rms_before),
                "heldout_rms_after": _number(c.heldout_rms_after),
                "heldout_over_noise": c.heldout_over_noise,
            }
            for c in fit.channels
        ]
    if fit.stretches:
        said["stretches"] = {
            k: {"before": _number(before), "after": _number(after)} for k, (before, after) in fit.stretches.items()
        }
    if fit.steady_error is not None:
        before, after = fit.steady_error
        said["steady_relative_error_before"], said["steady_relative_error_after"] = _number(before), _number(after)
    return said


def _next(found: NextExperiment | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "load_mn": None if found.load_n is None else 1e3 * found.load_n,
        "peak_force_ratio": found.peak_force_ratio,
        "separates": list(found.separates),
        "why": found.why,
        "moves": list(found.moves),
    }


def _fitted(fitted: FittedRig) -> dict[str, Any]:
    found = {"rig": _constants(fitted), "loads": _contact(fitted), "off_declared": dict(fitted.off)}
    return found | ({"also": [dict(one) for one in fitted.also]} if fitted.also else {})


def _constants(fitted: FittedRig) -> dict[str, Any]:
    return {
        k: {"value": v.value, "low": _number(v.low), "high": _number(v.high), "unit": v.unit}
        for k, v in fitted.constants.items()
    }


def _contact(fitted: FittedRig) -> list[dict[str, Any]]:
    return [
        {
            "load_mn": 1e3 * c.load_n,
            "contact_stiffness_n_per_m": c.stiffness.as_json(),
            "contact_damping_n_s_per_m": c.damping.as_json(),
            "damping_ratio": c.damping_ratio.as_json(),
        }
        for c in fitted.contact
    ]


def _number(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _version_1(answer: Answer, seconds: float) -> dict[str, Any]:
    listed = [m for m in answer.mechanisms if not m.learned]
    verdict: str = answer.verdict
    if verdict == "new_physics":
        verdict = "missing_physics" if listed else "unexplained"
    where, then, fit = answer.location, answer.next_experiment, answer.fit
    return {
        "format": FORMAT,
        "version": 1,
        "session": " + ".join(r.file for r in answer.recordings),
        "verdict": verdict,
        "p_value": answer.p_value,
        "mechanisms": [_mechanism(m) for m in listed],
        "location": None if where is None else {
            "component": where.component,
            "channels": list(where.channels),
            "time_ms": [1e3 * t for t in where.time_s],
            "frequency_hz": list(where.frequency_hz),
            "loads_mn": [1e3 * answer.loads_n[label] for label in where.groups],
            "why": where.why,
        },
        "fit": {
            "noise_rms_m_s2": fit.noise_rms,
            "heldout_rms_before_m_s2": _number(fit.heldout_rms_before) or 0.0,
            "heldout_rms_after_m_s2": _number(fit.heldout_rms_after),
            "heldout_impacts": fit.heldout_segments,
        },
        "next_experiment": None if then is None else {
            "load_mn": 1e3 * (then.load_n or 0.0),
            "peak_force_ratio": then.peak_force_ratio or 0.0,
            "separates": list(then.separates),
            "why": then.why,
        },
        "seconds": seconds,
        "adopted": None if answer.fitted is None else _fitted(answer.fitted),
    }  # fmt: skip
