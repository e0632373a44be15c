"""What an analysis answers: estimates of each impact and of each load, and the calibration behind the loads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.frequency_response.cross_check import CrossCheck
from analysis.modal.amplitude import AmplitudePoint
from analysis.modal.shapes import modal_assurance
from analysis.modal.spectrum import SpectralMode
from analysis.modal.stabilisation import StablePole
from analysis.statistics import BoxStatistics
from calibration.budget import Budget
from calibration.estimate import Estimate
from calibration.gauge import GaugeResult


@dataclass(frozen=True, slots=True)
class ImpactResult:
    """One impact; estimates are None where the data cannot carry one, and ``notes`` says why."""

    name: str
    load_set: int
    accepted: bool
    reject_reason: str
    load_mn: Estimate | None
    f1_hz: Estimate | None
    f2_hz: Estimate | None
    zeta1: Estimate | None
    zeta2: Estimate | None
    contact_stiffness_n_per_m: Estimate | None
    contact_damping_n_s_per_m: Estimate | None
    peak_acceleration_m_s2: float
    peak_contact_force_n: float | None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Averaged amplitude spectrum of the accepted impacts of a load: (n,) Hz, (n,) m/s2 per Hz."""

    frequency_hz: NDArray[np.float64]
    amplitude: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LoadResult:
    """One load: the accepted impacts combined. f in Hz is abs(s) / 2 pi, zeta is -Re s / abs(s) of the pole s.

    ``spectral_mode`` is the contact mode from the spectra alone, an independent check; ``along_decay`` the contact
    mode against its amplitude. ``budgets`` says what each uncertainty is made of, named as the fields are.
    """

    load_set: int
    target_load_mn: float
    load_mn: Estimate | None
    impacts_used: int
    f1_hz: Estimate | None
    f2_hz: Estimate | None
    zeta1: Estimate | None
    zeta2: Estimate | None
    contact_stiffness_n_per_m: Estimate | None
    contact_damping_n_s_per_m: Estimate | None
    stiffness_box: BoxStatistics | None
    damping_box: BoxStatistics | None
    spectrum: Spectrum | None
    notes: tuple[str, ...] = ()
    spectral_mode: SpectralMode | None = None
    along_decay: tuple[AmplitudePoint, ...] = ()
    budgets: tuple[Budget, ...] = ()


@dataclass(frozen=True, slots=True)
class SessionResults:
    """All that `analyze` answers about a session of the tester."""

    source: str
    method: str
    loads: tuple[LoadResult, ...]
    impacts: tuple[ImpactResult, ...]
    calibration: GaugeResult | None
    springs_n_per_m: tuple[Estimate, Estimate]
    notes: tuple[str, ...] = ()
    hammer: tuple[CrossCheck, ...] = ()
    """Of an instrumented hammer: frequency responses and k_c from them, a load each; empty without one."""
    remarks: tuple[str, ...] = ()
    """Values that are probably written in another unit, with what is usual; the numbers follow them as they stand."""


@dataclass(frozen=True, slots=True)
class Mode:
    """One mode of a recording that is not a session of the tester; amplitudes in the recording's unit, a channel each.

    ``emac`` and ``mpc``, 0 to 1, say how well ERA continues the mode and how much its channels move in one phase.
    ``shape`` is how the channels move together, complex, 1 for the one that moves most; empty where nobody kept it.
    """

    frequency_hz: Estimate
    damping_ratio: Estimate
    amplitude: tuple[float, ...]
    along_decay: tuple[AmplitudePoint, ...] = ()
    emac: float = float("nan")
    mpc: float = float("nan")
    shape: tuple[complex, ...] = ()


@dataclass(frozen=True, slots=True)
class RecordingModes:
    """All that `analyze` answers about any other ring-down; ``diagram`` is its stabilisation diagram.

    ``channels`` are the name and the unit, "" where none is stated, of each entry of an amplitude and of a shape.
    """

    source: str
    method: str
    modes: tuple[Mode, ...]
    notes: tuple[str, ...] = ()
    diagram: tuple[StablePole, ...] = ()
    channels: tuple[tuple[str, str], ...] = ()

    def shapes(self) -> NDArray[np.complex128]:
        """Shapes (c, m) of the modes, a column a mode; (0, m) where they were not kept."""
        channels = len(self.modes[0].shape) if self.modes else 0
        return np.array([mode.shape for mode in self.modes], np.complex128).reshape(len(self.modes), channels).T

    def mac(self, other: RecordingModes | None = None) -> NDArray[np.float64]:
        """Modal assurance criterion (m, n) between these modes and those of another recording, by default themselves.

        Raises
        ------
        ValueError
            The recordings have not the same channels.
        """
        return modal_assurance(self.shapes(), (other or self).shapes())
