"""What a recording shows before any rig is described: its channels, what may drive it, modes, noise, damage."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.ndimage import binary_dilation

from analysis.mismatch.recordings.noise import innovation_rms
from daq.exchange import Recording
from daq.exchange.units import newtons
from sim_backend.arrangement import DERIVATIVES, Quantity
from sim_backend.arrays import Real

Kind = Literal["force", "base acceleration", "sensor"]

QUANTITY_OF_UNIT: Final[dict[str, Quantity]] = {
    "m/s2": "acceleration", "m/s^2": "acceleration", "g": "acceleration", "mm/s2": "acceleration",
    "m/s": "velocity", "mm/s": "velocity", "rad/s": "velocity",
    "m": "displacement", "mm": "displacement", "um": "displacement", "nm": "displacement", "rad": "displacement",
}  # fmt: skip
IN_SI: Final = {"mm": 1e3, "um": 1e6, "nm": 1e9, "mm/s": 1e3, "mm/s2": 1e3}  # how many of them are one of m, s
QUANTITY_OF_NAME: Final[tuple[tuple[str, Quantity], ...]] = (
    (r"acc|^a\d*$", "acceleration"),
    (r"vel|speed|^v\d*$", "velocity"),
    (r"dis|pos|enc|lvdt|angle|theta|^[xyz]\d*$", "displacement"),
)
ENDING: Final = re.compile(r"[_ .-](mm|um|nm|kN|mN)$")  # not of one letter: that may mean anything
FORCES: Final = re.compile(r"force|input|drive|excit|hammer|command|torque|shaker|^u\d*$|^f\d*$|^in\d*$", re.IGNORECASE)
BASES: Final = re.compile(r"base|ground|table|floor", re.IGNORECASE)
PARTS: Final = 8  # of a recording, over which spectra are averaged
STANDS_OUT_DB: Final = 12.0  # of a peak above its surroundings: a mode, not noise
OVER_NOISE_DB: Final = 20.0  # of a peak above the floor of the spectrum
MOST_MODES: Final = 4
DEEPEST_DB: Final = 40.0  # below the highest peak of responses, where others no longer count
EXCITED, COHERENT = 1e-4, 0.8  # power of an input's line over its largest, and coherence, from which on it is believed
VOUCHED: Final = 3  # lines on either side of coherent ones that are believed too
STIFF: Final = (0.05, 0.4)  # of the lowest mode, between which a spring holds the rig and mass does not count
FEWEST_LINES, CLEAR = 4, 0.25  # of a slope there, and how far from a whole number it may be
SAME: Final = 0.98  # correlation of an input with itself a period later
STUCK: Final = 3  # samples in a row at the largest value that count as clipped
COARSE: Final = 0.25  # of the samples: fewer different values are those of a quantised channel
LESS_PREDICTABLE: Final = 1.5  # factor to the next channel, from which on the least predictable is taken for the input
DECAYED: Final = 0.5  # rms of the last quarter over that of the first, below which a recording is a decay


@dataclass(frozen=True, slots=True)
class ChannelLook:
    """A channel at a glance.

    Attributes
    ----------
    kind, quantity
        What it seems to be, by its name and unit; ``told`` says whether these told it.
    rms, mean
        In its unit, about the mean.
    unpredictable
        What an autoregression cannot predict of it, over its rms: noise, or what drives it.
    step
        Of its values where they are coarse, else zero.
    clipped
        Samples that are stuck at the largest or smallest value.
    """

    name: str
    unit: str
    kind: Kind
    quantity: Quantity
    told: bool
    rms: float
    mean: float
    unpredictable: float
    step: float
    clipped: int


@dataclass(frozen=True, slots=True)
class FirstLook:
    """A recording at a glance.

    Attributes
    ----------
    free
        Whether it is a free decay: nothing drives it, and it fades.
    modes_hz
        Peaks of the sensors' spectra (of the responses to the first input, where there is one).
    period_s
        After which the first input repeats itself; zero where it does not.
    """

    source: str
    rate_hz: float
    samples: int
    channels: tuple[ChannelLook, ...]
    free: bool
    modes_hz: tuple[float, ...]
    period_s: float

    @property
    def inputs(self) -> list[ChannelLook]:
        """Channels that seem to drive it."""
        return [c for c in self.channels if c.kind != "sensor"]

    @property
    def sensors(self) -> list[ChannelLook]:
        """Channels that seem to show what it does."""
        return [c for c in self.channels if c.kind == "sensor"]


def first_look(recording: Recording, inputs: Sequence[str] = ()) -> FirstLook:
    """Return what a recording shows at a glance.

    Parameters
    ----------
    inputs
        Names of the channels that drive it; found by names and units without, or by what is least predictable where
        nothing fades.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(4000) / 1000
    >>> decay = np.exp(-3 * t) * np.sin(2 * np.pi * 40 * t) + 1e-3 * np.random.default_rng(1).standard_normal(t.size)
    >>> look = first_look(Recording(decay[None], 1000.0, ("acc",), "m/s2", "decay.csv"))
    >>> look.free, [round(f) for f in look.modes_hz], look.sensors[0].quantity
    (True, [40], 'acceleration')
    """
    channels = _with_input([_channel(recording, i, inputs) for i in range(len(recording.names))], recording.data)
    sensors = [i for i, c in enumerate(channels) if c.kind == "sensor" and c.rms > 0]
    drives = [i for i, c in enumerate(channels) if c.kind != "sensor"]
    y = recording.data[sensors] - recording.data[sensors].mean(axis=1, keepdims=True)
    free = not drives and bool(sensors) and _fades(y)
    if not sensors:
        return FirstLook(recording.source, recording.rate_hz, recording.data.shape[1], channels, free, (), 0.0)
    period, rate = 0.0, recording.rate_hz
    if drives:
        driven = recording.data[drives[0]]
        responses = _Responses.of(y, driven, rate)
        modes, period = responses.modes(), _period(driven) / rate
        if modes:
            shown = {i: responses.quantity(c, modes[0]) for c, i in enumerate(sensors) if not channels[i].told}
            channels = tuple(replace(c, quantity=shown.get(i) or c.quantity) for i, c in enumerate(channels))
    elif free:
        modes = _decay_modes(y[:, _largest(y) :], rate)
    else:
        modes = _Responses.of(y, y[0], rate).modes()
    return FirstLook(recording.source, rate, recording.data.shape[1], channels, free, modes, period)


def _with_input(channels: list[ChannelLook], data: Real) -> tuple[ChannelLook, ...]:
    """Take the least predictable of several channels for the input where no name or unit tells and nothing fades."""
    shown = [i for i, c in enumerate(channels) if c.rms > 0]
    if all(c.kind == "sensor" for c in channels) and len(shown) > 1 and not _fades(data[shown]):
        i, second = sorted(shown, key=lambda i: -channels[i].unpredictable)[:2]
        if channels[i].unpredictable > LESS_PREDICTABLE * channels[second].unpredictable:
            channels[i] = replace(channels[i], kind="force", told=False)
    return tuple(channels)


def _channel(recording: Recording, number: int, inputs: Sequence[str]) -> ChannelLook:
    name, row = recording.names[number], recording.data[number]
    unit = (recording.units[number] if recording.units else recording.unit) or _ending(name)
    unit = unit.lower() if unit.lower() in IN_SI else unit
    kind: Kind = "sensor"
    if inputs:
        kind = "sensor" if name not in inputs else "base acceleration" if BASES.search(name) else "force"
    elif BASES.search(name):
        kind = "base acceleration"
    elif newtons(unit) is not None or FORCES.search(name):
        kind = "force"
    by_name = next((q for pattern, q in QUANTITY_OF_NAME if re.search(pattern, name, re.IGNORECASE)), None)
    quantity = QUANTITY_OF_UNIT.get(unit) or by_name
    rms = float(np.std(row))
    innovation = innovation_rms(row - row.mean()) / rms if rms > 0 else 0.0
    return ChannelLook(
        name, unit, kind, quantity or "acceleration", kind != "sensor" or quantity is not None, rms, float(row.mean()),
        innovation, _step(row), _clipped(row),
    )  # fmt: skip


def _ending(name: str) -> str:
    """Return the unit that a name such as ``y_mm`` ends in; nothing where it ends in none that is plain."""
    found = ENDING.search(name)
    return found[1] if found else ""


def _step(row: Real) -> float:
    """Return the step of coarse values, zero where they are fine."""
    values = np.unique(row)
    if values.size < 3 or values.size > COARSE * row.size:
        return 0.0
    steps = np.diff(values)
    least = float(steps.min())
    whole = np.abs(steps / least - np.round(steps / least))
    return least if float(whole.max()) < 0.01 else 0.0


def _clipped(row: Real) -> int:
    """Return how many samples are stuck, several in a row, at the largest or smallest value."""
    count = 0
    for at in (row.max(), row.min()):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], (row == at).astype(int), [0]])))
        runs = edges[1::2] - edges[::2]
        count += int(runs[runs >= STUCK].sum())
    return count if count < row.size // 2 else 0


def _largest(y: Real) -> int:
    """Return the sample at which channels (c, n) are largest, each over its own peak."""
    return int(np.argmax(np.abs(y / np.maximum(np.abs(y).max(axis=1, keepdims=True), 1e-300)).max(axis=0)))


def _fades(y: Real) -> bool:
    rest = y[:, _largest(y) :]
    quarter = max(rest.shape[1] // 4, 1)
    return bool(np.all(np.std(rest[:, -quarter:], axis=1) < DECAYED * np.std(rest[:, :quarter], axis=1)))


def _decay_modes(y: Real, rate_hz: float) -> tuple[float, ...]:
    """Return the frequencies of the peaks of free decays (c, n), rising."""
    n = y.shape[1]
    size = 2 ** math.ceil(math.log2(2 * n))
    power = np.sum([np.abs(np.fft.rfft(row, size)) ** 2 / max(float(row @ row), 1e-300) for row in y], axis=0)
    level = np.asarray(10 * np.log10(np.maximum(power, 1e-12 * power.max())), np.float64)
    above = float(np.median(level)) + OVER_NOISE_DB
    return _peaks(level, np.asarray(np.fft.rfftfreq(size, 1 / rate_hz), np.float64), max(2 * size // n, 3), above)


@dataclass(frozen=True, slots=True)
class _Responses:
    """Of sensors (c, lines) to an input: their sizes in dB; ``sure`` where a line of them can be believed."""

    frequency: Real
    level: Real
    sure: NDArray[np.bool_]

    @classmethod
    def of(cls, y: Real, driven: Real, rate_hz: float) -> _Responses:
        length = max(y.shape[1] // PARTS, 64)
        frequency, cross = signal.csd(driven[None, :], y, rate_hz, nperseg=length)
        own = signal.welch(driven, rate_hz, nperseg=length)[1]
        shown = signal.welch(y, rate_hz, nperseg=length)[1]
        coherence = np.abs(cross) ** 2 / np.maximum(own * shown, 1e-300)
        size = np.abs(cross) / np.maximum(own, 1e-300)
        # in a sharp resonance a short piece of a recording has not come to rest: its neighbours vouch for it
        coherent = binary_dilation(coherence > COHERENT, np.ones((1, 2 * VOUCHED + 1), np.bool_))
        sure = (own > EXCITED * own.max()) & coherent
        return cls(frequency, 20 * np.log10(np.maximum(size, 1e-300)), sure)

    def modes(self) -> tuple[float, ...]:
        """Return the frequencies of the peaks, rising."""
        line = np.any(self.sure, axis=0)
        if not np.any(line):
            return ()
        power = np.where(self.sure, 10 ** (self.level / 10), 0.0)
        total = np.sum(power / np.maximum(power.max(axis=1, keepdims=True), 1e-300), axis=0)
        level = np.asarray(10 * np.log10(np.maximum(total, 10 ** (-DEEPEST_DB / 10))), np.float64)
        return _peaks(level, self.frequency, 3, -DEEPEST_DB)

    def quantity(self, channel: int, lowest_hz: float) -> Quantity | None:
        """Return what a sensor shows, from how its response grows with frequency well below the lowest mode."""
        low, high = (share * lowest_hz for share in STIFF)
        at = self.sure[channel] & (self.frequency > max(low, self.frequency[1])) & (self.frequency < high)
        if np.count_nonzero(at) < FEWEST_LINES:
            return None
        slope = float(np.polyfit(np.log10(self.frequency[at]), self.level[channel, at], 1)[0]) / 20
        order = round(slope)
        found: Quantity | None = next((q for q, o in DERIVATIVES.items() if o == order), None)
        return found if abs(slope - order) < CLEAR else None


def _peaks(level: Real, frequency: Real, apart: int, above: float) -> tuple[float, ...]:
    prominent, _ = signal.find_peaks(
        np.concatenate([[level.min()], level[1:]]), prominence=STANDS_OUT_DB, distance=apart
    )
    prominent = prominent[level[prominent] > above]
    strongest = prominent[np.argsort(level[prominent])[::-1][:MOST_MODES]]
    return tuple(sorted(float(frequency[i]) for i in strongest))


def _period(row: Real) -> int:
    """Return after how many samples a signal repeats itself; zero where it does not."""
    x = row - row.mean()
    if not x.any():
        return 0
    n = x.size
    together = signal.correlate(x, x, method="fft")[n - 1 :]
    energy = np.concatenate([[0.0], np.cumsum(x**2)])
    lags = np.arange(1, n // 2)
    own = np.sqrt(energy[n - lags] * (energy[n] - energy[lags]))
    likeness = together[1 : n // 2] / np.maximum(own, 1e-300)
    low = np.flatnonzero(likeness < 0.5)
    if low.size == 0:
        return 0
    later = np.flatnonzero(likeness[low[0] :] > SAME)
    if later.size == 0:
        return 0
    first = low[0] + int(later[0])
    around = likeness[first : first + max(n // 200, 8)]
    return first + int(np.argmax(around)) + 1
