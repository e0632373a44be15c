"""What is behind an answer about simulated recordings: errors against time and frequency, the law, the selection."""

from __future__ import annotations

import math
from collections.abc import Mapping

from markupsafe import Markup

from analysis.mismatch.answer import Interval
from analysis.mismatch.recordings.account import BlockAccount
from analysis.mismatch.recordings.blocks import mean_of
from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.reasons import reason
from analysis.mismatch.recordings.recorded import CHOOSE
from analysis.mismatch.selection import SelectionStep
from mesotap.answers.diagnosis_page import Evidence, Picture, Table
from mesotap.answers.diagnosis_text import same_shown_words
from mesotap.answers.rounding import between, significant
from mesotap.report import figures
from sim_backend.arrangement import Parameter
from sim_backend.mechanisms.catalogue import catalogue
from sim_backend.mechanisms.kinds import Mechanism

DECLARED_COVERAGE = 2.0  # times the standard uncertainty of a description, as shown
METHOD = (
    "The recording is simulated from end to end. Blocks of it fit, others choose, others are held out; nothing is "
    "refitted on what is held out. A mechanism is added where the choosing blocks get better by more than chance and "
    "by at least 3 % of what the rig as described misses; nothing is named where a force of any shape would still take "
    "away more than 5 %."
)


def evidence_of_recordings(account: BlockAccount, known: Mapping[str, tuple[Mechanism, ...]]) -> Evidence:
    """Return figure and tables of a diagnosis; ``known`` are the mechanisms that took part, by id."""
    return Evidence(
        where=(),
        what=(),
        gained=(_errors(account),),
        candidates=tuple(_step(step, account, first=i == 0) for i, step in enumerate(account.selection.steps)),
        constants=(_constants(account),),
        excluded=tuple(m for m in catalogue() if m not in known),
        method=METHOD,
    )


def _errors(account: BlockAccount) -> Picture:
    third = (
        "frequency and damping ratio along the decay against amplitude, read from the recording (dots) and from the "
        "simulations (lines)"
        if account.decay
        else "the force that was left out, along the motion"
    )
    return Picture(
        "errors",
        figures.rig_figure(account),
        "Errors before and after against time and frequency, and the law that was left out",
        "(a) rms of the recording and of what is left of it by the rig as described and with what was left out, from "
        f"one simulation from end to end; grey: held out; (b) their spectra; (c) {third}.",
    )


def _constants(account: BlockAccount) -> Table:
    fitted = account.fitted()
    constants = {} if fitted is None else fitted.constants
    declared = {p.name: p for p in account.described.arrangement.parameters}
    rows = [
        (
            n,
            between(c.value, c.low, c.high, 5)[0],
            _interval(c),
            "" if c.unit == "1" else c.unit,
            _declared(declared.get(n)),
        )
        for n, c in constants.items()
    ]
    caption = (
        "Constants of the rig as fitted, with 95 % intervals from what the fit leaves, in its own colour. They hold "
        "for the rig with what is named above, and are too narrow where something remains unexplained. Declared: ± is "
        "twice the standard uncertainty of the description."
    )
    caption = " ".join(
        [caption, *([] if fitted is None else same_shown_words(fitted, account.selection.chosen is not None))]
    )
    return Table(caption, ("Constant", "Value", "95 % interval", "Unit", "Declared"), tuple(rows), (0, 2, 3, 4))


def _interval(found: Interval) -> str:
    if found.low == found.high:
        return "not fitted"
    if not (math.isfinite(found.low) and math.isfinite(found.high)):
        return "not determined by these recordings"
    _, low, high = between(found.value, found.low, found.high, 5)
    return f"{low} to {high}"


def _declared(constant: Parameter | None) -> str:
    if constant is None or not math.isfinite(constant.uncertainty):
        return "unknown"
    if constant.uncertainty == 0.0:
        return f"{significant(constant.value, 5)}, exactly"
    return f"{significant(constant.value, 5)} ± {significant(DECLARED_COVERAGE * constant.uncertainty, 2)}"


def _step(step: SelectionStep[SimulatedFit], account: BlockAccount, *, first: bool) -> Table:
    missed = math.sqrt(mean_of(step.before.by_block(CHOOSE)))
    nothing = "nothing" if first else "what was accepted before"
    rows: list[tuple[str | Markup, ...]] = [(nothing, "", f"{missed:.5f}", "")]
    for c in sorted((c for c in step.candidates if c.fit is not None), key=lambda c: mean_of(c.losses)):
        name = Markup("<strong>{}</strong>").format(c.id) if c is step.accepted else c.id
        place = c.mechanism.named(account.judge.problem.arrangement, c.score.term.place)
        place = account.element(c.score.term, place) or place
        why = "accepted" if c is step.accepted else reason(account.judge, step, account.selection.best, c)
        rows.append((name, place, f"{math.sqrt(mean_of(c.losses)):.5f}", why))
    caption = (
        "Error on blocks that took no part in fitting, in units of the recording's noise; where a smaller one was not "
        "accepted, the reason."
    )
    return Table(caption, ("With", "In", "Error", "Decided by"), tuple(rows), (0, 1, 3))
