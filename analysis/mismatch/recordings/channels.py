"""What the sensors of a described rig show of a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from analysis.mismatch.recordings.motion import Motion
from analysis.mismatch.rig_description import Seen
from sim_backend.arrangement import Arrangement
from sim_backend.arrays import Real


def rows_of(arrangement: Arrangement, constants: Mapping[str, float]) -> Real:
    """Return (elements, n) the deformation of each element by a unit of each body's displacement."""
    rows = [arrangement.vector(e.row, constants) for e in arrangement.elements]
    return np.array(rows).reshape(-1, len(arrangement.bodies))


def shown_by(seen: Sequence[Seen], arrangement: Arrangement, constants: Mapping[str, float], moved: Motion) -> Real:
    """Return (channels, samples) what is recorded; a body that a mechanism adds may be seen, too."""
    shown = np.empty((len(seen), len(moved.states)))
    displacement, velocity = np.split(moved.states, 2, axis=1)
    of = {"displacement": displacement, "velocity": velocity}
    with np.errstate(over="ignore", invalid="ignore"):  # of a mechanism that runs away: it counts as lost
        if any(sensor.quantity == "acceleration" for sensor in arrangement.sensors):
            of["acceleration"] = _accelerations(arrangement, constants, moved)
        for c, (channel, sensor) in enumerate(zip(seen, arrangement.sensors, strict=True)):
            own = of[sensor.quantity] @ arrangement.vector(sensor.row, constants)
            shown[c] = constants[channel.gain] * own + constants[channel.offset]
    return shown


def _accelerations(arrangement: Arrangement, constants: Mapping[str, float], moved: Motion) -> Real:
    """Return (samples, n) the bodies' accelerations, from their equations."""
    mass, damping, stiffness = arrangement.matrices(constants)
    x, v = np.split(moved.states, 2, axis=1)
    bent = moved.extra @ rows_of(arrangement, constants)
    return np.asarray((moved.force - x @ stiffness.T - v @ damping.T - bent) / mass, np.float64)
