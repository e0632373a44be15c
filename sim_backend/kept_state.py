"""The kept state of a simulated rig, looked at before it is taken up: it comes from a file that may be damaged."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

LARGEST = 1e15
"""Magnitude beyond which no number of a state lies, those of random number generators aside."""

FARTHEST_UM, LARGEST_MV, LARGEST_MN, LATEST_S = 1e9, 1e9, 1e12, 1e10
"""A kilometre, a million volts, a hundred thousand tonnes, three centuries."""

LONGEST_SHOWN = 40

Place = Annotated[float, Field(ge=-FARTHEST_UM, le=FARTHEST_UM)]
Time = Annotated[float, Field(ge=-LATEST_S, le=LATEST_S)]
Load = Annotated[float, Field(ge=0, le=LARGEST_MN)]
Voltage = Annotated[float, Field(ge=-LARGEST_MV, le=LARGEST_MV)]
Amount = Annotated[float, Field(ge=-LARGEST_MV, le=LARGEST_MV)]


class _Part(BaseModel):
    model_config = ConfigDict(strict=True, extra="allow")


class _Motion(_Part):
    start_um: Place
    target_um: Place
    begun_s: Time
    over_s: Time
    speed_um_per_s: Annotated[float, Field(gt=0, le=FARTHEST_UM)]


class _Stage(_Part):
    knob_um: Place
    carriage_um: Place
    locked: bool
    motion: _Motion | None = None


class _LoadCell(_Part):
    rng: dict[str, Any]
    last_voltage_mv: Voltage | None
    fault: (
        Literal["frozen", "dropout", "nan", "late"]
        | Annotated[list[Literal["scale", "offset"] | Amount], Field(min_length=2, max_length=2)]
        | None
    )


class _Weights(_Part):
    nominal_mn: Load


class _Impactor(_Part):
    rng: dict[str, Any]
    taps: list[dict[str, Any]]


class _Accelerometers(_Part):
    rng: dict[str, Any]
    fault: str | None


class _State(_Part):
    time_s: Annotated[float, Field(ge=0, le=LATEST_S)]
    peak_true_load_mn: Load
    stage: _Stage
    weights: _Weights
    load_cell: _LoadCell
    impactor: _Impactor
    accelerometers: _Accelerometers


def refuse_damaged(state: Mapping[str, Any]) -> None:
    """Raise where a kept state is none that a simulated rig can have been in.

    Raises
    ------
    ValueError
        One sentence that names the item.
    """
    _refuse_large(state, "")
    try:
        _State.model_validate(state)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        # the path names the branches of a union too
        item, message = (
            ".".join(str(part) for part in fault["loc"] if str(part).replace("_", "").isalnum()),
            fault["msg"],
        )
        if fault["type"] == "missing":
            raise ValueError(f"{item} is missing") from None
        raise ValueError(f"{item} is {shortened(fault['input'])}: {message[:1].lower()}{message[1:]}") from None


def shortened(value: object) -> str:
    """Return a value as it is shown: the beginning of a long one."""
    try:
        text = repr(value)
    except ValueError:
        return "a number of thousands of digits"
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 3] + "..."


def _refuse_large(value: object, where: str) -> None:
    """Refuse numbers that are none, anywhere but in the state of a random number generator."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if key != "rng":
                _refuse_large(inner, f"{where}.{key}" if where else str(key))
    elif isinstance(value, list):
        for inner in value:
            _refuse_large(inner, where)
    elif isinstance(value, int | float) and not abs(value) <= LARGEST:
        raise ValueError(f"{where[-LONGEST_SHOWN:]} is {shortened(value)}, which nothing in a rig is")
