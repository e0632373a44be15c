"""The gauge as a witness of the load: which of its readings are believed, and whether it still is one.

A reading counts where it is of now, a number, and of a gauge that lives. A gauge that has contradicted itself or the
stage is asked on, but nothing is concluded from it until it was found sound again.
"""

from __future__ import annotations

import math

from rig.errors import DeviceError, RigError, SessionAborted, StaleReading
from rig.interface import Rig
from rig.readings import GaugeScale, LoadReading
from rig.settings import Limits

AGAIN_S = 0.05  # longest reading of a gauge that repeats itself: whether it lives is to be known soon
QUANTA = 2.0  # steps of a rounded voltage by which the load must have risen before a gauge that stands still is frozen


class LoadWitness:
    """The gauge of one rig.

    Parameters
    ----------
    rig, limits
        Whose gauge, and how old or often the same its readings may be.
    scale
        Line between voltage and load.

    Attributes
    ----------
    scale
        The same; replaced by the calibrated one.
    doubted
        Whether it failed, or contradicted the stage or itself, since it was last believed.
    read_at_s, load_mn
        Rig time of the sample behind the last believable reading, s, and its load, mN.
    travelled_um
        Travel towards contact since its voltage changed, as the interlock counts it.
    """

    def __init__(self, rig: Rig, limits: Limits, scale: GaugeScale) -> None:
        self._rig = rig
        self._limits = limits
        self.scale = scale
        self.doubted = False
        self.read_at_s = -math.inf
        self.load_mn = math.nan
        self.travelled_um = 0.0
        self._same = 0  # readings in a row that were the same
        self._last_mv = math.nan

    def read(self, duration_s: float, risen_mn: float) -> LoadReading:
        """Return one believable reading.

        Parameters
        ----------
        risen_mn
            Least rise of the load since the voltage last changed: a gauge that rounds may stand still below it.

        Raises
        ------
        StaleReading
            It is late, frozen, silent or senseless.
        """
        try:
            reading = self._living(duration_s, risen_mn)
        except StaleReading:
            self.doubted = True
            raise
        self.read_at_s, self.load_mn = reading.time_s, self.scale.load_mn(reading.voltage_mv)
        return reading

    def doubt(self, what: str) -> StaleReading:
        """Return the error for a gauge that contradicts what is known, and is no witness any more."""
        self.doubted = True
        return StaleReading(f"{self._rig.load_cell.name}: {what}")

    def forget(self) -> None:
        """Forget what was read: a simulated rig that is put back to where it was reads the same once more."""
        self._same, self._last_mv = 0, math.nan

    def believe_again(self) -> None:
        """Begin anew, with the surfaces apart."""
        self.doubted = False

    def _living(self, duration_s: float, risen_mn: float) -> LoadReading:
        """One reading of a gauge that lives; one that repeats itself is asked again at once, before anything moves."""
        while True:
            reading = self._sound(duration_s)
            again = reading.voltage_mv == self._last_mv
            still = reading.samples > 1 and reading.spread_mv == 0.0
            if reading.quantum_mv:  # what the amplifier rounds may stand still while the load does
                shows = risen_mn * abs(self.scale.sensitivity_mv_per_mn) > QUANTA * reading.quantum_mv
                again, still = again and shows, False
            if reading.voltage_mv != self._last_mv:
                self.travelled_um = 0.0
            self._same = self._same + again + still if again or still else 0  # a reading that is both counts twice
            self._last_mv = reading.voltage_mv
            if not self._same:
                return reading
            duration_s = min(duration_s, AGAIN_S)
            if self._same >= self._limits.frozen_readings:
                raise StaleReading(
                    f"{self._rig.load_cell.name}: {self._same + 1} readings are the same to the last digit "
                    f"({reading.voltage_mv:.4f} mV); the amplifier is frozen: restart it"
                )

    def _sound(self, duration_s: float) -> LoadReading:
        """One reading that is a number, and of now."""
        name = self._rig.load_cell.name
        try:
            reading = self._rig.load_cell.read(duration_s)
        except (StaleReading, SessionAborted):  # whoever ends the session is not the gauge's fault
            raise
        except DeviceError as error:
            raise StaleReading(str(error)) from error
        except RigError as error:
            raise StaleReading(f"{name}: no reading ({error}); the stage does not move") from error
        age = self._rig.clock.now() - reading.time_s
        if age > self._limits.stale_reading_s:
            raise StaleReading(
                f"{name}: the last reading is {age:.2f} s old, more than {self._limits.stale_reading_s:g} s; check the "
                "amplifier's connection"
            )
        if not math.isfinite(reading.voltage_mv):
            raise StaleReading(f"{name}: the amplifier answers no number; check the bridge's wiring")
        return reading
