"""Spectral moments of a rough surface and the asperities they stand for (McCool, Wear 107, 1986, 37-60).

Along a profile m0 is the mean square of the height, m2 of the slope, m4 of the curvature. Of an isotropic Gaussian
surface, asperities have the density and mean radius

    eta = m4 / (6 pi 3^(1/2) m2),    R_s = 3/8 (pi / m4)^(1/2),    R_q = m0^(1/2).

The moments of independent surfaces add. m2 and m4 grow as the points come closer, for the asperities of a real surface
stand on each other: they belong to their spacing, and say nothing beyond it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.surface.scan import Scan, ScanError
from calibration.estimate import Estimate

FloatArray = NDArray[np.float64]
PROFILE_BLOCKS, MAP_BLOCKS = 16, 4  # along a profile; along each side of a map
LONGEST_WAVE = 4.0  # correlation lengths that a block has to hold
LARGEST_DEGREE = 6


@dataclass(frozen=True, slots=True)
class SurfaceParameters:
    """What a scan, or several surfaces together, say of the roughness.

    Attributes
    ----------
    R_q, R_s, eta
        Rms roughness and mean asperity radius, m; asperities per area, 1/m2.
    m0, m2, m4
        Spectral moments along a line, m2, 1, 1/m2.
    covariance
        (3, 3) of the logarithms of the moments.
    dof
        Degrees of freedom behind it.
    bandwidth
        m0 m4 / m2^2: 1.5 for waves of one length, large for many.
    """

    R_q: Estimate
    R_s: Estimate
    eta: Estimate
    m0: Estimate
    m2: Estimate
    m4: Estimate
    covariance: FloatArray
    dof: float
    bandwidth: float


@dataclass(frozen=True, slots=True)
class SurfaceAnswer:
    """A scan analysed.

    Attributes
    ----------
    source
        Where it was read.
    parameters
        At the scan's own spacing.
    spacing
        m.
    coarser
        The same with every second and every fourth point, where there are enough.
    roughness
        Heights without form, m, shaped like the scan.
    correlation_length
        Where the autocorrelation along a line falls to 1 / e, m.
    skewness, kurtosis
        Of the heights; 0 and 3 of Gaussian ones.
    notes
        What to keep in mind, a sentence each.
    """

    source: str
    parameters: SurfaceParameters
    spacing: float
    coarser: tuple[tuple[float, SurfaceParameters], ...]
    roughness: FloatArray
    correlation_length: float
    skewness: float
    kurtosis: float
    notes: tuple[str, ...]


def analyse_scan(scan: Scan, degree: int = 2) -> SurfaceAnswer:
    """Take the form off a scan and find the spectral moments of what is left.

    Parameters
    ----------
    scan
        Heights.
    degree
        Of the polynomial that is taken off as form: 0 the mean, 1 tilt, 2 curvature.

    Raises
    ------
    ScanError
        A degree that is none, or a scan that is form alone.

    Examples
    --------
    >>> x = np.arange(4000) * 1e-6
    >>> found = analyse_scan(Scan(1.4142e-6 * np.sin(2 * np.pi * x / 1e-4), (1e-6,)))
    >>> round(1e6 * found.parameters.R_q.value, 2)
    1.0
    """
    if not 0 <= degree <= LARGEST_DEGREE:
        raise ScanError(f"form is taken off with a polynomial of degree 0 to {LARGEST_DEGREE}, not {degree}")
    rough = without_form(scan.height, degree)
    if np.sqrt(np.mean(rough**2)) < 1e-9 * np.ptp(scan.height):
        raise ScanError(f"{scan.source}: nothing is left of the heights once their form is taken off")
    parameters = _parameters(rough, scan.spacing)
    coarser = []
    for stride in (2, 4):
        sparse = rough[tuple(slice(None, None, stride) for _ in rough.shape)]
        if min(sparse.shape) >= 2 * PROFILE_BLOCKS:
            coarser.append((stride * scan.spacing[0], _parameters(sparse, tuple(stride * s for s in scan.spacing))))
    length = _correlation_length(rough) * scan.spacing[0]
    z = rough / np.sqrt(np.mean(rough**2))
    skewness, kurtosis = float(np.mean(z**3)), float(np.mean(z**4))
    return SurfaceAnswer(
        scan.source,
        parameters,
        scan.spacing[0],
        tuple(coarser),
        rough,
        length,
        skewness,
        kurtosis,
        tuple(_notes(scan, rough, parameters, coarser, length, kurtosis)),
    )


def without_form(height: FloatArray, degree: int) -> FloatArray:
    """Return heights, (n,) or (rows, n), less the least-squares polynomial of total degree ``degree``."""
    axes = [np.linspace(-1, 1, n) for n in height.shape]
    powers = [p for p in np.ndindex(*(degree + 1 for _ in axes)) if sum(p) <= degree]
    basis = np.stack(
        [
            np.multiply.reduce(np.meshgrid(*(a**e for a, e in zip(axes, p, strict=True)), indexing="ij")).ravel()
            for p in powers
        ],
        axis=1,
    )
    z = height.ravel() - height.mean()
    coefficients, *_ = np.linalg.lstsq(basis, z, rcond=None)
    return np.asarray((z - basis @ coefficients).reshape(height.shape), dtype=np.float64)


def together(surfaces: Sequence[SurfaceParameters]) -> SurfaceParameters:
    """Return the parameters of the gap between independent surfaces: their moments add."""
    moments = np.array([[s.m0.value, s.m2.value, s.m4.value] for s in surfaces])
    total = moments.sum(axis=0)
    shares = moments / total
    covariance = sum(np.outer(w, w) * s.covariance for w, s in zip(shares, surfaces, strict=True))
    return _of_moments(total, np.asarray(covariance), min(s.dof for s in surfaces))


def _squares(rough: FloatArray, spacing: tuple[float, ...]) -> list[FloatArray]:
    """Squares of height, slope and curvature, each along every direction; (k, ...) with the points."""
    height, slope, curvature = [], [], []
    for axis, step in zip(range(rough.ndim - 1, -1, -1), spacing, strict=True):
        line = np.moveaxis(rough, axis, -1)
        first = np.diff(line, axis=-1)[..., :-1] / step
        second = np.diff(line, n=2, axis=-1) / step**2
        height.append(np.moveaxis(line[..., 1:-1] ** 2, -1, axis))
        slope.append(np.moveaxis(first**2, -1, axis))
        curvature.append(np.moveaxis(second**2, -1, axis))
    kept = tuple(slice(0, min(a.shape[i] for a in height)) for i in range(rough.ndim))
    return [np.mean([a[kept] for a in kind], axis=0) for kind in (height, slope, curvature)]


def _parameters(rough: FloatArray, spacing: tuple[float, ...]) -> SurfaceParameters:
    squares = np.stack(_squares(rough, spacing))
    blocks = PROFILE_BLOCKS if rough.ndim == 1 else MAP_BLOCKS
    parts = [squares]
    for axis in range(1, squares.ndim):
        parts = [piece for part in parts for piece in np.array_split(part, blocks, axis=axis)]
    means = np.array([part.reshape(3, -1).mean(axis=1) for part in parts])
    total = squares.reshape(3, -1).mean(axis=1)
    covariance = np.cov(means.T / total[:, None]) / len(parts)
    return _of_moments(total, covariance, len(parts) - 1)


def _of_moments(moments: FloatArray, covariance: FloatArray, dof: float) -> SurfaceParameters:
    """First order in the logarithms."""
    m0, m2, m4 = (float(m) for m in moments)

    def estimate(value: float, *powers: float) -> Estimate:
        p = np.array(powers)
        return Estimate(value, value * math.sqrt(max(float(p @ covariance @ p), 0.0)), dof)

    return SurfaceParameters(
        R_q=estimate(math.sqrt(m0), 0.5, 0, 0),
        R_s=estimate(0.375 * math.sqrt(math.pi / m4), 0, 0, -0.5),
        eta=estimate(m4 / m2 / (6 * math.pi * math.sqrt(3)), 0, -1, 1),
        m0=estimate(m0, 1, 0, 0),
        m2=estimate(m2, 0, 1, 0),
        m4=estimate(m4, 0, 0, 1),
        covariance=covariance,
        dof=dof,
        bandwidth=m0 * m4 / m2**2,
    )


def _correlation_length(rough: FloatArray) -> float:
    """Steps along a line to where the autocorrelation falls to 1 / e."""
    rows = np.atleast_2d(rough)
    n = rows.shape[1]
    power = np.abs(np.fft.rfft(rows, 2 * n, axis=1)) ** 2
    correlation = np.fft.irfft(power.mean(axis=0))[:n] / np.arange(n, 0, -1)
    below = np.flatnonzero(correlation < correlation[0] / math.e)
    if not below.size:
        return float(n)
    i = int(below[0])
    over, under = correlation[i - 1], correlation[i]
    return i - 1 + float((over - correlation[0] / math.e) / (over - under))


def _notes(
    scan: Scan,
    rough: FloatArray,
    parameters: SurfaceParameters,
    coarser: Sequence[tuple[float, SurfaceParameters]],
    length: float,
    kurtosis: float,
) -> list[str]:
    notes = []
    if scan.missing:
        notes.append(f"{scan.missing} points were not measured and were filled in between their neighbours")
    if coarser:
        step, sparse = coarser[0]
        radius, density = sparse.R_s.value / parameters.R_s.value, parameters.eta.value / sparse.eta.value
        if max(radius, density) > 1.25:
            notes.append(
                f"asperity radius and density belong to the spacing of {scan.spacing[0] * 1e6:.3g} um: at "
                f"{step * 1e6:.3g} um the radius is {radius:.2g} times as large and the density "
                f"{density:.2g} times smaller; a finer scan, or noise of the instrument, would move them further"
            )
    blocks = PROFILE_BLOCKS if rough.ndim == 1 else MAP_BLOCKS
    if rough.shape[-1] * scan.spacing[0] / blocks < LONGEST_WAVE * length:
        notes.append(
            f"the scan is short: {rough.shape[-1] * scan.spacing[0] / length:.0f} correlation lengths of "
            f"{length * 1e6:.3g} um; the interval of R_q is too narrow"
        )
    if rough.ndim == 2:
        along = [
            float(np.mean(np.diff(rough, axis=a) ** 2)) / s**2 for a, s in ((1, scan.spacing[0]), (0, scan.spacing[1]))
        ]
        if max(along) > 2 * min(along):
            notes.append(
                f"the surface has a lay: mean square slopes along x and y are {along[0]:.3g} and {along[1]:.3g}; the "
                "asperities of an isotropic surface with their mean are given"
            )
    elif rough.ndim == 1:
        notes.append("a profile sees one direction: a surface with a lay needs a map, or profiles along and across")
    if abs(kurtosis - 3) > 1.0:
        notes.append(f"the heights are not Gaussian: kurtosis {kurtosis:.2g} instead of 3")
    return notes
