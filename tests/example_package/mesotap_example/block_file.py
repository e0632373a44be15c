"""Files of a recorder: ``BLK1``, channels and samples, the rate, a name and a unit a channel, then the samples."""

import struct

import numpy as np

from daq.errors import RecordingError
from daq.exchange.formats import FormatPlugin
from daq.exchange.recording import Columns

HEAD = struct.Struct("<4sHId")  # magic, channels, samples, Hz
LABEL = struct.Struct("<16s8s")  # name and unit of a channel


def read(path):
    content = path.read_bytes()
    if content[:4] != b"BLK1":
        raise RecordingError(f"{path}: is not a block file, which begins with BLK1")
    if len(content) < HEAD.size:
        raise RecordingError(f"{path}: is truncated: its head is not whole")
    _, channels, samples, rate_hz = HEAD.unpack_from(content)
    start = HEAD.size + channels * LABEL.size
    if len(content) != start + 8 * channels * samples:
        raise RecordingError(f"{path}: is damaged: {channels} channels of {samples} samples do not fill it")
    labels = [LABEL.unpack_from(content, HEAD.size + i * LABEL.size) for i in range(channels)]
    names, units = ([text.rstrip(b"\0").decode("latin-1") for text in column] for column in zip(*labels, strict=True))
    data = np.frombuffer(content, "<f8", offset=start).reshape(channels, samples)
    return Columns(names, units, [row.astype(float) for row in data], rate_hz=rate_hz)


def example():  # what the reader is tried with by 'mesotap formats --check'
    t = np.arange(2000) / 10000.0
    noise = np.random.default_rng(1).normal(0.0, 1e-3, (2, t.size))
    data = [np.exp(-20 * t) * np.sin(2 * np.pi * f * t) + n for f, n in zip((356.0, 1904.0), noise, strict=True)]
    head = HEAD.pack(b"BLK1", 2, t.size, 10000.0)
    labels = b"".join(LABEL.pack(name, b"m/s2") for name in (b"A", b"B"))
    content = head + labels + np.array(data).astype("<f8").tobytes()
    return content, Columns(["A", "B"], ["m/s2", "m/s2"], data, rate_hz=10000.0)


FORMAT = FormatPlugin(ending="blk", read=read, example=example, summary="block files of an example recorder")
