"""Errors of a rig: sentences for the person beside it, saying what, where and what to do."""

from __future__ import annotations


class RigError(Exception):
    """A part of the rig failed or refused; the text is one sentence for the operator."""


class DeviceError(RigError):
    """A device failed or did not answer; the sentence names it, its port, what happened and what to check.

    Parameters
    ----------
    device
        What it is, in the operator's words.
    port
        Where it is connected: ``/dev/ttyUSB0``, ``192.168.1.5:502``, ``usb 1:4``.
    what
        What happened.
    check
        What to look at or do about it.
    """

    def __init__(self, device: str, port: str, what: str, check: str) -> None:
        super().__init__(f"{device} on {port}: {what}; {check}")
        self.device = device
        self.port = port
        self.what = what
        self.check = check


class NoAnswer(DeviceError):
    """A device said nothing, or nothing that could be understood, however often it was asked."""


class StaleReading(RigError):
    """The load is not known now: the gauge answered too late, froze, dropped out or contradicts the stage."""


class InterlockRefusal(RigError):
    """A move was refused because it could pass a limit."""


class SessionAborted(RigError):
    """The operator ended the session."""
