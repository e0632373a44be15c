"""States of a session and the legal transitions between them, as one table."""

from __future__ import annotations

from enum import Enum


class State(Enum):
    """What the session is doing."""

    CONNECT = "connecting"
    PRE_CALIBRATION = "calibrating before the test"
    APPROACH = "approaching"
    SET_LOAD = "setting the load"
    LOCK = "locking and dwelling"
    TAP = "tapping"
    RETRACT = "taking the surfaces apart"
    POST_CALIBRATION = "calibrating after the test"
    FILE = "writing the session file"
    DONE = "done"


class Event(Enum):
    """What ends a state."""

    CONNECTED = "connected"
    CALIBRATED = "calibrated"
    CONTACT = "contact"
    LOADED = "loaded"
    SETTLED = "settled"
    LOAD_MOVED = "load moved"
    LOAD_DONE = "load done"
    PLAN_DONE = "plan done"
    APART = "apart"
    FILED = "filed"


TRANSITIONS: dict[State, dict[Event, State]] = {
    State.CONNECT: {Event.CONNECTED: State.PRE_CALIBRATION},
    State.PRE_CALIBRATION: {Event.CALIBRATED: State.APPROACH},
    State.APPROACH: {Event.CONTACT: State.SET_LOAD},
    State.SET_LOAD: {Event.LOADED: State.LOCK},
    State.LOCK: {Event.SETTLED: State.TAP, Event.LOAD_MOVED: State.SET_LOAD},
    State.TAP: {Event.LOAD_MOVED: State.SET_LOAD, Event.LOAD_DONE: State.SET_LOAD, Event.PLAN_DONE: State.RETRACT},
    State.RETRACT: {Event.APART: State.POST_CALIBRATION},
    State.POST_CALIBRATION: {Event.CALIBRATED: State.FILE},
    State.FILE: {Event.FILED: State.DONE},
    State.DONE: {},
}


def follow(state: State, event: Event) -> State:
    """Return the state after ``event``; a `ValueError` names an illegal transition."""
    try:
        return TRANSITIONS[state][event]
    except KeyError:
        raise ValueError(f"'{event.value}' cannot happen while {state.value}") from None
