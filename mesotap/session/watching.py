"""Who is shown what the gauge reads while a session runs."""

from __future__ import annotations


class GaugeWatch:
    """Shown every reading that is believed; this one looks at none.

    All are called in the midst of a session: whoever overrides them returns at once and raises nothing.
    """

    def load(self, load_mn: float) -> None:
        """See the load, mN."""

    def point(self, load_mn: float, voltage_mv: float) -> None:
        """See one reading of a calibration: the weight, mN, and the bridge voltage, mV."""

    def locked(self, load_mn: float) -> None:
        """See the load, mN, at which the stage was clamped."""

    def aim(self, load_set: int, target_mn: float) -> None:
        """See which step of the load plan is set, and its load."""
