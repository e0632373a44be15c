"""A number with its uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass

from scipy import special

LEVEL = 0.95  # of every interval that mesotap states


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value with its standard error and the degrees of freedom behind it.

    Attributes
    ----------
    value, standard_error
        In the unit of the quantity.
    dof
        Degrees of freedom of ``standard_error``; infinite where it is known beforehand.
    coverage
        Half of the 95 % interval over the standard error, where it is not that of Student's t: an error between known
        limits reaches less far than a normal one of the same size.
    """

    value: float
    standard_error: float
    dof: float = math.inf
    coverage: float | None = None

    @property
    def half_width(self) -> float:
        """Half of the 95 % interval (Student's t, unless ``coverage`` says otherwise)."""
        if self.coverage is not None:
            return self.coverage * self.standard_error
        upper = 0.5 + LEVEL / 2
        quantile = special.ndtri(upper) if math.isinf(self.dof) else special.stdtrit(self.dof, upper)
        return float(quantile) * self.standard_error

    @property
    def low(self) -> float:
        """Lower end of the 95 % interval."""
        return self.value - self.half_width

    @property
    def high(self) -> float:
        """Upper end of the 95 % interval."""
        return self.value + self.half_width

    def as_json(self) -> dict[str, float]:
        """Return the mapping that the results contract asks for."""
        return {"value": self.value, "low": self.low, "high": self.high}
