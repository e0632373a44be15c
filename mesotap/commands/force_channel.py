"""The force channel of a recording of another program, and the frequency responses that it gives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.frequency_response.estimators import ForceError, FrequencyResponse
from analysis.frequency_response.hits import is_lasting
from analysis.frequency_response.impacts import Window, after_each_hit, of_recording, with_notes
from daq.errors import RecordingError
from daq.exchange import Recording
from daq.exchange.units import newtons

OTHER_SIDE = 0.2
"""Of a push's height, how far a hammer's force goes to the other side at most: a vibration of zeta 0.46 goes as far."""

OF_PUSH, LONGEST_PUSHES = 0.05, 0.02
"""Above so much of its height a push lasts, altogether so long a share of the recording at most: simulated taps of 1 to
5 ms in records of 0.2 s and more."""


@dataclass(frozen=True, slots=True)
class ForceOptions:
    """What the command line says: the force channel's name or number, the window, the length of a stretch, s, and the
    channel of the struck mass's own acceleration."""

    channel: str | None = None
    window: str | None = None
    segment_s: float | None = None
    driving_point: str | None = None

    @property
    def any(self) -> bool:
        """Whether anything was said."""
        return any(v is not None for v in (self.channel, self.window, self.segment_s, self.driving_point))


@dataclass(frozen=True, slots=True)
class ByForce:
    """What a recording's forces tell.

    Attributes
    ----------
    motions
        The recording whose modes are to be found: without its forces, and of several hits the longest decay.
    response
        Of all other channels to the force; None where it cannot be had.
    """

    motions: Recording
    response: FrequencyResponse | None


def by_force(recording: Recording, options: ForceOptions, say: Callable[[str], None]) -> ByForce:
    """Return the frequency responses of a recording of which a channel is a force, and what its modes are found in.

    Where nobody asked for them, what stands in their way is only said: the recording has its modes all the same.

    Raises
    ------
    RecordingError
        They were asked for and cannot be had.
    """
    try:
        channel = force_of(recording, options.channel)
        if channel is None and options.any:
            raise RecordingError(
                f"{recording.source}: has no channel in N, mN, kN, lbf or kgf: say with --force which one is the "
                "hammer's"
            )
        if channel is None:
            for i in like_forces(recording):
                say(
                    f"channel {recording.names[i]} is short pushes of one sign, as a hammer's force is, and says no "
                    f"unit: it is taken as a motion; with --force {recording.names[i]} it is the force"
                )
            return ByForce(recording, None)
        found = responses_of(recording, channel, options)
    except RecordingError as error:
        if options.any:
            raise
        say(f"no frequency response: {str(error).removeprefix(f'{recording.source}: ')}")
        return ByForce(without(recording, _forces(recording)), None)
    return ByForce(_one_decay(recording, channel, say), found)


def _one_decay(recording: Recording, channel: int, say: Callable[[str], None]) -> Recording:
    """Return a recording without its force; of several hits only the longest decay, as modes have no other."""
    motions, force = without(recording, [channel]), recording.data[channel]
    if is_lasting(force):
        return motions
    parts = after_each_hit(force, recording.rate_hz)
    if len(parts) == 1:
        return motions
    longest = max(parts, key=lambda part: part.stop - part.start)
    begin, end = longest.start / recording.rate_hz, longest.stop / recording.rate_hz
    say(f"the force shows {len(parts)} hits: the modes are those of the longest decay, {begin:.4g} to {end:.4g} s")
    return replace(motions, data=np.ascontiguousarray(motions.data[:, longest]))


def _forces(recording: Recording) -> list[int]:
    return [i for i, unit in enumerate(_units(recording)) if newtons(unit) is not None]


def like_forces(recording: Recording) -> list[int]:
    """Return which channels without a unit look like the force of a hammer, beside others that do not.

    Such a force pushes, and is nothing before and after: a free vibration goes as far to the other side but for its
    damping, exp(-pi zeta / sqrt(1 - zeta^2)) of a half-wave.
    """
    found = [i for i, unit in enumerate(_units(recording)) if not unit and _is_pushes(recording.data[i])]
    return found if len(found) < len(recording.names) else []


def _is_pushes(y: NDArray[np.float64]) -> bool:
    y = y - np.median(y)
    if abs(float(y.min())) > float(y.max()):
        y = -y
    highest = float(y.max())
    if not highest > 0 or -float(y.min()) > OTHER_SIDE * highest:
        return False
    return float(np.mean(np.abs(y) > OF_PUSH * highest)) < LONGEST_PUSHES


def force_of(recording: Recording, named: str | None) -> int | None:
    """Return which channel is a force: the one named, or the only one in N, mN, kN, lbf or kgf; None without any.

    Raises
    ------
    RecordingError
        None is called that, or several are forces and none was named.
    """
    names = recording.names
    if named is not None:
        return channel_called(recording, named, "--force")
    forces = _forces(recording)
    if len(forces) > 1:
        raise RecordingError(
            f"{recording.source}: channels {_listed([names[i] for i in forces])} are all forces: say with --force "
            "which one is the hammer's"
        )
    return forces[0] if forces else None


def channel_called(recording: Recording, named: str, option: str) -> int:
    """Return the channel of a name or number that an option gives.

    Raises
    ------
    RecordingError
        There is none.
    """
    names = recording.names
    if named in names:
        return names.index(named)
    if named.isascii() and named.isdigit() and len(named) < 9 and int(named) < len(names):
        return int(named)
    raise RecordingError(f"{recording.source}: {option} {named:.40}: it has no such channel, only {_listed(names)}")


def responses_of(recording: Recording, force: int, options: ForceOptions) -> FrequencyResponse:
    """Return the frequency responses of all other channels to the force.

    Raises
    ------
    RecordingError
        There is no other channel, the force is dead, or no hit of it can be used.
    """
    others = [i for i in range(len(recording.names)) if i != force]
    if not others:
        raise RecordingError(f"{recording.source}: has a force channel ({recording.names[force]}) and nothing else")
    units = _units(recording)
    scale = newtons(units[force])
    notes = []
    if scale is None:
        notes.append(
            f"the unit of {recording.names[force]} is {units[force]!r:.40}, which is no force known here: the "
            "responses are per that unit"
            if units[force]
            else f"{recording.names[force]} says no unit: its numbers are taken as newtons"
        )
    elif scale != 1.0:
        notes.append(f"{recording.names[force]} was in {units[force]}, and is taken as {scale:.6g} N each")
    per = "N" if scale is not None or not units[force] else units[force]
    said = {units[i] for i in others}
    unit = f"{said.pop() or '?'}/{per}" if len(said) == 1 else f"own unit/{per}"
    response = recording.data[others]
    window: Window = options.window or "auto"  # type: ignore[assignment]  # of_recording refuses others
    try:
        found = of_recording(
            recording.data[force] * (1.0 if scale is None else scale),
            response,
            recording.rate_hz,
            [recording.names[i] for i in others],
            unit,
            window,
            options.segment_s,
        )
    except ForceError as error:
        raise RecordingError(f"{recording.source}: {recording.names[force]}: {error}") from error
    return with_notes(found, notes)


def without(recording: Recording, channels: Sequence[int]) -> Recording:
    """Return a recording without some channels; all of them where nothing would be left."""
    left = [i for i in range(len(recording.names)) if i not in channels] or list(range(len(recording.names)))
    units = tuple(recording.units[i] for i in left) if recording.units else ()
    common = units[0] if units and len(set(units)) == 1 else recording.unit
    return replace(
        recording,
        data=np.ascontiguousarray(recording.data[left]),
        names=tuple(recording.names[i] for i in left),
        units=units,
        unit=common,
    )


def _units(recording: Recording) -> tuple[str, ...]:
    return recording.units or (recording.unit,) * len(recording.names)


def _listed(names: tuple[str, ...] | list[str]) -> str:
    return ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "")
