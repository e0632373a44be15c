"""k_c and zeta2 of a session corrected for physics that a diagnosis found, beside those of Eq. 9 alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rich.console import Console
from threadpoolctl import threadpool_limits

from analysis.mismatch.answer import TESTER_SCALES, ContactAtRest
from analysis.mismatch.parameters import Term
from analysis.mismatch.ring_downs.corrected import augmented, contact_at_rest
from analysis.mismatch.ring_downs.fit import fit
from analysis.mismatch.ring_downs.sessions import ring_downs
from daq.records import Session
from mesotap.answers.adoption import AdoptedModel
from mesotap.answers.diagnosis_text import constant_words
from mesotap.answers.rounding import with_uncertainty
from mesotap.configuration.config import ConfigError
from mesotap.configuration.declared import header_uncertainty
from mesotap.configuration.rig_files import tester_rig
from mesotap.operator.tables import Table
from sim_backend.adopted import adopted


@dataclass(frozen=True, slots=True)
class CorrectedLoad:
    """One load set: contact by Eq. 9, and at zero amplitude of the model with what it leaves out."""

    load_set: int
    plain: ContactAtRest
    corrected: ContactAtRest


@dataclass(frozen=True, slots=True)
class Correction:
    """A session corrected.

    Attributes
    ----------
    source
        The diagnosis.
    chi_squared_gain
        What its mechanisms take away.
    off
        Declared uncertainties by which its fit moved some constants far.
    """

    source: str
    mechanisms: tuple[str, ...]
    chi_squared_gain: float
    loads: tuple[CorrectedLoad, ...]
    off: Mapping[str, float] = field(default_factory=dict)

    @property
    def doubt(self) -> str:
        """What to think of the corrected values where the diagnosis moved declared constants far; else nothing."""
        moved = " and ".join(f"{constant_words(name)} by {by:.0f}" for name, by in self.off.items())
        so = (
            "the corrected k_c and c_c may be wrong by far more than their intervals"
            if TESTER_SCALES.isdisjoint(self.off)
            else "their intervals reach to what masses as declared and loads as measured give"
        )
        return f"The diagnosis moved {moved} declared uncertainties: {so}." if moved else ""

    @property
    def name(self) -> str:
        """Names of the mechanisms, in words."""
        return " and ".join(m.replace("_", " ") for m in self.mechanisms)


def correct(session: Session, model: AdoptedModel, folders: Sequence[str] = ()) -> Correction:
    """Fit a session by Eq. 9 and by Eq. 9 with a model's mechanisms, whose parameters are fitted again.

    Raises
    ------
    ConfigError
        The model holds a mechanism or a value that cannot be.
    AnalysisError
        The session cannot carry such a fit.
    """
    try:
        found = [adopted(name, v, folders, model.at.get(name)) for name, v in model.mechanisms.items()]
    except ValueError as error:
        raise ConfigError(f"{model.source}: {error}") from error
    with threadpool_limits(limits=1, user_api="blas"), np.errstate(all="ignore"):
        before = fit(ring_downs([session], tester_rig(), header_uncertainty(session)))
        after = augmented(before, [Term(a.mechanism, a.values, a.place) for a in found])
    sets = {impact.number: impact.load_set for impact in session.impacts}
    of_group = {s.group: sets[s.order] for s in before.segments}
    pairs = zip(contact_at_rest(before), contact_at_rest(after), strict=True)
    rows = tuple(CorrectedLoad(of_group[g], plain, corrected) for g, (plain, corrected) in enumerate(pairs))
    return Correction(model.source, tuple(model.mechanisms), before.objective - after.objective, rows, model.off)


def with_correction(answer: dict[str, Any], correction: Correction) -> dict[str, Any]:
    """Return the results for programs with the corrected values beside the plain ones of each load."""
    rows = {row.load_set: row for row in correction.loads}
    loads = [
        entry | {"corrected": _written(rows[entry["load_set"]]) if entry["load_set"] in rows else None}
        for entry in answer["loads"]
    ]
    model = {
        "source": correction.source,
        "mechanisms": list(correction.mechanisms),
        "chi_squared_gain": correction.chi_squared_gain,
    }
    notes = [*answer.get("notes", []), *([correction.doubt] if correction.doubt else [])]
    return answer | {"loads": loads, "model": model, "notes": notes}


def _written(row: CorrectedLoad) -> dict[str, Any]:
    return {
        which: {
            "contact_stiffness_n_per_m": contact.stiffness.as_json(),
            "contact_damping_n_s_per_m": contact.damping.as_json(),
            "zeta_c": contact.damping_ratio.as_json(),
        }
        for which, contact in (("eq_9", row.plain), ("at_zero_amplitude", row.corrected))
    }


def show_correction(correction: Correction, console: Console) -> None:
    """Print plain and corrected values side by side."""
    shown = Table(title=f"Corrected for {correction.name}: at zero amplitude, 95 % intervals of the joint fit")
    headings = ("load, mN", "k_c, MN/m, Eq. 9", "k_c, MN/m, corrected", "zeta2, %, Eq. 9", "zeta2, %, corrected")
    for heading in headings:
        shown.add_column(heading, justify="right")
    for row in correction.loads:
        shown.add_row(
            f"{1e3 * row.plain.load_n:.1f}",
            with_uncertainty(row.plain.stiffness, 1e-6),
            with_uncertainty(row.corrected.stiffness, 1e-6),
            with_uncertainty(row.plain.damping_ratio, 100),
            with_uncertainty(row.corrected.damping_ratio, 100),
        )
    console.print(shown)
    if correction.doubt:
        console.print(f"- {correction.doubt}", highlight=False, soft_wrap=True)
