"""From a session to what is compared with a model: whitened channels of every accepted impact, after its pulse."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from analysis.mismatch.ring_downs.noise import NoiseModel, level_error, noise_models
from daq.records import Impact, Session
from sim_backend.arrangement import DERIVATIVES, Arrangement
from sim_backend.arrays import Real
from sim_backend.state_space import StateSpace

GUARD_SAMPLES = 5  # before the trigger that a slow rise may already touch
PULSE_BAND_HZ = (400.0, 6000.0)  # where a tap's force stands clear of drift and of the recorder's noise
FAR_BEYOND = 2.0  # of that band, from which on nothing of it is left
PULSE_EDGE = 0.05  # of the tap's peak: below this the pulse is over
MARGIN_S = 0.1e-3  # left after it: the pulse's foot
LEAST_RUN_UP, MOST_RUN_UP_S = 4, 0.64e-3  # samples, and time, until the low-pass has forgotten forces of the pulse
FAST_HZ = 400.0  # poles of the recorder's filter beyond which forget within a few samples
SHORTER = 3  # samples by which a pulse may end before the session's median: one that ends sooner was misjudged
LONGEST_PULSE_S = 1.2e-3
PULSE_MIDDLE_S = 1e-4  # after the trigger: nominal time of the impact


@dataclass(frozen=True, slots=True)
class Segment:
    """One impact, whitened to noise of unit variance.

    Attributes
    ----------
    y
        (c, n) channels from the end of the pulse.
    start_s
        Time of its first sample after the tap began, s.
    raw
        (c, n) the same samples before whitening, m/s2.
    group
        Place of its load among the loads of all sessions; ``preload_n`` is that load.
    order
        Place in the session, from 0.
    run_up
        Samples before the first one from which on extra forces are computed: the filter remembers them.
    pulse
        (c, k) what the channels showed from before the tap up to the first sample, m/s2.
    tap_s
        Nominal time of the impact, s after the trigger; a fit finds it from the lowest mode.
    second
        Where in the segment a second impact falls in the way the first did at ``tap_s``, in samples; NaN without one.
    """

    name: str
    y: Real
    raw: Real
    start_s: float
    group: int
    preload_n: float
    order: int
    run_up: int = 0
    pulse: Real = field(default_factory=lambda: np.zeros((0, 0)))
    tap_s: float = PULSE_MIDDLE_S
    second: float = math.nan

    @property
    def since_tap_s(self) -> float:
        """Time of the first sample after the middle of the tap, s."""
        return self.start_s - self.tap_s


@dataclass(frozen=True, slots=True)
class Experiment:
    """All impacts of a session (or several of one rig) that are fitted together."""

    segments: tuple[Segment, ...]
    noise: tuple[NoiseModel, ...]
    sample_rate_hz: float
    loads_n: tuple[float, ...]

    @property
    def noise_rms(self) -> float:
        """Rms of the noise as residuals are measured: of what of it earlier samples do not predict, m/s2."""
        return float(np.sqrt(np.mean([m.deviation**2 for m in self.noise])))

    @property
    def level_error(self) -> float:
        """Relative standard error of the noise's power."""
        return level_error(sum(r.y.shape[1] for r in self.segments))


def tap_force(acceleration: Real, sample_rate_hz: float, rig: Arrangement, values: Mapping[str, float]) -> Real:
    """Return the force on the tapped body that the rig needs for what its first sensor shows, (n,) N.

    In the frequency domain, within `PULSE_BAND_HZ` only: a tap stands out in it as one lobe.
    """
    n = acceleration.size
    padded = 1 << (2 * n - 1).bit_length()
    frequency = np.fft.rfftfreq(padded, 1 / sample_rate_hz)
    low, high = PULSE_BAND_HZ
    kept = np.flatnonzero((frequency < FAR_BEYOND * high) & (frequency > 0))
    s = 2j * np.pi * frequency[kept]
    mass, damping, stiffness = rig.matrices(values)
    dynamic = stiffness + s[:, None, None] * damping + (s**2)[:, None, None] * np.diag(mass)
    unit = np.zeros((kept.size, len(mass), 1))
    unit[:, rig.bodies.index(rig.tapped)] = 1.0
    sensor = rig.sensors[0]
    shown = np.linalg.solve(dynamic, unit)[:, :, 0] @ rig.vector(sensor.row, values) * s ** DERIVATIVES[sensor.quantity]
    band = np.exp(-((frequency[kept] / high) ** 4)) * (1 - np.exp(-((frequency[kept] / low) ** 4)))
    spectrum = np.zeros(frequency.size, np.complex128)
    spectrum[kept] = np.fft.rfft(acceleration, padded)[kept] * band / shown
    out: Real = np.fft.irfft(spectrum, padded)[:n]
    return out


def pulse_end(force: Real, trigger: int, sample_rate_hz: float) -> int:
    """Return the first sample after the tap's main lobe, which lies near sample ``trigger``."""
    longest = int(LONGEST_PULSE_S * sample_rate_hz)
    near = slice(max(0, trigger - 10), trigger + longest)
    peak = near.start + int(np.argmax(force[near]))
    edge = PULSE_EDGE * float(force[peak])
    after = np.flatnonzero(force[peak : trigger + longest] < edge)
    return peak + int(after[0]) if after.size else trigger + longest


def channel_noise(impacts: Sequence[Impact], sample_rate_hz: float) -> tuple[NoiseModel, ...]:
    """Return the noise of each channel: its level before the triggers, its spectrum from the channels' difference."""
    quiet = [s.acceleration[:, : max(2, s.pretrigger - GUARD_SAMPLES)] for s in impacts]
    whole = [s.acceleration[0] - s.acceleration[1] for s in impacts if s.acceleration.shape[0] == 2]
    steps = np.concatenate([np.diff(np.unique(s.acceleration)) for s in impacts])
    return noise_models(quiet, whole, sample_rate_hz, float(steps.min(initial=math.inf)) if steps.size else 0.0)


def segments_of(
    session: Session,
    rig: Arrangement,
    loads_n: Mapping[int, float],
    constants: Mapping[int, Mapping[str, float]],
    noise: tuple[NoiseModel, ...] | None,
    analog: StateSpace,
) -> Experiment:
    """Whiten the accepted impacts of a session, from the end of each pulse on.

    Parameters
    ----------
    loads_n
        Load of each load set, N.
    constants
        The rig's constants at each load set, as a linear analysis has them.
    noise
        Of the channels, where it is known from more than this session; None to take it from this one.
    analog
        The recorder's filter.
    """
    rate = session.rig.sample_rate_hz
    impacts = [s for s in session.impacts if s.accepted and s.load_set in constants]
    if noise is None:
        noise = channel_noise(impacts, rate)
    groups = {load_set: g for g, load_set in enumerate(sorted(constants))}
    alike = [
        i for i, s in enumerate(rig.sensors) if (s.row, s.quantity) == (rig.sensors[0].row, rig.sensors[0].quantity)
    ]
    cleaned, starts = [], []
    for impact in impacts:
        rest = impact.acceleration[:, : max(1, impact.pretrigger - GUARD_SAMPLES)].mean(axis=1, keepdims=True)
        clean = impact.acceleration - rest
        force = tap_force(clean[alike].mean(axis=0), rate, rig, constants[impact.load_set])
        cleaned.append(clean)
        starts.append(pulse_end(force, impact.pretrigger, rate) - impact.pretrigger)
    least = round(float(np.median(starts))) - SHORTER if starts else 0
    ends = [i.pretrigger + max(end, least) + math.ceil(MARGIN_S * rate) for i, end in zip(impacts, starts, strict=True)]
    peaks = [np.abs(clean[:, end:]).max(axis=1) for clean, end in zip(cleaned, ends, strict=True)]
    run_up = run_up_of(analog, rate, float(np.max(np.array(peaks) / [m.deviation for m in noise], initial=1.0)))
    segments = []
    for impact, clean, end in zip(impacts, cleaned, ends, strict=True):
        start = end + run_up
        y = np.stack([m.whiten(row)[start:] for m, row in zip(noise, clean, strict=True)])
        pulse = clean[:, max(0, impact.pretrigger - GUARD_SAMPLES) : start]
        segments.append(
            Segment(
                impact.name, y, clean[:, start:], (start - impact.pretrigger) / rate, groups[impact.load_set],
                loads_n[impact.load_set], impact.number, run_up, pulse,
            )
        )  # fmt: skip
    loads = tuple(loads_n[k] for k in sorted(groups, key=lambda k: groups[k]))
    return Experiment(tuple(segments), noise, rate, loads)


def run_up_of(analog: StateSpace, sample_rate_hz: float, peak: float) -> int:
    """Return after how many samples a filter has forgotten forces whose response was so many times the noise.

    They act during the pulse, when the motion is not known: what the filter still shows of them is not computed.
    """
    fast = [p for p in np.linalg.eigvals(analog.a) if abs(p) > 2 * np.pi * FAST_HZ]
    forgotten = min((-p.real / sample_rate_hz for p in fast), default=math.inf)  # in a sample, a logarithm
    enough = min(math.log(max(peak, 1.0)) / forgotten, MOST_RUN_UP_S * sample_rate_hz)
    return max(math.ceil(enough), LEAST_RUN_UP)


def joined(parts: Sequence[Experiment]) -> Experiment:
    """Return the experiment of several sessions of one rig, whitened alike, as those of one.

    Loads stay each session's own: the contact may have changed between sessions.
    """
    segments: list[Segment] = []
    loads: list[float] = []
    for number, part in enumerate(parts):
        last = segments[-1].order + 1 if segments else 0
        prefix = f"{number + 1}." if len(parts) > 1 else ""
        segments += [
            replace(r, name=prefix + r.name, group=r.group + len(loads), order=r.order + last) for r in part.segments
        ]
        loads += part.loads_n
    return Experiment(tuple(segments), parts[0].noise, parts[0].sample_rate_hz, tuple(loads))
