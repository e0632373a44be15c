"""What is fitted: recordings, the rig that should have made them, its filter, and the mechanisms added to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.records import Record, Recordings
from sim_backend.arrangement import Arrangement, Element
from sim_backend.mechanisms.mechanism import AtRest, Mechanism
from sim_backend.state_space import StateSpace

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(slots=True)
class Effort:
    """Work done, in samples through which an extra force was carried; it is the same whatever the machine."""

    spent: float = 0.0


@dataclass(frozen=True, slots=True)
class Problem:
    """Recordings and the linear rig they are held against.

    Attributes
    ----------
    analog
        Declared filter.
    slow
        Poles that every channel may ring on by itself: an offset and the declared high-pass.
    start
        (groups, k) starting values of the constants that differ from load to load.
    scattered
        Whether these differ from impact to impact instead: every record is a group of its own.
    rig_start
        Starting values of constants of the rig for the linear rig alone, where the declared ones are too far off.
    effort
        What has been spent on the problem and on all its parts.
    """

    recordings: Recordings
    arrangement: Arrangement
    analog: StateSpace
    slow: Complex
    start: Real
    scattered: bool = False
    rig_start: Mapping[str, float] = field(default_factory=dict)
    effort: Effort = field(default_factory=Effort, compare=False)

    @property
    def samples(self) -> int:
        """Samples of a channel, all records together."""
        return sum(r.y.shape[1] for r in self.recordings.records)

    def apart(self) -> Problem:
        """Return the same problem with constants of its own for every impact in the place of every load."""
        records = tuple(replace(r, group=i) for i, r in enumerate(self.recordings.records))
        loads = tuple(r.preload_n for r in records)
        start = self.start[[r.group for r in self.recordings.records]]
        recordings = replace(self.recordings, records=records, loads_n=loads)
        return replace(self, recordings=recordings, start=start, scattered=True)

    def only(self, kept: Sequence[int]) -> Problem:
        """Return the same problem with these records alone."""
        records = tuple(self.recordings.records[i] for i in kept)
        return replace(self, recordings=replace(self.recordings, records=records))

    def later(self, skipped: int) -> Problem:
        """Return the same problem with every record beginning so many samples later."""
        rate = self.recordings.sample_rate_hz
        records = tuple(
            replace(
                r,
                y=r.y[:, skipped:],
                raw=r.raw[:, skipped:],
                start_s=r.start_s + skipped / rate,
                pulse=np.concatenate([r.pulse, r.raw[:, :skipped]], axis=1) if r.pulse.size else r.pulse,
                second=r.second - skipped,
            )
            for r in self.recordings.records
        )
        return replace(self, recordings=replace(self.recordings, records=records))


@dataclass(frozen=True, slots=True)
class Term:
    """A mechanism with values of its parameters (and of what stays fixed in it)."""

    mechanism: Mechanism
    values: Mapping[str, float]

    @property
    def nonlinear(self) -> bool:
        """Whether the rig with it is no longer linear, or a channel no longer shows it as it is."""
        m = self.mechanism
        return m.law is not None or m.distort is not None or m.blow


def at_rest(element: Element, values: Mapping[str, float], preload: float) -> AtRest:
    """Return what a law may know of an element."""
    return AtRest(
        preload if element.role == "contact" else 0.0,
        values[element.stiffness] if element.stiffness else 0.0,
        values[element.damping] if element.damping else 0.0,
    )


def law_parameters(term: Term, element: Element, values: Mapping[str, float], record: Record, h: float) -> Real:
    """Return the compiled law's parameters for a record."""
    rest = at_rest(element, values, record.preload_n)
    return np.array([rest.preload, rest.stiffness, rest.damping, h, *term.mechanism.constants(term.values, rest)])


def acted_on(term: Term, arrangement: Arrangement) -> list[int]:
    """Places of the elements that a term's law acts in."""
    return [i for i, e in enumerate(arrangement.elements) if e.role == term.mechanism.acts]
