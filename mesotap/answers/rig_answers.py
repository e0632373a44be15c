"""The diagnosis of a described rig as programs read it (``mesotap-diagnosis`` 1 and a little more) and as people do."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from analysis.mismatch.rigs.diagnosis import RigDiagnosis
from mesotap.answers.answer_parts import location_part, mechanism_part, next_part, print_mechanisms
from mesotap.operator.terminal import escape

VERDICTS = {
    "consistent": "The rig as described explains these recordings.",
    "unexplained": "The rig as described does not explain these recordings, and nothing listed does.",
    "missing_physics": "The rig as described leaves something out of these recordings.",
}
FAR_OFF = (
    "The rig as described misses most of the motion: check its stiffness and mass, their units and the channels, or "
    "say 'unknown' of what nobody knows."
)


def verdict_of(d: RigDiagnosis) -> str:
    """Return the verdict as a sentence."""
    return FAR_OFF if d.far_off else VERDICTS[d.verdict]


def rig_answer(d: RigDiagnosis, seconds: float) -> dict[str, Any]:
    """Return the answer for programs: the contract's keys, and beside them what only such rigs have."""
    return {
        "format": "mesotap-diagnosis",
        "version": 1,
        "session": d.source,
        "verdict": d.verdict,
        "p_value": d.p_value,
        "mechanisms": [mechanism_part(m) for m in d.mechanisms],
        "location": location_part(d.location),
        "fit": {
            "noise_rms_m_s2": d.noise_rms,
            "heldout_rms_before_m_s2": d.rms_before if math.isfinite(d.rms_before) else 0.0,
            "heldout_rms_after_m_s2": d.rms_after,
            "heldout_impacts": d.held_out,
            "unit": d.unit,
            "far_off": d.far_off,
            "stretches": {k: {"before": b, "after": a} for k, (b, a) in d.stretches.items()},
            "steady_relative_error_before": d.steady_before,
            "steady_relative_error_after": d.steady_after,
        },
        "rig": {"name": d.outcome.rig.name, "constants": dict(d.outcome.best.constants)},
        "decay": [
            {
                "time_s": p.time_s,
                "amplitude": p.amplitude,
                "frequency_hz": p.frequency_hz,
                "damping_ratio": p.damping_ratio,
            }
            for p in d.decay
        ],
        "candidates": candidates(d),
        "next_experiment": next_part(d.next_experiment),
        "seconds": seconds,
    }


def candidates(d: RigDiagnosis) -> list[dict[str, Any]]:
    """Return each step of the contest: error on the choosing blocks, over the recording's rms, with every mechanism."""
    return [
        {
            "linear_or_before": math.sqrt(float(np.mean(step.before))),
            "accepted": None if step.accepted is None else step.accepted.id,
            "with": {e.id: math.sqrt(e.mean) for e in reversed(step.entries) if e.fitted is not None},
        }
        for step in d.outcome.rounds
    ]


def print_rig_diagnosis(d: RigDiagnosis, console: Console) -> None:
    """Say the answer to a person."""
    # what is far off looks like coloured noise to the test, whose p would only mislead
    p = "" if d.far_off else f" (p = {d.p_value:.2g})"
    console.print(f"[bold]{verdict_of(d)}[/bold]{p}")
    print_mechanisms(d.mechanisms, console)
    if d.location is not None:
        console.print(f"  where: {escape(d.location.component)}; {escape(d.location.why)}")
    after = "" if d.rms_after is None else f", with what was left out {d.rms_after:.4g}"
    console.print(
        f"  held out, {d.held_out} pieces: rms {d.rms_before:.4g} {d.unit} by the rig as described{after}; "
        f"unforeseeable {d.noise_rms:.3g}"
    )
    for name, (before, later) in d.stretches.items():
        console.print(
            f"    {escape(name)}: {before:.4g}"
            + ("" if later is None else f", then {later:.4g}")
            + f" {escape(d.unit)}"
        )
    if d.steady_before is not None:
        then = "" if d.steady_after is None else f", then {100 * d.steady_after:.3g} %"
        console.print(f"  steady responses held out: force off by {100 * d.steady_before:.3g} %{then}")
    for step in candidates(d):
        table = Table(title="The contest: error on the choosing blocks, over the recording's rms")
        table.add_column("with")
        table.add_column("error", justify="right")
        table.add_row("nothing more", f"{step['linear_or_before']:.5f}")
        for name, value in sorted(step["with"].items(), key=lambda item: item[1]):
            table.add_row(name, f"{value:.5f}", style="bold" if name == step["accepted"] else "")
        console.print(table)
    if d.next_experiment is not None:
        console.print(f"  next: to part {' and '.join(d.next_experiment.separates)}. {escape(d.next_experiment.why)}")
