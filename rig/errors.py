"""Errors of a rig: sentences for the person beside it, saying what, where and what to do."""

from __future__ import annotations


class RigError(Exception):
    """A part of the rig failed or refused; the text is one sentence for the operator."""


class StaleReading(RigError):
    """The load is not known now: the gauge answered too late, froze, dropped out or contradicts the stage."""


class InterlockRefusal(RigError):
    """A move was refused because it could pass a limit."""


class SessionAborted(RigError):
    """The operator ended the session."""
