"""Which constants of a described rig its inputs and sensors determine, before anything is fitted.

What the channels show at some frequencies is differentiated with respect to the logarithms of all unknown constants.
Directions in which nothing changes are combinations that no recording of these channels tells, however long it is and
however little noise it has.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from analysis.mismatch.recordings.pieces import Piece
from analysis.mismatch.recordings.spectral_model import LOGARITHMIC, POLYNOMIAL, SpectralModel, Unknowns
from analysis.mismatch.rig_description import DescribedRig
from sim_backend.arrangement import LOAD, Arrangement, Parameter
from sim_backend.arrays import Real

DRAWS: Final = 3  # of unknown constants: a direction that is flat by chance in one is not in another
SEED: Final = 11
TYPICAL: Final = 60.0  # rad/s, of a rig of which nothing is declared
VARIED: Final = 0.4  # standard deviation of the logarithms about what is usual
LINES: Final = 160  # frequencies
LOWEST, HIGHEST = 0.2, 3.0  # of them, over the lowest and the highest mode
FLAT: Final = 1e-9  # relative singular value below which a direction changes nothing
TAKES_PART: Final = 1e-3  # share of a combination from which on a constant belongs to it
PREFERRED: Final = ("mass", "gain of input", "gain of sensor", "stiffness", "damping")  # to be declared


@dataclass(frozen=True, slots=True)
class Undetermined:
    """A constant that the channels do not determine unless one of others, which change with it, is declared.

    Attributes
    ----------
    name
        The constant that is best declared.
    with_it
        Constants that change with it while all channels show the same; none where no channel shows it at all.
    powers
        For each of them, the power of the constant's factor by which it is multiplied.
    """

    name: str
    with_it: tuple[str, ...] = ()
    powers: tuple[float, ...] = ()

    @property
    def statement(self) -> str:
        """Say what cannot be told, and what to do."""
        if not self.with_it:
            return f"no channel shows the {self.name}: give its value, or leave out what it belongs to"
        together = all(abs(p - 1) < TAKES_PART for p in self.powers)
        how = "by the same factor" if together else "against each other"
        names = [f"the {name}" for name in (self.name, *self.with_it)]
        return (
            f"{', '.join(names[:-1])} and {names[-1]} can change {how} and all channels show the same: give one of "
            f"them, best {names[0]}"
        )


def unknown(rig: DescribedRig) -> list[Parameter]:
    """Return the constants that nothing declares; offsets, which every recording shows as its mean, are left out."""
    return [p for p in rig.arrangement.parameters if p.unit and math.isinf(p.uncertainty)]


def undetermined(rig: DescribedRig) -> tuple[Undetermined, ...]:
    """Return the constants that have to be declared for all others to be determined, with what depends on them.

    Examples
    --------
    >>> from mesotap.configuration.rig_files import parse_rig
    >>> rig = parse_rig('''
    ... bodies: {mass: 1.0}
    ... springs: [{between: [mass, ground]}]
    ... inputs: [{channel: u, force_on: mass, gain: unknown}]
    ... sensors: [{channel: x, of: mass, shows: displacement, gain: unknown}]
    ... ''')
    >>> [(u.name, u.with_it) for u in undetermined(rig)]
    [('gain of input 1', ('gain of sensor 1',))]
    """
    names = sorted((p.name for p in unknown(rig)), key=_preference)
    if not names:
        return ()
    random = np.random.default_rng(SEED)
    flat = min((flat_directions(rig, names, random) for _ in range(DRAWS)), key=len)
    return tuple(_told(names, row) for row in reduced(flat))


def left_open(rig: DescribedRig) -> set[str]:
    """Return all constants that the channels do not determine: what a fit says of one of these is a choice."""
    return {name for one in undetermined(rig) for name in (one.name, *one.with_it)}


def left_open_beside(rig: DescribedRig, arrangement: Arrangement) -> set[str]:
    """Return what `left_open` does, of a rig with added bodies: nothing of their constants is declared.

    What else they have, such as what a sensor shows of a strain, is taken as it was found.
    """
    own = {p.name for p in rig.arrangement.parameters}
    parameters = (p if p.name in own else _undeclared(p) for p in arrangement.parameters)
    return left_open(replace(rig, arrangement=replace(arrangement, parameters=tuple(parameters))))


def _undeclared(parameter: Parameter) -> Parameter:
    if parameter.unit in LOGARITHMIC:
        return replace(parameter, value=math.nan)
    return replace(parameter, uncertainty=0.0)


def _preference(name: str) -> int:
    return next((i for i, kind in enumerate(PREFERRED) if name.startswith(kind)), len(PREFERRED))


def _told(names: Sequence[str], row: Real) -> Undetermined:
    first = int(np.argmax(np.abs(row) > TAKES_PART))
    others = [i for i in range(len(names)) if i != first and abs(row[i]) > TAKES_PART]
    return Undetermined(names[first], tuple(names[i] for i in others), tuple(float(row[i]) for i in others))


def flat_directions(rig: DescribedRig, names: Sequence[str], random: np.random.Generator) -> Real:
    """Return (r, k) orthonormal directions of constants' logarithms in which no channel of a rig at random changes."""
    unknowns = Unknowns(rig, _declared_frequency(rig))
    x = np.concatenate([VARIED * random.standard_normal(len(unknowns.bent)), np.ones(len(unknowns.gains))])
    _, slopes = shown_by(unknowns, x, random).evaluated(x)
    slopes = slopes[:, [unknowns.names.index(name) for name in names]]
    _, s, v = np.linalg.svd(slopes, full_matrices=True)
    s = np.concatenate([s, np.zeros(len(names) - s.size)])
    return np.asarray(v[s <= FLAT * max(s[0], 1e-300)], np.float64)


def shown_by(unknowns: Unknowns, x: Real, random: np.random.Generator, weight: float = 0.0) -> SpectralModel:
    """Return a model of what the channels of a rig with such constants show at some frequencies, without noise.

    Parameters
    ----------
    x
        (k,) the constants.
    weight
        Rate at which all that is shown is made to fade, over the mean mode; resonances are as much wider.
    """
    rig = unknowns.rig
    modes = 2 * math.pi * rig.arrangement.undamped_hz(unknowns.constants(x))
    modes = modes[modes > FLAT * modes.max()] if np.any(modes > 0) else np.ones(1)
    centre = float(np.mean(modes))
    s = weight * centre + 1j * np.geomspace(LOWEST * modes.min(), HIGHEST * modes.max(), LINES)
    inputs = random.standard_normal((2, len(rig.drives), LINES))
    nothing = np.zeros((len(rig.seen), LINES), np.complex128)
    piece = Piece(s, nothing, inputs[0] + 1j * inputs[1], np.ones(len(rig.seen)))
    bodies = len(rig.arrangement.bodies)
    begun = np.zeros(2 * bodies + (POLYNOMIAL + 1) * len(rig.seen))
    if not rig.drives:  # what rings freely began somehow
        begun[: 2 * bodies] = random.standard_normal(2 * bodies)
    outputs = SpectralModel(unknowns, [piece], centre).made(x, begun)
    return SpectralModel(unknowns, [replace(piece, outputs=outputs)], centre)


def _declared_frequency(rig: DescribedRig) -> float:
    """Return the angular frequency, rad/s, that goes with the stiffnesses and masses that are declared."""
    known = {p.name: p.value for p in rig.arrangement.parameters if p.scope != LOAD and p.value > 0}
    stiff = [known[e.stiffness] for e in rig.arrangement.elements if e.stiffness in known]
    masses = [known[m] for m in rig.arrangement.masses if m in known] or [1.0]
    return math.exp((np.mean(np.log(stiff)) - np.mean(np.log(masses))) / 2) if stiff else TYPICAL


def reduced(directions: Real) -> Real:
    """Return the same space (r, k) by rows in reduced echelon form: each begins with a one that no other row has."""
    rows = directions.copy()
    done = 0
    for column in range(rows.shape[1]):
        if done == len(rows):
            break
        pivot = done + int(np.argmax(np.abs(rows[done:, column])))
        if abs(rows[pivot, column]) < TAKES_PART:
            continue
        rows[[done, pivot]] = rows[[pivot, done]]
        rows[done] /= rows[done, column]
        for other in range(len(rows)):
            if other != done:
                rows[other] -= rows[other, column] * rows[done]
        done += 1
    return rows[:done]
