"""Section ``calibration`` of config.yaml: the dead weights and the tests on them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, field_validator

from rig.settings import NonNegative, Positive, Section


class CalibrationSettings(Section):
    """Section ``calibration``."""

    weights_mn: tuple[NonNegative, ...] = (0.0, 100.0, 200.0, 400.0, 600.0, 800.0, 1000.0)
    weight_uncertainty_mn: NonNegative = 0.1
    repeats: Annotated[int, Field(ge=1, le=20)] = 2
    averaging_s: Positive = 1.0
    drift_test_level: Annotated[float, Field(gt=0, lt=0.5)] = 0.01
    largest_nonlinearity_percent: Positive = 0.5
    largest_sensitivity_deviation_percent: Positive = 10.0

    @field_validator("weights_mn")
    @classmethod
    def _enough(cls, weights: tuple[float, ...]) -> tuple[float, ...]:
        if len(set(weights)) < 3:
            raise ValueError("a line and its linearity need at least three different weights")
        return weights
