"""What all answers of a diagnosis have in common, as programs read it and as a person does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import Console

from analysis.mismatch.diagnosis import Location, Named, NextExperiment
from mesotap.operator.terminal import escape


def location_part(found: Location | None) -> dict[str, Any] | None:
    """Return the contract's ``location``."""
    return None if found is None else {
        "component": found.component,
        "channels": list(found.channels),
        "time_ms": list(found.time_ms),
        "frequency_hz": list(found.frequency_hz),
        "loads_mn": list(found.loads_mn),
        "why": found.why,
    }  # fmt: skip


def next_part(found: NextExperiment | None) -> dict[str, Any] | None:
    """Return the contract's ``next_experiment``."""
    return None if found is None else {
        "load_mn": found.load_mn,
        "peak_force_ratio": found.peak_force_ratio,
        "separates": list(found.separates),
        "why": found.why,
    }  # fmt: skip


def mechanism_part(m: Named) -> dict[str, Any]:
    """Return one of the contract's ``mechanisms``."""
    return {
        "id": m.id,
        "probability": m.probability,
        "where": m.where,
        "statement": m.statement,
        "parameters": {
            k: {"value": v.value, "low": v.low, "high": v.high, "unit": v.unit} for k, v in m.parameters.items()
        },
        "indistinguishable_from": list(m.indistinguishable_from),
    }


def print_mechanisms(named: Sequence[Named], console: Console) -> None:
    """Say what was named, with its intervals."""
    for m in named:
        others = ", ".join(m.indistinguishable_from)
        alike = f"; these data cannot tell it from {others}" if others else ""
        console.print(f"  {escape(m.id)} ({escape(m.where)}, probability {m.probability:.2f}{alike})")
        console.print(f"    {escape(m.statement)}")
        for name, v in m.parameters.items():
            console.print(f"    {escape(name)} = {v.value:.4g} ({v.low:.4g} to {v.high:.4g}) {escape(v.unit)}")
