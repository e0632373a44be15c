"""Section ``mesotap`` of config.yaml, the session itself; and the version of all of it."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field, field_validator, model_validator

from daq.texts import refuse_unstorable
from rig.settings import Positive, Section

LARGEST_TOLERANCE_MN = 100.0  # loads of the plan lie some 80 mN apart: beyond this one counts as another
MOST_LOADS = 1000  # steps of a plan; at eight taps of 15 s each, a day and a half


CONFIG_VERSION = 2
"""Of config.yaml; raised when a key is renamed or means something else, with a step in `configuration.versions`."""


def _as_this_version(version: int) -> int:
    """Refuse a newer version; an older one is read as this one."""
    if version > CONFIG_VERSION:
        raise ValueError(
            f"a newer mesotap wrote this (version {version}), this one reads up to version {CONFIG_VERSION}: update "
            "mesotap, or carry your settings over into what 'mesotap config init' writes"
        )
    return CONFIG_VERSION


Version = Annotated[int, Field(ge=1), AfterValidator(_as_this_version)]
Text = Annotated[str, AfterValidator(refuse_unstorable)]


class SessionSettings(Section):
    """Section ``mesotap``."""

    operator: Text = ""
    specimen: Text = ""
    title: Text = ""
    load_plan_mn: tuple[Positive, ...] = (264.9, 348.3, 431.6, 524.8, 549.4, 627.8, 784.8, 927.0)
    load_tolerance_mn: Annotated[float, Field(gt=0, le=LARGEST_TOLERANCE_MN)] = 6.0
    impacts_per_load: Annotated[int, Field(ge=1, le=100)] = 8
    surplus_impacts: Annotated[int, Field(ge=0, le=100)] = 0
    tries_per_load: Annotated[int, Field(ge=1, le=1000)] = 40
    dwell_s: Annotated[float, Field(ge=0, le=86400)] = 10.0
    diagnose: bool = False

    @property
    def taps_per_load(self) -> int:
        """Good taps that are made at each load: those that are used, and those to choose from."""
        return self.impacts_per_load + self.surplus_impacts

    @model_validator(mode="after")
    def _taps_can_be_had(self) -> SessionSettings:
        if self.surplus_impacts and self.taps_per_load > self.tries_per_load:
            raise ValueError(
                f"mesotap.impacts_per_load and mesotap.surplus_impacts ask for {self.taps_per_load} good taps at each "
                f"load, and mesotap.tries_per_load ends it after {self.tries_per_load}"
            )
        return self

    @field_validator("load_plan_mn")
    @classmethod
    def _some(cls, plan: tuple[float, ...]) -> tuple[float, ...]:
        if not plan:
            raise ValueError("the plan needs at least one load")
        if len(plan) > MOST_LOADS:
            raise ValueError(f"the plan has {len(plan)} loads, more than {MOST_LOADS}")
        return plan
