"""One tap as an HDF5 group: `/impacts/00000` of a session file, and the whole of an impact file."""

from __future__ import annotations

import hashlib
import json
import math
import re
from datetime import datetime
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from daq.bounds import BOUNDS
from daq.errors import RecordingError
from daq.hdf5 import Node, claims_too_much, refuse_non_finite
from daq.records import Impact
from daq.texts import LONGEST_TEXT

DIGEST = "digest"
_DIGEST_FORM = re.compile(r"sha256:[0-9a-f]{64}")
_DIGESTED = (
    "load_set",
    "target_load_mn",
    "load_before_mn",
    "load_after_mn",
    "voltage_before_mv",
    "voltage_after_mv",
    "sample_rate_hz",
    "pretrigger",
    "accepted",
    "reject_reason",
)
"""What is digested besides the samples: all that a result is made from. The time is left out, so that equal taps have
equal digests."""


_ARRAYS = ("acceleration", "strain_mv", "channels", "force")
_LOADS = ("target_load_mn", "load_before_mn", "load_after_mn", "voltage_before_mv", "voltage_after_mv")
_BOUNDED = ("sample_rate_hz", *_LOADS)


def to_json(value: object) -> str:
    """Return ``value`` as one line of JSON; numpy scalars and arrays become numbers and lists."""
    return json.dumps(value, default=_plain, ensure_ascii=True)


def _plain(value: object) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise RecordingError(f"a {type(value).__name__} cannot be kept as JSON")


def digest_of(impact: Impact) -> str:
    """Return the digest of a tap: ``sha256:`` and 64 hexadecimal digits (FIPS 180-4).

    It is taken over each array (name, shape, and the samples as little-endian doubles, row after row), then over the
    numbers and texts that results are made from, as JSON.
    """
    taken = hashlib.sha256(b"mesotap impact 1\n")
    for name in _ARRAYS:
        values = getattr(impact, name)
        if values is not None:
            samples = np.ascontiguousarray(values, dtype="<f8")
            taken.update(f"{name} {samples.shape}\n".encode())
            taken.update(samples.data)
    numbers = [getattr(impact, name) for name in _DIGESTED]
    plain = [float(n) if isinstance(n, float | np.floating) else n for n in numbers]
    taken.update(to_json([*plain, list(impact.channel_names)]).encode())
    return f"sha256:{taken.hexdigest()}"


def check_time(text: str, where: str) -> str:
    """Return ``text`` if it is an ISO 8601 date, or empty for unknown.

    Raises
    ------
    RecordingError
        It is neither.
    """
    if text:
        try:
            datetime.fromisoformat(text)
        except ValueError:
            raise RecordingError(f"{where} is {text!r:.40}, not an ISO 8601 date") from None
    return text


def check_impact(impact: Impact, where: str) -> None:
    """Refuse an impact that `read_impact` would refuse, before it gets to disk.

    Raises
    ------
    RecordingError
        Names what is wrong with it.
    """
    a = impact.acceleration
    if a.ndim != 2 or a.shape[0] != 2 or a.shape[1] == 0:
        raise RecordingError(f"{where}/acceleration has shape {a.shape}, expected (2, n)")
    refuse_non_finite(a, f"{where}/acceleration")
    if impact.strain_mv is not None:
        if impact.strain_mv.shape != (a.shape[1],):
            raise RecordingError(f"{where}/strain_mv has shape {impact.strain_mv.shape}, expected ({a.shape[1]},)")
        refuse_non_finite(impact.strain_mv, f"{where}/strain_mv")
    if impact.force is not None:
        if impact.force.shape != (a.shape[1],):
            raise RecordingError(f"{where}/force has shape {impact.force.shape}, expected ({a.shape[1]},)")
        refuse_non_finite(impact.force, f"{where}/force")
    if not 0 <= impact.pretrigger < a.shape[1]:
        raise RecordingError(f"{where}: pretrigger {impact.pretrigger} lies outside the {a.shape[1]} samples recorded")
    if not (math.isfinite(impact.sample_rate_hz) and impact.sample_rate_hz > 0):
        raise RecordingError(f"{where}: sample_rate_hz is {impact.sample_rate_hz:g}, expected above 0")
    for name in _BOUNDED:
        if fault := BOUNDS[name].fault(getattr(impact, name)):
            raise RecordingError(f"{where}: {name} {fault}")
    for name in _ARRAYS:
        values = getattr(impact, name)
        if values is not None and (fault := BOUNDS[name].fault_of_all(values)):
            raise RecordingError(f"{where}/{name} {fault}")
    if impact.load_set < 0:
        raise RecordingError(f"{where}: load_set is {impact.load_set}, expected at least 0")
    check_time(impact.time, f"{where}: time")
    if impact.channels is not None:
        if impact.channels.ndim != 2 or impact.channels.shape != (len(impact.channel_names), a.shape[1]):
            expected = (len(impact.channel_names), a.shape[1])
            raise RecordingError(f"{where}/channels has shape {impact.channels.shape}, expected {expected}")
        refuse_non_finite(impact.channels, f"{where}/channels")


def write_impact(group: h5py.Group, impact: Impact, compress: bool) -> None:
    """Write ``impact`` into ``group``, samples kept exactly; ``compress`` trades time for a smaller file."""
    _dataset(group, "acceleration", impact.acceleration, compress).attrs["units"] = "m/s2"
    if impact.strain_mv is not None:
        _dataset(group, "strain_mv", impact.strain_mv, compress).attrs["units"] = "mV"
    if impact.force is not None:
        _dataset(group, "force", impact.force, compress).attrs["units"] = "N"
    if impact.channels is not None:
        _dataset(group, "channels", impact.channels, compress)
        group.attrs["channel_names"] = to_json(list(impact.channel_names))
    group.attrs["load_set"] = impact.load_set
    for name in _LOADS:
        group.attrs[name] = float(getattr(impact, name))
    group.attrs["time"] = impact.time
    group.attrs["sample_rate_hz"] = float(impact.sample_rate_hz)
    group.attrs["pretrigger"] = impact.pretrigger
    group.attrs["accepted"] = bool(impact.accepted)
    group.attrs["reject_reason"] = impact.reject_reason
    group.attrs[DIGEST] = digest_of(impact)
    write_json_item(group, "extra", impact.extra)


def write_json_item(group: h5py.Group, name: str, value: object) -> None:
    """Keep JSON types beside what the format asks for: as an attribute, or as a dataset where they are too long."""
    text = to_json(value)
    if len(text) <= LONGEST_TEXT:
        group.attrs[name] = text
    else:
        group.create_dataset(name, data=text, dtype=h5py.string_dtype())


def _dataset(group: h5py.Group, name: str, values: NDArray[np.float64], compress: bool) -> h5py.Dataset:
    data = np.asarray(values, dtype=np.float64)
    if compress:
        return group.create_dataset(name, data=data, compression="gzip", compression_opts=4, shuffle=True)
    return group.create_dataset(name, data=data)


def read_impact(node: Node, number: int) -> Impact:
    """Return the impact that `write_impact`, or another program that keeps format 1, wrote.

    Raises
    ------
    RecordingError
        An item of format 1 is missing or malformed, or the tap is not the one that its digest was taken of; the text
        names it. A tap without a digest (of an older version, of another program) is read as it is.
    """
    acceleration = node.values("acceleration", (2, None), floating=True)
    data = node.child("acceleration")
    units = data.attribute("units") if data else None
    if units != "m/s2":
        raise node.error(f"/acceleration: units are {units!r:.40}, expected 'm/s2'")
    samples = acceleration.shape[1]
    strain = node.values("strain_mv", (samples,)) if node.child("strain_mv") else None
    pretrigger = node.count("pretrigger")
    if pretrigger >= samples:
        raise node.error(f": pretrigger {pretrigger} lies outside the {samples} samples recorded")
    sample_rate = node.number("sample_rate_hz", above=0.0)
    if math.isnan(sample_rate):
        raise node.error(": sample_rate_hz is NaN")
    names = _channel_names(node)
    impact = Impact(
        number=number,
        load_set=node.count("load_set"),
        target_load_mn=node.number("target_load_mn"),
        load_before_mn=node.number("load_before_mn"),
        load_after_mn=node.number("load_after_mn"),
        time=check_time(node.text("time"), f"{node.path}: attribute time of {node.name}"),
        sample_rate_hz=sample_rate,
        pretrigger=pretrigger,
        acceleration=acceleration,
        accepted=node.flag("accepted"),
        reject_reason=node.text("reject_reason"),
        strain_mv=strain,
        voltage_before_mv=_beside(node, "voltage_before_mv"),
        voltage_after_mv=_beside(node, "voltage_after_mv"),
        extra=_extra(node),
        channels=node.values("channels", (len(names), samples)) if names else None,
        channel_names=names,
        force=_force(node, samples),
    )
    _check_digest(node, impact)
    return impact


def _check_digest(node: Node, impact: Impact) -> None:
    kept = node.attribute(DIGEST)
    # what another program keeps under that name is not a fault
    if isinstance(kept, str) and _DIGEST_FORM.fullmatch(kept) and kept != digest_of(impact):
        raise node.error(
            f": the samples or numbers of impact {impact.name} were altered after it was recorded (its digest differs)"
        )


# Items beside format 1. Another program may use these names for something else: what is not ours is not a fault.


def _beside(node: Node, name: str) -> float:
    value = node.attribute(name)
    return node.number(name) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


def _extra(node: Node) -> dict[str, Any]:
    value = read_json_item(node, "extra")
    return value if isinstance(value, dict) else {}


def read_json_item(node: Node, name: str) -> Any:
    """Return what `write_json_item` kept; None where there is nothing that could be it."""
    text = node.attribute(name)
    child = node.child(name) if text is None else None
    if child is not None and isinstance(child.item, h5py.Dataset) and child.item.shape == ():
        text = scalar_text(child)
    return _json(text)


def _force(node: Node, samples: int) -> NDArray[np.float64] | None:
    """Return the hammer's force, None where there is none in N: another program may keep something else there."""
    child = node.child("force")
    if child is None or not isinstance(child.item, h5py.Dataset) or child.attribute("units") != "N":
        return None
    return node.values("force", (samples,))


def _channel_names(node: Node) -> tuple[str, ...]:
    value = _json(node.attribute("channel_names"))
    return tuple(map(str, value)) if isinstance(value, list) else ()


def _json(text: object) -> Any:
    try:
        return json.loads(text) if isinstance(text, str) else None
    except (ValueError, RecursionError):
        return None


def scalar_text(node: Node) -> str:
    """Return the text of a scalar string dataset.

    Raises
    ------
    RecordingError
        It is not a dataset, no scalar, no string, longer than the file, or not UTF-8.
    """
    if not isinstance(node.item, h5py.Dataset) or node.item.shape != () or node.item.dtype.kind not in "OS":
        raise node.error(" is not a scalar string")
    node.refuse_layout()
    if claims_too_much(node):
        raise node.error(" is damaged: it claims to be longer than the file")
    if node.item.dtype.itemsize > node.ledger.size:
        raise node.error(" is damaged: it claims to be longer than the file")
    try:
        value = node.item[()]
        text = value.decode("utf-8") if isinstance(value, bytes) else value
    except (OSError, RuntimeError, ValueError, TypeError) as error:
        raise node.error(" cannot be read as UTF-8 text") from error
    if not isinstance(text, str):
        raise node.error(" is not a scalar string")
    return text
