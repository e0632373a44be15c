"""The masses of Eq. 9: the blocks, and what of the tube springs moves with them at each mode's frequency."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.estimate import Estimate
from daq.records import RigDescription
from rig.settings import Masses, Springs
from rig.tube import OwnMode


@dataclass(frozen=True, slots=True)
class MovingMasses:
    """m1 and m2 at rest, with their (2, 2) covariance, kg2; the tube springs' own mode adds to both with frequency."""

    m1: Estimate
    m2: Estimate
    covariance: NDArray[np.float64]
    own_mode: OwnMode | None = None

    def at(self, f_hz: float) -> tuple[Estimate, Estimate]:
        """Return both masses as they move at ``f_hz``."""
        more = 0.0 if self.own_mode is None else self.own_mode.added_mass(f_hz)
        return replace(self.m1, value=self.m1.value + more), replace(self.m2, value=self.m2.value + more)


def moving_masses(rig: RigDescription, masses: Masses, springs: Springs) -> tuple[MovingMasses, list[str]]:
    """Return the masses of a session, and a note where the tube springs were not in them yet.

    Parameters
    ----------
    rig
        Its header. Where that says how much of the tube springs is in its masses, this counts.
    masses, springs
        Of the configuration: uncertainties, and the inertia of the tube springs for a header that says nothing of it.
    """
    inertia, notes = springs.inertia(), []
    added, own_mode = 0.0, rig.tube_mode
    if inertia is not None and not rig.tube_added_kg:
        added, own_mode = inertia.added_kg, inertia.own_mode
        notes.append(
            f"{1e3 * added:.3g} g of each tube spring, which move with its block, are added to the session's masses"
        )
    common = 0.0 if inertia is None else inertia.uncertainty_kg
    covariance = np.eye(2) * masses.uncertainty_kg**2 + common**2
    error = float(np.sqrt(covariance[0, 0]))
    m1, m2 = (Estimate(m + added, error) for m in (rig.m1_kg, rig.m2_kg))
    return MovingMasses(m1, m2, covariance, own_mode), notes
