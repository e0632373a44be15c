"""Starting values of a fit: unknown constants, from the spectra of the recordings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import signal
from scipy.optimize import least_squares

from analysis.mismatch.recordings.recorded import Recorded, level
from analysis.mismatch.rig_description import DescribedRig
from analysis.session import AnalysisError
from sim_backend.arrangement import DERIVATIVES, Parameter
from sim_backend.arrays import Complex, Real

DRAWS: Final = 48  # random starting points
BINS: Final = 400  # lines of the spectra that are looked at
TYPICAL_RATIO: Final = 0.01  # damping ratio where nothing tells of one
SEED: Final = 7
WEAK_PRIOR: Final = 1e-3  # weight of staying near what is usual, beside a relative error of one


def start_values(rig: DescribedRig, recordings: list[Recorded]) -> tuple[dict[str, float], float]:
    """Return a value for every constant of the rig, and the highest frequency of it, Hz.

    Raises
    ------
    AnalysisError
        The rig as described neither swings nor comes to rest.
    """
    known = {p.name: p.value for p in rig.arrangement.parameters}
    unknown = [p for p in rig.arrangement.parameters if not math.isfinite(p.value)]
    if recordings[0].free:
        values = _from_decay(rig, recordings[0], known, unknown)
    else:
        values = _from_input(rig, recordings[0], known, unknown)
    mass, damping, stiffness = rig.arrangement.matrices(values)
    poles = _poles(mass, damping, stiffness)
    highest = float(np.abs(poles).max()) / (2 * math.pi)
    if not 0 < highest < math.inf:
        raise AnalysisError(
            f"{recordings[0].source}: {rig.name} as described neither swings nor comes to rest; check its constants"
        )
    return values, min(highest, 0.5 * recordings[0].rate_hz)


def _poles(mass: Real, damping: Real, stiffness: Real) -> Complex:
    n = len(mass)
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness / mass[:, None], -damping / mass[:, None]]])
    return np.asarray(np.linalg.eigvals(a), np.complex128)


def _peaks(recorded: Recorded, count: int) -> list[float]:
    """Return the frequencies of the highest separate peaks in the outputs' spectra, rising, Hz."""
    y = recorded.outputs / level(recorded)[:, None]
    y = y - y.mean(axis=1, keepdims=True)
    size = 4 * recorded.samples
    power = np.sum(np.abs(np.fft.rfft(y * np.hanning(recorded.samples), size, axis=1)) ** 2, axis=0)
    frequency = np.fft.rfftfreq(size, 1 / recorded.rate_hz)
    apart = max(int(0.02 * np.argmax(power)), 16)
    at, _ = signal.find_peaks(power, distance=apart)
    best = at[np.argsort(power[at])[::-1][:count]]
    return sorted(float(frequency[i]) for i in best)


def _decay_rate(recorded: Recorded) -> float:
    """Return how fast the outputs' envelope falls, 1/s."""
    envelope = np.abs(signal.hilbert(recorded.outputs - recorded.outputs.mean(axis=1, keepdims=True), axis=1))
    total = np.sqrt(np.sum((envelope / level(recorded)[:, None]) ** 2, axis=0))
    kept = slice(max(recorded.edge, recorded.samples // 50), recorded.samples - max(recorded.edge, 1))
    row = total[kept]
    row = row[: max(int(np.searchsorted(-row, -0.05 * row[: len(row) // 10 + 1].max())), len(row) // 10 + 2)]
    t = np.arange(row.size) / recorded.rate_hz
    return max(-float(np.polyfit(t, np.log(np.maximum(row, 1e-300)), 1)[0]), 0.0)


def _from_decay(
    rig: DescribedRig, recorded: Recorded, known: dict[str, float], unknown: list[Parameter]
) -> dict[str, float]:
    """Return constants whose modes lie at the peaks of the spectra, and dampings of the envelope's decay."""
    peaks = _peaks(recorded, len(rig.arrangement.bodies))
    if not peaks:
        raise AnalysisError(f"{recorded.source}: its spectrum has no peak: there is no ring-down to begin with")
    omega = 2 * math.pi * np.array(peaks)
    typical = _typical_mass(rig, known)
    free = [p for p in unknown if p.unit in ("N/m", "kg")]
    base = {**known, **{p.name: 0.0 for p in unknown if p.unit == "N s/m"}, **_plain(unknown)}
    usual = {"N/m": typical * float(np.mean(omega)) ** 2, "kg": typical}
    middle = np.array([math.log(usual[p.unit]) for p in free])

    def values(q: Real) -> dict[str, float]:
        return {**base, **{p.name: math.exp(v) for p, v in zip(free, q, strict=True)}}

    def off(q: Real) -> Real:
        mass, _, stiffness = rig.arrangement.matrices(values(q))
        found = np.sqrt(np.abs(np.sort(np.linalg.eigvals(stiffness / mass[:, None]).real)))[-len(omega) :]
        miss = np.log(np.maximum(found, 1e-9 * omega[-1]) / omega)
        return np.concatenate([miss, WEAK_PRIOR * (q - middle)])

    chosen = middle
    if free:
        random = np.random.default_rng(SEED)
        starts = [middle + (random.normal(0, 1.0, len(free)) if i else 0.0) for i in range(DRAWS // 4)]
        chosen = min((least_squares(off, x) for x in starts), key=lambda f: float(f.cost)).x
    found = values(chosen)
    rate = _decay_rate(recorded) or TYPICAL_RATIO * float(omega[0])
    for p in unknown:
        if p.unit == "N s/m":
            elements = rig.arrangement.elements
            beside = next((e.stiffness for e in elements if e.damping == p.name and e.stiffness), None)
            found[p.name] = 2 * rate * (found[beside] / float(omega[0]) ** 2 if beside else typical)
    return found


def _typical_mass(rig: DescribedRig, known: dict[str, float]) -> float:
    """Return the mean of the masses that are known; one where none is."""
    masses = np.array([known[m] for m in rig.arrangement.masses])
    return float(np.nanmean(masses)) if np.any(np.isfinite(masses)) else 1.0


def _plain(unknown: list[Parameter]) -> dict[str, float]:
    """Starting values of gains (one) and offsets (none)."""
    return {p.name: 1.0 if p.name.startswith("gain") else 0.0 for p in unknown if p.unit not in ("N/m", "N s/m", "kg")}


@dataclass(frozen=True, slots=True)
class _Spectra:
    """Strongest lines of the outputs' and inputs' spectra, over the channels' levels, (channels or inputs, lines)."""

    outputs: Complex
    inputs: Complex
    omega: Real
    centre: float

    @classmethod
    def of(cls, recorded: Recorded) -> _Spectra:
        """Return those of what is fitted of a recording."""
        kept = recorded.fitted
        y, u = recorded.outputs[:, kept], recorded.inputs[:, kept]
        window = np.hanning(y.shape[1])
        outputs = np.fft.rfft((y - y.mean(axis=1, keepdims=True)) * window, axis=1) / level(recorded)[:, None]
        inputs = np.fft.rfft((u - u.mean(axis=1, keepdims=True)) * window, axis=1)
        frequency = np.fft.rfftfreq(y.shape[1], 1 / recorded.rate_hz)
        power = np.sum(np.abs(outputs) ** 2, axis=0)
        strongest = np.argsort(power[3:])[::-1][: 4 * BINS] + 3
        used = np.sort(strongest[:: max(len(strongest) // BINS, 1)])
        omega = np.asarray(2 * math.pi * frequency[used], np.float64)
        centre = float(np.sum(omega * power[used]) / np.sum(power[used]))
        return cls(outputs[:, used], inputs[:, used], omega, centre)


def _from_input(
    rig: DescribedRig, recorded: Recorded, known: dict[str, float], unknown: list[Parameter]
) -> dict[str, float]:
    """Fit the linear rig's frequency response to the spectra of inputs and outputs, from many random starts."""
    spectra = _Spectra.of(recorded)
    total = float(np.sum(np.abs(spectra.outputs) ** 2))
    typical = _typical_mass(rig, known)
    size = {"N/m": typical * spectra.centre**2, "N s/m": 0.2 * typical * spectra.centre, "kg": typical}
    free = [p for p in unknown if p.unit in size]
    gains = [d.gain for d in rig.drives if not math.isfinite(known[d.gain])]
    base = {**known, **_plain(unknown)}

    def solved(q: Real) -> tuple[Real, dict[str, float]]:
        bent = {p.name: size[p.unit] * math.exp(min(max(v, -40.0), 40.0)) for p, v in zip(free, q, strict=False)}
        values = {**base, **bent}
        made = _responses(rig, values, spectra, level(recorded), gains)
        off, found = _gains_solved(rig, made, spectra.outputs, gains)
        return np.concatenate([off.real, off.imag]) / math.sqrt(total), {**values, **found}

    def objective(q: Real) -> Real:
        with np.errstate(all="ignore"):
            off = solved(q)[0]
        return np.concatenate([np.where(np.isfinite(off), off, 10.0), WEAK_PRIOR * q])

    random = np.random.default_rng(SEED)
    lighter = np.array([-1.5 * (p.unit == "N s/m") for p in free])
    tried = [random.normal(0.0, 1.0, len(free)) + lighter for _ in range(DRAWS)]
    tried.sort(key=lambda q: float(np.sum(objective(q) ** 2)))
    best, cost = np.zeros(len(free)), math.inf
    for q in tried[: DRAWS // 8] if free else []:
        found = least_squares(objective, q, max_nfev=60)
        if float(found.cost) < cost:
            best, cost = np.asarray(found.x, np.float64), float(found.cost)
    return solved(best)[1]


def _responses(
    rig: DescribedRig, values: dict[str, float], spectra: _Spectra, levels: Real, gains: list[str]
) -> Complex:
    """Return (inputs, channels, lines) what each input does to the channels; unknown gains count as one."""
    mass, damping, stiffness = rig.arrangement.matrices(values)
    s = 1j * spectra.omega
    dynamic = stiffness + s[:, None, None] * damping + (s**2)[:, None, None] * np.diag(mass)
    out = np.empty((len(rig.drives), len(rig.seen), s.size), np.complex128)
    for i, drive in enumerate(rig.drives):
        vector = rig.arrangement.vector(drive.row, values)
        push = (-mass * vector if drive.base else vector)[:, None]
        moved = np.linalg.solve(dynamic, np.broadcast_to(push, (s.size, len(mass), 1)))[:, :, 0]
        gain = 1.0 if drive.gain in gains else values[drive.gain]
        for c, seen in enumerate(rig.seen):
            row = rig.arrangement.vector(seen.sensor.row, values)
            order = s ** DERIVATIVES[seen.sensor.quantity]
            out[i, c] = values[seen.gain] * gain * (moved @ row) * order * spectra.inputs[i] / levels[c]
    return out


def _gains_solved(
    rig: DescribedRig, made: Complex, outputs: Complex, gains: list[str]
) -> tuple[Complex, dict[str, float]]:
    """Return what is left of the outputs (all lines in one row), and unknown gains by linear least squares."""
    free = [i for i, d in enumerate(rig.drives) if d.gain in gains]
    held = [i for i in range(len(rig.drives)) if i not in free]
    off = (outputs - made[held].sum(axis=0)).ravel()
    if not free:
        return off, {}
    a = made[free].reshape(len(free), -1).T
    stacked = np.concatenate([a.real, a.imag])
    found = np.linalg.lstsq(stacked, np.concatenate([off.real, off.imag]), rcond=1e-10)[0]
    return off - a @ found, dict(zip([rig.drives[i].gain for i in free], found.tolist(), strict=True))
