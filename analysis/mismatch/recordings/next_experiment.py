"""Which recording of a described rig to make next: one that parts what explains it as well, or tells what is left."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from analysis.mismatch.account import UNLISTED, Weights
from analysis.mismatch.answer import Move, NextExperiment
from analysis.mismatch.recordings.fit import SimulatedFit
from analysis.mismatch.recordings.judge import BlockJudge
from analysis.mismatch.recordings.ranking import with_time
from analysis.mismatch.recordings.recorded import level
from analysis.mismatch.rivals import LIKELY
from analysis.mismatch.selection import Candidate, Selection
from sim_backend.mechanisms.kinds import AddedBody, ChannelDistortion, Mechanism, Scale

STRONGER: Final = 3.0  # tap over the one made, that parts amplitude from time
WEAKER: Final = 0.5  # of the strength, at which what goes with amplitude has changed much, and nothing is at risk
AS_STRONG: Final = 2.0  # level of the strongest recording over that of the weakest, up to which amplitude tells little

OF_UNIT: Final = Scale(1.0, 1.0, 0.0, 1.0, (0.01, 0.1))
BY_PLACE: Final[tuple[str, Move]] = (
    "a sensor on what moves of its own does, or one on another body.",
    "other_place",
)
BY_EXCHANGE: Final[tuple[str, Move]] = (
    "exchange the sensors and their channels; what goes with one of them is its own, what stays is the rig's.",
    "swap_channels",
)

Chosen = Selection[SimulatedFit]


def next_experiment(
    selection: Chosen, judge: BlockJudge, named: Sequence[str], rival: Candidate[SimulatedFit] | None, weights: Weights
) -> NextExperiment | None:
    """Return what to record next, None where nothing is left to be told.

    Parameters
    ----------
    named
        Mechanisms that are named, the first one first.
    rival
        The best explanation by time, where amplitude and time go together in one decay.
    weights
        How likely the candidates of the first step are.
    """
    found = None
    if named and selection.steps:
        fits = [c for c in selection.steps[0].candidates if c.fit is not None]
        kinds = {c.id: c.mechanism for c in fits} | {t.mechanism.id: t.mechanism for t in selection.best.terms}
        found = _apart(judge, named, fits, weights, kinds) if rival is None else _amplitude_or_time(named, fits, rival)
    left = not named or selection.left.p_value < judge.problem.policy.level
    return found if found is not None or not left else _what_is_left(selection, judge, named)


def _amplitude_or_time(
    named: Sequence[str], fits: Sequence[Candidate[SimulatedFit]], rival: Candidate[SimulatedFit]
) -> NextExperiment | None:
    by_amplitude = [n for n in named if n != rival.id] + [c.id for c in fits if not with_time(c.mechanism)]
    if not by_amplitude:
        return None
    return NextExperiment(
        None,
        STRONGER,
        (by_amplitude[0], rival.id),
        "In one decay amplitude and time are confounded. Taps of different strength settle it (one "
        f"{STRONGER:g} times stronger or weaker than this one): what goes with amplitude then comes earlier or "
        "later in the decay, what goes with time does not move. So does a steady excitation at two or more levels.",
        ("tap", "input"),
    )


def _apart(
    judge: BlockJudge,
    named: Sequence[str],
    fits: Sequence[Candidate[SimulatedFit]],
    weights: Weights,
    kinds: Mapping[str, Mechanism],
) -> NextExperiment | None:
    """Return what parts what is named from what explains as much: strength, or a sensor where both are linear.

    ``kinds`` are mechanisms by id; what is named need not be among the fits of the first step.
    """
    settled = judge.steady is not None
    listed = [c.id for c in fits if c.id != named[0] and not (settled and with_time(c.mechanism))]
    others = [i for i in listed if weights.of.get(i, 0.0) > LIKELY * weights.total]
    if not others:
        return None
    # strength parts two of which one is not linear, and no sensor does that as easily
    linear = is_linear(kinds.get(named[0]))
    parted = [i for i in others if not (linear and is_linear(kinds.get(i)))]
    two = named[0], max(parted or others, key=weights.of.__getitem__)
    if not parted:
        why, move = BY_PLACE
        if any(isinstance(kinds.get(i), ChannelDistortion) for i in two):
            why, move = BY_EXCHANGE
        return NextExperiment(None, None, two, f"Both are linear, so that strength does not part them: {why}", (move,))
    return NextExperiment(
        None,
        STRONGER / 2,
        two,
        f"The two differ most at the largest amplitude: {STRONGER / 2:g} times as strong they would part further.",
        _moved(judge),
    )


def is_linear(mechanism: Mechanism | None) -> bool:
    """Whether what a mechanism does is in proportion to the motion: of a body, and of a channel where it shows so."""
    if not isinstance(mechanism, ChannelDistortion):
        return isinstance(mechanism, AddedBody)
    within = {
        q.name: math.sqrt(q.low * q.high) if q.log else q.low + 0.6 * (q.high - q.low) for q in mechanism.parameters
    }
    values = {**mechanism.trials(OF_UNIT)[0], **within, "peak": 1.0, "lowest": -1.0, "highest": 1.0}
    row = np.sin(0.3 * np.arange(100.0))[None]
    half, whole = (mechanism.distort(share * row, values, 1.0) for share in (0.5, 1.0))
    return bool(np.allclose(2 * half, whole, rtol=1e-6, atol=1e-9))


def _moved(judge: BlockJudge) -> tuple[Move, ...]:
    return ("input",) if judge.problem.rig.drives else ("tap",)


def _what_is_left(selection: Chosen, judge: BlockJudge, named: Sequence[str]) -> NextExperiment | None:
    """Return what would tell more of what is left: another strength; where there are several, another sensor."""
    scores = selection.last_screening.scores if named else selection.screening.scores
    likeliest = next((s.term.mechanism.id for s in scores if s.term.mechanism.id not in named), "")
    if not likeliest and not named:
        return None
    best = f"Of what is left, {likeliest.replace('_', ' ')} would take away most of all that is listed. "
    best = best if likeliest else ""
    strengths = [float(np.max(level(r))) for r in judge.problem.recordings]
    if max(strengths) < AS_STRONG * min(strengths):
        return NextExperiment(
            None,
            WEAKER,
            (likeliest or named[0], UNLISTED),
            f"{best}Whether what is left shrinks with the amplitude, and as which power of it, tells which law it "
            "is, or that it is none: recordings of one strength do not show that.",
            _moved(judge),
        )
    return NextExperiment(
        None,
        None,
        (likeliest or named[0], UNLISTED),
        f"{best}These recordings are of different strength already; a sensor on a body that none shows yet would "
        "tell in which element it is.",
        ("other_place",),
    )
