"""The diagnosis as programs read it (format ``mesotap-diagnosis`` 1) and as a person reads it in a terminal."""

from __future__ import annotations

import math
from typing import Any

from rich.console import Console
from rich.table import Table

from analysis.mismatch.corrected import contact_at_rest
from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.fit import Fit
from mesotap.answers.adoption import LOAD_CELL
from mesotap.answers.answer_parts import location_part, mechanism_part, next_part, print_mechanisms
from mesotap.operator.terminal import escape


def diagnosis_answer(d: Diagnosis, seconds: float) -> dict[str, Any]:
    """Return the answer for programs."""
    return {
        "format": "mesotap-diagnosis",
        "version": 1,
        "session": d.session,
        "verdict": d.verdict,
        "p_value": d.p_value,
        "mechanisms": [{**mechanism_part(m), "fixed": dict(m.fixed)} for m in d.mechanisms],
        "location": location_part(d.location),
        "fit": {
            "noise_rms_m_s2": d.noise_rms,
            "heldout_rms_before_m_s2": _number(d.rms_before),
            "heldout_rms_after_m_s2": d.rms_after,
            "heldout_impacts": len(d.contest.held_out),
        },
        "next_experiment": next_part(d.next_experiment),
        "seconds": seconds,
        "adopted": None if d.contest.chosen is None else _augmented(d.contest.chosen),
    }


def _augmented(fitted: Fit) -> dict[str, Any]:
    """Return the rig that the recordings are of, as fitted with what was left out: `mesotap adopt` takes it up."""
    rig = dict(zip(fitted.constants.names()[0], fitted.constants.rig.tolist(), strict=True))
    declared = [p for p in fitted.problem.arrangement.parameters if p.name in rig]
    return {
        "rig": {p.name: {"value": rig[p.name], "unit": p.unit} for p in declared},
        "loads": [
            {
                "load_mn": 1e3 * c.load_n,
                "contact_stiffness_n_per_m": c.stiffness.as_json(),
                "contact_damping_n_s_per_m": c.damping.as_json(),
                "damping_ratio": c.damping_ratio.as_json(),
            }
            for c in contact_at_rest(fitted)
        ],
    }


def _number(value: float) -> float:
    return value if math.isfinite(value) else 0.0


def print_diagnosis(d: Diagnosis, console: Console) -> None:
    """Say the answer to a person."""
    said = {
        "consistent": "Eq. 9 with its constants refitted explains these recordings.",
        "unexplained": "Eq. 9 does not explain these recordings, and nothing listed does.",
        "missing_physics": "Eq. 9 leaves something out of these recordings.",
    }
    drifted = bool(d.mechanisms) and all(m.where == LOAD_CELL for m in d.mechanisms)
    sentence = "Eq. 9 explains these recordings, but the load cell drifted." if drifted else said[d.verdict]
    console.print(f"[bold]{escape(sentence)}[/bold] (p = {d.p_value:.2g})")
    print_mechanisms(d.mechanisms, console)
    if d.location is not None:
        console.print(f"  where: {escape(d.location.component)}; {escape(d.location.why)}")
    after = "" if d.rms_after is None else f", with what was left out {d.rms_after:.5g}"
    console.print(
        f"  {len(d.contest.held_out)} held-out impacts: rms {d.rms_before:.5g} m/s2 by Eq. 9{after}; "
        f"noise {d.noise_rms:.5g}"
    )
    if d.contest.rounds:
        table = Table(title="The contest")
        table.add_column("mechanism")
        table.add_column("chi-squared taken away", justify="right")
        table.add_column("how")
        for entry in d.contest.rounds[0].entries[:8]:
            table.add_row(entry.id, f"{entry.evidence:.0f}", "full fit" if entry.fit is not None else "score test")
        console.print(table)
    if d.next_experiment is not None:
        n = d.next_experiment
        console.print(
            f"  next: {n.load_mn:.0f} mN, tap of {n.peak_force_ratio:.2f} of the load, "
            f"to part {' and '.join(n.separates)}. "
            f"{n.why}"
        )
