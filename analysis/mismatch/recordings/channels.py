"""What the sensors of a described rig show of a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from analysis.mismatch.parameters import Term
from analysis.mismatch.recordings.inputs import peaks_of
from analysis.mismatch.recordings.motion import Motion
from analysis.mismatch.recordings.recorded import Recorded
from analysis.mismatch.rig_description import Seen
from sim_backend.arrangement import Arrangement
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import ChannelDistortion, ForceLaw

Values = Mapping[str, float] | Mapping[str, Real]


def rows_of(arrangement: Arrangement, constants: Values) -> Real:
    """Return (..., elements, n) the deformation of each element by a unit of each body's displacement."""
    rows = [arrangement.vector(e.row, constants) for e in arrangement.elements]
    return np.stack(rows, axis=-2)


def shown_by(seen: Sequence[Seen], arrangement: Arrangement, constants: Values, moved: Motion) -> Real:
    """Return (..., channels, samples) what is recorded; a body that a mechanism adds may be seen, too.

    Of several motions each has its constants (runs,).
    """
    shown = np.empty((*moved.states.shape[:-2], len(seen), moved.states.shape[-2]))
    displacement, velocity = np.split(moved.states, 2, axis=-1)
    of = {"displacement": displacement, "velocity": velocity}
    with np.errstate(over="ignore", invalid="ignore"):  # of a mechanism that runs away: it counts as lost
        if any(sensor.quantity == "acceleration" for sensor in arrangement.sensors):
            of["acceleration"] = _accelerations(arrangement, constants, moved)
        for c, (channel, sensor) in enumerate(zip(seen, arrangement.sensors, strict=True)):
            own = (of[sensor.quantity] @ arrangement.vector(sensor.row, constants)[..., None])[..., 0]
            gain, offset = (np.asarray(constants[name])[..., None] for name in (channel.gain, channel.offset))
            shown[..., c, :] = gain * own + offset
    return shown


def told_by(term: Term, recorded: Recorded, recordings: Sequence[Recorded]) -> Sequence[Recorded]:
    """Return the recordings whose peak a distortion is measured by: all, unless it says that it is each one's."""
    return recordings if term.values.get("of_session", 1.0) else [recorded]


def distort(shown: Real, terms: Sequence[Term], recorded: Recorded, recordings: Sequence[Recorded], at: slice) -> None:
    """Make of some samples of the channels (c, n) what the terms make of them; of a motion that ran away nothing.

    An accelerometer on a shaken rig bends or delays the base's acceleration as well.
    """
    for term in terms if np.all(np.isfinite(shown)) else ():
        m, rows = term.mechanism, list(term.place)
        if isinstance(m, ChannelDistortion) and m.of == "sensor":
            values = {**term.values, **peaks_of([_whole(r, rows) for r in told_by(term, recorded, recordings)])}
            base = 0.0 if recorded.base is None else recorded.base[rows, at]
            shown[rows] = m.distort(shown[rows] + base, {**values, "thinned": recorded.every}, recorded.rate_hz) - base


def _whole(recorded: Recorded, rows: Sequence[int]) -> Real:
    """Return channels (c, n) as sensors showed them, with the base's acceleration."""
    return recorded.outputs[rows] + (0.0 if recorded.base is None else recorded.base[rows])


def memories(terms: Sequence[Term], free: bool) -> list[tuple[int, int]]:
    """Return what was before the first sample and is remembered: numbers of a term, and of its channel or element.

    Of ``free`` decays what channels remember follows from the motion before.
    """
    found = []
    for i, term in enumerate(terms):
        m = term.mechanism
        if (isinstance(m, ChannelDistortion) and m.forgets and not free) or (isinstance(m, ForceLaw) and m.carried):
            found += [(i, where) for where in term.place]
    return found


def remembered(terms: Sequence[Term], of: Sequence[tuple[int, int]], memory: Real, seconds: Real) -> dict[int, Real]:
    """Return (n,) what channels show of what was before the first sample, at the times since it; see `memories`."""
    out: dict[int, Real] = {}
    for value, (i, channel) in zip(memory.tolist(), of, strict=True):
        m = terms[i].mechanism
        if isinstance(m, ChannelDistortion) and m.forgets is not None:
            shown = value * np.exp(-m.forgets(terms[i].values) * seconds)
            out[channel] = out.get(channel, 0.0) + shown
    return out


def _accelerations(arrangement: Arrangement, constants: Values, moved: Motion) -> Real:
    """Return (..., samples, n) the bodies' accelerations, from their equations."""
    mass, damping, stiffness = arrangement.matrices(constants)
    x, v = np.split(moved.states, 2, axis=-1)
    bent = moved.extra @ rows_of(arrangement, constants)
    pulled = x @ stiffness.swapaxes(-1, -2), v @ damping.swapaxes(-1, -2)
    return np.asarray((moved.force - pulled[0] - pulled[1] - bent) / mass[..., None, :], np.float64)
