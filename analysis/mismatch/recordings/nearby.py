"""Simulations for parameters near others, of which differences are taken."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.recordings.channels import rows_of
from analysis.mismatch.recordings.motion import Motion, Own, Place
from analysis.mismatch.recordings.simulation import Simulation
from sim_backend.acting import laws_in
from sim_backend.arrays import Real
from sim_backend.mechanisms.kinds import ForceLaw

BESIDE: Final = 2  # samples on either side of a jump that no difference is taken of
HELD: Final = 1e-6  # of its largest rate, below which an element stands still


class Near(Simulation):
    """A simulation whose steps are divided along a recording as those of a motion nearby are.

    Of what is fitted, or of so many samples from its beginning. Beside a force that jumps, what another division
    changes is far more than what a small step of a parameter does. And what an accelerometer shows next to a jump is
    as nearby: that the jump passes a sample is no slope, and would be taken for a thousand times what the recording
    tells.
    """

    def __init__(self, simulation: Simulation, x: Real, own: Own, number: int, samples: int | None, moved: Motion):
        vars(self).update(vars(simulation))
        at = simulation.span(number, False, samples)
        self.divided = {number: (at, moved.division)}
        self.near, self.beside, self.shown = (number, at), np.zeros((0, 0), np.bool_), np.zeros((0, 0))
        if simulation.jumps and any(s.sensor.quantity == "acceleration" for s in self.rig.seen):
            self.shown, _ = simulation.run(x, own, number, samples=samples)
            accelerations = np.array([s.sensor.quantity == "acceleration" for s in self.rig.seen])
            self.beside = accelerations[:, None] & self._beside_jumps(self.read(x)[0], moved)

    def _beside_jumps(self, constants: dict[str, float], moved: Motion) -> NDArray[np.bool_]:
        """Return (n,) which samples lie next to where an element with a force that jumps turns about or stops."""
        jumping = sorted({e for _, m, e in laws_in(self.terms) if isinstance(m, ForceLaw) and m.jumps})
        rates = rows_of(self.arrangement, constants)[jumping] @ moved.states[:, self.n :].T
        way = np.sign(rates) * (np.abs(rates) > HELD * np.abs(rates).max(axis=1, keepdims=True))
        turned = np.any(way[:, 1:] != way[:, :-1], axis=0)
        reach = np.ones(2 * BESIDE, np.bool_)
        return np.convolve(turned, reach)[BESIDE - 1 : BESIDE + turned.size] > 0

    def runs(
        self, places: Sequence[Place], number: int, whole: bool = False, samples: int | None = None
    ) -> tuple[Real, slice]:
        """Return what `Simulation.runs` does, next to jumps what is shown nearby."""
        shown, at = super().runs(places, number, whole, samples)
        if self.beside.size and (number, at) == self.near:
            shown = np.where(self.beside, self.shown, shown)
        return shown, at


def nearby(simulation: Simulation, x: Real, own: Own, number: int, samples: int | None = None) -> Simulation:
    """Return the simulation for parameters near these, along one recording; see `Near`."""
    at = simulation.span(number, False, samples)
    if not laws_in(simulation.terms):
        return simulation
    moved = simulation.motion(x, own, number, at, whole=False, keeps_division=True)
    return simulation if moved is None else Near(simulation, x, own, number, samples, moved)


def roughly(simulation: Simulation) -> Simulation:
    """Return the simulation with errors that are little beside the noise, for what a score test tries."""
    found = copy.copy(simulation)
    found.rough = True
    return found


def beside_jumps(simulation: Simulation) -> NDArray[np.bool_]:
    """Return (c, n) at which samples differences tell nothing; empty where they do everywhere."""
    return simulation.beside if isinstance(simulation, Near) else np.zeros((0, 0), np.bool_)
