"""From a file of any known format to a recording, and from a recording to a session."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from daq.errors import RecordingError
from daq.exchange.formats import format_of
from daq.exchange.recording import Columns, Recording, make_recording
from daq.exchange.tdms import BEGINS as TDMS
from daq.exchange.units import is_no_acceleration
from daq.exchange.wav import BEGINS as WAV
from daq.limited import read_limited
from daq.records import Impact, RigDescription, Session
from daq.regular import read_head, read_regular

LARGEST_FILE = 1_000_000_000
"""Bytes beyond which a file is not read."""

LARGEST_TEXT = 100_000_000
"""Bytes of a text beyond which it is not read: numbers in text take twenty times its room while they are read."""

_HEAD = 520  # bytes that tell what a file is

_HDF5 = b"\x89HDF\r\n\x1a\n"
_KNOWN_OTHERS = {
    b"\x89PNG": "a PNG image",
    b"\xff\xd8\xff": "a JPEG image",
    b"GIF8": "a GIF image",
    b"%PDF": "a PDF document",
    b"PK\x03\x04": "a ZIP archive or office document",
    b"\x1f\x8b": "a gzip archive",
}


def import_recording(
    path: str | Path,
    rate_hz: float | None = None,
    channels: Sequence[str | int] | None = None,
    unit: str | None = None,
) -> Recording:
    """Read a recording from a CSV, MAT (5 to 7.3), universal, WAV or TDMS file, told apart by content.

    A file whose ending is that of another package's format (`daq.exchange.formats`) is read by that.

    Parameters
    ----------
    rate_hz
        Sampling rate, Hz. Needed where the file has no times; where it has, the two must agree to 0.5 %.
    channels
        Names, or numbers from 0, of the channels wanted; the column of times is none. All by default.
    unit
        Unit of the samples where the file does not say, or says wrongly; "g" becomes m/s2.

    Raises
    ------
    RecordingError
        One sentence: what about which file, channel, line or sample.
    """
    path = Path(path)
    columns = read_limited(columns_in, path, kinds=(Columns,))
    return make_recording(path, columns, rate_hz, channels, unit)


def columns_in(path: Path) -> Columns:
    """Return what a file that this process opens itself holds.

    Raises
    ------
    RecordingError
        As `import_recording`.
    """
    other = format_of(path)
    if other is not None:
        read_head(path, _HEAD)  # no pipe, and no folder
        return other.columns(path)
    # The readers are imported where they are used: a CSV file should not wait for pyuff.
    content = content_of(path)
    if is_hdf5(content):
        from daq.exchange.matlab73 import read_mat73

        return read_mat73(path)
    if is_mat5(path, content):
        from daq.exchange.matlab5 import read_mat5

        return read_mat5(path, content)
    return columns_of(path, content)


def columns_of(path: Path, content: bytes) -> Columns:
    """Return what the content of a file holds that is neither HDF5 nor MAT.

    Raises
    ------
    RecordingError
        As `import_recording`.
    """
    if content.startswith(WAV):
        from daq.exchange.wav import read_wav

        return read_wav(path, content)
    if content.startswith(TDMS):
        from daq.exchange.tdms import read_tdms

        return read_tdms(path, content)
    from daq.exchange.universal import BEGINS, read_universal

    if BEGINS.match(content):
        return read_universal(path, content)
    from daq.exchange.text import read_text

    return read_text(path, content)


def is_hdf5(content: bytes) -> bool:
    """Return whether this is an HDF5 file, of which MAT 7.3 is a kind."""
    return content.startswith(_HDF5) or content[512:520] == _HDF5


def is_mat5(path: Path, content: bytes) -> bool:
    """Return whether this is a MAT file of version 5."""
    return content.startswith(b"MATLAB") or path.suffix.lower() == ".mat"


def content_of(path: Path) -> bytes:
    """Return what a file holds, unless it is certainly no recording; of an HDF5 file only its beginning.

    Raises
    ------
    RecordingError
        It cannot be read, is empty or too large, or of a kind that is known to be something else.
    """
    head = read_head(path, _HEAD)
    if is_hdf5(head):
        return head
    if is_mat5(path, head) or head.startswith((*WAV, TDMS)):
        content = read_regular(path, LARGEST_FILE, "a recording")
    else:
        content = read_regular(path, LARGEST_TEXT, "a text of numbers")
    if not content or content.isspace():
        raise RecordingError(f"{path}: the file is empty")
    for start, kind in _KNOWN_OTHERS.items():
        if content.startswith(start):
            raise RecordingError(f"{path}: is not a recording but {kind}")
    return content


def as_session(recording: Recording, channels: Sequence[str | int] | None = None) -> Session:
    """Return a session of one impact: two channels in the place of A and B, all of them kept beside.

    Nothing is known of the rig but the sampling rate; loads are NaN. The trigger is found in the two channels;
    where they hold no onset the record begins with it.

    Parameters
    ----------
    channels
        Names, or numbers from 0, of the two channels; the first two by default.

    Raises
    ------
    RecordingError
        There are no two channels, one of those asked for is not there or is not an acceleration, or none were asked for
        and something of the file was left out.
    """
    from daq.trigger import find_trigger  # brings all of scipy.signal, which a reader of files need not wait for

    names = recording.names
    if len(names) < 2:
        more = f"; left out: {', '.join(recording.left_out[:5])}" if recording.left_out else ""
        raise RecordingError(f"{recording.source}: has only one channel ({names[0]}), two are needed{more}")
    wanted = (0, 1) if channels is None else tuple(_place(recording, channel) for channel in channels)
    if len(wanted) != 2 or wanted[0] == wanted[1]:
        raise RecordingError(f"{recording.source}: two different channels are needed, of {', '.join(names)}")
    if channels is None and recording.left_out:
        left_out = ", ".join(recording.left_out[:5]) + (" and more" if len(recording.left_out) > 5 else "")
        raise RecordingError(
            f"{recording.source}: left out is what may be a channel, {left_out}: "
            f"name A and B with --channel, of {_listed(names)}"
        )
    for i in wanted if recording.units else ():
        if is_no_acceleration(recording.units[i]):
            raise RecordingError(
                f"{recording.source}: channel {names[i]} is in {recording.units[i]}, and a session's A and B are "
                "accelerations: name others with --channel, or convert it to m/s2 or g"
            )
    pair = recording.data[list(wanted)]
    try:
        pretrigger = find_trigger(pair, recording.rate_hz)
    except RecordingError:
        pretrigger = 0
    source = Path(recording.source)
    time = _modified(source)
    impact = Impact(
        number=0,
        load_set=0,
        target_load_mn=math.nan,
        load_before_mn=math.nan,
        load_after_mn=math.nan,
        time=time,
        sample_rate_hz=recording.rate_hz,
        pretrigger=pretrigger,
        acceleration=pair,
        accepted=True,
        extra={
            "imported_from": source.name,
            "unit": recording.unit,
            "channels_as_a_and_b": [names[i] for i in wanted],
        },
        channels=recording.data,
        channel_names=names,
    )
    return Session(
        created=time,
        rig=RigDescription(sample_rate_hz=recording.rate_hz, filter_family=""),
        impacts=(impact,),
        title=source.name,
        complete=True,
        source=recording.source,
    )


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "")


def _place(recording: Recording, channel: str | int) -> int:
    names = recording.names
    if isinstance(channel, str) and channel in names:
        return names.index(channel)
    if isinstance(channel, int) or (channel.isascii() and channel.isdigit() and len(channel) < 9):
        number = int(channel)
        if 0 <= number < len(names):
            return number
    raise RecordingError(f"{recording.source}: has no channel {channel}; it holds {', '.join(names)}")


def _modified(path: Path) -> str:
    try:
        seconds = path.stat().st_mtime
    except OSError:
        seconds = datetime.now(UTC).timestamp()
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
