"""A linear rig as matrices: bodies, springs beside and in series with dampers, an input, what sensors see."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from mesotap.proof.rigs import laws
from mesotap.proof.rigs.stepping import Kick, Machine, integrate, propagate, solved

Array = NDArray[np.float64]
NO_KICK = Kick(-1, np.zeros(0))


@dataclass(frozen=True, slots=True)
class Branch:
    """A spring and damper across ``shape`` (q,): its deformation is shape @ q."""

    shape: Array
    stiffness: float
    damping: float


@dataclass(frozen=True, slots=True)
class Relaxing:
    """A spring in series with a damper across ``shape``."""

    shape: Array
    stiffness: float
    time_s: float


@dataclass(frozen=True, slots=True)
class Law:
    """A force of `laws` across ``shape``; ``constants`` as listed there."""

    code: int
    shape: Array
    constants: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Plant:
    """Masses (q,), what connects them, the force of a unit of the input (q,), and the laws beyond linear ones."""

    masses: Array
    branches: tuple[Branch, ...]
    drive: Array
    relaxing: tuple[Relaxing, ...] = ()
    laws: tuple[Law, ...] = field(default=())

    def with_body(self, mass: float, branch: Branch | None, input_share: float = 0.0) -> Plant:
        """Return it with one more body at the end; ``branch`` has a shape of the larger size.

        ``input_share`` is minus its mass where the input is an acceleration of the base.
        """
        return replace(
            self,
            masses=np.append(self.masses, mass),
            branches=(
                *(replace(b, shape=np.append(b.shape, 0.0)) for b in self.branches),
                *((branch,) if branch else ()),
            ),
            drive=np.append(self.drive, input_share),
            relaxing=tuple(replace(r, shape=np.append(r.shape, 0.0)) for r in self.relaxing),
            laws=tuple(replace(law, shape=np.append(law.shape, 0.0)) for law in self.laws),
        )

    def matrices(self) -> tuple[Array, Array]:
        """Return A and b of x' = A x + b u for x = (q, q', forces of the relaxing springs)."""
        q, r = self.masses.size, len(self.relaxing)
        a = np.zeros((2 * q + r, 2 * q + r))
        a[:q, q : 2 * q] = np.eye(q)
        for branch in self.branches:
            across = np.outer(branch.shape / self.masses, branch.shape)
            a[q : 2 * q, :q] -= branch.stiffness * across
            a[q : 2 * q, q : 2 * q] -= branch.damping * across
        for i, series in enumerate(self.relaxing):
            a[q : 2 * q, 2 * q + i] = -series.shape / self.masses
            a[2 * q + i, q : 2 * q] = series.stiffness * series.shape
            a[2 * q + i, 2 * q + i] = -1.0 / series.time_s
        b = np.concatenate([np.zeros(q), self.drive / self.masses, np.zeros(r)])
        return a, b

    def poles(self) -> NDArray[np.complex128]:
        """Return the eigenvalues of A."""
        return np.linalg.eigvals(self.matrices()[0]).astype(np.complex128)

    def modes_hz(self) -> Array:
        """Return the undamped natural frequencies, lowest first; motion without a spring has 0."""
        stiffness = sum((b.stiffness * np.outer(b.shape, b.shape) for b in self.branches), np.zeros((1, 1)))
        root = np.sqrt(self.masses)
        squared = np.linalg.eigvalsh(stiffness / np.outer(root, root))
        return np.asarray(np.sqrt(np.maximum(squared, 0.0)) / (2 * np.pi))

    def machine(self, h: float) -> Machine:
        """Return what is integrated in steps of ``h`` seconds, with fresh memories."""
        a, b = self.matrices()
        half, whole = solved(a, h)
        q, n, m = self.masses.size, b.size, len(self.laws)
        deformation, rate, push = np.zeros((m, n)), np.zeros((m, n)), np.zeros((m, n))
        constants, memory = np.zeros((m, 4)), np.zeros((m, 3, laws.SLIDERS))
        for i, law in enumerate(self.laws):
            deformation[i, :q] = law.shape
            rate[i, q : 2 * q] = law.shape
            push[i, q : 2 * q] = -law.shape / self.masses
            constants[i, : len(law.constants)] = law.constants
            memory[i, 0] = laws.reaches(law.code, constants[i])
        codes = np.array([law.code for law in self.laws], dtype=np.int64)
        return Machine(a, b, half, whole, h, deformation, rate, push, codes, constants, memory)

    def motion(self, start: Array, u: Array, h: float, kick: Kick = NO_KICK) -> tuple[Array, Array]:
        """Return displacements, velocities and accelerations (steps + 1, q), as one array (3, steps + 1, q), and times.

        ``start`` holds q and q' of the first bodies at the beginning; whatever else there is rests.
        ``u`` is (steps, 3): the input at the beginning, middle and end of each step.
        """
        q = self.masses.size
        m = self.machine(h)
        x = self._begun(start)
        kick = Kick(kick.step, self._begun(kick.jump) if kick.step >= 0 else np.zeros(x.size))
        if not self.laws:
            states = propagate(m, x, u, kick)
            ends = np.append(u[:, 0], u[-1, 2])
            rates = states @ m.a.T + np.outer(ends, m.b)
        else:
            jumping = next((i for i, law in enumerate(self.laws) if law.code in laws.KINKED), -1)
            states, rates = integrate(m, x, u, kick, jumping)
        moved = np.stack([states[:, :q], states[:, q : 2 * q], rates[:, q : 2 * q]])
        return moved, np.asarray(h * np.arange(len(states)), np.float64)

    def _begun(self, start: Array) -> Array:
        """State with the given q and q' of the first bodies; the others rest, and relaxing springs carry nothing."""
        bodies = start.size // 2
        q = self.masses.size
        x = np.zeros(2 * q + len(self.relaxing))
        x[:bodies], x[q : q + bodies] = start[:bodies], start[bodies:]
        return x
