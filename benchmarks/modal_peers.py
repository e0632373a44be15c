"""Other programs' ways from one impact to sampled poles, each with the settings it is tried with.

Each gets the mean of the two channels (1, n): they see the same motion, so that nothing is lost and its matrices are
half as large. An order of four is two modes; where a method needs more (LSCF fits noise with the surplus), it gets
more. The caller takes the pole nearest to each true one, so that no peer loses for want of a rule of selection.
"""

from __future__ import annotations

import contextlib
import io
import logging
import warnings
from collections.abc import Callable
from functools import partial
from importlib import metadata
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Identify = Callable[[Real, float], Complex]


def control_era(size: int) -> Identify:
    """python-control: ERA with ``size`` block rows and columns."""
    import control

    def identify(y: Real, rate: float) -> Complex:
        system, _ = control.eigensys_realization(y[:, None, :], 4, m=size, n=size, dt=1 / rate)
        return np.linalg.eigvals(system.A).astype(np.complex128)

    return identify


def pyyeti_era(rows: int) -> Identify:
    """Pyyeti: ERA with ``rows`` block rows and columns, all of its four poles kept."""
    from pyyeti import era

    def identify(y: Real, rate: float) -> Complex:
        found = era.ERA(
            y,
            rate,
            svd_tol=4,
            alpha=rows,
            beta=rows,
            auto=True,
            all_lower_limits=0.0,
            damp_range=(-1.0, 1.0),
            verbose=False,
            show_plot=False,
        )
        return np.asarray(found.eigs, np.complex128)

    return identify


def pyoma_ssi(method: Literal["cov", "dat"], rows: int) -> Identify:
    """pyOMA2: stochastic subspace identification, covariance- or data-driven, with ``rows`` block rows."""
    from pyoma2.functions import ssi

    def identify(y: Real, rate: float) -> Complex:
        hankel, _ = ssi.build_hank(y, y, rows, method)
        _, states, *_ = ssi.SSI_fast(hankel, rows, 4, step=4)
        return np.linalg.eigvals(states[-1]).astype(np.complex128)

    return identify


def sdypy_lscf(order: int) -> Identify:
    """sdypy-EMA: least-squares complex frequency on the spectrum of the decay, poles of the highest order."""
    from sdypy import EMA

    def identify(y: Real, rate: float) -> Complex:
        spectrum = np.fft.rfft(y)
        frequency = np.fft.rfftfreq(y.shape[1], 1 / rate)
        model = EMA.Model(spectrum, frequency, lower=100, upper=5000, pol_order_high=order)
        model.get_poles(method="lscf", show_progress=False)
        return np.exp(np.asarray(model.all_poles[-1], np.complex128) / rate)

    return identify


def mdof_era(size: int) -> Identify:
    """Mdof: ERA with ``size`` block rows and columns."""
    from mdof import realize

    def identify(y: Real, rate: float) -> Complex:
        state, *_ = realize.era(y[:, None, :], horizon=size, nc=size, order=4)
        return np.linalg.eigvals(state).astype(np.complex128)

    return identify


Setting = tuple[str, Callable[[], Identify]]
PEERS: dict[str, tuple[str, list[Setting]]] = {
    "python-control eigensys_realization": (
        "control",
        [(f"m = n = {s}", partial(control_era, s)) for s in (50, 100, 200, 350, 500, 800)],
    ),
    "pyyeti ERA": ("pyyeti", [(f"alpha = beta = {r}", partial(pyyeti_era, r)) for r in (100, 200, 500)]),
    "pyOMA2 SSI-cov": ("pyOMA-2", [(f"br = {r}", partial(pyoma_ssi, "cov", r)) for r in (50, 150)]),
    "pyOMA2 SSI-dat": ("pyOMA-2", [(f"br = {r}", partial(pyoma_ssi, "dat", r)) for r in (50, 150)]),
    "sdypy-EMA LSCF": ("sdypy-EMA", [(f"order {o}", partial(sdypy_lscf, o)) for o in (10, 20, 40)]),
    "mdof ERA": ("mdof", [(f"horizon = nc = {s}", partial(mdof_era, s)) for s in (100, 200, 500)]),
}


def version(package: str) -> str:
    """Installed version of a package."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def quiet(identify: Identify, y: Real, rate: float) -> Complex:
    """Run a peer without its prints and warnings."""
    logging.disable(logging.WARNING)
    try:
        with (
            warnings.catch_warnings(),
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(io.StringIO()),
        ):
            warnings.simplefilter("ignore")
            return identify(y, rate)
    finally:
        logging.disable(logging.NOTSET)
