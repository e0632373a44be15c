"""Air between two flats: a film that is squeezed gives way at its edges slowly, and springs back faster."""

from __future__ import annotations

import math

from sim_backend.force_law import STEP
from sim_backend.mechanisms.kinds import AtRest, Derived, ForceLaw, Quantity, Values, law

SIDE, GAP, PRESSURE, VISCOSITY = "film_side_m", "film_gap_m", "pressure_pa", "viscosity_pa_s"
AIR = {PRESSURE: 101325.0, VISCOSITY: 1.83e-5}  # of 20 degrees C
MODES = {2: 1.0, 10: 2 / 9, 18: 1 / 81, 26: 2 / 25, 34: 2 / 225, 50: 1 / 625 + 2 / 49}
"""m^2 + n^2 of pressure modes with odd m and n to their sum of 1 / (m n)^2; faster ones give way at once."""
LOSS = 0.42171  # c h^3 / (mu L^4) of a square film without compression


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """Pressure modes that leak, f' + f / tau = k v each with p[6 + 2 i] = k, p[7 + 2 i] = tau, and a damper p[5]."""
    out = force + p[5] * v
    for i in range(int(p[4])):
        z = p[STEP] / p[7 + 2 * i]
        grown = math.exp(-z)
        mean = (1.0 - grown) / z
        second = (1.0 - mean) / z
        own = before[i] * grown
        if before[23] > 0.0:
            own += p[6 + 2 * i] * p[STEP] * (before[22] * (mean - second) + v * second)
        after[i] = own
        out += own
    after[22], after[23] = v, 1.0
    return out


def stiffness(values: Values) -> float:
    """Return the film's stiffness where it has no time to leak, N/m."""
    return values.get(PRESSURE, AIR[PRESSURE]) * values[SIDE] ** 2 / values[GAP]


def constants(values: Values, rest: AtRest) -> list[float]:
    """Return count, damper, and stiffness and time of each pressure mode."""
    lag = 12 * values[VISCOSITY] * values[SIDE] ** 2 / (values[PRESSURE] * values[GAP] ** 2 * math.pi**2)
    modes = [(64 / math.pi**4 * weight * stiffness(values), lag / q) for q, weight in MODES.items()]
    whole = LOSS * values[VISCOSITY] * values[SIDE] ** 4 / values[GAP] ** 3
    damper = max(whole - sum(k * tau for k, tau in modes), 0.0)
    return [len(modes), damper, *(number for mode in modes for number in mode)]


MECHANISM = ForceLaw(
    id="air_film",
    component="contact",
    summary="air between flats: stiffness and damping of a squeezed film",
    source=(
        "linearised Reynolds equation: Langlois, Q. Appl. Math. 20 (1962) 131; Blech, J. Lubr. Technol. 105 (1983) 615"
    ),
    parameters=(
        Quantity(SIDE, "m", 1e-6, 1.0, "side of the square flat", log=True),
        Quantity(GAP, "m", 1e-9, 1e-2, "mean distance of the flats", log=True),
    ),
    strength=None,
    trials=lambda scale: [{SIDE: 1.35e-3, GAP: 1e-6, **AIR}],
    law=force_law,
    fits=("contact",),
    preloaded=True,
    constants=constants,
    derived=(Derived("film_stiffness_n_per_m", "N/m", stiffness, positive=True, meaning="stiffness of the film"),),
    hidden=(
        "The film is linear, and a decay shows the contact at one frequency for each load: what the film adds there is "
        "part of k_c and c_c. It cannot damp the contact more than all that was measured, which bounds how close and "
        "how flat the faces are (docs/benchmarks/air-film.md). A test in vacuum or in another gas tells it."
    ),
    statement=lambda values, name: (
        f"Air between the faces of the {name}, {1e6 * values[GAP]:.2g} um apart, adds up to {stiffness(values):.3g} "
        "N/m and damps it."
    ),
)
