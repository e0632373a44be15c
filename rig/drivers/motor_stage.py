"""Motor micrometer on a Newport controller, as a stage that moves towards contact with growing positions.

A motion is followed by asking at a steady rate, so that whatever goes wrong, the stage is told to stop within one
question. Towards contact it moves so slowly that it passes no more than the largest step until such a stop takes
effect, over a wire as slow as it was found to be. The clamp of the paper's micrometer (Sec. 3.3) is the motor switched
off: its screw holds by itself, and no control loop moves it while the contact rings.
"""

from __future__ import annotations

import contextlib
import logging
import math
from collections.abc import Callable

from rig.drivers.driver import Driver
from rig.drivers.newport import HERE_IS_HOME, NewportAxis
from rig.drivers.newport_codes import AxisState, AxisStatus
from rig.drivers.retraction import LONGER, PATIENCE_S, Retraction
from rig.drivers.settings import NewportStage
from rig.drivers.transport import Transport
from rig.errors import DeviceError, RigError
from rig.hardware_log import repeated
from rig.interface import Clock, Stage
from rig.readings import StageReading

LOG = logging.getLogger("mesotap.rig.stage")
DEVICE = "micrometer stage"
DIGITS = 6  # of a position in um: the picometre that arithmetic in mm would blur
SWITCHING_S = 2.0  # in which the motor is on or off
SWITCHING_ON_S = 0.15  # which that mostly takes
HOMING_S = 120.0
ATTEMPTS = 3  # to get to a target that a damaged command or a false alarm missed
SPEED_TOLERANCE = 0.01  # digits that a controller prints
QUESTIONS_TO_STOP = 3.0  # round trips until a motion that goes wrong is over: state, position, stop


class MotorStage(Stage, Driver):
    """Stage driven by a CONEX-CC or SMC100.

    Parameters
    ----------
    transport
        Its port, not yet open.
    settings
        Address, travel, resolution, timing.
    clock
        Rig time.
    largest_overshoot_um
        Travel that may pass between two questions: the largest step towards contact.
    """

    def __init__(self, transport: Transport, settings: NewportStage, clock: Clock, largest_overshoot_um: float) -> None:
        self._transport = transport
        self._settings = settings
        self._clock = clock
        self._overshoot = largest_overshoot_um
        self._axis = NewportAxis(
            transport, settings.address, clock, settings.reply_timeout_s, settings.tries, settings.driver
        )
        self.step_um = settings.resolution_um
        self._speed = math.nan  # um/s, of the next motion; NaN if it is not known for sure
        self._last_um = math.nan  # where it was seen last
        self._motor_off = False  # when it was seen last
        self._range_um = (self._to_um(settings.lowest_mm), self._to_um(settings.highest_mm))

    def connect(self) -> str:
        """Open the port and see that the controller is the one expected, in order, and slow enough.

        Raises
        ------
        DeviceError
            It is not.

        A stage without its reference looks for it here only where ``home_at_connect`` allows that.
        """
        self._transport.open()
        version = self._axis.version()
        if self._settings.expected_identity not in version:
            raise self._error(
                f"it says that it is '{version}', not the '{self._settings.expected_identity}' of "
                "rig.parts.stage.expected_identity",
                "another controller is plugged in here: exchange it, or correct the configuration",
            )
        if self._axis.home_kind() == HERE_IS_HOME:
            raise self._error(
                "it takes the place where it stands for its home (HT1): after a power cut it could not find it again",
                "set another kind of home search with the maker's program",
            )
        self._speed = self._axis.velocity_mm_s() * 1e3
        lowest, highest = (self._to_um(limit) for limit in self._axis.soft_limits_mm())
        self._range_um = (max(self._range_um[0], lowest), min(self._range_um[1], highest))
        status = self._axis.status()
        if status.state in (AxisState.MOVING, AxisState.HOMING):  # on its way for a program that is no more
            self._axis.stop()
            self._at_rest()
            status = self._axis.status()
        self.round_trip_s = self._axis.reply_time.round_trip_s
        if status.state is AxisState.NOT_REFERENCED and self._settings.home_at_connect:
            self._home()
            status = self._axis.status()
        if status.state is AxisState.NOT_REFERENCED:
            # who reads it is told; a retraction finds the reference, and must not fail to connect for want of it
            return f"{DEVICE} on {self._transport.port}: {version}, not referenced"
        trouble = status.trouble()
        if status.state is not AxisState.DISABLED:
            self._require(status, (AxisState.READY,))
        self._axis.power_came_back = False
        # a motor that was switched off by a fault is switched on when it is moved, and says if the fault is still there
        before = "" if trouble is None else f", before: {trouble[0]}"
        return (
            f"{DEVICE} on {self._transport.port}: {version}, at {self._position_um():.2f} um, "
            f"{status.state.value}, {self._approach_speed():.3g} um/s towards contact{self._slow_wire()}{before}"
        )

    def close(self) -> None:
        """Close the port; the stage stays where it is."""
        self._transport.close()

    @property
    def travel_um(self) -> tuple[float, float]:
        """Lowest and highest position within the limits of configuration and controller."""
        return self._range_um

    def descriptor(self) -> int | None:
        """Return the descriptor of its open port, for whoever takes the stage over; None if it has none."""
        return self._transport.fileno()

    def take_over(self, travel_um: tuple[float, float], round_trip_s: float) -> None:
        """Stop the stage of a program that is no more, over the port that it had open.

        Parameters
        ----------
        travel_um, round_trip_s
            What that program knew of it.
        """
        self._transport.open()
        self._axis.stop()
        self._range_um, self.round_trip_s = travel_um, round_trip_s
        self._axis.reply_time.expect(round_trip_s)
        self._motor_off = True  # not known: the longer way is safe

    def read(self) -> StageReading:
        """Position of the encoder, and whether the motor is off."""
        status, place = self._axis.look()
        if status.state is AxisState.NOT_REFERENCED:
            raise self._lost_reference(status)
        self._motor_off = status.state is AxisState.DISABLED
        return StageReading(self._clock.now(), self._where(place), self._motor_off)

    def move_by(self, step_um: float, aim: str = "") -> StageReading:
        """Move and come to rest.

        A stage that has lost its reference, by a power cut, is taken apart by finding it: the reference lies on the
        retracted side.

        Raises
        ------
        DeviceError
            It is clamped, would leave its travel, does not follow, does not arrive in time, or does not answer.
        """
        if not math.isfinite(step_um):
            raise self._error(f"cannot move by {step_um} um", "report this as a fault of the program")
        status, place = self._axis.look()
        if status.state is AxisState.NOT_REFERENCED and step_um < 0:
            self._home()
            return self.read()
        self._require(status, (AxisState.READY,))
        target = self._where(place) + step_um
        if step_um < 0:
            target = max(target, self._range_um[0])  # apart as far as it goes
        self._go_to(target)
        return StageReading(self._clock.now(), self._last_um, False)

    def advance(self, travel_um: float, step_um: float, stop: Callable[[], bool], aim: str = "") -> StageReading:
        """Step towards contact until told to stop or the travel is used up."""
        if not (step_um > 0 and travel_um >= 0 and math.isfinite(travel_um)):
            raise self._error(
                f"cannot advance {travel_um} um in steps of {step_um} um", "report this as a fault of the program"
            )
        self._require(self._axis.status(), (AxisState.READY,))
        start = self._position_um()
        steps = math.ceil(travel_um / step_um - 1e-9)
        for i in range(1, steps + 1):
            if stop():
                return self.read()
            self._go_to(start + min(i * step_um, travel_um))
        stop()
        return self.read()

    def retract(self, travel_um: float, aim: str = "") -> StageReading:
        """Move back, clamped or not, without waiting for a word first: on a slow wire each costs time under load.

        A stage that has lost its reference, by a power cut, is taken apart by finding it.

        Raises
        ------
        DeviceError
            It does not answer, does not follow, or does not arrive in time.
        """
        start = self._last_um if math.isfinite(self._last_um) else self._position_um()
        target = self._on_grid(max(start - travel_um, self._range_um[0]))
        trouble, begun, turn = None, self._clock.now(), 0
        self._begin_retraction(target)
        course = Retraction(self._settings, self._clock, start, target, self._axis.reply_time.round_trip_s)
        while not course.stuck():
            status, place = self._axis.look(confirmed=False)
            trouble = status.trouble() or trouble
            if status.state is AxisState.NOT_REFERENCED:
                self._home()
                return self.read()
            here = self._where(place)
            if course.arrived(status.state, here):
                return self.read()
            if course.again(status.state, here):
                self._begin_retraction(target)
            turn += 1
            self._clock.sleep(begun + turn * self._settings.poll_s - self._clock.now())
        raise self._error(*(trouble or (f"it did not move back by {travel_um:g} um", "look what blocks it")))

    def lock(self) -> None:
        """Switch the motor off: the screw holds the position."""
        self._switch(False)

    def unlock(self) -> None:
        """Switch the motor on; a stage without its reference has none to switch on."""
        self._switch(True)

    # --- motions --------------------------------------------------------------------------------------------

    def _go_to(self, position_um: float) -> None:
        """Be at the multiple of the resolution next to ``position_um``, whatever it takes within a few attempts.

        Where it begins was asked just before.
        """
        self.idle()
        target = self._on_grid(position_um)
        low, high = self._range_um
        if not low <= target <= high:
            raise self._error(
                f"{target:.1f} um lies outside its travel of {low:.1f} to {high:.1f} um",
                "correct zero_mm or the travel in rig.parts.stage, or set the specimen nearer",
            )
        reached = self._last_um
        self._use_speed(self._approach_speed())
        for _ in range(ATTEMPTS):
            reached = self._follow(target)
            if abs(reached - target) <= self._settings.in_position_um:
                return
            repeated(LOG, DEVICE, "a move missed its target", f"{reached:.2f} um instead of {target:.2f} um")
        raise self._error(
            f"it stands at {reached:.2f} um instead of {target:.2f} um after {ATTEMPTS} attempts",
            "look what blocks it, and check its cable",
        )

    def _follow(self, target_um: float) -> float:
        """Begin a move and ask until it is over; returns where it ended, um. Any exit before that stops the stage."""
        start = self._last_um
        slack = self._settings.in_position_um
        lowest, highest = min(start, target_um) - slack, max(start, target_um) + slack
        begun = self._clock.now()
        deadline = begun + LONGER * abs(target_um - start) / self._speed + PATIENCE_S
        if target_um > start:
            self.permit()
            begun = self._clock.now()
            deadline = begun + LONGER * abs(target_um - start) / self._speed + PATIENCE_S
        try:
            self._axis.move_to(self._to_mm(target_um))
            turn = 0
            while True:
                turn += 1
                self._clock.sleep(begun + turn * self._settings.poll_s - self._clock.now())
                status, place = self._axis.look()
                if status.state is not AxisState.MOVING:
                    break
                if not lowest <= self._where(place) <= highest:
                    # by a damaged command, or as a damaged reply says: stop first, then look
                    self._axis.stop()
                    return self._at_rest()
                self.idle()
                if self._clock.now() > deadline:
                    lasts = self._clock.now() - begun
                    raise self._error(
                        f"it still moves {lasts:.1f} s after it was sent {target_um - start:+.2f} um",
                        "look what blocks it",
                    )
        except BaseException:
            self._stop_somehow()
            raise
        self._require(status, (AxisState.READY,))
        reached = self._position_um()
        if abs(reached - target_um) > slack:
            return self._at_rest()  # asked again: the reply may have been damaged
        return reached

    def _at_rest(self) -> float:
        """Position once two answers agree that the stage stands, um."""
        before = self._position_um()
        for _ in range(round(PATIENCE_S / self._settings.poll_s)):
            self._clock.sleep(self._settings.poll_s)
            now = self._position_um()
            standing = self._axis.status().state not in (
                AxisState.MOVING,
                AxisState.HOMING,
                AxisState.JOGGING,
                AxisState.TRACKING,
            )
            if standing and abs(now - before) <= self._settings.resolution_um:
                return now
            before = now
        raise self._error("it does not come to rest", "switch its power off and look what ails it")

    def _begin_retraction(self, target_um: float) -> None:
        """Send it back; where it takes longer to ask than to switch the motor on, again and again meanwhile."""
        self._speed = math.nan
        place, speed = self._to_mm(target_um), self._settings.speed_um_per_s * 1e-3
        self._axis.begin_retraction(place, speed)
        if self._motor_off and self._axis.reply_time.round_trip_s > self._settings.poll_s:
            for _ in range(round(SWITCHING_ON_S / self._settings.poll_s)):
                self._clock.sleep(self._settings.poll_s)
                self._axis.begin_retraction(place, speed, stop=False)

    def _slow_wire(self) -> str:
        """What is said of a wire that slows the approach down."""
        slow = self._axis.reply_time.round_trip_s > self._settings.poll_s
        return f" (replies take {self._axis.reply_time.round_trip_s * 1e3:.0f} ms)" if slow else ""

    def _approach_speed(self) -> float:
        """Speed towards contact, um/s: what goes wrong ends within the largest step, over this wire."""
        latency_s = self._settings.poll_s + QUESTIONS_TO_STOP * self._axis.reply_time.round_trip_s + self.idle_takes_s
        return min(self._settings.speed_um_per_s, self._overshoot / latency_s)

    def _use_speed(self, um_per_s: float) -> None:
        """Have the motions to come be this fast."""
        if not abs(self._speed - um_per_s) <= SPEED_TOLERANCE * um_per_s:
            self._axis.set_velocity(um_per_s * 1e-3)
            self._speed = um_per_s

    def _on_grid(self, position_um: float) -> float:
        resolution = self._settings.resolution_um
        return round(round(position_um / resolution) * resolution, DIGITS)

    def _home(self) -> None:
        """Look for the reference, which lies on the retracted side."""
        self._axis.power_came_back = False
        self._speed = math.nan  # a power cut undoes what was set
        begun = self._clock.now()
        try:
            self._axis.home()
            while self._clock.now() < begun + HOMING_S:
                self._clock.sleep(self._settings.poll_s)
                self.idle()
                status = self._axis.status()
                if status.state is not AxisState.HOMING:
                    self._require(status, (AxisState.READY,))
                    return
        except BaseException:
            self._stop_somehow()
            raise
        self._stop_somehow()
        raise self._error(f"it did not find its reference in {HOMING_S:g} s", "look what blocks it")

    def _switch(self, on: bool) -> None:
        wanted = AxisState.READY if on else AxisState.DISABLED
        status = self._axis.status()
        if status.state is AxisState.NOT_REFERENCED:
            return  # nothing is switched; the next move says what is the matter, or finds the reference
        if status.state is wanted:
            return
        begun, turn = self._clock.now(), 0
        self._axis.switch_motor(on)
        while self._clock.now() < begun + SWITCHING_S:
            turn += 1
            self._clock.sleep(begun + turn * self._settings.poll_s - self._clock.now())
            if self._axis.status().state is wanted:
                return
            self.idle()
        raise self._error(f"its motor does not go {'on' if on else 'off'}", "switch the controller off and on again")

    def _stop_somehow(self) -> None:
        """Stop; a stage that cannot be told stands by itself once its motion is over."""
        with contextlib.suppress(RigError):  # the error that led here says more
            self._axis.stop()

    # --- what is said ---------------------------------------------------------------------------------------

    def _require(self, status: AxisStatus, states: tuple[AxisState, ...]) -> None:
        """Raise unless the stage is in one of ``states`` and in no trouble."""
        trouble = status.trouble()
        if status.state is AxisState.NOT_REFERENCED:
            raise self._lost_reference(status)
        if trouble is not None:
            raise self._error(*trouble)
        if status.state not in states:
            if status.state is AxisState.DISABLED:
                raise self._error("it is clamped (motor off)", "unlock it before it is moved")
            if status.state is AxisState.JOGGING:
                raise self._error(f"it is {status.state.value}", "let go of the keypad and end jogging there")
            if status.state is AxisState.TRACKING:
                raise self._error(f"it is {status.state.value}", "end that with the maker's program (TK0)")
            raise self._error(f"it is {status.state.value}", "wait until it is ready, or switch it off and on again")

    def _lost_reference(self, status: AxisStatus) -> DeviceError:
        cut = "its power was cut and came back: it" if self._axis.power_came_back else "it"
        if (trouble := status.trouble()) is not None:
            cut = f"{trouble[0]}, and it"
        return self._error(
            f"{cut} does not know where it is",
            "check its power supply; it finds its reference when the surfaces are taken apart or, with "
            "rig.parts.stage.home_at_connect, when it is connected",
        )

    def _where(self, told_mm: float | None) -> float:
        """Position, um, as it was told with the state, or asked for now."""
        if told_mm is None:
            return self._position_um()
        self._last_um = self._to_um(told_mm)
        return self._last_um

    def _position_um(self) -> float:
        self._last_um = self._to_um(self._axis.position_mm())
        return self._last_um

    def _to_um(self, position_mm: float) -> float:
        return round((position_mm - self._settings.zero_mm) * 1e3, DIGITS)

    def _to_mm(self, position_um: float) -> float:
        return self._settings.zero_mm + position_um * 1e-3

    def _error(self, what: str, check: str) -> DeviceError:
        return DeviceError(DEVICE, self._transport.port, what, check)
