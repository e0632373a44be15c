"""How much memory and time a file of a size may take to be read."""

from __future__ import annotations

LARGEST_ARRAY = 100_000_000
"""Values in one array, and in one file, beyond which a file is not believed (an hour of two channels at 14 kHz)."""

EXPANSION = 100
"""Times its size that a file may unpack to: samples with noise pack to a third, zeros to a thousandth."""

LEAST_ROOM = 64_000_000
"""Bytes that the smallest file may unpack to: a constant second of a recorder packs to nothing."""

OWN_ROOM = 256_000_000
"""Bytes that a library may take for itself."""

_CPU_S, _WALL_S = 8.0, 15.0
_CPU_BYTES_PER_S, _WALL_BYTES_PER_S = 4e6, 3e6
"""A text of numbers is read at 8 MB/s of a slow processor, everything else faster; a network disk gives 10 MB/s."""

_LARGEST_TEXT = 100_000_000  # bytes; what is larger is not text, and read a hundred times as fast


def data_room(size: int) -> int:
    """Return how many bytes of arrays a file of ``size`` bytes may hold."""
    return min(max(EXPANSION * size, LEAST_ROOM), 8 * LARGEST_ARRAY)


IMPACT_EXPANSION = 4
"""Times its size that an impact's file may unpack to: it is written unpacked, and noise packs to a third."""

LEAST_IMPACT_ROOM = 1_000_000
"""Bytes that the smallest impact's file may unpack to."""


def impact_room(size: int) -> int:
    """Return how many bytes of arrays the file of an impact, of ``size`` bytes, may hold."""
    return min(max(IMPACT_EXPANSION * size, LEAST_IMPACT_ROOM), 8 * LARGEST_ARRAY)


def folder_room(size: int) -> int:
    """Return how many bytes of arrays the impacts of a folder, ``size`` bytes together, may hold."""
    return min(max(IMPACT_EXPANSION * size, LEAST_ROOM), 8 * LARGEST_ARRAY)


def memory_room(size: int) -> int:
    """Return how many bytes a process may grow by to read a file of ``size`` bytes: data, one copy, the file's text."""
    return OWN_ROOM + data_room(size) + data_room(size) // 2 + min(size, 300_000_000)


def longest_read_s(size: int) -> tuple[float, float]:
    """Return the time, s of the processor and of the clock, that reading a file of ``size`` bytes may take."""
    size = min(size, _LARGEST_TEXT)
    return _CPU_S + size / _CPU_BYTES_PER_S, _WALL_S + size / _WALL_BYTES_PER_S
