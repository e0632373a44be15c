"""A solenoid that taps the upper mass: a pulse on a digital line, as long as the preload asks for."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from rig.drivers.recorder_settings import SolenoidSettings
from rig.errors import RigError
from rig.interface import Clock, Impactor

STEP = 1.15
"""Factor by which the pulse grows or shrinks after a tap that was too weak or too hard."""

FURTHEST = 2.0
"""Largest departure of that factor from 1, either way."""


@runtime_checkable
class DigitalOutputs(Protocol):
    """Whoever has digital lines."""

    def set_line(self, line: int, high: bool) -> None:
        """Set one line; `RigError` when that failed."""


class SolenoidImpactor(Impactor):
    """Taps by itself; learns from what was wrong with the tap before.

    Parameters
    ----------
    outputs
        The recorder whose line switches the solenoid.
    settings
        Line and pulse.
    clock
        Rig time.
    """

    def __init__(self, outputs: DigitalOutputs, settings: SolenoidSettings, clock: Clock) -> None:
        self._outputs = outputs
        self._settings = settings
        self._clock = clock
        self._factor = 1.0
        self._may_be_on = True  # a program that was killed may have left it so

    def release(self) -> None:
        """Switch the solenoid off, unless it is known to be off.

        Raises
        ------
        RigError
            It may still be under current.
        """
        if self._may_be_on:
            self._switch_off()

    def tap(self, load_mn: float, hint: str = "") -> None:
        """Switch the solenoid on for one pulse.

        Raises
        ------
        RigError
            The line could not be set, or not be set back: then the solenoid may still be under current.
        """
        if not load_mn >= 0:
            raise RigError(f"solenoid: it cannot tap for a preload of {load_mn:g} mN; the load must be known")
        # the sentences of daq.quality end in what to do about the tap
        if "more gently" in hint:
            self._factor = max(self._factor / STEP, 1 / FURTHEST)
        elif "harder" in hint:
            self._factor = min(self._factor * STEP, FURTHEST)
        settings = self._settings
        pulse_ms = self._factor * (settings.pulse_ms + settings.pulse_ms_per_n * load_mn * 1e-3)
        self._may_be_on = True
        try:
            self._outputs.set_line(settings.line, True)
            self._clock.sleep(min(pulse_ms, settings.longest_pulse_ms) * 1e-3)
        finally:
            self._switch_off()

    def _switch_off(self) -> None:
        try:
            self._outputs.set_line(self._settings.line, False)
        except RigError:
            try:
                self._outputs.set_line(self._settings.line, False)
            except RigError as error:
                raise RigError(f"solenoid: it may still be under current ({error}); switch its supply off") from error
        self._may_be_on = False
