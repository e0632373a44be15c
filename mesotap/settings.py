"""Section ``mesotap`` of config.yaml: the session itself."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, field_validator

from rig.settings import Positive, Section


class SessionSettings(Section):
    """Section ``mesotap``."""

    operator: str = ""
    specimen: str = ""
    title: str = ""
    load_plan_mn: tuple[Positive, ...] = (264.9, 348.3, 431.6, 524.8, 549.4, 627.8, 784.8, 927.0)
    load_tolerance_mn: Positive = 6.0
    impacts_per_load: Annotated[int, Field(ge=1, le=100)] = 8
    tries_per_load: Annotated[int, Field(ge=1, le=1000)] = 40
    dwell_s: Annotated[float, Field(ge=0, le=86400)] = 10.0
    diagnose: bool = False

    @field_validator("load_plan_mn")
    @classmethod
    def _some(cls, plan: tuple[float, ...]) -> tuple[float, ...]:
        if not plan:
            raise ValueError("the plan needs at least one load")
        return plan
