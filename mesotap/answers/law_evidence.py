"""What is known of the laws that were learned, as the page of a diagnosis shows it."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

from analysis.mismatch.answer import Interval, Law, Named
from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.law_reading import force_on
from analysis.mismatch.learning import is_learned
from mesotap.answers.diagnosis_page import Picture, Table
from mesotap.answers.diagnosis_text import KINDS, words
from mesotap.answers.rounding import significant, with_ends
from mesotap.report import figures
from mesotap.report.typesetting import prose
from sim_backend.mechanisms.kinds import ForceLaw

LISTED = 2  # laws of the catalogue drawn beside a learned one
UNITS = {"deflection": "m", "rate": "m/s", "load_mn": "mN"}
SYMBOLS = {"deflection": "d", "rate": "v", "load": "P"}  # in formulas


def evidence_of_laws(found: Diagnosis) -> tuple[tuple[Picture, ...], tuple[Table, ...]]:
    """Return curve and table of every learned law of a diagnosis."""
    pictures, tables = [], []
    for number, m in enumerate(found.answer.mechanisms):
        if m.law is None:
            continue
        tables += [_known(m, m.law), *([_formulas(m.law)] if m.law.formulas else [])]
        if m.law.table is not None:
            listed = _nearest(found, m.law, number)
            drawn = figures.law_figure(m.law.table, listed)
            at_load = ", at the load that is nearest to its reference" if found.answer.loads_n else ""
            dashed = " Dashed: the listed laws that come nearest, as fitted." if listed else ""
            pictures.append(
                Picture(
                    f"law-{number}",
                    drawn,
                    f"Force of the learned law in the {m.element or m.where} with its 95 % band",
                    f"Force that acts in the {m.element or m.where} beside its linear stiffness and damping{at_load}, "
                    f"over what the recordings cover; shaded: 95 %.{dashed}",
                )
            )
    return tuple(pictures), tuple(tables)


def _nearest(found: Diagnosis, law: Law, number: int) -> list[figures.Overlay]:
    """Return the best listed laws in the same element, on the grid of a learned one."""
    selection = found.selection
    if law.table is None or selection.chosen is None or number:
        return []
    term = selection.chosen.terms[number]
    drawn: list[figures.Overlay] = []
    for c in selection.steps[0].candidates:
        listed: Any = None if c.fit is None else c.fit.terms[-1]
        if listed is None or is_learned(listed) or listed.place != term.place or len(drawn) == LISTED:
            continue
        if isinstance(listed.mechanism, ForceLaw):
            force = force_on(c.fit, listed, term, law.table.axes)
            if np.all(np.isfinite(force)):
                drawn.append((words(c.id), force))
    return drawn


def exponent_told(law: Law, name: str) -> str:
    """Return the exponent of a variable with its interval; what else holds of a formula that has none."""
    value = law.exponents[name]
    if value is not None:
        return prose(_interval(value))
    if not law.formulas and law.table is not None and any(axis.startswith(name) for axis in law.table.axes):
        return "it is no power of it"
    formula = law.formulas[0].text if law.formulas else ""
    symbol = rf"\b{SYMBOLS[name]}\b"
    return "it is no power of it alone" if re.search(symbol, formula) else "it does not depend on it"


def _known(m: Named, law: Law) -> Table:
    kept = {True: "gives back what it takes", False: "dissipates", None: "not told by these recordings"}
    rows = [
        ("What it is", KINDS[law.kind]),
        ("Where", m.element or m.where),
        ("Symmetry", {"odd": "odd", "even": "even", "none": "neither odd nor even"}[law.symmetry]),
        ("Energy", kept[law.conservative]),
    ]
    rows += [(f"Exponent of the {name}", exponent_told(law, name)) for name in law.exponents]
    for name, (low, high) in law.valid.items():
        what = name.removesuffix("_mn")
        rows.append((f"Covered: {what}", prose(f"{low:.4g} to {high:.4g} {UNITS.get(name, '')}".strip())))
    return Table("What is known of the law.", ("Property", "Of this law"), tuple(rows), text=(0, 1))


def _formulas(law: Law) -> Table:
    rows = []
    for formula in law.formulas:
        free = "; ".join(f"{k} = {_interval(v)} {v.unit if v.unit != '1' else ''}".strip()
                         for k, v in formula.parameters.items())  # fmt: skip
        rows.append((formula.text, free, f"{formula.evidence:+.1f}"))
    caption = (
        "Formulas that lose nothing against a force of any shape; evidence is the logarithm of the Bayes factor over "
        "it. d deflection, v rate, P load, t time since the tap."
    )
    return Table(caption, ("Formula", "Parameters (95 %)", "Evidence"), tuple(rows), text=(0, 1))


def _interval(v: Interval) -> str:
    if not math.isfinite(v.low + v.high) or v.low == v.high:
        return significant(v.value, 4)
    return with_ends(v.value, v.low, v.high)
