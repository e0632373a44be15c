"""How a described rig moves at the samples of a recording, and before the first of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from sim_backend.arrays import Real

BEFORE = 32  # samples before the first that what remembers is shown
GROWTH = 10.0  # of a motion followed backwards, up to which it is: what has died out cannot be told


@dataclass(frozen=True, slots=True)
class Motion:
    """At the samples: states (n, 2 bodies), extra forces (n, elements), inputs' forces on the bodies (n, bodies)."""

    states: Real
    extra: Real
    force: Real

    def begun_earlier(self, mass: Real, damping: Real, stiffness: Real, rate_hz: float) -> Motion:
        """Return a free decay with samples before its first, as the linear rig (n,), (n, n), (n, n) came there."""
        n = mass.size
        back = np.zeros((2 * n, 2 * n))
        back[:n, n:] = -np.eye(n) / rate_hz
        back[n:, :n], back[n:, n:] = stiffness / mass[:, None] / rate_hz, damping / mass[:, None] / rate_hz
        growth = float(np.linalg.eigvals(back).real.max())
        count = BEFORE if growth * BEFORE <= math.log(GROWTH) else int(math.log(GROWTH) / growth)
        step, states = expm(back), [self.states[0]]
        for _ in range(count):
            states.append(step @ states[-1])
        still = [np.zeros((count, rows.shape[1])) for rows in (self.extra, self.force)]
        return Motion(
            np.concatenate([states[:0:-1], self.states]) if count else self.states,
            np.concatenate([still[0], self.extra]),
            np.concatenate([still[1], self.force]),
        )
