"""Recordings and scans of other programs made to fill memory, take for ever, or say what terminals act on."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tests.hostile.case import Case

ROWS = "\n".join(f"{i / 1000:.3f},{np.sin(i):.6f},{np.cos(i):.6f}" for i in range(100))
HEADER = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"


def file(name: str, content: bytes | Callable[[], bytes]) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        (folder / name).write_bytes(content if isinstance(content, bytes) else content())
        return ["import", name, "y.h5"]

    return make


def scan(content: bytes | Callable[[], bytes]) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        (folder / "x.csv").write_bytes(content if isinstance(content, bytes) else content())
        return ["surface", "x.csv", "--unit", "nm", "--spacing-um", "1"]

    return make


def sparse(name: str, size: int, begins: bytes = b"") -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        with (folder / name).open("wb") as hollow:
            hollow.write(begins)
            hollow.truncate(size)
        return ["import", name, "y.h5"]

    return make


def table(header: str, rows: str = ROWS) -> bytes:
    return f"{header}\n{rows}\n".encode()


TEXTS: tuple[tuple[str, bytes | Callable[[], bytes], dict[str, Any]], ...] = (
    ("one line of 300 MB", lambda: b"1," * 150_000_000, {"says": "100 MB", "quick": True}),
    ("one line of 60 MB", lambda: b"1," * 30_000_000, {"says": "line of more than"}),
    ("60 MB of line ends", lambda: b"\n" * 60_000_000, {"says": "empty"}),
    ("20 MB of commas", lambda: b",,,\n" * 5_000_000, {"says": "x.csv"}),
    ("20 MB of words", lambda: b"abc def\n" * 2_500_000, {"says": "no table"}),
    ("10 MB of comments", lambda: b"# a\n" * 2_500_000, {"says": "x.csv"}),
    ("100,000 columns", lambda: (b"1," * 100_000 + b"1\n") * 20, {"says": "more than this program takes"}),
    ("numbers of 100,000 digits", table("t,a,b", "\n".join(["9" * 100_000] * 20)), {"says": "x.csv"}),
    ("exponents beyond numbers", table("t,a,b", ROWS.replace("0.841471", "1e999")), {"says": "infinite"}),
    ("zeros among the text", b"a,b\n" + b"\0" * 1000, {"says": "not a recording"}),
    ("a lone half of UTF-16", b"\xff\xfe" + b"\x00\xd8" * 1000, {"says": "x.csv"}),
    ("names that act on terminals", table("t,\x1b[31ma,b"), {"either": True}),
    ("names that turn the writing", table("t,\u202ea,b"), {"shows": "\\u202ea", "quick": True}),
    ("names that are markup", table("t,[/red]a,[link=x]b"), {"shows": "[/red]a"}),
    ("names that are mathematics", table("t,$\\frac$,a_{b}$"), {"shows": "$\\frac$"}),
    ("names that are formulas", table("t,=1+1,@SUM(A1)"), {"shows": "=1+1"}),
    ("times that stand still", table("t,a,b", "\n".join(["0,1,1"] * 100)), {"says": "not evenly spaced"}),
    ("times of 1e-320", table("t,a,b", "\n".join(f"{i}e-320,1,{i}" for i in range(100))), {"either": True}),
)

DEEP = b""
for _ in range(60):  # cells within cells
    DEEP = struct.pack("<IIII", 6, 8, 1, 0) + struct.pack("<IIii", 5, 8, 1, 1) + struct.pack("<II", 1, 0) + DEEP
    DEEP = struct.pack("<II", 14, len(DEEP)) + DEEP


def packed(size: int) -> bytes:
    """A compressed variable that unpacks to zeros."""
    packer = zlib.compressobj(9)
    parts = [packer.compress(bytes(10_000_000)) for _ in range(size // 10_000_000)]
    content = b"".join([*parts, packer.flush()])
    return HEADER + struct.pack("<II", 15, len(content)) + content


def claimed(rows: int, columns: int) -> bytes:
    inner = (
        struct.pack("<IIII", 6, 8, 6, 0)
        + struct.pack("<IIii", 5, 8, rows, columns)
        + struct.pack("<II4s4x", 1, 1, b"a")
    )
    inner += struct.pack("<II", 9, 80) + bytes(80)
    return HEADER + struct.pack("<II", 14, len(inner)) + inner


MATS: tuple[tuple[str, bytes | Callable[[], bytes], dict[str, Any]], ...] = (
    ("zeros for 3 GB", lambda: packed(3_000_000_000), {"says": "x.mat", "quick": True}),
    ("zeros for 700 MB", lambda: packed(700_000_000), {"says": "x.mat"}),
    ("an array of 2^31 by 2^31", claimed(2**31 - 1, 2**31 - 1), {"says": "x.mat"}),
    ("an array of -1 by 5", claimed(-1, 5), {"says": "x.mat"}),
    ("cells within cells", HEADER + DEEP, {"says": "not a recording"}),
    ("an element of 4 GB", HEADER + struct.pack("<II", 14, 2**32 - 1), {"says": "damaged"}),
    ("a header alone", HEADER, {"says": "x.mat"}),
    ("zeros after the header", HEADER + bytes(1_000_000), {"says": "x.mat"}),
)

UFF_HEAD = (
    "    -1\n    58\n"
    + "x\n" * 5
    + "    1         0    0         0       NONE         0   0       NONE         0   0\n"
)


def uff(points: str, values: str) -> bytes:
    head = f"{UFF_HEAD}         4{points:>10}         1  0.00000E+00  1.00000E-03  0.00000E+00\n"
    axes = "        17    0    0    0                 NONE                 NONE\n" * 4
    return (head + axes + values + "\n    -1\n").encode()


UFFS: tuple[tuple[str, bytes | Callable[[], bytes], dict[str, Any]], ...] = (
    ("999,999,999 values claimed", uff("999999999", " 1.0E0 2.0E0"), {"says": "x.uff"}),
    ("-5 values claimed", uff("-5", " 1.0E0 2.0E0"), {"says": "x.uff"}),
    ("10,000 data sets of nothing", b"    -1\n   151\nx\n    -1\n" * 10_000, {"says": "x.uff"}),
    ("a data set without end", uff("10", "1.0 " * 10)[:-8], {"says": "x.uff"}),
    (
        "binary noise",
        b"    -1\n    58b     1     2          11       4096     0     0           0           0\n"
        + bytes(range(256)) * 100,
        {"says": "x.uff"},
    ),
)

PLAIN = "\n".join(f"{np.sin(i):.5f}" for i in range(4000))
SCANS: tuple[tuple[str, bytes | Callable[[], bytes], dict[str, Any]], ...] = (
    ("one line of 300 MB", lambda: b"1," * 150_000_000, {"says": "100 MB"}),
    ("one line of 40 MB", lambda: b"1," * 20_000_000, {"says": "more than 10000000 characters"}),
    ("infinities", PLAIN.replace("0.84147", "inf").encode(), {"says": "not a number"}),
    ("numbers of 100,000 digits", ("9" * 100_000 + "\n").encode() * 50, {"says": "x.csv"}),
    ("a unit that acts on terminals", b"# unit: \x1b[2J\n" + PLAIN.encode(), {"shows": "x.csv"}),
    ("noise", bytes(range(256)) * 1000, {"says": "not text"}),
    ("nothing", b"", {"says": "no numbers"}),
    ("heights of 1e300", PLAIN.replace("0.", "1e300").encode(), {"either": True}),
)


def cases() -> Iterator[Case]:
    for name, content, how in TEXTS:
        yield Case("text recordings", name, file("x.csv", content), **how)
    for name, content, how in MATS:
        yield Case("MAT 5 files", name, file("x.mat", content), **how)
    for name, content, how in UFFS:
        yield Case("universal files", name, file("x.uff", content), **how)
    for name, content, how in SCANS:
        yield Case("profilometer scans", name, scan(content), **how)
    yield Case("text recordings", "3 GB of nothing", sparse("x.csv", 3_000_000_000), says="100 MB")
    yield Case("MAT 5 files", "3 GB of nothing", sparse("x.mat", 3_000_000_000, HEADER), says="1000 MB")
    yield Case("MAT 5 files", "900 MB of nothing", sparse("x.mat", 900_000_000, HEADER), says="x.mat")
    yield Case("MAT 7.3 files", "3 GB of nothing", sparse("x.mat", 3_000_000_000, b"\x89HDF\r\n\x1a\n"), says="x.mat")
