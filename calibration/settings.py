"""Section ``calibration`` of config.yaml: the dead weights, what they weigh where the rig stands, and tests on them."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, field_validator, model_validator

from calibration.weights import Gravity, buoyancy, local_gravity, weight_errors_mn
from rig.settings import NonNegative, Positive, Section

HEAVIEST_MN = 1e5  # weights beyond it belong to no gauge of this tester: grams taken for kilograms


class CalibrationSettings(Section):
    """Section ``calibration``."""

    weights_mn: tuple[NonNegative, ...] = (0.0, 100.0, 200.0, 400.0, 600.0, 800.0, 1000.0)
    weights_g: tuple[NonNegative, ...] | None = None
    weight_uncertainty_mn: NonNegative = 0.1
    weight_class: Literal["E1", "E2", "F1", "F2", "M1", "M2", "M3"] | None = None
    common_weight_uncertainty_percent: NonNegative = 0.0
    gravity_m_s2: Annotated[float, Field(ge=9.7, le=9.9)] | None = None
    latitude_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    height_m: Annotated[float, Field(ge=-500, le=9000)] | None = None
    zero_drift_mn_per_root_hour: NonNegative | None = None
    sensitivity_drift_percent_per_root_hour: NonNegative | None = None
    temperature_uncertainty_k: NonNegative = 0.0
    sensitivity_percent_per_k: NonNegative = 0.0
    zero_mn_per_k: NonNegative = 0.0
    zero_limit_mn: NonNegative = 0.0
    resolution_mv: NonNegative = 0.0
    repeats: Annotated[int, Field(ge=1, le=20)] = 2
    averaging_s: Positive = 1.0
    zero_every_loads: Annotated[int, Field(ge=1, le=1000)] | None = None
    drift_test_level: Annotated[float, Field(gt=0, lt=0.5)] = 0.01
    largest_nonlinearity_percent: Positive = 0.5
    largest_sensitivity_deviation_percent: Positive = 10.0
    uncalibrated_sensitivity_percent: NonNegative = 10.0  # limits of the configured one; assumed (docs/uncertainty.md)

    @field_validator("weights_mn", "weights_g")
    @classmethod
    def _enough(cls, weights: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if weights is not None and len(set(weights)) < 3:
            raise ValueError("a line and its linearity need at least three different weights")
        return weights

    @model_validator(mode="after")
    def _plausible(self) -> CalibrationSettings:
        if max(self.loads_mn) > HEAVIEST_MN:
            raise ValueError(
                f"the heaviest weight makes {max(self.loads_mn):g} mN, more than {HEAVIEST_MN:g}: weights_g are grams, "
                "weights_mn millinewtons"
            )
        if self.height_m is not None and self.latitude_deg is None:
            raise ValueError("height_m alone does not tell gravity: give latitude_deg too")
        return self

    @property
    def gravity(self) -> Gravity:
        """Gravity where the rig stands, with its uncertainty."""
        return local_gravity(self.gravity_m_s2, self.latitude_deg, self.height_m)

    @property
    def zero_declared(self) -> bool:
        """Whether anything is declared of how far the zero may go between its readings."""
        by_temperature = self.zero_mn_per_k * self.temperature_uncertainty_k
        return self.zero_drift_mn_per_root_hour is not None or self.zero_limit_mn + by_temperature > 0

    @property
    def loads_mn(self) -> tuple[float, ...]:
        """Force of each weight: of ``weights_g`` by local gravity less the buoyancy of the air, else ``weights_mn``."""
        if self.weights_g is None:
            return self.weights_mn
        return tuple(mass * self.gravity.value * (1 - buoyancy()) for mass in self.weights_g)

    def weight_errors_mn(self, load_mn: ArrayLike) -> NDArray[np.float64]:
        """Return the standard uncertainty of each of these weights by itself, mN."""
        return weight_errors_mn(load_mn, self.weight_class, self.weight_uncertainty_mn)

    def typical_weight_error_mn(self, load_mn: ArrayLike) -> float:
        """Return the root mean square of the weights' own uncertainties, mN, where one number has to do."""
        errors = self.weight_errors_mn(load_mn)
        hung = errors[np.atleast_1d(np.asarray(load_mn, dtype=np.float64)) != 0.0]
        return float(np.sqrt(np.mean(hung**2))) if hung.size else 0.0
