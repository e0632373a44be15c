"""Shapes of the modes of two recordings beside each other: which modes of one are those of the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.results import RecordingModes
from daq.errors import RecordingError


@dataclass(frozen=True, slots=True)
class Beside:
    """Modes of a recording beside those of another.

    Attributes
    ----------
    other
        Modes of the other recording, their shapes over the channels in the order of the first.
    mac
        (m, n) modal assurance criterion: a row a mode of the first recording, a column a mode of the other.
    channels
        Which channel of the first was compared with which of the other.
    """

    other: RecordingModes
    mac: NDArray[np.float64]
    channels: tuple[tuple[str, str], ...]

    @property
    def matched_by_order(self) -> bool:
        """Whether the names did not say which channel is which."""
        return any(first != second for first, second in self.channels)


def beside(modes: RecordingModes, names: Sequence[str], other: RecordingModes, other_names: Sequence[str]) -> Beside:
    """Compare the shapes of two recordings over the same channels: those of one name, else those at one place.

    Raises
    ------
    RecordingError
        They have not as many channels, or one alone, over which all shapes are the same.
    """
    if len(names) != len(other_names):
        raise RecordingError(
            f"{other.source}: has {len(other_names)} channels and {modes.source} {len(names)}: "
            "shapes are compared over the same channels"
        )
    if len(names) == 1:
        raise RecordingError(f"{modes.source}: has one channel, over which all shapes are the same")
    if set(names) == set(other_names):
        order = [list(other_names).index(name) for name in names]
    else:
        order = list(range(len(names)))
    ordered = replace(
        other, modes=tuple(replace(mode, shape=tuple(mode.shape[at] for at in order)) for mode in other.modes)
    )
    return Beside(ordered, modes.mac(ordered), tuple((a, other_names[at]) for a, at in zip(names, order, strict=True)))


def with_beside(mapping: dict[str, Any], found: Beside | None) -> dict[str, Any]:
    """Return a `mesotap-modes` mapping with ``mac_with``, where there was something to compare with."""
    if found is None:
        return mapping
    compared = {
        "source": found.other.source,
        "frequency_hz": [mode.frequency_hz.value for mode in found.other.modes],
        "channels": [list(pair) for pair in found.channels],
        "mac": [[float(value) if np.isfinite(value) else None for value in row] for row in found.mac],
    }
    return {**mapping, "mac_with": compared}
