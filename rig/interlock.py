"""The interlock: nobody moves the stage but through it.

It knows the load limit, the largest step towards contact and the age of the last load reading, and it does not
believe the gauge alone: the springs bound how much load a micrometre of travel can make, so the distance travelled
since contact was felt is a second witness. Leaving it, by whatever exit, leaves the rig in the safe state: surfaces
apart by the clearance, and what is said of it is what was seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType

from rig.errors import InterlockRefusal, RigError, StaleReading
from rig.interface import Rig
from rig.load_loop import LoadLoop
from rig.readings import GaugeScale, LoadReading
from rig.settable import whole_steps
from rig.settings import Limits
from rig.settling import MOST_TURNS, let_settle
from rig.travel import TravelWitness
from rig.witness import LoadWitness

OnProgress = Callable[[str], None]

RETRACTIONS = 3
LEFT_THRESHOLDS = 3.0  # load, in contact thresholds, that a gauge may show with the surfaces apart
READING_S = 0.1
CAREFUL_READING_S = 0.2
STEP_READING_S = 0.05  # after a step: its noise is far below what a step makes
CONFIRMING_READING_S = 0.1  # what a tap adds to one reading has died away, or averages out, in a longer one
STANDING_DRIFT_UM = 1.0  # by which the encoder of a standing stage may be off: many steps of any actuator
SETTLED_THRESHOLDS = 0.1  # change within a settling time, in contact thresholds, that is not a lag but a creep


@dataclass(frozen=True, slots=True)
class SafeState:
    """What became of the attempt to bring the rig into its safe state.

    Attributes
    ----------
    troubles
        A sentence for each thing that did not work, or is not known to have worked; empty if the gauge saw the
        surfaces apart.
    moved_um
        How far the stage was moved back; 0 if it could not be.
    """

    troubles: tuple[str, ...]
    moved_um: float

    def sentence(self) -> str:
        """Return what a person has to know of it."""
        return "; ".join(self.troubles) or "the surfaces are apart"


def unseen(load_mn: float) -> None:
    """Show nobody what the gauge reads."""


class Interlock:
    """Moves the stage within the limits, or not at all.

    Parameters
    ----------
    rig
        Opened rig.
    limits
        Section ``rig.limits`` of the configuration.
    scale
        Line between voltage and load: declared at first, replaced by the calibrated one.
    spring_stiffness
        k1, k2 in N/m, for the load that a micrometre of travel can make at most.

    Attributes
    ----------
    shown
        Called with the load, mN, of each believable reading; returns at once.
    """

    def __init__(self, rig: Rig, limits: Limits, scale: GaugeScale, spring_stiffness: tuple[float, float]) -> None:
        self._rig = rig
        self._limits = limits
        self._witness = LoadWitness(rig, limits, scale)
        self._travel = TravelWitness(limits, spring_stiffness)
        self._stands: tuple[float, bool] | None = None  # where the stage was left, and whether clamped
        self._left_mn = math.nan  # load at which it was left
        self._looked_mn: tuple[float, ...] = ()  # at the last two looks since
        self.shown: Callable[[float], None] = unseen
        rig.stage.permit = self._permit

    @property
    def scale(self) -> GaugeScale:
        """Line between the gauge's voltage and the load."""
        return self._witness.scale

    @scale.setter
    def scale(self, scale: GaugeScale) -> None:
        self._witness.scale = scale

    @property
    def contact(self) -> tuple[float, float] | None:
        """Position (um) and load (mN) at which contact was felt; None while the surfaces are apart."""
        return self._travel.contact

    @contact.setter
    def contact(self, felt: tuple[float, float] | None) -> None:
        self._travel.contact = felt

    def forget_readings(self) -> None:
        """Forget what the gauge read, which a rig that was put back to where it was reads once more."""
        self._witness.forget()

    def expect_contact(self, felt: tuple[float, float] | None) -> None:
        """Be told where (um, mN) the surfaces met before: they are not looked for far beyond."""
        self._travel.felt_before = felt

    # --- the gauge ------------------------------------------------------------------------------------------

    def load_mn(self, duration_s: float = READING_S) -> float:
        """Load now; `StaleReading` if the gauge is late, frozen, silent or senseless."""
        return self.scale.load_mn(self.read_gauge(duration_s).voltage_mv)

    def read_gauge(self, duration_s: float = READING_S) -> LoadReading:
        """One believable reading of the gauge."""
        reading = self._witness.read(duration_s, self._travel.must_have_risen_mn(self._witness.travelled_um))
        self.shown(self.scale.load_mn(reading.voltage_mv))
        return reading

    def _let_settle(self, watched: bool = True) -> None:
        """Wait until the gauge shows what the stage did; ``watched``: a load over the limit is not waited out."""
        settling_s = self._rig.load_cell.settling_s
        within_mv = SETTLED_THRESHOLDS * self._limits.contact_threshold_mn * abs(self.scale.sensitivity_mv_per_mn)

        def read() -> LoadReading:
            reading = self._witness.read(STEP_READING_S, 0.0)  # what lags may stand still for a while
            if watched:
                self._check_limit(self.scale.load_mn(reading.voltage_mv))
                self.look_at_stage()
            return reading

        if not let_settle(self._rig.clock, settling_s, read, within_mv, self._rig.load_cell.idle) and watched:
            raise self._witness.doubt(
                f"it does not come to rest within {MOST_TURNS * settling_s:g} s while the stage stands; look what "
                "touches the masses, or give a longer settling_s in rig.parts.load_cell"
            )

    # --- moves ----------------------------------------------------------------------------------------------

    def approach(self, on_progress: OnProgress | None = None) -> float:
        """Bring the surfaces together and return the load at first contact, mN.

        The load may not change before contact, contact shows as a rise by the contact threshold, and it is looked
        for no further than ``search_beyond_um`` past where it was expected.

        Raises
        ------
        InterlockRefusal
            When no contact was felt within the travel allowed.
        """
        self._stands = None
        self._rig.stage.unlock()
        self._travel.contact = None
        self._witness.believe_again()
        resting = sum(self.load_mn() for _ in range(3)) / 3
        threshold = self._limits.contact_threshold_mn
        if abs(resting) > 2 * threshold:
            raise InterlockRefusal(
                f"approach: the gauge shows {resting:.0f} mN with the surfaces apart, more than {2 * threshold:g} mN; "
                "calibrate it again, or look whether they touch"
            )
        position = self._rig.stage.read().position_um
        reach = self._travel.reach_um()
        travel = reach - position if math.isfinite(position) else reach + self._limits.clearance_um

        def felt() -> bool:
            self._let_settle()
            load = self.load_mn()
            if on_progress is not None:
                on_progress(f"approaching, load {load:.0f} mN")
            self._check_limit(load)
            if load < resting - 2 * threshold:
                raise self._witness.doubt(
                    f"it fell from {resting:.0f} to {load:.0f} mN on the approach, which no contact "
                    "does; check its cable and that nothing leans on the masses"
                )
            return load - resting > threshold

        step = min(self._limits.largest_approach_step_um, self._limits.load_mn / self._travel.mn_per_um)
        step = whole_steps(step, self._rig.stage.step_um)
        reading = self._rig.stage.advance(travel, step, felt, "until the load just begins to rise")
        load = self.load_mn()
        if load - resting <= threshold / 2:
            raise InterlockRefusal(
                f"approach: no contact up to {reach:g} um, {self._limits.search_beyond_um:g} um past where it was "
                f"expected ({reach - self._limits.search_beyond_um:g} um); check that the gauge answers a touch of the "
                "finger, then correct rig.limits.expected_contact_um"
            )
        self._travel.met(reading.position_um, load)
        return load

    def set_load(self, target_mn: float, tolerance_mn: float, on_progress: OnProgress | None = None) -> float:
        """Close the loop on the gauge until the load is within ``tolerance_mn`` of the target; returns the load.

        The target is approached from below, see `LoadLoop`.

        Raises
        ------
        InterlockRefusal
            If the target lies past the limit, a step would pass it, or no step ends within the tolerance.
        StaleReading
            If the gauge cannot be believed.
        """
        if target_mn + tolerance_mn > self._limits.load_mn:
            raise InterlockRefusal(
                f"load: {target_mn:g} mN is past the limit of {self._limits.load_mn:g} mN (rig.limits.load_mn)"
            )
        self._stands = None
        self._rig.stage.unlock()
        loop = LoadLoop(self._travel.mn_per_um, self._rig.stage.step_um, self._limits.largest_approach_step_um)
        load = loop.close(target_mn, tolerance_mn, self.load_mn(), self.move_by, on_progress)
        self._travel.carried()
        return load

    def move_by(self, step_um: float, aim: str = "", load_mn: float | None = None) -> float:
        """Make one guarded step and return the load after it, mN. Steps towards contact are cut to the limit."""
        before = self.load_mn() if load_mn is None else load_mn
        if step_um > 0:
            step_um = min(step_um, self._limits.largest_approach_step_um)
            room = (self._limits.load_mn - before) / self._travel.mn_per_um
            if room <= 0:
                raise InterlockRefusal(
                    f"step: the load, {before:.0f} mN, is at the limit of {self._limits.load_mn:g} mN; "
                    "the stage only retracts"
                )
            step_um = whole_steps(min(step_um, room), self._rig.stage.step_um)  # a stage rounds up as well
            self._travel.check_step(self._rig.stage.read().position_um, step_um)
        self._check_standing(before, self.load_mn(0.0))
        self._stands = None
        with self._travel.step(step_um, before):
            position = self._rig.stage.move_by(step_um, aim).position_um
        self._stands = (position, False)
        self._left_mn, self._looked_mn = math.nan, ()
        if step_um < 0:
            self._travel.turned_back(position)
        self._witness.travelled_um += max(step_um, 0.0)
        self._let_settle()
        after = self.load_mn(STEP_READING_S)
        self._check_limit(after)
        if step_um > 0:
            self._believe(self._travel.against_response(position, after))
        self._left_mn = after
        return after

    def retract(self, on_progress: OnProgress | None = None) -> str:
        """Take the surfaces apart by the clearance, whatever the gauge says, and look whether it agrees.

        Returns
        -------
        str
            Empty if the gauge saw them apart; else why it is no witness, so that the travel is the only one: it "is
            silent", "cannot be believed", shows a pull.

        Raises
        ------
        InterlockRefusal
            If a gauge that can be believed still shows a load after some tries.
        """
        if on_progress is not None:
            on_progress("taking the surfaces apart")
        self._stands = None
        for _ in range(RETRACTIONS):
            self._rig.stage.retract(self._limits.clearance_um, "taking the surfaces apart")
            doubted = "cannot be believed" if self._witness.doubted else ""
            try:
                self._let_settle(watched=False)
                load = self.load_mn()
            except StaleReading:
                load, doubted = math.nan, "is silent"
            left = LEFT_THRESHOLDS * self._limits.contact_threshold_mn
            if load < -left:
                doubted = doubted or f"shows {load:.0f} mN"
            if not load > left:
                self._travel.parted()
                return doubted
        raise InterlockRefusal(
            f"retract: the gauge still shows {load:.0f} mN after {RETRACTIONS} times {self._limits.clearance_um:g} um; "
            "look whether the surfaces are apart, and back the micrometer off by hand"
        )

    def lock(self) -> None:
        """Clamp the stage at its load."""
        self._rig.stage.lock()
        self._looked_mn = ()
        self._stands = (self._rig.stage.read().position_um, True)

    # --- watching -------------------------------------------------------------------------------------------

    def look_at_gauge(self, taps: bool) -> None:
        """See that the load is known and within the limit.

        Where there may be ``taps``, a single reading may hold what one makes the gauge swing, and what counts is what a
        longer one confirms. A jump in the midst of a reading shows half in it and half in the next: the last two looks
        count.
        """
        left, before = (math.nan, ()) if self._stands is None else (self._left_mn, self._looked_mn)
        load = self.load_mn(0.0)
        if taps:
            before = ()
            if load > self._limits.load_mn or self._travel.against_waiting(left, before, load):
                load = self.load_mn(CONFIRMING_READING_S)
        self._looked_mn = () if taps else (*before[-1:], load)
        self._check_limit(load)
        self._believe(self._travel.against_step(load) or self._travel.against_waiting(left, before, load))

    def look_at_stage(self) -> None:
        """See that the stage answers, and stands as it was left.

        Raises
        ------
        InterlockRefusal
            It moved by itself, or its clamp opened.
        RigError
            It does not answer, or does not know where it is.
        """
        reading = self._rig.stage.read()
        if self._stands is None:
            return
        position, locked = self._stands
        if locked and not reading.locked:
            raise InterlockRefusal("stage: its clamp has opened by itself; look who else commands it")
        if abs(reading.position_um - position) > STANDING_DRIFT_UM:
            raise InterlockRefusal(
                f"stage: it was left at {position:.2f} um, and is at {reading.position_um:.2f} um by itself; look who "
                "else moves it"
            )

    def _permit(self) -> None:
        """See that the load is still known when the stage is about to move towards contact.

        A program that was stopped, or a machine that was busy, since the last reading knows nothing of what happened
        meanwhile.
        """
        if self._rig.clock.now() - self._witness.read_at_s > self._limits.stale_reading_s:
            before = self._witness.load_mn
            load = self.load_mn()
            self._check_standing(before, load)
            self._check_limit(load)

    def check(self) -> float:
        """Return the load now, making sure that it is known and within the limit, mN."""
        load = self.load_mn()
        self._check_limit(load)
        return load

    def read_load(self) -> tuple[float, float]:
        """Load (mN) and the bridge voltage behind it (mV), read with care for the record; within the limit."""
        voltage = self.read_gauge(CAREFUL_READING_S).voltage_mv
        load = self.scale.load_mn(voltage)
        self._check_limit(load)
        return load, voltage

    # --- what is held against the gauge --------------------------------------------------------------------

    def _check_limit(self, load: float) -> None:
        if load > self._limits.load_mn:
            raise InterlockRefusal(
                f"load: {load:.0f} mN is over the limit of {self._limits.load_mn:g} mN; the surfaces are taken apart"
            )

    def _check_standing(self, before: float, now: float) -> None:
        """Refuse a change of the load that cannot happen while the stage stands."""
        self._believe(self._travel.against_standing(before, now))

    def _believe(self, against: str) -> None:
        """Give the gauge up if something speaks against it."""
        if against:
            raise self._witness.doubt(against)

    # --- leaving --------------------------------------------------------------------------------------------

    def make_safe(self) -> SafeState:
        """Bring the rig into its safe state, whatever works, and say what was seen of it."""
        troubles = []
        moved = 0.0
        rig = self._rig
        try:
            doubted = self.retract()
            moved = self._limits.clearance_um
            if doubted:
                troubles.append(
                    f"moved back {moved:g} um, but the gauge {doubted}: look whether the surfaces are apart"
                )
        except InterlockRefusal as error:
            troubles.append(str(error))
        except Exception as error:
            troubles.append(f"not made safe: {error}; back the micrometer off by hand")
        for action in (rig.impactor.release, rig.accelerometers.stop):  # the load first, whatever else hangs
            try:
                action()
            except Exception as error:  # every part gets its chance, whatever ails another
                troubles.append(f"not made safe: {error}")
        return SafeState(tuple(troubles), moved)

    def __enter__(self) -> Interlock:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        safe = self.make_safe()
        if safe.troubles and error is not None:
            error.add_note(safe.sentence())
        elif safe.troubles:
            raise RigError(safe.sentence())
