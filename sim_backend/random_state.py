"""Random number generators whose whole state is JSON."""

from __future__ import annotations

from typing import Any

import numpy as np


def generator(seed: int, role: int) -> np.random.Generator:
    """Return the generator of one part: the same for the same seed and role, unlike that of any other role."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, role])))


def state_of(rng: np.random.Generator) -> dict[str, Any]:
    """Return the generator's state as JSON types; its 128-bit numbers are integers."""
    return dict(rng.bit_generator.state)


def restore(rng: np.random.Generator, state: dict[str, Any]) -> None:
    """Continue where `state_of` was called."""
    rng.bit_generator.state = state
