"""Section ``daq`` of config.yaml: the trigger and what a good tap is."""

from __future__ import annotations

from typing import Annotated

from pydantic import AliasChoices, Field, model_validator

from rig.settings import NonNegative, Positive, Section

Fraction = Annotated[float, Field(gt=0, le=1)]


LONGEST_WAIT_S = 3600.0  # a tap that is waited for longer is not coming
LARGEST_ACCELERATION_G = 50.0  # at 100 mV/g the 5 V that a recorder takes; a tap that is used has less than 1


class Trigger(Section):
    """When a record begins and how long it is."""

    threshold_m_s2: Positive = 0.05
    pretrigger_samples: Annotated[int, Field(ge=16)] = 250
    record_samples: Annotated[int, Field(ge=256, le=10_000_000)] = 5000
    timeout_s: Annotated[float, Field(gt=0, le=LONGEST_WAIT_S)] = 30.0

    @model_validator(mode="after")
    def _room_for_the_tap(self) -> Trigger:
        if self.pretrigger_samples >= self.record_samples:
            raise ValueError("pretrigger_samples must be smaller than record_samples")
        return self


class Quality(Section):
    """Limits beyond which a tap is rejected."""

    largest_acceleration_g: Annotated[float, Field(gt=0, le=LARGEST_ACCELERATION_G)] = 1.0
    largest_force_ratio: Positive = 0.8
    smallest_signal_to_noise: Positive = 20.0
    largest_noise_m_s2: Positive = 0.02
    largest_rotation: Fraction = 0.15
    rotation_window_ms: Positive = 3.0
    largest_load_change_percent: Positive = 3.0
    largest_load_change_mn: Positive = 5.0
    second_impact_ratio: Annotated[
        NonNegative,
        Field(validation_alias=AliasChoices("second_impact_ratio", "second_blow_ratio")),  # its name until 2026
    ] = 0.08


class DaqSettings(Section):
    """Section ``daq``."""

    trigger: Trigger = Trigger()
    quality: Quality = Quality()
