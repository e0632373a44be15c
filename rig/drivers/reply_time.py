"""How long to wait for a reply: found out from the first ones, since each wire takes its own time."""

from __future__ import annotations

PATIENT_S = 0.5  # for which a reply is waited while nobody knows yet how long one takes
ROUND_TRIPS = 5  # replies from which that is found out
SHORTEST_WAIT_S, WAIT_SHARE, WAIT_MARGIN_S = 0.06, 1.1, 0.01
"""A reply counts as lost after 1.1 times what the slowest took, and 10 ms for a busy machine; never before 60 ms."""

LATE_REPLIES, LONGEST_WAIT_S = 2, 0.15
"""Replies that came after they were given up, after which it is waited longer, and how long at most: a wire whose times
vary was learnt at its quickest, but one late reply may be a busy machine's."""


class ReplyTime:
    """What one wire takes.

    Parameters
    ----------
    given_s
        Time that a reply may take; None finds out.

    Attributes
    ----------
    limit_s
        How long to wait for a reply, s.
    round_trip_s
        Longest time that one of the first replies took, s; 0 before they came.
    """

    def __init__(self, given_s: float | None) -> None:
        self.limit_s = PATIENT_S if given_s is None else given_s
        self.round_trip_s = 0.0
        self._given = given_s is not None
        self._times: list[float] = []
        self._late = 0

    def learn(self, took_s: float) -> None:
        """Take in how long a reply took, until it is known how long to wait for one."""
        if len(self._times) < ROUND_TRIPS:
            self._times.append(took_s)
            if len(self._times) == ROUND_TRIPS:
                self.expect(sorted(self._times)[-2])  # the longest but for one, which may have been late

    def came_late(self) -> None:
        """Take in that a reply came after it was given up."""
        self._late += 1
        if self._late % LATE_REPLIES == 0 and not self._given and self.limit_s < LONGEST_WAIT_S:
            self.expect(self.limit_s)

    def expect(self, round_trip_s: float) -> None:
        """Be told how long a reply takes."""
        self._times = [round_trip_s] * ROUND_TRIPS
        self.round_trip_s = round_trip_s
        if not self._given:
            self.limit_s = max(SHORTEST_WAIT_S, WAIT_SHARE * round_trip_s + WAIT_MARGIN_S)
