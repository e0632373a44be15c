"""The exact step of a linear rig under forces that are parabolas: phi functions of its state matrix, compiled.

With ``z' = a z + b f`` and f(t) the parabola ``f0 + (f1 - f0) u + c u (u - 1)`` of ``u = t / h``, the step is
``z1 = phi0 z0 + h ((phi1 - phi2) b f0 + phi2 b f1 + (2 phi3 - phi2) b c)`` with the phi functions of ``a h``
(Hochbruck and Ostermann, Acta Numerica 19 (2010) 209): exact whatever the poles, rigid-body modes included.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, types

_TABLE = types.Array(types.float64, 2, "C")
TAYLOR_TERMS = 13  # of phi3, for a norm below 1/2: (1/2)^13 3! / 16! is below rounding


@njit([_TABLE(_TABLE, _TABLE)], cache=True, nogil=True)
def product(a, b):  # type: ignore[no-untyped-def]
    """Return a @ b in plain loops: a linear-algebra library spreads such small matrices over threads."""
    c = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            if a[i, k] != 0.0:
                for j in range(b.shape[1]):
                    c[i, j] += a[i, k] * b[k, j]
    return c


@njit([types.Array(types.float64, 4, "C")(_TABLE, types.int64)], cache=True, nogil=True)
def phi_functions(a, levels):  # type: ignore[no-untyped-def]
    """Return phi0 to phi3 of a, a / 4, ..., a / 4^(levels - 1), (levels, 4, n, n), by their series and doubling."""
    norm = 0.0
    for j in range(a.shape[1]):
        norm = max(norm, np.sum(np.abs(a[:, j])))
    halvings = max(0, math.ceil(math.log2(norm)) + 1) if 0.0 < norm < 1e300 else 0
    halvings = max(halvings, 2 * (levels - 1))
    small, one = a / 2.0**halvings, np.eye(len(a))
    phi3, factorial = np.zeros_like(a), math.gamma(TAYLOR_TERMS + 3.0)
    for k in range(TAYLOR_TERMS - 1, -1, -1):
        phi3 = product(small, phi3)
        for i in range(len(a)):
            phi3[i, i] += 1.0 / factorial
        factorial /= k + 3.0
    phi2 = product(small, phi3) + 0.5 * one
    phi1 = product(small, phi2) + one
    phi0 = product(small, phi1) + one
    out = np.empty((levels, 4, len(a), len(a)))
    for left in range(halvings, -1, -1):  # these are the functions of a / 2^left
        if left % 2 == 0 and left // 2 < levels:
            at = out[left // 2]
            at[0], at[1], at[2], at[3] = phi0, phi1, phi2, phi3
        if left > 0:
            phi3 = (product(phi1, phi2) + phi2 + 2.0 * phi3) / 8.0
            phi2 = (product(phi1, phi1) + 2.0 * phi2) / 4.0
            phi1 = product(phi0 + one, phi1) / 2.0
            phi0 = product(phi0, phi0)
    return out


@njit(cache=True, nogil=True)
def exact_steps(rigs, run, unit, h, divisions):  # type: ignore[no-untyped-def]
    """Return ``matrix`` and ``late`` of `sim_backend.propagate.stepping`, and (2 n + 2 elements, 2 n) what sees both.

    ``unit`` is the frequency, rad/s, that displacements are multiplied by; each division is by four.
    """
    mass, rows, inputs = rigs.mass[run], rigs.rows[run], rigs.inputs[run]
    n, elements, forces = len(mass), len(rows), len(rows) + inputs.shape[1]
    a, b = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, forces))
    for i in range(n):
        a[i, n + i] = unit
        for j in range(n):
            a[n + i, j] = -rigs.stiffness[run, i, j] / mass[i] / unit
            a[n + i, n + j] = -rigs.damping[run, i, j] / mass[i]
        for e in range(elements):
            b[n + i, e] = -rows[e, i] / mass[i]  # a positive force in an element pushes against its deformation
        for u in range(inputs.shape[1]):
            b[n + i, elements + u] = inputs[i, u] / mass[i]
    sees = np.zeros((2 * n + 2 * elements, 2 * n))
    for i in range(2 * n):
        sees[i, i] = 1.0
    sees[2 * n : 2 * n + elements, :n], sees[2 * n + elements :, n:] = rows / unit, rows
    matrix = np.empty((divisions, len(sees), 2 * n + 2 * elements + 3 * inputs.shape[1]))
    late = np.empty((divisions, 3, len(sees), elements))
    phi = phi_functions(a * h, divisions)
    for level in range(divisions):
        own = h / 4.0**level
        phi0, phi1, phi2, phi3 = phi[level, 0], phi[level, 1], phi[level, 2], phi[level, 3]
        start = product(sees, product(own * (phi1 - phi2), b))
        end, bend = product(sees, product(own * phi2, b)), product(sees, product(own * (2.0 * phi3 - phi2), b))
        matrix[level, :, : 2 * n] = product(sees, phi0)
        matrix[level, :, 2 * n : 2 * n + elements] = start[:, :elements]
        matrix[level, :, 2 * n + elements : 2 * n + 2 * elements] = bend[:, :elements]
        for u in range(inputs.shape[1]):
            at = 2 * n + 2 * elements + 3 * u
            matrix[level, :, at], matrix[level, :, at + 1] = start[:, elements + u], end[:, elements + u]
            matrix[level, :, at + 2] = bend[:, elements + u]
        late[level, 0], late[level, 1], late[level, 2] = end[:, :elements], bend[:, :elements], start[:, :elements]
    return matrix, late, sees
