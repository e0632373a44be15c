"""Fits of recordings that are made once, however often a selection is made again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.fit import SimulatedFit


@dataclass(frozen=True, slots=True)
class FittedOnce:
    """Fits by the fit that they began with, which is kept, and the terms that were added."""

    kept: dict[tuple[Any, ...], tuple[SimulatedFit | None, float, SimulatedFit]] = field(default_factory=dict)

    def once(
        self, begun: SimulatedFit | None, terms: Sequence[Term], to_beat: float, fitted: Callable[[], SimulatedFit]
    ) -> SimulatedFit:
        """Return a fit, made now if it has not been; one that may be given up does for any that may be earlier.

        Parameters
        ----------
        to_beat
            Objective from which the fit may have been given up: if that happened it does not do for a higher one.
        """
        key = (id(begun), *map(_identity, terms))
        if key in self.kept:
            _, beaten, known = self.kept[key]
            if known.objective < beaten or to_beat <= beaten:
                return known
        found = fitted()
        self.kept[key] = begun, to_beat, found
        return found


def _identity(term: Term) -> tuple[Any, ...]:
    free = tuple(q.name for q in term.mechanism.parameters)
    return term.mechanism.id, term.place, free, tuple(sorted(term.values.items()))
