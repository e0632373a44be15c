"""What taps were rejected for, by kind: the verdicts of `daq.quality` hold numbers, which differ from tap to tap."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Final

KINDS: Final = (
    ("clipped", "overloads", "tap more gently, or take a larger range of the recorder"),
    ("peak acceleration", "taps too strong for the accelerometers", "tap more gently"),
    ("the contact was relieved", "taps that nearly part the surfaces", "tap more gently"),
    ("a second impact", "double impacts", "pull back faster, or let a lighter tip bounce off by itself"),
    ("the mass rotated", "taps off centre", "tap in the middle of the upper mass"),
    ("shows hardly anything", "a silent channel", "check its cable, its input and its sensitivity"),
    ("the load moved", "a load that moved", "let it settle, and look at the clamp"),
    ("too weak", "taps too weak", "tap harder"),
    ("noisy before the tap", "noise before the tap", "keep off the table and check the cables"),
    ("by hand", "rejections by hand", "read the reasons given"),
)
"""What a reason holds, what it is called, and what to do at the bench."""


def most_frequent(reasons: Iterable[str]) -> tuple[str, int, str] | None:
    """Return the kind that most of these reasons are of, how many are, and what to do; None where there is none.

    Of several reasons of one tap the first, which is the worst, counts.

    Examples
    --------
    >>> most_frequent(["too weak: the peak ...: tap harder", "a second impact of 8% ...", "a second impact of 9% ..."])
    ('double impacts', 2, 'pull back faster, or let a lighter tip bounce off by itself')
    """
    counts: Counter[tuple[str, str]] = Counter()
    for reason in reasons:
        first = reason.split("; ")[0]
        found = next(((what, then) for mark, what, then in KINDS if mark in first), None)
        counts[found or ("other reasons", "read the reasons in the table of taps")] += 1
    if not counts:
        return None
    ((what, then), count) = counts.most_common(1)[0]
    return what, count, then
