"""What every section of config.yaml is made of."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, GetCoreSchemaHandler
from pydantic_core import CoreSchema

from rig.written import as_written

SMALLEST, LARGEST = 1e-30, 1e30
"""Magnitudes between which a setting has to lie, so that products and ratios of some of them are numbers too."""


def of_a_size(smallest: float, largest: float) -> AfterValidator:
    """Return what refuses numbers, but for zero, whose magnitude does not lie between these."""

    def check(value: float) -> float:
        if value and not smallest <= abs(value) <= largest:
            than = f"smaller than {smallest:g}" if abs(value) < smallest else f"larger than {largest:g}"
            raise ValueError(f"{value:g} is {than}, which nothing in a rig is")
        return value

    return AfterValidator(check)


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False), of_a_size(SMALLEST, LARGEST)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False), of_a_size(SMALLEST, LARGEST)]
Finite = Annotated[float, Field(allow_inf_nan=False), of_a_size(SMALLEST, LARGEST)]


class Section(BaseModel):
    """A part of config.yaml: unknown keys are errors, values do not change after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        schema: CoreSchema = as_written(handler(source))
        return schema
