"""Bodies with dry friction between two of them, from event to event: matrix exponentials, and roots for the events."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from sim_backend.arrays import Real

XTOL = 1e-16  # s


def exact_motion(
    rig: tuple[Real, Real, Real], pushed: Real, rubs: Real, friction: float, force: Real, h: float
) -> Real:
    """Return (n, 2 bodies) states at the ends of steps, from rest.

    Parameters
    ----------
    rig
        Mass (bodies,), damping and stiffness (bodies, bodies).
    pushed, rubs
        (bodies,) what a unit of the force pushes, and the row whose rate friction works against.
    force
        (2 n - 1,) at every half step: a parabola over each.
    """
    mass, damping, stiffness = rig
    n, size = mass.size, 2 * mass.size
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness / mass[:, None], -damping / mass[:, None]]])
    b, g = np.append(np.zeros(n), pushed / mass), np.append(np.zeros(n), -rubs / mass)
    rate = np.append(np.zeros(n), rubs)
    inertia = 1 / (rubs @ (rubs / mass))
    held = (
        inertia * (rate @ a),
        inertia * (rate @ b),
    )  # friction that keeps the rate as it is, by the state and the force

    def generator(a: Real, b: Real, g: Real) -> Real:  # of the state, the force with two derivatives, and friction
        out = np.zeros((size + 4, size + 4))
        out[:size, :size], out[:size, size], out[:size, size + 3] = a, b, g
        out[size, size + 1] = out[size + 1, size + 2] = 1.0
        return out

    slides, rests = generator(a, b, g), generator(a + np.outer(g, held[0]), b + g * held[1], 0 * g)
    whole = {id(m): expm(m * h) for m in (slides, rests)}

    def after(m: Real, z: Real, t: float) -> Real:
        return np.asarray((whole[id(m)] if t == h else expm(m * t)) @ z)

    def needed(z: Real) -> float:
        return float(held[0] @ z[:size] + held[1] * z[size])

    z, sign, states = np.zeros(size + 4), 0, [np.zeros(size)]
    for first, middle, last in zip(force[:-2:2], force[1::2], force[2::2], strict=True):
        bend = 4 * (first + last - 2 * middle) / h**2
        z[size : size + 3] = first, (last - first) / h - bend * h / 2, bend
        left = h
        while left > 0:
            m, z[size + 3] = (slides, sign * friction) if sign else (rests, 0.0)
            end = after(m, z, left)

            def beyond(t: float, m: Real = m, z: Real = z, sign: int = sign) -> float:
                at = expm(m * t) @ z
                return -sign * float(rate @ at[:size]) if sign else abs(needed(at)) - friction

            if (sign and -sign * rate @ end[:size] <= 0) or (not sign and abs(needed(end)) <= friction):
                z = end
                break
            least = 1e-13 if sign else 0.0
            t = float(brentq(beyond, least, left, xtol=XTOL)) if beyond(least) < 0 else 0.0
            z, left = expm(m * t) @ z, left - t
            if sign:
                z[n:size] -= rubs / mass * inertia * (rate @ z[:size])  # what is left of the root
            sign = 0 if sign and abs(needed(z)) <= friction else int(np.sign(needed(z)))
        states.append(z[:size].copy())
    return np.array(states)
