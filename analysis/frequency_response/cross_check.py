"""k_c a second time, from the hammer's force: each load of a session, beside k_c by Eq. 11 from the ring-down."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.frequency_response.estimators import (
    HIGHEST_SHARE,
    Complex,
    ForceError,
    FrequencyResponse,
    Real,
    laplace,
)
from analysis.frequency_response.impacts import HitRecord, Measured, of_hits, with_notes
from analysis.frequency_response.two_mass import LOWER, Seen, TwoMassFit, TwoMassModel, fit_two_mass
from analysis.frequency_response.windows import BandPass
from analysis.moving_masses import MovingMasses, moving_masses
from calibration.estimate import Estimate
from daq.records import Impact, RigDescription, Session
from rig.settings import Hammer, Masses, Springs, Wiring
from rig.tube import HIGHEST

POUND_FORCE_N = 4.4482216152605
"""Newtons in a pound-force: mV/lbf over mV/N."""

NEAR_POUND = 0.12
"""Relative distance of a factor from `POUND_FORCE_N` within which it may be that: sensitivities together, doubled."""

LOWEST_HZ, HIGHPASS_MULTIPLE = 50.0, 3.0
"""Where the fit begins: well above the mains' rectified drift and the corner of a high-pass."""

WITHIN = 0.9
"""Share of the excited band below which the contact mode has to lie to be fitted."""

CONTACT_ABOVE = 1.5
"""Of the system mode's frequency, above which the contact mode's peak is looked for."""

DIFFERS = 3.0
"""Standard errors from which a sum of masses counts as wrong, and what may be wrong is said."""


@dataclass(frozen=True, slots=True)
class CrossCheck:
    """What the hammer says of one load.

    Attributes
    ----------
    load_set, target_load_mn
        Which load.
    response
        Of the mean of A and B to the force on the upper mass; None without a usable hit.
    fit
        Eq. 9 fitted to it; None where it cannot be, and ``notes`` says why.
    by_ring_down
        k_c by Eq. 11, N/m.
    difference
        k_c by the hammer less that by Eq. 11, N/m.
    declared_mass_sum
        m1 + m2 as weighed, with what moves of the tube springs, kg.
    notes
        Faults of the hammer, hits that were left out, what does not agree.
    """

    load_set: int
    target_load_mn: float
    response: FrequencyResponse | None
    fit: TwoMassFit | None
    by_ring_down: Estimate | None
    difference: Estimate | None
    declared_mass_sum: Estimate
    notes: tuple[str, ...] = ()

    @property
    def standard_errors(self) -> float:
        """Difference of both k_c in standard errors of it; NaN where there is none."""
        if self.difference is None or not self.difference.standard_error > 0:
            return math.nan
        return self.difference.value / self.difference.standard_error

    @property
    def agrees(self) -> bool | None:
        """Whether the 95 % interval of the difference holds zero; None where there is no difference."""
        return None if self.difference is None else self.difference.low <= 0 <= self.difference.high

    @property
    def mass_difference(self) -> Estimate | None:
        """Sum of the masses by the hammer less that as weighed, kg."""
        return None if self.fit is None else _less(self.fit.mass_sum, self.declared_mass_sum)

    @property
    def sentence(self) -> str:
        """What came out, in one sentence."""
        if self.difference is None:
            return self.notes[0] if self.notes else "no k_c from the hammer"
        size = abs(self.standard_errors)
        share = self.difference.value / self.by_ring_down.value if self.by_ring_down else math.nan
        word = "agrees with" if self.agrees else "differs from"
        return f"k_c from the hammer {word} Eq. 11: {share:+.1%}, {size:.1f} standard errors of the difference"


def _less(first: Estimate, second: Estimate) -> Estimate:
    """Return the difference of two independent estimates; degrees of freedom by Welch and Satterthwaite."""
    error = math.hypot(first.standard_error, second.standard_error)
    parts = sum(e.standard_error**4 / e.dof for e in (first, second) if math.isfinite(e.dof))
    return Estimate(first.value - second.value, error, math.inf if parts == 0 else error**4 / parts)


def cross_checks(
    session: Session,
    ring_down: Sequence[tuple[int, Estimate | None]],
    masses: Masses,
    springs: Springs,
    wiring: Wiring,
) -> tuple[CrossCheck, ...]:
    """Return what the hammer says of each load; empty for a session without a hammer.

    Parameters
    ----------
    session
        Its accepted impacts are used, where they have a force.
    ring_down
        Each load set, with k_c by Eq. 11, N/m.
    masses, springs
        Their uncertainties, and the inertia of the tube springs.
    wiring
        Sensitivities of accelerometers and hammer with their uncertainties, and how far the hammer's channel reaches.
    """
    if all(impact.force is None for impact in session.impacts):
        return ()
    moving, _ = moving_masses(session.rig, masses, springs)
    return tuple(
        _of_load(session.accepted(load_set), load_set, by_eq_11, session.rig, moving, wiring)
        for load_set, by_eq_11 in ring_down
    )


def _of_load(
    impacts: Sequence[Impact],
    load_set: int,
    by_eq_11: Estimate | None,
    rig: RigDescription,
    moving: MovingMasses,
    wiring: Wiring,
) -> CrossCheck:
    total = float(moving.covariance.sum())
    declared = Estimate(moving.m1.value + moving.m2.value, math.sqrt(max(0.0, total)))
    target = impacts[0].target_load_mn if impacts else math.nan
    empty = CrossCheck(load_set, target, None, None, by_eq_11, None, declared)
    if not impacts:
        return replace(empty, notes=("no impact of this load was accepted",))
    hammer = wiring.hammer or Hammer(input=0)
    notes = []
    if wiring.hammer is None:
        notes.append(
            "the session declares no hammer (rig.wiring.hammer): its sensitivity counts as known to "
            f"{hammer.sensitivity_uncertainty_percent:g} %"
        )
    try:
        measured = response_of(impacts, rig, hammer if wiring.hammer is not None else None)
    except ForceError as error:
        return replace(empty, notes=(*notes, str(error)))
    response = with_notes(measured.response, notes)
    found = replace(empty, response=response, notes=response.notes)
    try:
        fit = _fit(measured, rig, moving, wiring, hammer)
    except ForceError as error:
        return replace(found, notes=(*found.notes, str(error)))
    found = replace(found, fit=fit, difference=None if by_eq_11 is None else _less(fit.contact_stiffness, by_eq_11))
    return replace(found, notes=(*found.notes, *_doubts(found)))


def response_of(impacts: Sequence[Impact], rig: RigDescription, hammer: Hammer | None) -> Measured:
    """Return the response of the mean of A and B to the hammer, averaged over the impacts that have a force.

    Raises
    ------
    ForceError
        None has, or none can be used.
    """
    hit = [impact for impact in impacts if impact.force is not None]
    if not hit:
        raise ForceError("no impact of this load has a force channel")
    rate = hit[0].sample_rate_hz
    same = [impact for impact in hit if impact.sample_rate_hz == rate]
    records = [
        HitRecord(impact.force, impact.acceleration.mean(axis=0, keepdims=True), f"impact {impact.name}")
        for impact in same
        if impact.force is not None
    ]
    filtered = True if hammer is None else hammer.filtered
    largest = math.inf if hammer is None else hammer.reach_n() * (1 - 2.0**-12)  # within a step of 12 bits of the end
    measured = of_hits(records, rate, ["mean of A and B"], band=_band(rig, filtered), largest_force=largest)
    left = len(impacts) - len(same)
    if not left:
        return measured
    return replace(
        measured,
        response=with_notes(measured.response, [f"{left} of {len(impacts)} impacts have no force, or another rate"]),
    )


def _band(rig: RigDescription, on_force: bool) -> BandPass | None:
    if rig.filter_family != "butterworth":
        return None
    high, low = (math.isfinite(f) and f > 0 for f in (rig.highpass_hz, rig.lowpass_hz))
    return BandPass(
        rig.highpass_hz if high else 0.0,
        rig.highpass_order if high else 0,
        rig.lowpass_hz if low else 0.0,
        rig.lowpass_order if low else 0,
        on_force,
    )


def _fit(measured: Measured, rig: RigDescription, moving: MovingMasses, wiring: Wiring, hammer: Hammer) -> TwoMassFit:
    response = measured.response
    frequency, h1 = response.frequency_hz, response.h1[0]
    rate = 2 * float(frequency[-1])
    band = fitted_band(response, rig, moving, rate)
    start = first_model(frequency, h1, response.decay_per_s, rig, moving, band)
    m1, m2, c = moving.m1.value, moving.m2.value, moving.covariance
    of_share = math.sqrt(max(0.0, m2**2 * c[0, 0] + m1**2 * c[1, 1] - 2 * m1 * m2 * c[0, 1])) / (m1 + m2) ** 2
    of_both = math.hypot(
        *(ch.sensitivity_uncertainty_percent for ch in (wiring.accelerometer_a, wiring.accelerometer_b))
    )
    return fit_two_mass(
        measured.spectra,
        frequency,
        [Seen(0, LOWER)],
        start,
        band,
        response.decay_per_s,
        scale_error=math.hypot(hammer.sensitivity_uncertainty_percent, of_both / 2) / 100,
        ratio_error=of_share,
    )


def fitted_band(
    response: FrequencyResponse, rig: RigDescription, moving: MovingMasses, rate: float
) -> tuple[float, float]:
    """Return between which frequencies, Hz, Eq. 9 is fitted to responses sampled at a rate, Hz."""
    corner = rig.highpass_hz if math.isfinite(rig.highpass_hz) else 0.0
    top = min(response.force_limit_hz, HIGHEST_SHARE * rate)
    if moving.own_mode is not None:
        top = min(top, HIGHEST * moving.own_mode.frequency_hz)
    return max(LOWEST_HZ, HIGHPASS_MULTIPLE * corner), top


def first_model(
    frequency: Real,
    h1: Complex,
    decay: float,
    rig: RigDescription,
    moving: MovingMasses,
    band: tuple[float, float],
) -> TwoMassModel:
    """Return where the fit begins: the declared rig, k_c by the highest peak above f1, all scaled to the size of H1."""
    m1, m2 = moving.m1.value, moving.m2.value
    k1, k2 = rig.k1_n_per_m, rig.k2_n_per_m
    f1 = math.sqrt((k1 + k2) / (m1 + m2)) / (2 * math.pi)
    above = (frequency > CONTACT_ABOVE * f1) & (frequency <= band[1])
    peak = float(frequency[above][np.argmax(np.abs(h1[above]))]) if above.any() else math.nan
    if not peak < WITHIN * band[1]:
        raise ForceError(
            f"the hammer excites up to {band[1]:.0f} Hz only, and no contact mode shows below {WITHIN * band[1]:.0f} "
            "Hz: use a harder tip"
        )
    # the contact mode of Eq. 9 with equal springs: omega^2 = (k_c + k1 k2 / (k1 + k2)) (m1 + m2) / (m1 m2)
    kc = max((2 * math.pi * peak) ** 2 * m1 * m2 / (m1 + m2) - k1 * k2 / (k1 + k2), 0.01 * (k1 + k2))
    model = TwoMassModel(m1, m2, k1, k2, kc, 0.02 * math.sqrt(kc * m1 * m2 / (m1 + m2)), 0.0, moving.own_mode)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    shape = np.abs(model.accelerance(laplace(frequency[inside], decay)))
    size = float(np.median(np.abs(h1[inside])) / np.median(shape))
    own = model.tube_mode
    return replace(
        model,
        m1=m1 / size,
        m2=m2 / size,
        k1=k1 / size,
        k2=k2 / size,
        kc=kc / size,
        cc=model.cc / size,
        tube_mode=None if own is None else replace(own, mass_kg=own.mass_kg / size),
    )


def _doubts(found: CrossCheck) -> list[str]:
    """Return what may be wrong where the masses do not come out as they were weighed."""
    difference = found.mass_difference
    if found.fit is None or difference is None or abs(difference.value) < DIFFERS * difference.standard_error:
        return []
    factor = found.fit.mass_sum.value / found.declared_mass_sum.value
    said = f"the masses come out {factor:.3g} times as heavy as they were weighed"
    for guess, key in ((POUND_FORCE_N, "the force reads too high"), (1 / POUND_FORCE_N, "the force reads too low")):
        if abs(factor / guess - 1) < NEAR_POUND:
            unit = "mV/N given where mV/lbf were meant" if guess > 1 else "mV/lbf given where mV/N were meant"
            return [
                f"{said}, which is 4.448 or its inverse: {key} as if the sensitivity had been in pounds-force ({unit}, "
                "in rig.wiring.hammer.sensitivity_mv_per_n); a gain of the conditioner that is 4 or 5 times off, or an "
                "accelerometer's sensitivity, would look the same"
            ]
    return [
        f"{said}, {abs(difference.value) / difference.standard_error:.1f} standard errors: the sensitivity or gain of "
        "the hammer, or of the accelerometers, is off by that factor, or the tap did not act on the upper mass alone; "
        "k_c by Eq. 11 does not depend on either"
    ]
