"""What every section of config.yaml is made of."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

SMALLEST, LARGEST = 1e-30, 1e30
"""Magnitudes between which a setting has to lie, so that products and ratios of some of them are numbers too."""


def _of_a_size(value: float) -> float:
    if value and not SMALLEST <= abs(value) <= LARGEST:
        than = f"smaller than {SMALLEST:g}" if abs(value) < SMALLEST else f"larger than {LARGEST:g}"
        raise ValueError(f"{value:g} is {than}, which nothing in a rig is")
    return value


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False), AfterValidator(_of_a_size)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False), AfterValidator(_of_a_size)]
Finite = Annotated[float, Field(allow_inf_nan=False), AfterValidator(_of_a_size)]


class Section(BaseModel):
    """A part of config.yaml: unknown keys are errors, values do not change after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True)
