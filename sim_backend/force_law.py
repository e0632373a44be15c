"""What a compiled force law is, and the force of one along a known motion."""

from __future__ import annotations

import warnings
from functools import cache
from typing import Any

import numpy as np
from numba import float64, njit, types
from numba.core.errors import NumbaExperimentalFeatureWarning

from sim_backend.arrays import Real

warnings.filterwarnings("ignore", category=NumbaExperimentalFeatureWarning)

_ROW = types.Array(types.float64, 1, "C")
_TABLE = types.Array(types.float64, 2, "C")
LAW = float64(float64, float64, float64, float64, _ROW, _ROW, _ROW)
"""force so far (N, about rest), deformation (m), its rate (m/s), time since the tap (s), parameters, memory before the
step, memory after it -> force (N). The parameters begin with `REST`. A step may be tried more than once and in parts: a
law takes its length from the parameters, and at every call it writes each number of its memory that it reads."""
PRELOAD, STIFFNESS, DAMPING, STEP = range(4)
REST = 4  # places taken by preload (N), stiffness (N/m), damping (N s/m) and time step (s) of the element
MEMORY = 24  # most numbers that a law may remember
SLOTS = 4  # most laws at work together


class CompiledLaw(types.WrapperAddressProtocol):
    """The address of a compiled law: passing the law itself to compiled code costs as much as 2,000 of its steps."""

    def __init__(self, law: Any):
        self.law = law  # keeps the code alive
        compiled = law.get_compile_result(LAW)
        self._address = int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_cfunc_wrapper_name))

    def __wrapper_address__(self) -> int:
        return self._address

    def signature(self) -> Any:
        """Return the types of what it takes and gives."""
        return LAW


@cache
def compiled_law(law: Any) -> CompiledLaw:
    """Return the address of a law, the same one each time."""
    return CompiledLaw(law)


@njit(LAW, cache=True)
def no_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """Leave the force as it is."""
    return force


_ALONG = _TABLE(types.FunctionType(LAW), _TABLE, _ROW, _ROW, float64, float64, _ROW)


@njit([_ALONG], cache=True, nogil=True)
def _along(law, p, d, v, t0, h, memory):  # type: ignore[no-untyped-def]
    extra = np.empty((len(p), len(d)))
    for k in range(len(p)):
        own, before, after = p[k], memory.copy(), memory.copy()
        for n in range(len(d)):
            linear = own[STIFFNESS] * d[n] + own[DAMPING] * v[n]
            extra[k, n] = law(linear, d[n], v[n], t0 + n * h, own, before, after) - linear
            before, after = after, before
    return extra


_along_at_once: Any = _along.get_overload(_ALONG)  # without the look at the types, which takes as long as 10,000 steps


def along(law: Any, p: Real, d: Real, v: Real, t0: float, h: float, memory: Real) -> Real:
    """Return the extra forces (k, n) of a law with k sets of parameters along a deformation and its rate, each (n,)."""
    rows = (np.ascontiguousarray(a, np.float64) for a in (p, d, v))
    return np.asarray(_along_at_once(compiled_law(law), *rows, float(t0), float(h), np.array(memory, np.float64)))
