"""From the load as it is to the load that is wanted, by guarded steps of a stage that has play and a smallest step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rig.errors import InterlockRefusal
from rig.settable import whole_steps

SHORTFALL = 0.8  # of the remaining load that one step closes, were the springs as stiff as may be
LARGEST_TRIES = 400
LARGEST_TURNS = 2  # back from above the target: once for where it was, once for a step that came out too far

GuardedStep = Callable[[float, str, float], float]  # travel (um), aim, load before (mN): returns the load after it, mN


@dataclass(frozen=True, slots=True)
class LoadLoop:
    """The loop of one rig.

    Attributes
    ----------
    mn_per_um
        Load that a micrometre of travel can make at most, mN/um.
    step_um
        Smallest step of the stage; 0 where it is not known.
    largest_step_um
        Largest step towards contact.
    """

    mn_per_um: float
    step_um: float
    largest_step_um: float

    def close(
        self,
        target_mn: float,
        tolerance_mn: float,
        load_mn: float,
        move_by: GuardedStep,
        on_progress: Callable[[str], None] | None = None,
    ) -> float:
        """Step until the load is within ``tolerance_mn`` of the target; returns it.

        Always from below, as the contact was loaded before: a load that is too high is first taken back by a largest
        step under the target, on which way the play of the stage is used up, and then come up to again.

        Raises
        ------
        InterlockRefusal
            No step ends within the tolerance.
        """
        load, turns, back = load_mn, 0, False
        # under the target by a largest step, but not so far that the surfaces part
        lowest = max(target_mn - self.largest_step_um * self.mn_per_um, target_mn / 2)
        for _ in range(LARGEST_TRIES):
            aim = f"load {load:.0f} mN, target {target_mn:.0f} mN"
            if on_progress is not None:
                on_progress(aim)
            back = back and load > (target_mn + lowest) / 2
            if not back and abs(target_mn - load) <= tolerance_mn:
                return load
            if not back and load > target_mn:
                back, turns = True, turns + 1
                if turns > LARGEST_TURNS:
                    break
            load = move_by(
                -self._away(load - lowest) if back else self._towards(target_mn - load, tolerance_mn), aim, load
            )
        told = f" (a step of the stage, {self.step_um:g} um, is up to {self.step_um * self.mn_per_um:.3g} mN)"
        raise InterlockRefusal(
            f"load: {target_mn:g} mN was not reached within {tolerance_mn:g} mN, the last was {load:.0f} mN"
            f"{told if self.step_um else ''}; check stage and gauge (settling_s, if the amplifier's filter is "
            "slow), or give a wider mesotap.load_tolerance_mn"
        )

    def _towards(self, missing_mn: float, tolerance_mn: float) -> float:
        travel = max(SHORTFALL * missing_mn, 0.5 * tolerance_mn) / self.mn_per_um
        return max(whole_steps(min(travel, self.largest_step_um), self.step_um), self.step_um)

    def _away(self, excess_mn: float) -> float:
        return max(whole_steps(excess_mn / self.mn_per_um, self.step_um), self.step_um)
