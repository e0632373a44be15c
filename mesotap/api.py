"""What programs and notebooks use: read a session, identify its modes, k_c, theory, diagnosis, a simulated tap.

Everything here is importable from `mesotap` itself. Values are in SI units unless a name says otherwise; each estimate
is an `Estimate` with its standard error and 95 % interval (``low``, ``high``). Whatever a person can mend is raised as
a `MesotapError`, whose text is one sentence.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.frequency_response.cross_check import CrossCheck
from analysis.frequency_response.estimators import FrequencyResponse
from analysis.frequency_response.impacts import Window, of_recording
from analysis.mismatch.answer import Answer
from analysis.modal.identify import RingDownModes, decay_begins, identify_ring_down
from analysis.results import SessionResults
from analysis.settings import PRESETS, FlatContact, SphereContact
from analysis.stiffness import contact_from_pole, pole
from calibration.estimate import Estimate
from daq.errors import RecordingError
from daq.records import Session
from mesotap.answers.analysing import analysed_as_configured
from rig.errors import MesotapError

__all__ = [
    "Answer",
    "CrossCheck",
    "Estimate",
    "FrequencyResponse",
    "MesotapError",
    "RingDownModes",
    "Session",
    "SessionResults",
    "contact_stiffness",
    "diagnose",
    "frf",
    "identify",
    "read_session",
    "simulate",
    "theory",
]

AnyPath = str | os.PathLike[str]
Method = Literal["ml", "era"]
Contact = Literal["paper-flat", "paper-sphere"] | SphereContact | FlatContact
Real = NDArray[np.float64]


def read_session(path: AnyPath) -> Session:
    """Return what a session file, or the folder of a session, holds.

    Parameters
    ----------
    path
        ``session.h5``, or a session's folder, finished or not.

    Returns
    -------
    Session
        Its ``impacts`` hold the records, ``acceleration`` (2, n) in m/s2; `Session.to_pandas` is a table of them,
        `Session.to_xarray` all records as one labelled array. ``refused`` says what is wrong with each record that
        could not be read and is left out.

    Raises
    ------
    MesotapError
        The file is missing, damaged, or no session, or none of its records can be read.

    Examples
    --------
    >>> import mesotap
    >>> session = mesotap.read_session("session.h5")  # doctest: +SKIP
    >>> session.impacts[0].acceleration.shape  # doctest: +SKIP
    (2, 5000)
    """
    from mesotap.commands.recordings import opened

    found = opened(Path(path), None)
    if not isinstance(found, Session):
        raise RecordingError(f"{path}: is a recording of another program and no session; identify() takes its samples")
    return found


@overload
def identify(
    recording: Session, sample_rate_hz: None = None, *, method: Method = "ml", on_progress: Callable[..., None] = ...
) -> SessionResults: ...
@overload
def identify(
    recording: ArrayLike,
    sample_rate_hz: float,
    *,
    method: Method = "ml",
    decay_from_s: float | None = None,
    on_progress: Callable[..., None] = ...,
) -> RingDownModes: ...
def identify(
    recording: Session | ArrayLike,
    sample_rate_hz: float | None = None,
    *,
    method: Method = "ml",
    decay_from_s: float | None = None,
    on_progress: Callable[..., None] = lambda *_: None,
) -> SessionResults | RingDownModes:
    """Identify the modes of a session's impacts, with k_c and c_c of each load; or those of any ring-down.

    Parameters
    ----------
    recording
        A session; or a free decay, (n,) or (channels, n) in any unit.
    sample_rate_hz
        Of a free decay, Hz; a session knows its own.
    method
        ``"ml"`` maximum likelihood begun from ERA; ``"era"`` the Eigensystem Realization Algorithm alone.
    decay_from_s
        Of samples: when the free decay begins, s; found by default, after an impact.
    on_progress
        Of a session: called with the number of loads done and of all.

    Returns
    -------
    SessionResults or RingDownModes
        ``loads``, each with f1, f2, zeta1, zeta2, k_c, c_c (Eq. 10, 11); or ``modes`` in ascending frequency.

    Raises
    ------
    MesotapError
        The session declares no masses and springs; or the samples are too few, not finite or of another shape.

    Notes
    -----
    A load of which every tap was rejected has None in place of each estimate, and says so in its ``notes``. The
    frequencies of a session count the clock of its recorder; of samples nothing is known about it, so it is to be added
    (50 parts in a million is usual).

    Examples
    --------
    >>> import numpy as np
    >>> import mesotap
    >>> t = np.arange(2000) / 1e4
    >>> decay = np.exp(-20 * t) * np.sin(2 * np.pi * 300 * t)
    >>> [round(mode.frequency_hz.value) for mode in mesotap.identify(decay, 1e4).modes]
    [300]
    """
    if method not in ("ml", "era"):
        raise MesotapError(f"identify(): there is no method {method!r}; give 'ml' or 'era'")
    if not isinstance(recording, Session):
        if sample_rate_hz is None:
            raise TypeError("identify(): samples need their sample_rate_hz")
        y = _free_decay(recording, sample_rate_hz)
        start = decay_begins(decay_from_s, y.shape[1], sample_rate_hz)
        return identify_ring_down(y, sample_rate_hz, start, method=method)
    if sample_rate_hz is not None or decay_from_s is not None:
        raise TypeError("identify(): a session knows its own sampling rate, and where its taps begin")
    from mesotap.configuration.config import Config, ConfigError
    from mesotap.session.header import kept_config

    try:
        config = kept_config(recording.config, f"{recording.source}: /config").config
    except ConfigError:  # written by another program; the recording is as good as ever
        config = Config()
    settings = config.analysis.model_copy(update={"method": method})
    return analysed_as_configured(recording, config.model_copy(update={"analysis": settings}), on_progress)


def _free_decay(samples: ArrayLike, sample_rate_hz: float) -> Real:
    """Return samples as (channels, n), or say which of them, or what of the sampling rate, cannot be used."""
    if not 0 < sample_rate_hz < np.inf:
        raise MesotapError(f"identify(): a sampling rate of {sample_rate_hz} Hz is none; give samples a second")
    y = _numbers(samples, "identify(): the samples")
    if y.ndim not in (1, 2) or not y.size:
        raise MesotapError(f"identify(): samples of shape {y.shape} are no free decay, (n,) or (channels, n)")
    y = np.atleast_2d(y)
    wrong = np.argwhere(~np.isfinite(y))
    if wrong.size:
        channel, first = (int(place) for place in wrong[0])
        raise MesotapError(
            f"identify(): {len(wrong)} of {y.size} samples are not finite; the first is sample {first} of channel "
            f"{channel}, {y[channel, first]}"
        )
    return y


def _numbers(values: ArrayLike, what: str) -> Real:
    try:
        return np.asarray(values, np.float64)
    except (TypeError, ValueError) as error:
        raise MesotapError(f"{what} are no array of numbers: {error}") from error


@overload
def frf(recording: Session, response: None = None, sample_rate_hz: None = None) -> tuple[CrossCheck, ...]: ...
@overload
def frf(
    recording: ArrayLike,
    response: ArrayLike,
    sample_rate_hz: float,
    *,
    window: Window = "auto",
    segment_s: float | None = None,
    unit: str = "m/s2/N",
) -> FrequencyResponse: ...
def frf(
    recording: Session | ArrayLike,
    response: ArrayLike | None = None,
    sample_rate_hz: float | None = None,
    *,
    window: Window = "auto",
    segment_s: float | None = None,
    unit: str = "m/s2/N",
) -> tuple[CrossCheck, ...] | FrequencyResponse:
    """Return frequency responses H1, H2, Hv with coherence and random error, from a hammer's force or a shaker's.

    Parameters
    ----------
    recording
        A session with an instrumented hammer: its modes are identified for the comparison. Or a force, (n,), with any
        number of hits, or one that lasts.
    response
        With a force: responses, (n,) or (channels, n).
    sample_rate_hz
        With a force: Hz.
    window
        ``"impact"``: force set to zero beyond its pulses, exponential window where the response has not died away;
        ``"none"``: the same stretches as they are; ``"hann"``: for a force that lasts; ``"auto"`` by what it looks
        like. `FrequencyResponse.window` says what was done.
    segment_s
        Length of what is averaged, s; by default up to the next hit, or an eighth of the recording.
    unit
        Of response over force, for labels.

    Returns
    -------
    FrequencyResponse or tuple of CrossCheck
        Of a session one `CrossCheck` a load: the response of the mean of A and B, Eq. 9 fitted to it, k_c beside that
        of Eq. 11. Empty for a session without a hammer.

    Raises
    ------
    MesotapError
        The force is dead, no hit can be used, or the arrays do not fit together.

    Examples
    --------
    A mass of 0.5 kg, hit once:

    >>> import numpy as np
    >>> import mesotap
    >>> force = np.zeros(2000)
    >>> force[100:120] = np.sin(np.pi * np.arange(20) / 20)
    >>> response = mesotap.frf(force, force / 0.5, 10_000.0)
    >>> round(float(abs(response.h1[0, 10])), 6)
    2.0
    """
    if isinstance(recording, Session):
        if response is not None or sample_rate_hz is not None:
            raise TypeError("frf(): a session knows its own responses and sampling rate")
        if all(impact.force is None for impact in recording.impacts):
            return ()
        return identify(recording).hammer
    if response is None or sample_rate_hz is None:
        raise TypeError("frf(): a force needs its response and its sample_rate_hz")
    force, others = np.asarray(recording, np.float64), np.atleast_2d(np.asarray(response, np.float64))
    names = [f"channel {i}" for i in range(len(others))]
    return of_recording(force, others, sample_rate_hz, names, unit, window, segment_s)


@overload
def contact_stiffness(
    f2_hz: float, zeta2: float = 0.0, *, m1_kg: float, m2_kg: float, k1_n_per_m: float, k2_n_per_m: float
) -> float: ...
@overload
def contact_stiffness(
    f2_hz: ArrayLike, zeta2: ArrayLike = 0.0, *, m1_kg: float, m2_kg: float, k1_n_per_m: float, k2_n_per_m: float
) -> Real: ...
def contact_stiffness(
    f2_hz: ArrayLike, zeta2: ArrayLike = 0.0, *, m1_kg: float, m2_kg: float, k1_n_per_m: float, k2_n_per_m: float
) -> Real | float:
    """Return the contact stiffness k_c from the contact resonance, N/m (Eq. 10 and 11).

    Parameters
    ----------
    f2_hz, zeta2
        Resonance, Hz, and damping ratio of the contact mode; broadcast against each other. Without damping it is the
        real part of Eq. 11.
    m1_kg, m2_kg, k1_n_per_m, k2_n_per_m
        Masses and tube springs of the tester.

    Returns
    -------
    float or NDArray
        Of single values a float, else shaped like the two together.

    Raises
    ------
    MesotapError
        A resonance at or below the system resonance, where Eq. 11 has no contact stiffness.

    Examples
    --------
    Table 5 at 264.9 mN, springs from the system resonance of 356 Hz:

    >>> import mesotap
    >>> k_c = mesotap.contact_stiffness(1409.0, m1_kg=0.107, m2_kg=0.108, k1_n_per_m=5.379e5, k2_n_per_m=5.379e5)
    >>> f"{k_c:.3g}"
    '3.94e+06'
    """
    f, zeta = np.broadcast_arrays(np.asarray(f2_hz, np.float64), np.asarray(zeta2, np.float64))
    each = [
        contact_from_pole(pole(float(a), float(b)), m1_kg, m2_kg, k1_n_per_m, k2_n_per_m)[0]
        for a, b in zip(f.ravel(), zeta.ravel(), strict=True)
    ]
    return np.array(each, np.float64).reshape(f.shape) if f.ndim else each[0]


@overload
def theory(load_mn: float, contact: Contact = "paper-flat") -> dict[str, float]: ...
@overload
def theory(load_mn: ArrayLike, contact: Contact = "paper-flat") -> dict[str, Real]: ...
def theory(load_mn: ArrayLike, contact: Contact = "paper-flat") -> dict[str, Real] | dict[str, float]:
    """Return the contact stiffness that each theory gives at a load, N/m, by the theory's name.

    Parameters
    ----------
    load_mn
        Preload, mN, any shape.
    contact
        One of the paper's specimens, or surfaces of your own (`analysis.settings.FlatContact`, ``SphereContact``).

    Returns
    -------
    dict
        Of a single load floats, else arrays shaped like the loads.

    Raises
    ------
    MesotapError
        There is no such contact, or a load is negative or not a number.

    Examples
    --------
    >>> import mesotap
    >>> k_c = mesotap.theory(50.0, "paper-sphere")["Hertz, smooth"]
    >>> f"{k_c / 1e6:.2f} MN/m"
    '1.38 MN/m'
    """
    from analysis.contact.theory import theory as curves

    if not isinstance(contact, SphereContact | FlatContact) and contact not in PRESETS:
        raise MesotapError(
            f"theory(): there is no contact {contact!r}; give {' or '.join(map(repr, PRESETS))}, a FlatContact or a "
            "SphereContact"
        )
    load_n = 1e-3 * _numbers(load_mn, "theory(): the loads")
    if not np.isfinite(load_n).all():
        raise MesotapError("theory(): a load is not finite")
    found = {curve.name: np.asarray(curve.stiffness(load_n), np.float64) for curve in curves(contact)}
    return found if load_n.ndim else {name: float(k) for name, k in found.items()}


def diagnose(
    *recordings: Session | AnyPath,
    rig: AnyPath | None = None,
    without: Sequence[str] = (),
    mechanisms: Sequence[AnyPath] = (),
    listed_only: bool = False,
) -> Answer:
    """Say which physics Eq. 9, or a described rig, leaves out of recordings.

    Parameters
    ----------
    recordings
        Sessions, session files or folders of one rig; with ``rig``, files of that rig's recordings.
    rig
        Description of a rig other than the tester, a YAML file.
    without
        Ids of mechanisms that are excluded.
    mechanisms
        Folders of mechanisms of your own.
    listed_only
        Name listed mechanisms; learn no law.

    Returns
    -------
    Answer
        ``verdict``, ``p_value``, ``mechanisms`` with probabilities and intervals, ``remainder``, ``upper_limits``.

    Raises
    ------
    MesotapError
        A file cannot be used, or the recordings cannot carry a diagnosis.

    Examples
    --------
    >>> import mesotap
    >>> answer = mesotap.diagnose("session.h5")  # doctest: +SKIP
    >>> answer.verdict, [m.id for m in answer.mechanisms]  # doctest: +SKIP
    ('missing_physics', ['hertz_stiffness'])
    """
    from rich.console import Console

    from mesotap.commands.diagnose import Read, diagnosed, file_of, known_mechanisms, read_files
    from mesotap.configuration.rig_files import load_rig, tester_rig

    if not recordings:
        raise TypeError("diagnose(): name a session or a recording")
    quiet = Console(quiet=True)
    description = None if rig is None else Path(rig)
    sessions = tuple(r for r in recordings if isinstance(r, Session))
    paths = [file_of(Path(r)) for r in recordings if not isinstance(r, Session)]
    if sessions and paths:
        sessions, paths = tuple(r if isinstance(r, Session) else read_session(r) for r in recordings), []
    if sessions:
        read = Read(tester_rig() if description is None else load_rig(description), (), sessions)
    else:
        read = read_files(paths, description, quiet)
    known = known_mechanisms(without, [os.fspath(m) for m in mechanisms])
    return diagnosed(read, known, quiet, learn=not listed_only).answer


def simulate(load_mn: float = 500.0, *, seed: int = 1, config: AnyPath | None = None) -> Session:
    """Return a session of one tap on the simulated rig.

    Parameters
    ----------
    load_mn
        Preload, up to ``rig.limits.load_mn`` of the configuration.
    seed
        The same seed gives the same tap.
    config
        Configuration of the rig and of what is simulated; the defaults where None.

    Returns
    -------
    Session
        One impact. As at the bench a tap may be rejected: it is then not ``accepted``, ``reject_reason`` says why, and
        `identify` finds no estimates at its load. Another seed is another tap.

    Raises
    ------
    MesotapError
        The load is none that the rig can be set to, or the configuration cannot be used.

    Examples
    --------
    >>> import mesotap
    >>> session = mesotap.simulate(load_mn=300.0, seed=2)
    >>> session.impacts[0].acceleration.shape
    (2, 5000)
    """
    from mesotap.configuration.config import Config, ConfigError, effective_text, load_config, parse_config
    from mesotap.session.one_tap import simulated_tap

    plain = Config() if config is None else load_config(Path(config))
    limit = plain.rig.limits.load_mn
    if not 0 < load_mn <= limit:
        raise MesotapError(f"simulate(): load_mn is {load_mn:g}; it lies above 0 and up to {limit:g} mN")
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise MesotapError(f"simulate(): seed is {seed!r}; it is a whole number from 0 on")
    try:
        known = parse_config(effective_text(plain), "simulate()", [f"mesotap.load_plan_mn=[{float(load_mn)!r}]"])
    except ConfigError as error:
        raise MesotapError(
            f"simulate(): load_mn={load_mn:g} cannot be set on this rig: {str(error).removeprefix('simulate(): ')}"
        ) from error
    return simulated_tap(known, load_mn, int(seed)).session
