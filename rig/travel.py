"""The travel as a witness of the load: what the springs make of each micrometre, whatever the gauge says."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rig.errors import InterlockRefusal
from rig.settable import largest_mn_per_um
from rig.settings import Limits

SOFTEST_RESPONSE = 0.55  # of the springs' stiffness: below this, at load, the gauge does not follow the stage
STIFFEST_RESPONSE = 1.35
RESPONSE_FROM_THRESHOLDS = 5.0  # contact thresholds of load from which the response is judged
RESPONSE_TRAVEL_UM = 0.4  # travel over which it is judged
LOST_SHARE = 0.5  # of the load at which the stage was left: what a tap or creep never takes away
STANDING_CHANGE_THRESHOLDS = 4.0  # load change, in contact thresholds, that cannot happen while the stage stands


class TravelWitness:
    """The travel of one rig's stage since the surfaces met.

    Parameters
    ----------
    limits
        Section ``rig.limits`` of the configuration.
    spring_stiffness
        k1, k2 in N/m, for the load that a micrometre of travel can make at most.

    Attributes
    ----------
    mn_per_um
        That load, mN/um.
    contact
        Position (um) and load (mN) at which contact was felt; None while the surfaces are apart.
    felt_before
        The same of the last contact that carried a load, also when apart again.
    """

    def __init__(self, limits: Limits, spring_stiffness: tuple[float, float]) -> None:
        self._limits = limits
        self.mn_per_um = largest_mn_per_um(spring_stiffness)
        self.contact: tuple[float, float] | None = None
        self.felt_before: tuple[float, float] | None = None
        self._judged_from: tuple[float, float] | None = None  # position and load where the response began
        self._turned_at: float | None = None  # where the stage last turned back, until its play is used up
        self._under_way: tuple[float, float] | None = None  # load before a step, and its travel

    def met(self, position_um: float, load_mn: float) -> None:
        """Note where contact was felt."""
        self.contact, self._judged_from = (position_um, load_mn), None

    def parted(self) -> None:
        """Note that the surfaces are apart."""
        self.contact = self._judged_from = self._turned_at = None

    def carried(self) -> None:
        """Note that this contact carries a load, which no jump of a gauge does."""
        self.felt_before = self.contact or self.felt_before

    def reach_um(self) -> float:
        """Position up to which contact is looked for.

        Once the surfaces have met, they meet there again, give or take the play: a gauge that has died since then
        cannot have the stage go on to where the configuration would have allowed it to look.
        """
        reach = self._limits.expected_contact_um + self._limits.search_beyond_um
        if self.felt_before is None or not math.isfinite(self.felt_before[0]):
            return reach
        again = self.felt_before[0] + self._limits.largest_backlash_um + self._limits.search_beyond_um
        return min(reach, again)

    @contextmanager
    def step(self, step_um: float, load_mn: float) -> Iterator[None]:
        """A step is under way, from this load."""
        if step_um <= 0:
            self._judged_from = None
        self._under_way = (load_mn, step_um)
        try:
            yield
        finally:
            self._under_way = None

    def turned_back(self, position_um: float) -> None:
        """Note where a step away from contact ended: the stage has play from there."""
        if math.isfinite(position_um):
            self._turned_at = position_um

    def must_have_risen_mn(self, travelled_um: float) -> float:
        """Least rise of the load by a travel towards contact; 0 while apart."""
        if self.contact is None:
            return 0.0
        play = 0.0 if self._turned_at is None else self._limits.largest_backlash_um
        return SOFTEST_RESPONSE * self.mn_per_um * (travelled_um - play)

    def check_step(self, position_um: float, step_um: float) -> None:
        """Refuse a step after which the springs alone could carry more than the limit and one step."""
        if self.contact is None or not math.isfinite(position_um) or not math.isfinite(self.contact[0]):
            return
        past_um = position_um + step_um - self.contact[0]
        largest = self.contact[1] + past_um * self.mn_per_um
        if largest > self._limits.load_mn + self._limits.largest_approach_step_um * self.mn_per_um:
            raise InterlockRefusal(
                f"step: {past_um:.2f} um past contact the load can be {largest:.0f} mN, whatever the gauge says; check "
                "the gauge's sensitivity"
            )

    # --- what speaks against the gauge -------------------------------------------------------------------------

    def against_standing(self, before_mn: float, now_mn: float) -> str:
        """Say why a change of the load cannot be while the stage stands; empty if it can."""
        if abs(now_mn - before_mn) <= STANDING_CHANGE_THRESHOLDS * self._limits.contact_threshold_mn:
            return ""
        return (
            f"the load changed from {before_mn:.0f} to {now_mn:.0f} mN while the stage stood still; check its cable "
            "and what touches the masses, then resume; a filter slower than its settling_s does the same"
        )

    def against_waiting(self, left_mn: float, before_mn: Sequence[float], now_mn: float) -> str:
        """Say why the load of a stage that stands cannot be lost, or jump; empty if it is as it may be.

        ``left_mn`` is the load at which the stage was left, NaN for none, ``before_mn`` those seen just before.
        """
        room = STANDING_CHANGE_THRESHOLDS * self._limits.contact_threshold_mn
        if left_mn - now_mn > max(room, LOST_SHARE * left_mn):
            return self.against_standing(left_mn, now_mn)
        return next((said for before in before_mn if (said := self.against_standing(before, now_mn))), "")

    def against_step(self, now_mn: float) -> str:
        """Say why the load cannot be what it is in the midst of a step; empty if it can, or nothing is under way."""
        if self._under_way is None:
            return ""
        before, step_um = self._under_way
        room = STANDING_CHANGE_THRESHOLDS * self._limits.contact_threshold_mn
        most = step_um * self.mn_per_um * STIFFEST_RESPONSE
        if min(most, 0.0) - room <= now_mn - before <= max(most, 0.0) + room:
            return ""
        return (
            f"the load went from {before:.0f} to {now_mn:.0f} mN in a step of {step_um:.2f} um; gauge and stage "
            "disagree: check the gauge's wiring and what else touches the masses"
        )

    def against_response(self, position_um: float, load_mn: float) -> str:
        """Hold the rise of the load against what the springs make of the travel; say what speaks against it."""
        if not math.isfinite(position_um) or load_mn < RESPONSE_FROM_THRESHOLDS * self._limits.contact_threshold_mn:
            return self._against_no_rise(position_um, load_mn)
        if self._judged_from is None:
            self._judged_from = (position_um, load_mn)
            return ""
        travel = position_um - self._judged_from[0]
        if travel < RESPONSE_TRAVEL_UM:
            return ""
        response = (load_mn - self._judged_from[1]) / (travel * self.mn_per_um)
        self._judged_from = (position_um, load_mn)
        if self._turned_at is not None:
            # a stage that was turned back has play: a step that begins before that is used up may do nothing
            used_up = position_um - travel - self._turned_at >= self._limits.largest_backlash_um
            if response < SOFTEST_RESPONSE and not used_up:
                return ""
            self._turned_at = None
        if SOFTEST_RESPONSE < response < STIFFEST_RESPONSE:
            return ""
        return (
            f"{travel:.2f} um of travel changed it by {response:.0%} of what the springs allow; gauge and stage "
            "disagree: check the gauge's wiring and what else touches the masses"
        )

    def _against_no_rise(self, position_um: float, load_mn: float) -> str:
        """A gauge that does not rise at all; a soft first contact does, in the end."""
        if self.contact is None or not math.isfinite(position_um) or not math.isfinite(self.contact[0]):
            return ""
        past_um = position_um - self.contact[0]
        if past_um * self.mn_per_um <= self._limits.load_mn * 0.75 + self.contact[1]:
            return ""
        return (
            f"{past_um:.1f} um past contact it shows only {load_mn:.0f} mN; it does not follow the stage: look whether "
            "it answers a touch of the finger"
        )
