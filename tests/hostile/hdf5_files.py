"""Session files and MAT 7.3 files made to crash, fill or mislead whoever reads them."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from daq.session_file import write_session
from tests.fuzz.sessions import in_the_old_layout, small_session
from tests.hostile.case import Case

ACCELERATION, CONFIG = "impacts/00000/acceleration", "config"
FLOATS = h5py.h5t.IEEE_F64LE
Edit = Callable[[h5py.File], Any]


def edited(edit: Edit) -> Callable[[Path], list[str]]:
    """A sound session with something changed in it."""

    def make(folder: Path) -> list[str]:
        write_session(folder / "x.h5", small_session())
        with h5py.File(folder / "x.h5", "r+") as file:
            edit(file)
        return ["info", "x.h5"]

    return make


def instead(where: str, put: Callable[[h5py.File], Any]) -> Edit:
    """Put something in the place of an item."""

    def edit(file: h5py.File) -> None:
        del file[where]
        put(file)

    return edit


def virtual(where: str, shape: tuple[int, ...], file_name: str, source: str) -> Edit:
    layout = h5py.VirtualLayout(shape, "f8")
    layout[...] = h5py.VirtualSource(file_name, source, shape=shape)
    return instead(where, lambda file: file.create_virtual_dataset(where, layout))


def low_level(where: str, shape: tuple[int, ...], chunk: tuple[int, ...], plan: Callable[[Any], Any]) -> Edit:
    """An array without samples, its creation plan made by hand."""

    def put(file: h5py.File) -> None:
        properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        properties.set_chunk(chunk)
        plan(properties)
        data = h5py.Dataset(
            h5py.h5d.create(file.id, where.encode(), FLOATS, h5py.h5s.create_simple(shape), dcpl=properties)
        )
        data.attrs["units"] = "m/s2"

    return instead(where, put)


def bomb(where: str, chunks: int, width: int) -> Edit:
    """Zeros, packed to a thousandth, in chunks that are all the same."""

    def put(file: h5py.File) -> None:
        data = file.create_dataset(where, (2, chunks * width), "f8", chunks=(2, width), compression="gzip")
        data.attrs["units"] = "m/s2"
        packed = zlib.compress(bytes(16 * width), 9)
        for i in range(chunks):
            data.id.write_direct_chunk((0, i * width), packed)

    return instead(where, put)


def array(where: str, values: Any, **options: Any) -> Edit:
    def put(file: h5py.File) -> None:
        file.create_dataset(where, data=values, **options).attrs["units"] = "m/s2"

    return instead(where, put)


def undigested(change: Edit) -> Edit:
    """The same by a program that keeps no digests."""

    def edit(file: h5py.File) -> None:
        change(file)
        for impact in file["impacts"].values():
            impact.attrs.pop("digest", None)

    return edit


def attribute(item: str, name: str, value: Any) -> Edit:
    def edit(file: h5py.File) -> None:
        file[item].attrs[name] = value

    return edit


def linked(where: str, link: Any) -> Edit:
    return instead(where, lambda file: file.__setitem__(where, link))


def many_links(file: h5py.File) -> None:
    for number in range(2, 20_000):
        file[f"impacts/{number:05d}"] = file["impacts/00000"]


def many_names(file: h5py.File) -> None:
    for number in range(100_001):
        file["impacts"][f"x{number}"] = h5py.SoftLink("/")


def external_text(file: h5py.File) -> None:
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_external(b"/etc/passwd", 0, 100)
    text = h5py.h5t.C_S1.copy()
    text.set_size(100)
    h5py.h5d.create(file.id, b"config", text, h5py.h5s.create(h5py.h5s.SCALAR), dcpl=properties)


def text_claim(file: h5py.File) -> int:
    return int(file["config"].id.get_offset())


def long_text(folder: Path) -> list[str]:
    write_session(folder / "x.h5", small_session())
    with h5py.File(folder / "x.h5") as file:
        place = text_claim(file)
    with (folder / "x.h5").open("r+b") as file:
        file.seek(place)
        file.write(b"\xff\xff\xff\xef")
    return ["info", "x.h5"]


def bytes_of(change: Callable[[bytes], bytes], old: bool = False) -> Callable[[Path], list[str]]:
    def make(folder: Path) -> list[str]:
        write_session(folder / "x.h5", small_session())
        content = bytes(in_the_old_layout(folder / "old.h5")) if old else (folder / "x.h5").read_bytes()
        (folder / "x.h5").write_bytes(change(content))
        return ["info", "x.h5"]

    return make


def heap_that_never_ends(content: bytes) -> bytes:
    at = content.index(b"GCOL\x01")
    return content[: at + 24] + bytes(8) + content[at + 32 :]


MERGE_BOMB = "a: &a {x: 1}\n" + "\n".join(
    f"{chr(98 + i)}: &{chr(98 + i)} {{<<: [{', '.join(['*' + chr(97 + i)] * 9)}]}}" for i in range(12)
)
HOSTILE_TEXT = "\x1b]0;owned\x07\x1b[31m\u202etxt\nmesotap: all is well [/red] $\\frac$"

SOFT, ELSEWHERE = h5py.SoftLink("/rig"), h5py.ExternalLink("other.h5", "/x")
EDITS: tuple[tuple[str, Edit, dict[str, Any]], ...] = (
    ("a virtual array of itself", virtual(ACCELERATION, (2, 64), ".", ACCELERATION), {"says": "made of other arrays"}),
    ("a virtual text of itself", virtual(CONFIG, (4,), ".", CONFIG), {"says": "/config"}),
    ("a virtual array of another file", virtual(ACCELERATION, (2, 64), "/etc/passwd", "x"), {"says": "made of other"}),
    ("a virtual array without end", virtual(ACCELERATION, (2, 10**9), ".", "nothing"), {"says": "made of other"}),
    ("an external text", instead(CONFIG, external_text), {"says": "kept in another file", "quick": True}),
    (
        "an external array",
        instead(
            ACCELERATION,
            lambda f: f.create_dataset(ACCELERATION, (2, 64), "f8", external=[("/etc/passwd", 0, 1024)]),
        ),
        {"says": "kept in another file"},
    ),
    ("a link into another file", linked(CONFIG, ELSEWHERE), {"says": "link to another place"}),
    ("an impact in another file", linked("impacts/00000", ELSEWHERE), {"says": "link to another place"}),
    ("a soft link to another item", linked(CONFIG, SOFT), {"says": "link to another place"}),
    ("a soft link to itself", linked("impacts", h5py.SoftLink("/impacts")), {"says": "link to another place"}),
    ("the root as its own impact", lambda f: f["impacts"].__setitem__("00002", f["/"]), {"shows": "impacts: 2"}),
    ("impacts as their own impact", lambda f: f["impacts"].__setitem__("00002", f["impacts"]), {"shows": "impacts: 2"}),
    ("20,000 hard links to one impact", many_links, {"says": "the same as another item", "quick": True}),
    ("100,001 names", many_names, {"says": "more than this program takes"}),
    ("two impacts with one array", lambda f: f.__setitem__("impacts/00001/strain", f[ACCELERATION]), {"shows": "2"}),
    (
        "one array in two impacts",
        lambda f: (
            f.__delitem__("impacts/00001/acceleration"),
            f.__setitem__("impacts/00001/acceleration", f[ACCELERATION]),
        ),
        {"says": "the same as another item"},
    ),
    ("zeros for 3.2 GB", bomb(ACCELERATION, 200, 1_000_000), {"says": "claims shape", "quick": True}),
    ("zeros for 160 MB", bomb(ACCELERATION, 10, 1_000_000), {"says": "more than a file of this size holds"}),
    ("zeros for 1.6 GB in one chunk", bomb(ACCELERATION, 1, 30_000_000), {"says": "claims shape"}),
    ("zeros for 1 MB", bomb(ACCELERATION, 1, 62_500), {"shows": "strain_mv has shape"}),
    (
        "packed twice",
        low_level(ACCELERATION, (2, 64), (2, 64), lambda p: (p.set_deflate(9), p.set_deflate(9))),
        {"says": "packed twice"},
    ),
    (
        "an unknown filter",
        low_level(ACCELERATION, (2, 64), (2, 64), lambda p: p.set_filter(32013, 1, (1,))),
        {"says": "packed by filter 32013"},
    ),
    ("a chunk of 2 GB", low_level(ACCELERATION, (2, 2**30), (2, 2**27), lambda p: None), {"says": "claims shape"}),
    (
        "a claim of 10^15 samples",
        array(ACCELERATION, None, shape=(2, 10**15), dtype="f8", chunks=(2, 64)),
        {"says": "claims shape"},
    ),
    (
        "a claim of 2^62 samples",
        array(ACCELERATION, None, shape=(2, 2**61), dtype="f8", chunks=(2, 64)),
        {"says": "claims shape"},
    ),
    (
        "a fill value for 640 MB",
        array(ACCELERATION, None, shape=(2, 40_000_000), dtype="f8", fillvalue=1.0),
        {"says": "more than a file"},
    ),
    (
        "samples of one byte for 50 GB",
        array(ACCELERATION, None, shape=(2, 25 * 10**9), dtype="i1", chunks=(2, 64)),
        {"shows": "is not an array of"},
    ),
    ("records for samples", array(ACCELERATION, np.zeros((2, 64), [("a", "f8")])), {"shows": "is not an array of"}),
    (
        "lists for samples",
        array(ACCELERATION, None, shape=(2, 64), dtype=h5py.vlen_dtype("f8")),
        {"shows": "is not an array of"},
    ),
    (
        "references for samples",
        array(ACCELERATION, None, shape=(2, 64), dtype=h5py.ref_dtype),
        {"shows": "is not an array of"},
    ),
    ("texts for samples", array(ACCELERATION, np.full((2, 64), b"1.0")), {"shows": "is not an array of"}),
    ("samples of 16 bits", undigested(array(ACCELERATION, np.zeros((2, 64), "f2"))), {"shows": "impacts: 2"}),
    ("samples that were altered", array(ACCELERATION, np.zeros((2, 64), "f2")), {"shows": "its digest differs"}),
    ("samples of 128 bits", array(ACCELERATION, np.zeros((2, 64), np.longdouble)), {"either": True}),
    ("a type for a group", instead("impacts", lambda f: f.__setitem__("impacts", np.dtype("f8"))), {"says": "impacts"}),
    ("a group for a text", instead(CONFIG, lambda f: f.create_group(CONFIG)), {"says": "not a scalar string"}),
    ("a text of 30 MB", array(CONFIG, "x: 1 # " + "y" * 30_000_000), {"either": True}),
    ("a fixed text of 1 GB", array(CONFIG, None, shape=(), dtype="S1000000000"), {"says": "longer than the file"}),
    ("a filter of 10^6 poles", attribute("rig", "highpass_order", 1_000_000), {"says": "at most 8", "quick": True}),
    ("a filter of 2^40 poles", attribute("rig", "lowpass_order", 2**40), {"says": "at most 8"}),
    ("10^9 bits", attribute("rig", "bits", 10**9), {"says": "at most 64"}),
    ("a rate of 1e308 Hz", attribute("rig", "sample_rate_hz", 1e308), {"says": "sample_rate_hz"}),
    ("a mass of nothing", attribute("rig", "m1_kg", 0.0), {"says": "m1_kg"}),
    ("a load set of 2^60", attribute("impacts/00000", "load_set", 2**60), {"either": True}),
    ("a nested JSON beside", attribute("impacts/00000", "extra", "[" * 50_000), {"shows": "impacts: 2"}),
    (
        "a long number beside",
        attribute("impacts/00000", "extra", '{"a": ' + "9" * 50_000 + "}"),
        {"shows": "impacts: 2"},
    ),
    (
        "10,000 channels named",
        attribute("impacts/00000", "channel_names", "[" + "1," * 9_999 + "1]"),
        {"shows": "channels"},
    ),
    (
        "an operator that acts on terminals",
        attribute("/", "operator", HOSTILE_TEXT),
        {"shows": "\\x1b]0;owned", "quick": True},
    ),
    ("a specimen with a line end", attribute("/", "specimen", "a\nmesotap: done"), {"shows": "specimen: a mesotap"}),
    ("a title that turns the writing", attribute("/", "title", "\u202egnp.exe"), {"shows": "\\u202e"}),
    (
        "a title that is markup",
        attribute("/", "title", "[link=file:///etc]x[/nope]"),
        {"shows": "[link=file:///etc]x[/nope]"},
    ),
    ("a software that is not UTF-8", attribute("/", "software", np.bytes_(b"\xff\xfe")), {"says": "software"}),
    ("a reason for a number", attribute("impacts/00000", "load_after_mn", HOSTILE_TEXT), {"shows": "load_after_mn"}),
    ("a name of control characters", lambda f: f["impacts"].create_group("\x1b[2J"), {"shows": "impacts: 2"}),
    ("a negative impact", lambda f: f["impacts"].create_group("-0001"), {"shows": "impacts: 2"}),
    (
        "an impact without anything",
        lambda f: f["impacts"].create_group("00009"),
        {"shows": "00009 is missing; this record is left out"},
    ),
)

BYTES: tuple[tuple[str, Callable[[Path], list[str]], dict[str, Any]], ...] = (
    ("a text that claims 4 GB", long_text, {"says": "longer than the file"}),
    ("half of a file", bytes_of(lambda c: c[: len(c) // 2]), {"says": "truncated"}),
    ("a signature alone", bytes_of(lambda c: c[:8]), {"says": "x.h5"}),
    ("zeros", bytes_of(lambda c: bytes(len(c))), {"says": "not an HDF5 file"}),
    ("nothing", bytes_of(lambda c: b""), {"says": "empty", "quick": True}),
    ("half of an old file", bytes_of(lambda c: c[: len(c) // 2], old=True), {"says": "damaged"}),
    ("an old file behind 512 bytes", bytes_of(lambda c: bytes(512) + c, old=True), {"either": True}),
    ("a heap that never ends", bytes_of(heap_that_never_ends, old=True), {"says": "damaged"}),
    ("an old file of noise", bytes_of(lambda c: c[:96] + os.urandom(len(c) - 96), old=True), {"says": "x.h5"}),
)


def mat(fill: Edit) -> Callable[[Path], list[str]]:
    """A file of arrays to be imported."""

    def make(folder: Path) -> list[str]:
        with h5py.File(folder / "x.mat", "w") as file:
            file["fs"] = 1000.0
            fill(file)
        return ["import", "x.mat", "y.h5"]

    return make


def sound(file: h5py.File) -> None:
    file["a"], file["b"] = np.sin(np.arange(100.0)), np.cos(np.arange(100.0))


def own_child(file: h5py.File) -> None:
    sound(file)
    file["c"] = file["/"]
    file.create_group("d")["e"] = file["/"]


def a_thousand_ways(file: h5py.File) -> None:
    sound(file)
    above = [file]
    for depth in range(7):
        group = file.create_group(f"g{depth}")
        for parent in above:
            for way in range(30):
                parent[f"way{way}"] = group
        above = [group]


def soft(file: h5py.File) -> None:
    sound(file)
    file["c"], file["d"] = h5py.SoftLink("/nowhere"), h5py.ExternalLink("/etc/passwd", "/")


def deep(file: h5py.File) -> None:
    sound(file)
    file.create_group("/".join(["x"] * 2000))


def huge(file: h5py.File) -> None:
    sound(file)
    file.create_dataset("c", (10**12,), "f8", chunks=(64,))


MATS: tuple[tuple[str, Edit, dict[str, Any]], ...] = (
    ("groups within themselves", own_child, {"shows": "2 channels"}),
    ("21 billion ways to a group", a_thousand_ways, {"shows": "2 channels", "quick": True}),
    ("links to other places", soft, {"shows": "2 channels"}),
    ("2000 groups within each other", deep, {"shows": "2 channels"}),
    ("an array of 8 TB", huge, {"says": "claims shape"}),
    ("an array of itself", lambda f: (sound(f), virtual("a", (100,), ".", "a")(f)), {"says": "made of other arrays"}),
    ("zeros for 3.2 GB as a channel", lambda f: (sound(f), bomb("a", 200, 1_000_000)(f)), {"says": "claims shape"}),
    ("no numbers at all", lambda f: f.create_group("x"), {"says": "not a recording"}),
)


def cases() -> Iterator[Case]:
    for name, edit, how in EDITS:
        yield Case("HDF5 session files", name, edited(edit), **how)
    for name, make, how in BYTES:
        yield Case("HDF5 session files", name, make, **how)
    yaml = edited(array(CONFIG, MERGE_BOMB))
    yield Case("HDF5 session files", "a merge bomb as configuration", yaml, shows="impacts: 2")
    for name, fill, how in MATS:
        yield Case("MAT 7.3 files", name, mat(fill), **how)
