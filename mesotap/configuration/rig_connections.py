"""Whether the bodies of a described rig hang together: what is connected to nothing says nothing of the others."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def unconnected(bodies: Sequence[str], between: Iterable[tuple[str, str]], ground: str) -> list[str]:
    """Return the bodies of the smallest group that nothing connects to the ground or to the others; empty if none is.

    Examples
    --------
    >>> unconnected(["a", "b", "c"], [("a", "ground"), ("b", "c")], "ground")
    ['b', 'c']
    >>> unconnected(["a", "b"], [("a", "b")], "ground")
    []
    """
    groups = [{body} for body in bodies]
    for ends in map(set, between):
        joined = [g for g in groups if g & ends]
        groups = [g for g in groups if not g & ends] + [ends.union(*joined)]
    if len(groups) < 2:
        return []
    least = min(groups, key=lambda g: (ground in g, len(g)))
    return [body for body in bodies if body in least]


def unconnected_words(apart: Sequence[str]) -> str:
    """Say what nothing connects, and what to do."""
    if len(apart) == 1:
        return (
            f"bodies.{apart[0]}: nothing connects it to the others or to the ground; add a spring, joint, slide or "
            "contact between it and another, or leave it out"
        )
    return (
        f"bodies.{', '.join(apart)}: nothing connects them to the others or to the ground; add a spring, joint, slide "
        "or contact between one of them and another, or leave them out"
    )
