"""How much the taps of one load scatter, and what a single tap leaves unknown of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.settings import TapScatter
from analysis.statistics import combine
from calibration.estimate import Estimate

QUANTITIES = ("f1_hz", "f2_hz", "zeta1", "zeta2")
FEWEST_DOF = 3  # from which the scatter of a session's other loads is told at all
STATED_DOF = 8.0  # of a scatter that is stated beforehand: known to a quarter


@dataclass(frozen=True, slots=True)
class Scatter:
    """Standard deviation of one tap about its load, relative; its degrees of freedom, and where it comes from."""

    relative: float
    dof: float
    source: str


@dataclass(frozen=True, slots=True)
class Repeated:
    """What the taps of a load say of one quantity, and what the uncertainty of it is made of.

    ``scatter`` is what is added for a single tap; ``noise`` what the noise of the records alone would leave.
    """

    estimate: Estimate
    taps: int
    noise: float
    scatter: Scatter | None = None


def known_scatter(loads: Sequence[Mapping[str, Sequence[Estimate]]], stated: TapScatter) -> dict[str, Scatter]:
    """Return the scatter of each of `QUANTITIES`, from the loads with several taps, else as stated beforehand.

    Parameters
    ----------
    loads
        The taps' estimates of each quantity, for every load of the session.
    stated
        Section ``analysis.tap_scatter``.
    """
    found = {}
    for name in QUANTITIES:
        squares, dof = 0.0, 0
        for load in loads:
            values = np.array([estimate.value for estimate in load.get(name, ())])
            if len(values) > 1 and values.mean() > 0:
                squares += float(np.sum((values / values.mean() - 1) ** 2))
                dof += len(values) - 1
        if dof >= FEWEST_DOF and squares > 0:
            found[name] = Scatter(math.sqrt(squares / dof), float(dof), "the session's other loads")
        else:
            found[name] = Scatter(stated.relative(name), STATED_DOF, "analysis.tap_scatter")
    return found


def repeated(estimates: Sequence[Estimate], scatter: Scatter) -> Repeated | None:
    """Combine the taps of a load; to a single one its unknown scatter is added. None without a tap."""
    combined = combine([e.value for e in estimates], [e.standard_error for e in estimates])
    if combined is None:
        return None
    errors = np.array([e.standard_error for e in estimates])
    noise = float(1 / math.sqrt(np.sum(1 / errors**2))) if np.all(errors > 0) else 0.0
    if len(estimates) > 1:
        return Repeated(combined, len(estimates), noise)
    added = scatter.relative * abs(combined.value)
    variance = combined.standard_error**2 + added**2
    dof = scatter.dof * (variance / added**2) ** 2 if added > 0 else math.inf
    return Repeated(replace(combined, standard_error=math.sqrt(variance), dof=dof), 1, noise, scatter)


def single_tap_note(found: Mapping[str, Repeated | None]) -> str:
    """Return what a single tap leaves unknown, in a sentence; empty where there are several."""
    single = {name: r.scatter for name, r in found.items() if r is not None and r.scatter is not None}
    f2, zeta2 = single.get("f2_hz"), single.get("zeta2")
    if f2 is None or zeta2 is None:
        return ""
    return (
        f"a single tap does not tell how much taps scatter: {100 * f2.relative:.2g} % of f2 and "
        f"{100 * zeta2.relative:.2g} % of zeta2 are taken from {f2.source}"
    )
