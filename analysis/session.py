"""A test session of the tester, analysed: modes of each impact, k_c and zeta of each load, all with uncertainties."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from analysis.budgets import (
    RigSource,
    contact_budgets,
    mass_sources,
    modal_budget,
    with_clock,
)
from analysis.frequency_response.cross_check import cross_checks
from analysis.modal.amplitude import AmplitudePoint, along_the_decay, combined_curve, varies
from analysis.modal.checks import DISAGREEMENT
from analysis.modal.clipping import clipped_samples
from analysis.modal.consensus import CONTACT_MODE_ABOVE, HIGHEST_SHARE
from analysis.modal.modes import ModeEstimate
from analysis.modal.noise import NoiseModel, noise_model
from analysis.modal.noise_of_taps import noise_with_residuals
from analysis.modal.spectrum import SpectralMode, spectral_mode
from analysis.modal.tester import (
    ImpactModes,
    filter_poles,
    identify_impacts,
    system_resonance_hz,
)
from analysis.moving_masses import MovingMasses, moving_masses
from analysis.results import ImpactResult, LoadResult, SessionResults, Spectrum
from analysis.settings import AnalysisSettings
from analysis.statistics import box_statistics, combine
from analysis.stiffness import (
    ContactEstimate,
    ResonanceError,
    contact_estimate,
    contact_from_pole,
    pole,
    springs_from_system_mode,
)
from analysis.tap_scatter import QUANTITIES, Repeated, Scatter, known_scatter, repeated, single_tap_note
from calibration.budget import Budget, Contribution
from calibration.estimate import Estimate
from calibration.gauge import GaugeHistory
from calibration.settings import CalibrationSettings
from daq.contact_force import contact_force
from daq.hits import is_left_out
from daq.records import Impact, RigDescription, Session
from rig.errors import MesotapError
from rig.interlock import CAREFUL_READING_S
from rig.settings import Masses, Springs, Wiring
from rig.tube import OwnMode

BUDGETED = ("load_mn", *QUANTITIES, "contact_stiffness_n_per_m", "contact_damping_n_s_per_m")
CALM_SAMPLES = 5  # after the first one used, by which the last of the pulse and of the low-pass is gone
GUARD_SAMPLES = 8  # before the trigger that may already belong to the tap
FEW_QUIET = 2000  # samples of noise, below which what the modes leave tells of it too: 250 hold zeta1 in 171 of 200
VARIES_LEVEL = 1e-5  # chance of calling a mode that is constant along its decay a changing one, each load
SURE = 0.1  # relative standard error of the damping up to which a point is quoted
SMALLEST_PROBABILITY = 1e-10
BROAD = 0.1  # damping ratio from which a peak is too broad to be read off a spectrum
SPECTRAL_BIAS = 2e-3, 0.05  # of frequency and damping, relative, that reading a spectrum may have
TUBE_SHARE_UNSURE = 0.5  # standard error of what is taken off for tube damping, relative: other causes take off nothing
TUBE_DAMPING_SCORE = 5.0  # standard errors of zeta1 from which the system mode counts as decaying
LEAST_TUBE_DAMPING = 1e-5  # and the smallest zeta1 that does
POOR_FIT = 1.3  # residual variance over noise variance from which the model is said to be incomplete

OnProgress = Callable[[int, int], None]


class AnalysisError(MesotapError, ValueError):
    """A session cannot be analysed; one sentence."""


@dataclass(frozen=True, slots=True)
class KnownRig:
    """Masses and springs as known beforehand, with their standard errors, and how k1 and k2 hang together.

    ``covariance`` is that of (m1, m2, k1, k2): springs that were measured through the system mode follow the masses.
    ``tube_damping`` is a viscous damper beside each tube spring, N s/m, which Eq. 9 leaves out: zero unless the system
    mode is seen to decay. Its share is taken off k_c and c_c, and counts in part as uncertain. ``m1`` and ``m2`` are
    the masses at rest; the tube springs' ``own_mode`` adds to them with the frequency. ``sources`` are what the
    covariance is made of, ``springs_by_clock`` what an error of the recorder's clock does to k1 and k2.
    """

    m1: Estimate
    m2: Estimate
    k1: Estimate
    k2: Estimate
    covariance: NDArray[np.float64]
    tube_damping: float = 0.0
    own_mode: OwnMode | None = None
    sources: tuple[RigSource, ...] = ()
    springs_by_clock: tuple[float, float] = (0.0, 0.0)

    def contact(self, mode: ModeEstimate) -> ContactEstimate:
        """k_c and c_c of one impact."""
        both = _correlation_block(mode)
        full = np.zeros((6, 6))
        full[:2, :2], full[2:, 2:] = both, self.covariance
        return self._without_tubes(mode.frequency_hz, mode.damping_ratio, full)

    def contact_of_load(self, found: Mapping[str, Repeated], wiring: Wiring) -> tuple[Budget, Budget]:
        """Budgets of k_c and c_c of the combined impacts of a load."""
        f2, zeta2 = found["f2_hz"].estimate, found["zeta2"].estimate
        full = np.zeros((6, 6))
        full[0, 0], full[1, 1] = f2.standard_error**2, zeta2.standard_error**2
        full[2:, 2:] = self.covariance
        plain = replace(self, tube_damping=0.0)._without_tubes(f2, zeta2, full)
        corrected = self._without_tubes(f2, zeta2, full)
        return contact_budgets(found, plain, corrected, self.sources, self.springs_by_clock, wiring, TUBE_SHARE_UNSURE)

    def _without_tubes(self, f2: Estimate, zeta2: Estimate, covariance: NDArray[np.float64]) -> ContactEstimate:
        """k_c and c_c by Eq. 10, less what dampers beside the tube springs add: each k_i becomes k_i + c s."""
        m1, m2 = MovingMasses(self.m1, self.m2, self.covariance[:2, :2], self.own_mode).at(f2.value)
        plain = contact_estimate(f2, zeta2, m1, m2, self.k1, self.k2, covariance)
        if self.tube_damping == 0.0:
            return plain
        s = pole(f2.value, zeta2.value)
        a = m1.value * s * s + self.tube_damping * s + self.k1.value
        b = m2.value * s * s + self.tube_damping * s + self.k2.value
        interface = -a * b / (a + b)
        damping = interface.imag / s.imag
        stiffness = interface.real - damping * s.real
        corrected = [
            Estimate(value, math.hypot(e.standard_error, TUBE_SHARE_UNSURE * (value - e.value)), e.dof)
            for value, e in ((stiffness, plain.stiffness_n_per_m), (damping, plain.damping_n_s_per_m))
        ]
        return replace(plain, stiffness_n_per_m=corrected[0], damping_n_s_per_m=corrected[1])


@dataclass(frozen=True, slots=True)
class _Beside:
    """What a session knows beside its taps: rig, gauge and its reading error (mV), noise, recorder, usual scatter."""

    known: KnownRig
    history: GaugeHistory
    reading: float
    noise: NoiseModel
    wiring: Wiring
    scatter: Mapping[str, Scatter]


def analyse_session(
    session: Session,
    settings: AnalysisSettings,
    calibration: CalibrationSettings,
    masses: Masses,
    springs: Springs,
    on_progress: OnProgress | None = None,
    wiring: Wiring | None = None,
) -> SessionResults:
    """Analyse all accepted impacts of a session.

    Parameters
    ----------
    session
        From a session file, with masses and springs known.
    settings
        Method, whether the springs are taken from the session's own system mode, and how single taps scatter.
    calibration
        What is declared of weights, gravity and the gauge's stability, and the level of the drift test.
    masses, springs
        Their uncertainties (values are those of the session).
    on_progress
        Called with loads done and loads in all.
    wiring
        Accuracy of the recorder's clock and of the accelerometers; None: the defaults.

    Raises
    ------
    AnalysisError
        If the session's rig is unknown or it holds no impacts.

    Examples
    --------
    >>> from daq.session_file import read_session  # doctest: +SKIP
    >>> session = read_session("session.h5")  # doctest: +SKIP
    >>> results = analyse_session(session, settings, calibration, masses, springs)  # doctest: +SKIP
    >>> [load.contact_stiffness_n_per_m for load in results.loads]  # doctest: +SKIP
    """
    rig = session.rig
    if not rig.is_tester:
        raise AnalysisError(
            f"{session.source or 'session'}: masses and springs are unknown, so there is no k_c to find"
        )
    if not session.impacts:
        raise AnalysisError(f"{session.source or 'session'}: holds no impacts")
    slowest_hz = min(impact.sample_rate_hz for impact in session.impacts)
    if rig.filter_family == "butterworth" and rig.highpass_hz >= slowest_hz / 2:
        raise AnalysisError(
            f"{session.source or 'session'}: the declared high-pass begins at {rig.highpass_hz:g} Hz, so nothing "
            f"that {slowest_hz:g} samples a second show would pass it; correct highpass_hz of /rig"
        )
    history = GaugeHistory(session.pre, session.post, calibration, session.zeros)
    load_sets = session.load_sets()
    # the matrices are small: further BLAS threads would only get in each other's way
    with threadpool_limits(limits=1, user_api="blas"):
        modes, noise = _modes_in_noise(session, settings, on_progress)
    known, notes = _known_rig(session, modes, settings, masses, springs)
    taps = {load_set: _taps(session.accepted(load_set), modes) for load_set in load_sets}
    beside = _Beside(
        known=known,
        history=history,
        reading=_gauge_reading_error(
            session.impacts, history.reading_std_mv * math.sqrt(calibration.averaging_s / CAREFUL_READING_S)
        ),
        noise=noise,
        wiring=wiring or Wiring(),
        scatter=known_scatter(list(taps.values()), settings.tap_scatter),
    )
    impacts = [_impact(impact, modes.get(impact.number), beside, rig) for impact in session.impacts]
    loads = [_load(session, load_set, modes, taps[load_set], impacts, beside) for load_set in load_sets]
    k_c = [(load.load_set, load.contact_stiffness_n_per_m) for load in loads]
    return SessionResults(
        source=session.source,
        method=settings.method,
        loads=tuple(loads),
        impacts=tuple(impacts),
        calibration=history.result(),
        springs_n_per_m=(known.k1, known.k2),
        notes=(*session.refused, *notes, *history.notes),
        hammer=cross_checks(session, k_c, masses, springs, beside.wiring),
    )


def session_modes(session: Session, settings: AnalysisSettings) -> dict[int, ImpactModes]:
    """Return both modes of every accepted impact, by its number."""
    return _modes_in_noise(session, settings, None)[0]


def _modes_in_noise(
    session: Session, settings: AnalysisSettings, on_progress: OnProgress | None
) -> tuple[dict[int, ImpactModes], NoiseModel]:
    """Both modes of every accepted impact, and the noise that they were read in, told again where little was heard."""
    noise = _noise(session)
    modes = _modes(session, session.load_sets(), noise, settings, on_progress)
    heard = _noise_in_taps(session, modes)
    if heard is None:
        return modes, noise
    return _modes(session, session.load_sets(), heard, settings, None), heard


def _modes(
    session: Session,
    load_sets: Sequence[int],
    noise: NoiseModel,
    settings: AnalysisSettings,
    on_progress: OnProgress | None,
) -> dict[int, ImpactModes]:
    """Both modes of every accepted impact, by its number."""
    modes: dict[int, ImpactModes] = {}
    for done, load_set in enumerate(load_sets):
        impacts = session.accepted(load_set)
        for rate in sorted({s.sample_rate_hz for s in impacts}):
            same = [s for s in impacts if s.sample_rate_hz == rate]
            found = identify_impacts(
                [s.acceleration.mean(axis=0) for s in same],
                [s.pretrigger for s in same],
                rate,
                session.rig,
                noise,
                settings.method,
                [clipped_samples(s.acceleration) for s in same],
            )
            modes |= {s.number: m for s, m in zip(same, found, strict=True)}
        if on_progress is not None:
            on_progress(done + 1, len(load_sets))
    return modes


def _taps(impacts: Sequence[Impact], modes: dict[int, ImpactModes]) -> dict[str, list[Estimate]]:
    """Each quantity of the accepted taps of a load that show a contact mode, without what all taps have in common."""
    taps: dict[str, list[Estimate]] = {name: [] for name in QUANTITIES}
    for impact in impacts:
        found = modes.get(impact.number)
        if found is None or found.contact is None:
            continue
        for mode, frequency, damping in ((found.system, "f1_hz", "zeta1"), (found.contact, "f2_hz", "zeta2")):
            if mode is not None:
                taps[frequency].append(mode.frequency_hz)
                taps[damping].append(mode.damping_ratio)
    return taps


def _quiet(session: Session) -> list[NDArray[np.float64]]:
    """Mean of A and B of the accepted records before their triggers."""
    good = [s for s in session.impacts if s.accepted]
    return [s.acceleration[:, : max(0, s.pretrigger - GUARD_SAMPLES)].mean(axis=0) for s in good]


def _noise(session: Session) -> NoiseModel:
    """Noise of the mean of A and B, from the accepted records before their triggers."""
    return noise_model(_quiet(session))


def _noise_in_taps(session: Session, modes: dict[int, ImpactModes]) -> NoiseModel | None:
    """Noise told from what the modes leave, too; None where enough was heard before the taps, or nothing."""
    quiet = _quiet(session)
    if not 0 < sum(stretch.size for stretch in quiet) < FEW_QUIET:
        return None
    rates = {s.sample_rate_hz for s in session.impacts if s.accepted}
    if len(rates) > 1:
        return None
    (rate,) = rates
    good = [s for s in session.impacts if s.accepted and s.number in modes]
    means, found = [s.acceleration.mean(axis=0) for s in good], [modes[s.number] for s in good]
    return noise_with_residuals(quiet, means, found, filter_poles(session.rig, rate), rate)


def _correlation_block(mode: ModeEstimate) -> NDArray[np.float64]:
    """Covariance of (f, zeta) of a mode."""
    s = mode.pole
    size = abs(s)
    jacobian = np.array(
        [
            [s.real / size / (2 * math.pi), s.imag / size / (2 * math.pi)],
            [-(s.imag**2) / size**3, s.real * s.imag / size**3],
        ]
    )
    block: NDArray[np.float64] = jacobian @ mode.pole_covariance @ jacobian.T
    return block


def _known_rig(
    session: Session,
    modes: dict[int, ImpactModes],
    settings: AnalysisSettings,
    masses: Masses,
    springs: Springs,
) -> tuple[KnownRig, list[str]]:
    """Masses as declared; springs as declared, or from the system mode of this session (Eq. 10)."""
    rig = session.rig
    moving, notes = moving_masses(rig, masses, springs)
    m1, m2, own_mode = moving.m1, moving.m2, moving.own_mode
    covariance = np.zeros((4, 4))
    covariance[:2, :2] = moving.covariance
    systems = [m.system.frequency_hz for m in modes.values() if m.system is not None]
    f1 = combine([e.value for e in systems], [e.standard_error for e in systems])
    if settings.springs == "declared" or f1 is None:
        errors = [k * springs.uncertainty_percent / 100 for k in (rig.k1_n_per_m, rig.k2_n_per_m)]
        covariance[2, 2], covariance[3, 3] = errors[0] ** 2, errors[1] ** 2
        k1, k2 = Estimate(rig.k1_n_per_m, errors[0]), Estimate(rig.k2_n_per_m, errors[1])
        sources = [
            *mass_sources((m1.value, m2.value), covariance[:2, :2], None),
            RigSource("tube spring k1", k1.value, "N/m", errors[0], np.array([0.0, 0.0, 1.0, 0.0])),
            RigSource("tube spring k2", k2.value, "N/m", errors[1], np.array([0.0, 0.0, 0.0, 1.0])),
        ]
        if settings.springs != "declared":
            notes.append("no system mode was found: the springs are the declared ones")
        return KnownRig(m1, m2, k1, k2, covariance, own_mode=own_mode, sources=tuple(sources)), notes
    ratio = rig.k2_n_per_m / rig.k1_n_per_m
    values = _spring_values(moving, modes, f1.value, ratio)
    mass = sum(m.value for m in moving.at(f1.value))
    # k = (m1 + m2) omega1^2 / 2 each; the split between them is not seen
    by_mass = np.array([[k / mass] * 2 for k in values])
    mass_part = by_mass @ covariance[:2, :2]
    by_f1 = np.array([2 * k / f1.value for k in values]) * f1.standard_error
    split = np.array([values[0], -values[1]]) * settings.spring_asymmetry_percent / 100 / math.sqrt(2)
    covariance[2:, :2], covariance[:2, 2:] = mass_part, mass_part.T
    covariance[2:, 2:] = mass_part @ by_mass.T + np.outer(by_f1, by_f1) + np.outer(split, split)
    k1, k2 = (Estimate(k, math.sqrt(covariance[i, i])) for i, k in enumerate(values, start=2))
    sources = [
        *mass_sources((m1.value, m2.value), covariance[:2, :2], by_mass),
        RigSource(
            "f1, for the tube springs", f1.value, "Hz", f1.standard_error, np.array([0, 0, *values]) * 2 / f1.value
        ),
        RigSource(
            "how the tube springs' sum splits",
            math.nan,
            "%",
            settings.spring_asymmetry_percent,
            np.array([0, 0, values[0], -values[1]]) / 100 / math.sqrt(2),
        ),
    ]
    declared = (rig.k1_n_per_m + rig.k2_n_per_m) / sum(values) - 1
    if abs(declared) > 3 * springs.uncertainty_percent / 100:
        notes.append(
            f"the declared springs are {100 * declared:+.1f} % off what the system mode of this session says; "
            "its own are used"
        )
    damping = _tube_damping(modes, mass, f1.value, notes)
    # a clock that runs wrong shifts f1 as it does f2
    by_clock = 2 * values[0], 2 * values[1]
    return KnownRig(m1, m2, k1, k2, covariance, damping, own_mode, tuple(sources), by_clock), notes


def _tube_damping(modes: dict[int, ImpactModes], mass: float, f1: float, notes: list[str]) -> float:
    """Damper beside each tube spring that makes the system mode decay as it does, N s/m; zero if it hardly does."""
    systems = [m.system.damping_ratio for m in modes.values() if m.system is not None]
    zeta1 = combine([e.value for e in systems], [e.standard_error for e in systems])
    if zeta1 is None or zeta1.value < max(TUBE_DAMPING_SCORE * zeta1.standard_error, LEAST_TUBE_DAMPING):
        return 0.0
    notes.append(
        f"the system mode decays (zeta1 = {100 * zeta1.value:.3g} %), which Eq. 9 leaves out: equal dampers beside the "
        "tube springs are taken off k_c and c_c"
    )
    # both masses move together: 2 zeta1 omega1 = 2 c / (m1 + m2)
    return zeta1.value * 2 * math.pi * f1 * mass


def _spring_values(moving: MovingMasses, modes: dict[int, ImpactModes], f1: float, ratio: float) -> tuple[float, float]:
    """k1, k2 from the system mode, for the finite k_c of this session."""
    m1, m2 = (m.value for m in moving.at(f1))
    k1, k2 = springs_from_system_mode(f1, math.inf, m1, m2, ratio)
    stiffness = []
    for found in modes.values():
        if found.contact is not None:
            try:
                frequency, damping = found.contact.frequency_hz, found.contact.damping_ratio
                at = pole(frequency.value, damping.value)
                stiffness.append(contact_from_pole(at, m1, m2, k1, k2)[0])
            except ResonanceError:
                continue
    if not stiffness:
        return k1, k2
    return springs_from_system_mode(f1, float(np.median(stiffness)), m1, m2, ratio)


def _gauge_reading_error(impacts: Sequence[Impact], calibrations_mv: float) -> float:
    """Standard error of one gauge reading, mV, from readings before and after the same tap.

    A single tap hardly shows it: there it is at least what the scatter of the calibrations makes of so short a reading.
    """
    change = [s.voltage_after_mv - s.voltage_before_mv for s in impacts if s.accepted]
    usable = [c for c in change if math.isfinite(c)]
    own = math.sqrt(sum(c * c for c in usable) / len(usable) / 2) if usable else 0.0
    return own if len(usable) >= 2 else max(own, calibrations_mv)


def _impact_voltage(impact: Impact) -> float:
    """Bridge voltage of an impact: mean of before and after, or of the samples before the trigger."""
    read = [v for v in (impact.voltage_before_mv, impact.voltage_after_mv) if math.isfinite(v)]
    if read:
        return sum(read) / len(read)
    if impact.strain_mv is not None and impact.pretrigger > GUARD_SAMPLES:
        return float(np.mean(impact.strain_mv[: impact.pretrigger - GUARD_SAMPLES]))
    return math.nan


def _written_load(impact: Impact) -> float:
    """Load that the session file itself gives for an impact, mN."""
    read = [v for v in (impact.load_before_mn, impact.load_after_mn) if math.isfinite(v)]
    return sum(read) / len(read) if read else math.nan


def _impact_load(impact: Impact, history: GaugeHistory, reading: float) -> Estimate | None:
    by_gauge = history.load_at(_impact_voltage(impact), impact.time, reading / math.sqrt(2))
    if by_gauge is not None:
        return by_gauge
    written = _written_load(impact)
    if not math.isfinite(written):
        return None
    return history.of_written_load(written, _before_and_after(impact)).estimate()


def _before_and_after(impact: Impact) -> Contribution:
    """What the load before a tap and that after it, as written in the file, tell of the uncertainty of their mean."""
    change = abs(impact.load_after_mn - impact.load_before_mn)
    error = change / 2 if math.isfinite(change) else 0.0
    return Contribution("load before the tap against that after it", _written_load(impact), "mN", error, 1.0)


def _impact(
    impact: Impact,
    found: ImpactModes | None,
    beside: _Beside,
    rig: RigDescription,
) -> ImpactResult:
    mean = impact.acceleration.mean(axis=0)
    force = contact_force(mean, impact.sample_rate_hz, rig.m2_kg, rig.k2_n_per_m, impact.pretrigger)
    system = None if found is None else found.system
    contact = None if found is None else found.contact
    unused = "others of its load were chosen" if is_left_out(impact) else "rejected when it was recorded"
    notes = list(found.notes) if found is not None else [f"{unused}: not analysed"]
    if impact.accepted and impact.extra.get("overruled"):
        why, against = impact.extra.get("hand_reason"), impact.extra["overruled"]
        notes.insert(0, f"accepted by hand: {why} (against it: {against})")
    stiffness = damping = None
    if contact is not None:
        try:
            interface = beside.known.contact(contact)
            stiffness, damping = interface.stiffness_n_per_m, interface.damping_n_s_per_m
        except ResonanceError as error:
            notes.append(str(error))
    return ImpactResult(
        name=impact.name,
        load_set=impact.load_set,
        accepted=impact.accepted,
        reject_reason=impact.reject_reason,
        load_mn=_impact_load(impact, beside.history, beside.reading),
        f1_hz=None if system is None else with_clock(system.frequency_hz, beside.wiring),
        f2_hz=None if contact is None else with_clock(contact.frequency_hz, beside.wiring),
        zeta1=None if system is None else system.damping_ratio,
        zeta2=None if contact is None else contact.damping_ratio,
        contact_stiffness_n_per_m=stiffness,
        contact_damping_n_s_per_m=damping,
        peak_acceleration_m_s2=float(np.max(np.abs(impact.acceleration))),
        peak_contact_force_n=float(np.max(np.abs(force))),
        notes=tuple(notes),
    )


def _load(
    session: Session,
    load_set: int,
    modes: dict[int, ImpactModes],
    taps: Mapping[str, Sequence[Estimate]],
    found: Sequence[ImpactResult],
    beside: _Beside,
) -> LoadResult:
    impacts = session.accepted(load_set)
    accepted = [i for i in found if i.load_set == load_set and i.accepted]
    used = [i for i in accepted if i.f2_hz is not None]
    together = {name: r for name in QUANTITIES if (r := repeated(taps[name], beside.scatter[name])) is not None}
    budgets = {name: modal_budget(name, r, beside.wiring) for name, r in together.items()}
    load_budget = _mean_load(impacts, beside.history, beside.reading)
    if load_budget is not None:
        budgets["load_mn"] = load_budget
    notes = [note] if (note := single_tap_note(together)) else []
    if {"f2_hz", "zeta2"} <= together.keys():
        try:
            budgets |= {b.quantity: b for b in beside.known.contact_of_load(together, beside.wiring)}
        except ResonanceError as error:
            notes.append(str(error))
    elif not accepted:
        notes.append("no accepted impact at this load")
    else:
        notes += sorted({n for i in accepted for n in i.notes})
    notes += _load_notes(used, [modes[s.number] for s in impacts if s.number in modes], beside.history)
    spectral, curve, found_along = _along(impacts, modes, session.rig, beside.noise)
    notes += found_along
    if spectral is not None and {"f2_hz", "zeta2"} <= together.keys():
        notes += _spectral_notes(spectral, together["f2_hz"].estimate, together["zeta2"].estimate)
    rejected = [s for s in session.impacts if s.load_set == load_set]
    estimates = {name: budget.estimate() for name, budget in budgets.items()}
    return LoadResult(
        load_set=load_set,
        target_load_mn=(impacts or rejected)[0].target_load_mn,
        load_mn=estimates.get("load_mn"),
        impacts_used=len(used),
        f1_hz=estimates.get("f1_hz"),
        f2_hz=estimates.get("f2_hz"),
        zeta1=estimates.get("zeta1"),
        zeta2=estimates.get("zeta2"),
        contact_stiffness_n_per_m=estimates.get("contact_stiffness_n_per_m"),
        contact_damping_n_s_per_m=estimates.get("contact_damping_n_s_per_m"),
        stiffness_box=box_statistics(
            [i.contact_stiffness_n_per_m.value for i in used if i.contact_stiffness_n_per_m is not None]
        ),
        damping_box=box_statistics([i.zeta2.value for i in used if i.zeta2 is not None]),
        spectrum=_averaged_spectrum(impacts),
        notes=tuple(notes),
        spectral_mode=spectral,
        along_decay=tuple(curve),
        budgets=tuple(budgets[name] for name in BUDGETED if name in budgets),
    )


DRIFTED = "the strain gauge drifted during the test: the load is interpolated and its interval widened"
"""Note of every load of a session whose gauge drifted."""


def _load_notes(used: Sequence[ImpactResult], found: Sequence[ImpactModes], history: GaugeHistory) -> list[str]:
    notes = []
    if history.verdict is not None and history.verdict.drifted:
        notes.append(DRIFTED)
    ratios = [m.residual_ratio for m in found if math.isfinite(m.residual_ratio)]
    if ratios and float(np.median(ratios)) > POOR_FIT:
        notes.append(
            f"the two modes leave {np.median(ratios):.3g} times the noise's variance: the model is not complete here"
        )
    for sentence in sorted({n for m in found for n in m.notes if n.startswith("a further mode")}):
        notes.append(sentence)
    split = sum(any("disagree" in n for n in i.notes) for i in used)
    if split > len(used) / 4:
        notes.append(
            f"ERA and maximum likelihood disagree beyond their uncertainties on {split} of {len(used)} impacts"
        )
    return notes


def _along(
    impacts: Sequence[Impact], modes: dict[int, ImpactModes], rig: RigDescription, noise: NoiseModel
) -> tuple[SpectralMode | None, list[AmplitudePoint], list[str]]:
    """Contact mode of a load from its spectra, and against its amplitude along the ring-downs, with what that says."""
    decays, curves = [], []
    rate = impacts[0].sample_rate_hz if impacts else math.nan
    for impact in impacts:
        found = modes.get(impact.number)
        if found is None or found.system is None or found.contact is None or impact.sample_rate_hz != rate:
            continue
        mean = impact.acceleration.mean(axis=0)
        poles = np.exp(np.array([found.system.pole, found.contact.pole]) / rate)
        decays.append(mean[found.start :])
        # errors are those of white noise; what whitening does to the amplitude is undone
        white = noise.whiten(mean)[found.start - noise.order + CALM_SAMPLES :]
        gain = float(abs(np.polyval(noise.coefficients[::-1], 1 / poles[1])))
        points = along_the_decay(white, rate, poles, 1, filter_poles(rig, rate))
        curves.append([replace(p, amplitude=p.amplitude / gain) for p in points])
    band = CONTACT_MODE_ABOVE * system_resonance_hz(rig), HIGHEST_SHARE * rate
    spectral = spectral_mode(decays, rate, *band) if decays else None
    curve = combined_curve(curves)
    notes = []
    for probability, what, unit, scale in zip(
        varies(curves), ("frequency_hz", "damping_ratio"), ("Hz", "%"), (1.0, 100.0), strict=True
    ):
        sure = [p for p in curve if p.damping_ratio.standard_error < SURE * abs(p.damping_ratio.value)]
        if probability < VARIES_LEVEL and len(sure) > 1:
            ends = [getattr(point, what).value * scale for point in (sure[0], sure[-1])]
            chance = f"p = {probability:.1g}" if probability > SMALLEST_PROBABILITY else f"p < {SMALLEST_PROBABILITY:g}"
            notes.append(
                f"the {what.split('_')[0]} of the contact mode changes along the ring-down ({chance}): "
                f"{ends[0]:.5g} {unit} at {sure[0].amplitude:.2g} m/s2, {ends[1]:.5g} {unit} at "
                f"{sure[-1].amplitude:.2g} m/s2"
            )
    return spectral, curve, notes


def _spectral_notes(spectral: SpectralMode, f2: Estimate, zeta2: Estimate) -> list[str]:
    """Sentences where the spectra contradict the time domain by more than both uncertainties and the check's bias."""
    if spectral.damping_ratio.value > BROAD:
        return []
    notes = []
    for name, a, b, bias in (
        ("frequency", spectral.frequency_hz, f2, SPECTRAL_BIAS[0] * f2.value),
        ("damping ratio", spectral.damping_ratio, zeta2, SPECTRAL_BIAS[1] * abs(zeta2.value)),
    ):
        if abs(a.value - b.value) > DISAGREEMENT * math.hypot(a.standard_error, b.standard_error) + bias:
            notes.append(f"the averaged spectra give the contact mode a {name} of {a.value:.5g}, not {b.value:.5g}")
    return notes


def _mean_load(impacts: Sequence[Impact], history: GaugeHistory, reading: float) -> Budget | None:
    """Load of the accepted impacts of a load: mean voltage through the gauge's curve, or what the file says."""
    if not impacts:
        return None
    voltage = [_impact_voltage(s) for s in impacts]
    middle = sorted(s.time for s in impacts)[len(impacts) // 2]
    if all(map(math.isfinite, voltage)):
        count = len(voltage)
        spread, dof = (float(np.std(voltage, ddof=1)), count - 1.0) if count > 1 else (reading, math.inf)
        if spread < reading / 2:
            spread, dof = reading / 2, math.inf
        budget = history.budget_at(float(np.mean(voltage)), middle, spread / math.sqrt(count), dof)
        each = [load for load in (_impact_load(s, history, reading) for s in impacts) if load is not None]
        if budget is not None and each:
            # each tap has its own place between the calibrations
            return replace(budget, quantity="load_mn", value=float(np.mean([load.value for load in each])))
    written = [w for w in map(_written_load, impacts) if math.isfinite(w)]
    if not written:
        return None
    load = float(np.mean(written))
    if len(written) == 1:
        (only,) = (s for s in impacts if math.isfinite(_written_load(s)))
        return history.of_written_load(load, _before_and_after(only))
    error = float(np.std(written, ddof=1)) / math.sqrt(len(written))
    scatter = Contribution(f"scatter of {len(written)} taps", load, "mN", error, 1.0, len(written) - 1.0, "t")
    return history.of_written_load(load, scatter)


def _averaged_spectrum(impacts: Sequence[Impact]) -> Spectrum | None:
    """Mean amplitude spectrum of the impacts (Fig. 6b), each from its trigger on; m/s2 per Hz."""
    if not impacts:
        return None
    rate = impacts[0].sample_rate_hz
    length = min(s.acceleration.shape[1] - s.pretrigger for s in impacts)
    if length < 16 or any(s.sample_rate_hz != rate for s in impacts):
        return None
    amplitude = np.mean(
        [np.abs(np.fft.rfft(s.acceleration.mean(axis=0)[s.pretrigger : s.pretrigger + length])) for s in impacts],
        axis=0,
    )
    frequency = np.fft.rfftfreq(length, 1 / rate).astype(np.float64)
    return Spectrum(frequency, np.asarray(amplitude, np.float64) / rate)
