"""The page of a proof: `proof.md` with its figures, and `scores.json` for programs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from daq.durable import write_whole
from mesotap.proof import law_page, law_scores, scores
from mesotap.proof.entries import LEVEL, NEW, UNEXPLAINED, Entry
from mesotap.proof.figures import confusion_figure, detection_figure, p_value_figure, reliability_figure
from mesotap.proof.generator.effects import LISTED
from mesotap.proof.scored import completeness, scored, seconds
from mesotap.proof.scores import Count
from mesotap.report.figures._files import save


@dataclass(frozen=True, slots=True)
class Proof:
    """What a page is about.

    Attributes
    ----------
    heading
        What it is a proof of, one line.
    origin
        Where the sessions come from and how to make them again, a paragraph.
    entries
        The answered sessions.
    failures
        Session to what its diagnosis said instead of an answer.
    """

    heading: str
    origin: str
    entries: tuple[Entry, ...]
    failures: dict[str, str]


def write(proof: Proof, folder: Path) -> Path:
    """Write ``proof.md``, ``scores.json`` and the figures into a folder; return the page."""
    folder.mkdir(parents=True, exist_ok=True)
    found = scored(proof.entries, proof.failures)
    write_whole(folder / "scores.json", (json.dumps(found, indent=1, allow_nan=False) + "\n").encode())
    entries = proof.entries
    nulls, lines = scores.nulls(entries), scores.by_grade(entries)
    if any(g.detected.of for g in lines):
        save(detection_figure(lines), folder / "detection.svg")
    if nulls.p_values:
        save(p_value_figure(nulls), folder / "p-values.svg")
    if any(e.named for e in entries):
        save(reliability_figure(scores.calibration(entries)[0]), folder / "reliability.svg")
    table = scores.confusion(entries)
    if table:
        save(confusion_figure(table, list(LISTED)), folder / "confusion.svg")
    page = folder / "proof.md"
    write_whole(page, _page(proof, folder).encode())
    return page


def _share(count: Count) -> str:
    """'12 of 13 (92 %; 64 to 100)'."""
    if not count.of:
        return "none"
    low, high = count.interval
    return f"{count.hits} of {count.of} ({100 * count.share:.0f} %; {100 * low:.0f} to {100 * high:.0f})"


def _table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(headings) + " |", "|" + "---|" * len(headings)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines)


def _page(proof: Proof, folder: Path) -> str:
    entries = proof.entries
    parts = [f"# {proof.heading}", proof.origin, INTRODUCTION]
    if proof.failures:
        rows = [(name, said.replace("|", "/").replace("\n", " ")[:200]) for name, said in proof.failures.items()]
        parts += ["## Without an answer", _table(("session", "what was said"), rows)]
    for section in (
        _nulls,
        _singles,
        _confusion,
        _unlisted,
        _laws,
        _pairs,
        _coverage,
        _limits,
        _calibration,
        _held_out,
        _mistakes,
    ):
        text = section(entries, folder)
        if text:
            parts.append(text)
    return "\n\n".join(parts) + "\n"


INTRODUCTION = """`d` is what survives the refit of Eq. 9: the root of chi-squared, in standard deviations of the noise
over the whole session, that the linear rig leaves when the state after every tap, k_c and c_c of every load and the
rig's constants within their uncertainties are fitted again. Shares are followed by their exact 95 % intervals. A name
counts as covered where it is true, or where what is hidden is among the look-alikes that the answer declares."""

HELD_OUT = """The fit that knows the answer leaves the session's own noise less the freedom of each impact (state of
both masses, offset and high-pass ringing of each channel), whitened by the true noise model. It is taken over all
impacts of the session, of which the answer held out some: that alone scatters the ratio by a percent or so."""


def _figure(folder: Path, name: str, label: str) -> str:
    return f"![{label}]({name})" if (folder / name).exists() else ""


def _joined(*parts: str) -> str:
    return "\n\n".join(p for p in parts if p)


def _nulls(entries: Sequence[Entry], folder: Path) -> str:
    found = scores.nulls(entries)
    if not found.p_values:
        return ""
    return _joined(
        "## Nothing hidden",
        f"p below {LEVEL:g}: {_share(found.alarms)}. Verdict other than `consistent`: {_share(found.not_consistent)}. "
        f"The Kolmogorov-Smirnov test for uniform p-values gives {found.uniform:.2g}.",
        _figure(folder, "p-values.svg", "p-values of sessions in which nothing is hidden, against uniform ones"),
    )


def _singles(entries: Sequence[Entry], folder: Path) -> str:
    lines = [g for g in scores.by_grade(entries) if g.detected.of]
    if not lines:
        return ""
    rows = [
        (
            f"{g.grade:g}", _share(g.detected), f"{100 * scores.power(g.grade):.0f} %", _share(g.component),
            _share(g.right), _share(g.covered), _share(g.confident_wrong), _share(g.unexplained), _share(g.missed),
        )
        for g in lines
    ]  # fmt: skip
    sets = [g.false_sets for g in lines if g.false_sets.of]
    checked = Count(sum(c.hits for c in sets), sum(c.of for c in sets))
    alike = (
        "Where a name is right by a declared look-alike only, the surviving signals of both were computed: "
        f"{_share(checked)} have a cosine below {scores.TRULY_ALIKE:g} and are no look-alikes."
        if checked.of
        else ""
    )
    headings = (
        "d", "detected", "test that knows", "component right, of detected", "first name right", "covered",
        "confident and wrong", "`unexplained`", "`consistent`",
    )  # fmt: skip
    label = "Share of effects detected, located and named against d"
    return _joined("## One effect", _table(headings, rows), alike, _figure(folder, "detection.svg", label))


def _confusion(entries: Sequence[Entry], folder: Path) -> str:
    figure = _figure(folder, "confusion.svg", "What was said of each effect")
    note = "Listed effects from the grade d = 30 on, nothing, and (in brackets) effects outside the list."
    return _joined("## What was said of what", note, figure) if figure else ""


def _unlisted(entries: Sequence[Entry], folder: Path) -> str:
    headings_of = {"excluded": "## The true mechanism excluded from the list", "outside": "## Effects outside the list"}
    parts = []
    for kind, heading in headings_of.items():
        lines = [g for g in scores.unlisted(entries, kind) if g.unexplained.of]
        if lines:
            rows = [(f"{g.grade:g}", _share(g.unexplained), _share(g.confident_wrong), _share(g.missed)) for g in lines]
            headings = (
                "d",
                "`unexplained` or `new_physics`",
                "a listed name stated with more than 0.9",
                "`consistent`",
            )
            parts.append(_joined(heading, _table(headings, rows)))
    return _joined(*parts)


def _laws(entries: Sequence[Entry], folder: Path) -> str:
    return law_page.section(entries, _share, _table)


def _pairs(entries: Sequence[Entry], folder: Path) -> str:
    found = scores.pairs(entries)
    if not found.both.of:
        return ""
    return _joined(
        "## Two effects at once",
        f"Both named: {_share(found.both)}. One at least: {_share(found.one)}. "
        f"A wrong name stated with more than {scores.CONFIDENT:g}: {_share(found.confident_wrong)}. "
        f"Detected: {_share(found.detected)}. `unexplained`: {_share(found.unexplained)}.",
    )


def _limits(entries: Sequence[Entry], folder: Path) -> str:
    lines = scores.limits(entries)
    found = completeness(entries)
    parts = []
    if lines:
        parts += [
            "## Upper limits",
            "Of single effects that are not named: how often the 95 % upper limit holds the true strength.",
            _table(("d", "the limit holds"), [(f"{g:g}", _share(count)) for g, count in lines]),
        ]
    if found["brier"] is not None:
        parts.append(
            f"That what is named is all there is was stated with {found['stated']:.2f} on average, and was so in "
            f"{found['true']:.2f} of all sessions. Brier's score {found['brier']:.3f}."
        )
    return _joined(*parts) if parts else ""


def _coverage(entries: Sequence[Entry], folder: Path) -> str:
    lines = scores.coverage(entries)
    if not lines:
        return ""
    rows = [(c.mechanism, c.parameter, _share(c.inside)) for c in lines]
    return _joined(
        "## 95 % intervals",
        f"Of parameters of effects that are named rightly, where truth and answer mean the same quantity: "
        f"{_share(scores.together(lines))} hold the true value.",
        _table(("mechanism", "parameter", "intervals that hold the true value"), rows),
    )


def _calibration(entries: Sequence[Entry], folder: Path) -> str:
    lines, brier = scores.calibration(entries)
    rows = [(f"{r.low:g} to {r.high:g}", f"{r.mean:.3f}", _share(r.right)) for r in lines if r.right.of]
    if not rows:
        return ""
    return _joined(
        "## Stated probabilities",
        f"Of all names in all sessions, those without a listed effect included, where no name is right. "
        f"Brier score {brier:.3f}.",
        _table(("stated", "mean", "covered"), rows),
        _figure(folder, "reliability.svg", "Share of names that are right against the probability stated"),
    )


def _held_out(entries: Sequence[Entry], folder: Path) -> str:
    found = scores.held_out(entries)
    taken = seconds(entries)
    time = f"A diagnosis took {taken['median']:.0f} s (median), {taken['largest']:.0f} s at most."
    if not found.ratios:
        return _joined("## Held-out impacts and time", time)
    return _joined(
        "## Held-out impacts and time",
        "Error on held-out impacts over that of a fit that knows the answer (nulls found consistent, single effects "
        f"named rightly): median {found.median:.3f}, largest {found.ratios[-1]:.3f}; within {scores.ERROR_ALLOWED:g}: "
        f"{_share(found.within)}.",
        HELD_OUT,
        time,
    )


def _mistakes(entries: Sequence[Entry], folder: Path) -> str:
    """List the sessions to look at first."""
    rows = [
        (e.name, e.kind, " + ".join(e.effects) or "nothing", f"{e.d:.0f}", e.verdict, f"{e.p_value:.2g}", _names(e))
        for e in entries
        if _mistaken(e)
    ]
    if not rows:
        return ""
    headings = ("session", "kind", "hidden", "d", "verdict", "p", "named")
    return _joined("## Answers that are wrong or missing", _table(headings, rows))


def _mistaken(e: Entry) -> bool:
    if e.kind == "null":
        return e.detected
    if e.kind == "outside":
        return not law_scores.noticed(e)
    if e.kind == "excluded":
        return e.verdict not in (NEW, UNEXPLAINED)
    return scores.grade(e.d) >= 30 and not e.covered


def _names(e: Entry) -> str:
    return ", ".join(f"{m.id} {m.probability:.2f}" for m in e.named) or "-"
