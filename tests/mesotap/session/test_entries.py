"""What a journal's entry may hold."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mesotap.session.entries import KINDS, fault_of, walk
from mesotap.session.states import Event, State

SCALARS = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
VALUES = st.recursive(SCALARS, lambda v: st.lists(v, max_size=3) | st.dictionaries(st.text(max_size=5), v, max_size=3))
FIELDS = ("at", "rig", "number", "load_set", "load_mn", "voltage_mv", "time", "position_um", "truth", "repeated")
ENTRIES = st.fixed_dictionaries(
    {"event": st.sampled_from(sorted(KINDS)) | VALUES}, optional=dict.fromkeys(FIELDS, VALUES)
)


@given(st.lists(ENTRIES, max_size=6))
def test_any_entries_leave_the_session_somewhere_or_are_named_on_one_line(entries):
    for entry, (progress, fault) in zip(entries, walk(entries), strict=True):
        assert isinstance(progress.state, State)
        assert "\n" not in fault
        assert fault or not fault_of(entry)


def test_every_event_that_ends_a_state_has_its_fields_checked():
    assert {event.value for event in Event} <= set(KINDS)


@pytest.mark.parametrize(
    ("entry", "fault"),
    [
        ({"event": "connected"}, ""),
        ({"event": "contact", "position_um": None, "load_mn": 50}, ""),
        ({"event": "contact", "position_um": 1.0, "load_mn": math.nan}, "entry 'contact': load_mn is nan"),
        ({"event": "contact", "position_um": 1.0, "load_mn": True}, "entry 'contact': load_mn is True"),
        ({"event": "loaded"}, "entry 'loaded': load_mn is missing"),
        ({"event": "no tap", "reason": 3}, "entry 'no tap': reason is 3"),
        ({"event": "safe", "at": "soon"}, "entry 'safe': at is 'soon', not an ISO 8601 date"),
        ({"event": "hardware", "repeated": [{"device": "a"}]}, "entry 'hardware': repeated.0.what is missing"),
        ({"event": None}, "event None is unknown"),
    ],
)
def test_what_is_wrong_with_an_entry_is_named_with_its_field(entry, fault):
    said = fault_of(entry)
    assert said.startswith(fault)
    assert bool(said) == bool(fault)
