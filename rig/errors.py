"""Errors of a rig: sentences for the person beside it, saying what, where and what to do."""

from __future__ import annotations

from collections.abc import Sequence


class MesotapError(Exception):
    """Base of every error that a person can cause or mend; the text is one sentence that says what, where, what to do.

    The command line prints the sentence and ends with exit code 2. Whatever is no `MesotapError` is a fault of the
    program.
    """


class RigError(MesotapError):
    """A part of the rig failed or refused; the text is one sentence for the operator."""


class RigFailures(ExceptionGroup[Exception], RigError):
    """Several parts failed, each with its own error; the text is their sentences one after the other.

    Attributes
    ----------
    exceptions
        One error for each part.
    """

    def __new__(cls, failures: Sequence[Exception]) -> RigFailures:
        """Make a group of at least one failure."""
        return super().__new__(cls, "several parts failed", list(failures))

    def __init__(self, failures: Sequence[Exception]) -> None:
        super().__init__("several parts failed", list(failures))

    def derive(self, excs: Sequence[Exception]) -> RigFailures:  # type: ignore[override]
        """Return a group of the same kind with some of the failures."""
        return RigFailures(excs)

    def __str__(self) -> str:
        return "; ".join(map(str, self.exceptions))


def together(failures: Sequence[Exception]) -> Exception:
    """Return the failure itself where there is one, a `RigFailures` of all where there are several."""
    return failures[0] if len(failures) == 1 else RigFailures(failures)


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
