"""The cheapest locator: stiffness and damping of the contact let free in windows of time, or of amplitude.

About a fit of the linear rig each segment is linear in small changes of ``k_c`` and ``c_c`` within a window: the force
that such a change adds along the fitted motion, sent through rig, filter and whitening. A constant that has to change
with time or amplitude is none.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.ring_downs.model import SUBSTEPS
from analysis.mismatch.ring_downs.problem import RingDownFit
from analysis.mismatch.ring_downs.response import whiten
from sim_backend.arrays import Real

TIME_S = (0.0, 1e-3, 2e-3, 4e-3, 8e-3, 16e-3, 32e-3, 64e-3, 0.2)
AMPLITUDES = tuple(float(a) for a in np.geomspace(1e-3, 1.0, 13))  # dynamic contact force over the load
UNIT_RATIO = 0.01  # of damping by which c_c is changed
LARGEST_ERROR = 0.005  # of the relative change of k_c: a window that says less is left out


@dataclass(frozen=True, slots=True)
class Varying:
    """Contact at one load in windows, each array (n,).

    Attributes
    ----------
    middle
        Of the windows: s after the pulse, or dynamic contact force over the load.
    stiffness, stiffness_error
        Change of k_c over its fitted value, and standard error.
    damping_ratio, damping_ratio_error
        c_c over its critical value 2 sqrt(k_c m), m the reduced mass, in the window, and standard error.
    """

    load_n: float
    middle: Real
    stiffness: Real
    stiffness_error: Real
    damping_ratio: Real
    damping_ratio_error: Real


Windows = Callable[[Real, Real], NDArray[np.intp]]
"""Times after a segment's start (n,), dynamic contact force over the load (n,) -> number of each sample's window."""


def contact_in_time(fit: RingDownFit) -> tuple[Varying, ...]:
    """Return the contact in windows of time after the pulse, at every load."""
    edges = np.array(TIME_S)
    return _varying(fit, edges, lambda t, size: np.searchsorted(edges, t, side="right") - 1)


def contact_by_amplitude(fit: RingDownFit) -> tuple[Varying, ...]:
    """Return the contact in windows of its own dynamic force over the load, at every load."""
    edges = np.array(AMPLITUDES)
    return _varying(fit, edges, lambda t, size: np.searchsorted(edges, size, side="right") - 1)


def _varying(fit: RingDownFit, edges: Real, windows: Windows) -> tuple[Varying, ...]:
    bins = edges.size - 1
    middle = np.sqrt(np.maximum(edges[:-1], edges[1:] / 4) * edges[1:])
    found = []
    for groups in fit.problem.groups_by_load:
        parts = [_equations(fit, group, bins, windows) for group in groups]
        normal, gradient = sum(p[0] for p in parts), sum(p[1] for p in parts)
        ratio = float(np.mean([p[2] for p in parts]))
        change, error = _solved(np.asarray(normal), np.asarray(gradient))
        k, ke, c, ce = change[:bins], error[:bins], UNIT_RATIO * change[bins:], UNIT_RATIO * error[bins:]
        kept = (ke < LARGEST_ERROR) & (ce < LARGEST_ERROR)
        load = fit.problem.experiment.loads_n[groups[0]]
        found.append(Varying(load, middle[kept], k[kept], ke[kept], ratio + c[kept], ce[kept]))
    return tuple(found)


def _equations(fit: RingDownFit, group: int, bins: int, windows: Windows) -> tuple[Real, Real, float]:
    """Return normal matrix and gradient of the changes of a group's contact in each window, and its damping ratio."""
    problem = fit.problem
    place = next(i for i, e in enumerate(fit.arrangement.elements) if e.role == "contact")
    nuisance, noise, rate = problem.nuisance(), problem.experiment.noise, problem.experiment.sample_rate_hz
    values, modes, to = fit.constants.at(group), fit.modes[group], fit.responded(group)
    critical = 2 * math.sqrt(values["kc"] * _reduced_mass(fit, place, values))
    fastest = float(np.abs(modes.rig.poles).max())
    normal, gradient = np.zeros((2 * bins, 2 * bins)), np.zeros(2 * bins)
    for number, segment in enumerate(problem.experiment.segments):
        if segment.group != group:
            continue
        t = np.arange((segment.y.shape[1] - 1) * SUBSTEPS + 1) / rate / SUBSTEPS
        d, v = to.motion(fit.amplitudes[number], place, t)
        size = values["kc"] * np.hypot(d, v / fastest) / (segment.preload_n or 1.0)
        window = windows(t, size)
        forces = values["kc"] * d, UNIT_RATIO * critical * v
        columns = np.stack(
            [
                whiten(to.to(place, np.where(window == w, f, 0.0), t[1], SUBSTEPS), noise).ravel()
                for f in forces
                for w in range(bins)
            ],
            axis=1,
        )
        own = nuisance.columns(modes, segment).reshape(columns.shape[0], -1)
        basis = np.linalg.qr(own)[0]
        columns -= basis @ (basis.T @ columns)
        normal += columns.T @ columns
        gradient += columns.T @ fit.residuals[number].ravel()
    return normal, gradient, values["cc"] / critical


def _solved(normal: Real, gradient: Real) -> tuple[Real, Real]:
    """Solve for the windows that hold anything; the others get an infinite error."""
    diagonal = np.diag(normal)
    kept = np.flatnonzero(diagonal > 1e-12 * max(float(diagonal.max()), 1e-300))
    scale = np.sqrt(diagonal[kept])
    inverse = np.linalg.pinv(normal[np.ix_(kept, kept)] / np.outer(scale, scale), rcond=1e-10) / np.outer(scale, scale)
    change, error = np.zeros_like(gradient), np.full_like(gradient, np.inf)
    change[kept] = inverse @ gradient[kept]
    error[kept] = np.sqrt(np.diag(inverse))
    return change, error


def _reduced_mass(fit: RingDownFit, place: int, values: dict[str, float]) -> float:
    """Reduced mass of what the contact joins, kg: m1 m2 / (m1 + m2) for the tester."""
    mass = np.array([values[m] for m in fit.arrangement.masses])
    row = fit.arrangement.vector(fit.arrangement.elements[place].row, values)
    return 1 / float(np.sum(row**2 / mass))
