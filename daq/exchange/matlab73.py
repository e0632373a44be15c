"""MAT files of version 7.3, which are HDF5 files, and HDF5 files of other programs."""

from __future__ import annotations

from pathlib import Path

import h5py

from daq.errors import RecordingError
from daq.exchange.arrays import NamedArrays, sort_arrays
from daq.exchange.recording import Columns
from daq.hdf5 import Node, open_hdf5, reading

DEEPEST = 8
"""Structs within structs beyond which nothing is looked for."""

LONGEST_TEXT = 1000
"""Characters of a text; units have few."""


def read_mat73(path: Path) -> Columns:
    """Return the channels in a MAT file of version 7.3, or in another HDF5 file.

    Raises
    ------
    RecordingError
        The file is damaged, is a session file already, or holds no array that could be a channel.
    """
    return sort_arrays(path, walk_mat73(path))


def walk_mat73(path: Path) -> NamedArrays:
    """Return all arrays in such a file, each under its dotted name.

    Raises
    ------
    RecordingError
        The file is damaged, or is a session file.
    """
    found = NamedArrays()
    with open_hdf5(path) as root:
        if root.attribute("format") == "mesotap-session":
            raise RecordingError(f"{path}: is a session file already: there is nothing to import")
        _walk_group(root, found, "", 0)
    return found


def _walk_group(group: Node, found: NamedArrays, name: str, depth: int) -> None:
    if depth > DEEPEST:
        return
    group.take()
    for inner in group.names():
        full = f"{name}.{inner}" if name else inner
        if inner.startswith("#") or group.is_link(inner):  # where MATLAB keeps what cells refer to; what is elsewhere
            continue
        with reading(group.path, f"/{full.replace('.', '/')}", "is damaged"):
            item = group.child(inner)
            if item is None or item.is_taken():
                continue
            if isinstance(item.item, h5py.Group):
                _walk_group(item, found, full, depth + 1)
            elif isinstance(item.item, h5py.Dataset):
                _take_dataset(item, found, full)


def _take_dataset(data: Node, found: NamedArrays, name: str) -> None:
    data.refuse_layout()
    if data.item.shape is None or data.attribute("MATLAB_empty") is not None:
        return
    if data.attribute("MATLAB_class") == "char":
        if data.item.size <= LONGEST_TEXT:
            found.texts[name] = "".join(chr(int(code)) for code in data.content().reshape(-1))
    elif data.item.dtype.kind in "fiu":
        _refuse_packed(data)
        unit = data.attribute("units")
        if isinstance(unit, str):
            found.units[name] = unit.strip("\0 ")
        found.add(name, data.content())
    elif data.item.dtype.kind == "c" or set(data.item.dtype.names or ()) in ({"real", "imag"}, {"r", "i"}):
        found.leave_out(name, "complex", data.item.size)


def _refuse_packed(data: Node) -> None:
    """Refuse numbers that are others before they are scaled, as netCDF does it."""
    for attribute, nothing in (("scale_factor", 1.0), ("add_offset", 0.0)):
        value = data.attribute(attribute)
        if value is not None and value != nothing:
            raise data.error(f" has the attribute {attribute}, which is not applied here: write the scaled numbers")
