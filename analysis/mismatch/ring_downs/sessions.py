"""From sessions of impacts to what is fitted: loads, noise, the contact as a linear analysis has it, the filter."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.mismatch.answer import LOAD_SCALE
from analysis.mismatch.rig_description import DescribedRig
from analysis.mismatch.ring_downs.experiment import channel_noise, joined, segments_of
from analysis.mismatch.ring_downs.modes import slow_filter_poles
from analysis.mismatch.ring_downs.noise import NoiseModel
from analysis.mismatch.ring_downs.problem import RingDowns
from analysis.session import AnalysisError, session_modes
from analysis.settings import AnalysisSettings
from analysis.stiffness import ResonanceError, springs_from_system_mode
from daq.records import Impact, RigDescription, Session
from rig.settings import Filter
from rig.tube import OwnMode
from sim_backend.arrangement import LOAD, Arrangement, Element, Parameter
from sim_backend.mechanisms import tube_mode
from sim_backend.recorder import analog_filter
from sim_backend.state_space import StateSpace
from sim_backend.two_mass import TUBE_MODE_DAMPING

NOISE_DIFFERENCE = 0.1  # of sessions that are diagnosed together
CYCLES_SKIPPED = 0.2  # oscillations of the system mode by which the declared springs may be off to begin with
FEWEST_IMPACTS = 4
HELD = 1e-6  # relative standard error of a constant that is declared as exact
NOWHERE = 1e-12  # the same of one that is zero
TUBE_MODE = ("mt", "kt", "ct")  # constants of the tube springs' declared own mode
LOAD_ERROR = 0.005  # relative standard error common to all loads where no calibration says it: assumed
TUBE_MODE_ERROR = 0.1  # relative standard error of its mass and stiffness: wall, seats, plane strain or stress


def ring_downs(
    sessions: Sequence[Session],
    rig: DescribedRig,
    uncertainty: Mapping[str, float],
) -> RingDowns:
    """Return the fitting problem of a session of impacts, or of several of one rig.

    Parameters
    ----------
    uncertainty
        Standard error of what the sessions' header declares, in its units, by its names.

    Raises
    ------
    AnalysisError
        A constant is not known, the sessions are of different rigs, or too few impacts show the modes.
    """
    first = sessions[0]
    arrangement = _declared(rig, first, uncertainty)
    usable = [_usable(session, arrangement) for session in sessions]
    noise, analog = _common_noise(usable), declared_filter(first.rig)
    parts = []
    for one in usable:
        try:
            parts.append(segments_of(one.session, arrangement, one.loads_n, one.constants, noise, analog))
        except ValueError as error:
            raise AnalysisError(f"{_name(one.session)}: {error}") from None
    scoped = [p.name for p in arrangement.parameters if p.scope == LOAD]
    start = np.array([[c[n] for n in scoped] for one in usable for _, c in sorted(one.constants.items())])
    header = first.rig
    highpass = header.highpass_hz if header.filter_family == "butterworth" else math.nan
    slow = slow_filter_poles(highpass, int(header.highpass_order))
    experiment = joined(parts)
    duration = max(s.y.shape[1] for s in experiment.segments) / experiment.sample_rate_hz
    return RingDowns(
        experiment, arrangement, analog, slow, start.reshape(len(experiment.loads_n), len(scoped)),
        rig_start=_springs_to_begin_with(usable, duration), name=rig.name, parts=rig.parts,
    )  # fmt: skip


def _declared(rig: DescribedRig, session: Session, uncertainty: Mapping[str, float]) -> Arrangement:
    """Return what the rig is made of, with what the session's header declares; sensors without gain and offset."""
    name = _name(session)
    if len(rig.seen) != len(session.impacts[0].acceleration) if session.impacts else False:
        raise AnalysisError(
            f"{name}: has {len(session.impacts[0].acceleration)} channels, {rig.name} has {len(rig.seen)}"
        )
    if rig.drives:
        raise AnalysisError(f"{name}: holds impacts; {rig.name} describes measured inputs")
    sensors = {n for seen in rig.seen for n in (seen.gain, seen.offset)}
    found = []
    for p in rig.arrangement.parameters:
        if p.name in sensors:
            continue
        if p.name in rig.header:
            key = rig.header[p.name]
            value = getattr(session.rig, key)
            if not math.isfinite(value):
                raise AnalysisError(f"{name}: masses and springs are unknown, so there is no Eq. 9 to compare with")
            found.append(replace(p, value=value, uncertainty=uncertainty[key]))
        elif p.scope == LOAD:
            found.append(p)
        elif not math.isfinite(p.value):
            raise AnalysisError(f"{name}: {rig.name} does not say {p.name}, which impacts alone cannot tell; give it")
        else:
            found.append(replace(p, uncertainty=max(p.uncertainty, HELD * abs(p.value), NOWHERE)))
    declared = replace(rig.arrangement, parameters=tuple(found))
    if not rig.preload_n:  # each session tells it
        declared = _with_load_scale(declared, uncertainty.get(LOAD_SCALE, LOAD_ERROR))
    return _with_tube_mode(declared, rig, session.rig.tube_mode)


def _with_load_scale(arrangement: Arrangement, error: float) -> Arrangement:
    """Return the rig whose measured loads are right up to a common factor with this relative standard error."""
    loaded = {e.name: replace(e, load_scale=LOAD_SCALE) for e in arrangement.elements if e.preload}
    scale = Parameter(LOAD_SCALE, "1", 1.0, max(error, HELD))
    return arrangement.extended(changed=loaded, parameters=(scale,) if loaded else ())


def _with_tube_mode(arrangement: Arrangement, rig: DescribedRig, own: OwnMode | None) -> Arrangement:
    """Return Eq. 9 with the tube springs' own mode that a session's header declares beside its masses at rest."""
    places = [] if own is None else tube_mode.at(arrangement)
    if own is None or not places:
        return arrangement
    lighter = tuple(
        replace(p, value=p.value - own.mass_kg) if rig.header.get(p.name) in ("m1_kg", "m2_kg") else p
        for p in arrangement.parameters
    )
    damping = 2 * TUBE_MODE_DAMPING * math.sqrt(own.mass_kg * own.stiffness)
    return tube_mode.mounted(replace(arrangement, parameters=lighter), places[0], TUBE_MODE).extended(
        parameters=(
            Parameter(TUBE_MODE[0], "kg", own.mass_kg, TUBE_MODE_ERROR * own.mass_kg, positive=True),
            Parameter(TUBE_MODE[1], "N/m", own.stiffness, TUBE_MODE_ERROR * own.stiffness, positive=True),
            Parameter(TUBE_MODE[2], "N s/m", damping, damping, positive=True),
        )
    )


def _springs_to_begin_with(usable: Sequence[_Usable], duration_s: float) -> dict[str, float]:
    """Return springs (N/m) as the system mode shows them, where a fit with the declared ones would skip cycles."""
    rig = usable[0].session.rig
    if not rig.is_tester or not usable[0].system_hz:
        return {}
    f1 = float(np.median([hz for one in usable for hz in one.system_hz]))
    kc = float(np.median([c["kc"] for one in usable for c in one.constants.values()]))
    try:
        k1, k2 = springs_from_system_mode(f1, kc, rig.m1_kg, rig.m2_kg, rig.k2_n_per_m / rig.k1_n_per_m)
    except ResonanceError:
        return {}
    off = f1 * (math.sqrt(rig.k1_n_per_m / k1) - 1)
    return {"k1": k1, "k2": k2} if abs(off) * duration_s > CYCLES_SKIPPED else {}


@dataclass(frozen=True, slots=True)
class _Usable:
    """What of a session can be fitted: load (N) and constants of the rig at each load set; system resonances."""

    session: Session
    loads_n: dict[int, float]
    constants: dict[int, dict[str, float]]
    system_hz: tuple[float, ...]

    @property
    def impacts(self) -> list[Impact]:
        return [s for s in self.session.impacts if s.accepted and s.load_set in self.constants]


def _name(session: Session) -> str:
    return session.source or "session"


def _usable(session: Session, arrangement: Arrangement) -> _Usable:
    name = _name(session)
    rates = {s.sample_rate_hz for s in session.impacts if s.accepted}
    if len(rates) != 1:
        raise AnalysisError(f"{name}: a diagnosis needs accepted impacts of one sampling rate, not of {len(rates)}")
    scoped = {p.name for p in arrangement.parameters if p.scope == LOAD}
    element = next((e for e in arrangement.elements if e.stiffness in scoped), None)
    constants, system = _constants_at_loads(session, arrangement, element)
    if sum(len(session.accepted(k)) for k in constants) < FEWEST_IMPACTS:
        raise AnalysisError(f"{name}: a diagnosis needs at least four accepted impacts that show both modes")
    loads = {load_set: 1e-3 * _load(session, load_set) for load_set in constants}
    return _Usable(session, loads, constants, system)


def _constants_at_loads(
    session: Session, rig: Arrangement, element: Element | None
) -> tuple[dict[int, dict[str, float]], tuple[float, ...]]:
    """Return the rig's constants at each load set, those of an element that changes with it from the identified poles.

    The second is the system resonances (Hz) of all impacts.
    """
    declared = rig.declared()
    if element is None:
        return {load_set: declared for load_set in session.load_sets() if session.accepted(load_set)}, ()
    if not session.rig.is_tester:
        raise AnalysisError(f"{_name(session)}: masses and springs are unknown, so there is no Eq. 9 to compare with")
    modes = session_modes(session, AnalysisSettings())
    found: dict[int, dict[str, float]] = {}
    for load_set in session.load_sets():
        poles = [m.pole for s in session.accepted(load_set) if (m := modes[s.number].contact) is not None]
        held = [k for s in poles if (k := element_from_pole(rig, declared, element, s)) is not None]
        if held:
            own = zip((element.stiffness, element.damping), np.median(held, axis=0).tolist(), strict=True)
            found[load_set] = declared | {name: value for name, value in own if name is not None}
    return found, tuple(m.system.frequency_hz.value for m in modes.values() if m.system is not None)


def element_from_pole(
    rig: Arrangement, values: Mapping[str, float], element: Element, pole: complex
) -> tuple[float, float] | None:
    """Return stiffness (N/m) and damping (N s/m) of an element that put a pole (1/s) of the rig exactly there.

    With the dynamic stiffness D of all else and the element's row r, ``det(D + (k + c s) r r^T) = 0`` is
    ``k + c s = -1 / (r^T D^-1 r)``: one complex equation for both (for Eq. 9 it is Eq. 10). None where only a negative
    stiffness would do.
    """
    without = {**values, **{n: 0.0 for n in (element.stiffness, element.damping) if n is not None}}
    mass, damping, stiffness = rig.matrices(without)
    row = rig.vector(element.row, without)
    needed = -1 / complex(row @ np.linalg.solve(stiffness + pole * damping + pole**2 * np.diag(mass), row))
    c = needed.imag / pole.imag if pole.imag > 0 else math.nan
    k = needed.real - c * pole.real
    return (k, c) if k > 0 and math.isfinite(c) else None


def _common_noise(usable: Sequence[_Usable]) -> tuple[NoiseModel, ...] | None:
    """Return the noise of several sessions of one rig taken together; None for a single one.

    Raises
    ------
    AnalysisError
        The sessions are not of one rig, one is there twice, or their noise differs in size.
    """
    first = usable[0].session
    for other in (one.session for one in usable[1:]):
        if other.rig != first.rig:
            raise AnalysisError(
                f"{_name(other)}: its masses, springs, filter or sampling rate are not those of {_name(first)}; "
                "only sessions of one rig are diagnosed together"
            )
    if len(usable) == 1:
        return None
    shown: dict[bytes, Session] = {}
    for one in usable:
        key = one.impacts[0].acceleration.tobytes()
        if key in shown:
            raise AnalysisError(
                f"{_name(one.session)}: holds the impacts of {_name(shown[key])} once more; name it once"
            )
        shown[key] = one.session
    rate = first.rig.sample_rate_hz
    try:
        own = [channel_noise(one.impacts, rate) for one in usable]
        both = channel_noise([s for one in usable for s in one.impacts], rate)
    except ValueError as error:
        raise AnalysisError(f"{_name(first)} and others: {error}") from None
    for one, noise in zip(usable, own, strict=True):
        for mine, common in zip(noise, both, strict=True):
            if abs(mine.deviation / common.deviation - 1) > NOISE_DIFFERENCE:
                raise AnalysisError(
                    f"{_name(one.session)}: its noise is {mine.deviation / common.deviation:.2f} times that of the "
                    "sessions together; diagnose it by itself"
                )
    return both


def declared_filter(rig: RigDescription) -> StateSpace:
    """Return the recorder's filter as the session declares it; none where it declares none."""
    known = rig.filter_family == "butterworth" and all(map(math.isfinite, (rig.highpass_hz, rig.lowpass_hz)))
    if not known or rig.highpass_order < 1 or rig.lowpass_order < 1:
        return analog_filter(Filter(family="none"))
    return analog_filter(
        Filter(
            family="butterworth",
            highpass_hz=rig.highpass_hz,
            highpass_order=int(rig.highpass_order),
            lowpass_hz=rig.lowpass_hz,
            lowpass_order=int(rig.lowpass_order),
        )
    )


def _load(session: Session, load_set: int) -> float:
    """Load of a load set as the session file gives it, mN."""
    impacts = session.accepted(load_set)
    read = [v for s in impacts for v in (s.load_before_mn, s.load_after_mn) if math.isfinite(v)]
    return float(np.mean(read)) if read else impacts[0].target_load_mn
