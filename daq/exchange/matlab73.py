"""MAT files of version 7.3, which are HDF5 files, and HDF5 files of other programs."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from daq.errors import RecordingError
from daq.exchange.arrays import NamedArrays, sort_arrays
from daq.exchange.recording import Columns
from daq.hdf5 import LARGEST_ARRAY, open_hdf5, reading

DEEPEST = 8
"""Structs within structs beyond which nothing is looked for."""


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
        _walk_group(path, found, "", root.item, 0)
    return found


def _walk_group(path: Path, found: NamedArrays, name: str, group: h5py.Group, depth: int) -> None:
    if depth > DEEPEST:
        return
    for inner in group:
        full = f"{name}.{inner}" if name else str(inner)
        if str(inner).startswith("#"):  # where MATLAB keeps what cells refer to
            continue
        with reading(path, f"/{full.replace('.', '/')}", "is damaged"):
            item = group.get(inner)
            if isinstance(item, h5py.Group):
                _walk_group(path, found, full, item, depth + 1)
            elif isinstance(item, h5py.Dataset):
                _take_dataset(path, found, full, item)


def _take_dataset(path: Path, found: NamedArrays, name: str, data: h5py.Dataset) -> None:
    if data.shape is None or "MATLAB_empty" in data.attrs:
        return
    if data.size > LARGEST_ARRAY:
        raise RecordingError(f"{path}: {name} claims shape {data.shape}, more than this program takes")
    if data.attrs.get("MATLAB_class") == b"char":
        if data.size <= 1000:
            found.texts[name] = "".join(chr(int(code)) for code in np.asarray(data[()]).reshape(-1))
    elif data.dtype.kind in "fiu":
        found.add(name, np.asarray(data[()]))
