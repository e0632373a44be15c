"""Oscillations that a distortion may have made of modes: a sensor that saturates, a spring that hardens.

The square and the cube of a sum of decays are sums of decays, too, at sums of two or three of their exponents: at three
times a frequency with three times its decay, at the frequency itself with three times its decay, and between two modes.
Few structures have modes there, in frequency and in decay; a string of one damping ratio has all of its own there, so
that what is found is a doubt.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations_with_replacement

import numpy as np
from scipy import stats

from analysis.modal.modes import ModeEstimate

WEAKER = 0.3  # of the amplitude of the weakest mode it is made of, that a product has at most
OFF = 0.15  # of its decay, by which a product may be off, beside its error: a distortion has higher orders, too
BASES = 4  # strongest modes, of which a distortion makes others that are seen
MOST = 6  # modes of a structure, beyond which sums of exponents lie everywhere (2 of 19 of a bolted beam are near one)
BY_CHANCE = 0.3  # chance of as many modes near the sums of others
ALIKE = 0.2  # chance of two decays to be as near as that
SIGNS = 3  # frequencies of a sum of three exponents, by its signs
ERRORS = 3.0  # standard errors by which it may be off


def products_of_modes(modes: Sequence[ModeEstimate]) -> dict[int, tuple[int, ...]]:
    """Which modes lie where a distortion of stronger ones puts an oscillation: index, and those of what it is made of.

    Examples
    --------
    >>> from analysis.modal.modes import mode_from_sampled_pole
    >>> exact, one = 1e-12 * np.eye(2), np.ones(1, complex)
    >>> base = mode_from_sampled_pole(np.exp(-0.01 + 0.1j), exact, one, 1e3)
    >>> third = mode_from_sampled_pole(np.exp(-0.03 + 0.3j), exact, 0.1 * one, 1e3)
    >>> products_of_modes([base, third])
    {1: (0, 0, 0)}
    """
    strength = [float(np.linalg.norm(mode.amplitude)) for mode in modes]
    highest = max((abs(mode.pole) for mode in modes), default=1.0)
    found: dict[int, tuple[int, ...]] = {}
    base: list[int] = []
    expected = 0.0
    for made in (int(i) for i in np.argsort(strength)[::-1]):
        stronger = [i for i in base[:BASES] if strength[made] < WEAKER * strength[i]]
        sums = [parts for order in (3, 2) for parts in combinations_with_replacement(stronger, order)]
        apart = [_apart(modes[made], [modes[i].pole for i in parts]) for parts in sums]
        width = max((error for _, error in apart), default=0.0)
        near = [parts for parts, (off, _) in zip(sums, apart, strict=True) if off < ERRORS]
        expected += ALIKE * SIGNS * len(sums) * 2 * ERRORS * width / highest
        if near:
            found[made] = near[0]
        else:
            base.append(made)
    # where there are many modes, some are near the sums of others by chance
    told = len(base) <= MOST and stats.poisson.sf(len(found) - 1, expected) < BY_CHANCE
    return found if told else {}


def _apart(mode: ModeEstimate, poles: list[complex]) -> tuple[float, float]:
    """How far a mode is from a sum of exponents, each or its conjugate, in errors; and that of the frequency, rad/s."""
    decay = -sum(s.real for s in poles)
    turns = {poles[0].imag}
    for s in poles[1:]:
        turns = {t + sign * s.imag for t in turns for sign in (1, -1)}
    decay_error = abs(mode.pole) * mode.damping_ratio.standard_error + OFF * decay
    turn_error = 2 * np.pi * mode.frequency_hz.standard_error + OFF * decay / ERRORS
    off = min(abs(abs(t) - mode.pole.imag) for t in turns) / turn_error
    return max(off, abs(-mode.pole.real - decay) / decay_error), turn_error


def perhaps_distorted(modes: Sequence[ModeEstimate]) -> list[str]:
    """A sentence about modes that a distortion may have made of others."""
    made = products_of_modes(modes)
    if not made:
        return []

    def hz(indices: Iterable[int]) -> str:
        return ", ".join(f"{modes[i].frequency_hz.value:.5g}" for i in sorted(set(indices)))

    return [
        f"what is at {hz(made)} Hz is where a distortion of the modes at "
        f"{hz(k for parts in made.values() for k in parts)} Hz would put an oscillation, in frequency and in decay: if "
        "a sensor saturates or a spring hardens it may be no mode, and the damping of these modes seems less than it is"
    ]
