"""Files like those of other programs, to try the README's commands with; written into the folder it is run in.

    python docs/sample-files/make.py

``r.csv``
    A body of 0.8 kg on a spring of 3 kN/m that hardens with the cube of its deflection, shaken by a measured force:
    a rig that is not the tester. ``rig init`` describes it, ``diagnose --rig`` says what is left out.
``other.mat``
    Two accelerometers on something that was tapped: three modes.
``upper.csv``, ``lower.csv``
    Profilometer scans of two ground surfaces.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.io import savemat
from scipy.ndimage import gaussian_filter1d

SEED = 7
RATE_HZ, SECONDS = 500.0, 16.0
MASS_KG, DAMPING_N_S_PER_M, STIFFNESS_N_PER_M, CUBIC_N_PER_M3 = 0.8, 1.5, 3e3, 3e7


def shaken(random: np.random.Generator) -> None:
    """Write r.csv."""
    time = np.arange(round(RATE_HZ * SECONDS)) / RATE_HZ
    lines_hz = np.arange(1, 25 * int(SECONDS)) / SECONDS
    phases = random.uniform(0, 2 * np.pi, lines_hz.size)
    pushed = np.cos(2 * np.pi * np.outer(time, lines_hz) + phases).sum(axis=1)
    pushed *= 2.0 / pushed.std()
    force = CubicSpline(time, pushed)

    def rate(t: float, state: np.ndarray) -> list[float]:
        x, v = state
        held = STIFFNESS_N_PER_M * x + CUBIC_N_PER_M3 * x**3 + DAMPING_N_S_PER_M * v
        return [v, (float(force(t)) - held) / MASS_KG]

    x = solve_ivp(rate, (0, time[-1]), [0.0, 0.0], t_eval=time, rtol=1e-8, atol=1e-11, max_step=1e-3).y[0]
    x += random.normal(0, 2e-6, x.size)
    header = "time [s],force [N],displacement [m]"
    np.savetxt("r.csv", np.column_stack([time, pushed, x]), "%.6e", ",", header=header, comments="")


def tapped(random: np.random.Generator) -> None:
    """Write other.mat."""
    time = np.arange(8192) / 8192
    modes = [(181.0, 0.004, 1.0, 0.8), (412.0, 0.002, 0.6, -0.5), (1290.0, 0.006, 0.3, 0.4)]
    decays = [np.exp(-2 * np.pi * f * z * time) * np.sin(2 * np.pi * f * time) for f, z, _, _ in modes]
    channels = {
        name: sum(decay * mode[at] for decay, mode in zip(decays, modes, strict=True))
        + random.normal(0, 3e-3, time.size)
        for name, at in (("acc1", 2), ("acc2", 3))
    }
    savemat("other.mat", {"time": time, **channels})


def scanned(random: np.random.Generator, name: str) -> None:
    """Write one scan: 4 mm in steps of 0.5 um."""
    heights = gaussian_filter1d(random.normal(size=8000), 12)
    heights *= 1.2e3 / heights.std()
    rows = np.column_stack([0.5 * np.arange(heights.size), heights])
    np.savetxt(name, rows, "%.4f", ",", header="x_um,z_nm", comments="")


def main() -> None:
    """Write all of them."""
    random = np.random.default_rng(SEED)
    shaken(random)
    tapped(random)
    scanned(random, "upper.csv")
    scanned(random, "lower.csv")


if __name__ == "__main__":
    main()
