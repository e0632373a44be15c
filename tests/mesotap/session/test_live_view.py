"""The live view on the simulated rig in virtual time: what is told, the check of each fault, and how it ends."""

from __future__ import annotations

import math
import os
import re
from collections import deque

import numpy as np
import pytest

from mesotap.configuration.config import parse_config
from mesotap.console.session_people import PagePeople
from mesotap.session.bench import emulated_rig, simulated_rig
from mesotap.session.guardian import Guardian
from mesotap.session.live_view import LiveView, ViewBench, for_setting_up
from mesotap.session.watching import GaugeWatch
from rig import RigError, SessionAborted
from rig.settings import RigSettings
from tests.mesotap.benches import Silent

SEEDS = int(os.environ.get("MESOTAP_SCOPE_SEEDS", "10"))
WRONG = {
    "sim_backend.sensors.b.gain=-1": ("polarity", "B sees the tap upside down.*accelerometer_b.polarity to 1"),
    "sim_backend.sensors.a.gain=-1": ("polarity", "A sees the tap upside down.*accelerometer_a.polarity to -1"),
    "sim_backend.sensors.a.gain=0": ("channels", r"A does not see the tap.*accelerometer_a.input \(0\)"),
    "sim_backend.sensors.swapped=true": ("polarity", "both see a tap from above upside down: their cables"),
    "sim_backend.sensors.b.gain=10": ("gain", "B reads (10|9.99|10.0)[0-9]* .* no tap of a session would be used"),
    "sim_backend.sensors.a.gain=1.1": ("gain", "B reads 0.909.* do not explain: tap once more"),
    "sim_backend.sensors.b.delay_samples=2": ("delay", "B comes later, 2.00"),
    "sim_backend.sensors.b.hum_m_s2=0.02": ("hum", "B 0.014 m/s2 rms at 50 Hz"),
    "sim_backend.sensors={a: {hum_m_s2: 0.02}, mains_hz: 60}": ("hum", "A 0.014 m/s2 rms at 60 Hz"),
    "sim_backend.noise.rms_m_s2=0.03": ("noise", "A and B over 0.02"),
    "rig.wiring.input_range_v=0.1": ("saturation", "A and B clipped"),
}


NO_PLAY = "sim_backend.stage.backlash_um=0"


class Guarding(Guardian):
    """Remembers what it was told."""

    def __init__(self):
        self.told = []

    def start(self):
        self.told.append("start")

    def arm(self, load):
        self.told.append(load)

    def dismiss(self):
        self.told.append("dismiss")


class Ending:
    """Does things at their time, and at last presses STOP."""

    def __init__(self, rig, stop_s, things=()):
        self._rig, self._stop_s, self._things = rig, stop_s, list(things)

    def check(self, hold):
        now = self._rig.clock.now()
        while self._things and now >= self._things[0][0]:
            self._things.pop(0)[1]()
        if now >= self._stop_s:
            self._stop_s = math.inf
            raise SessionAborted("STOP")


class Viewed:
    """A live view that was run to its end."""

    def __init__(self, *changes, wishes=(), stop_s=4.0, seed=None, build=simulated_rig, things=lambda rig: ()):
        config = for_setting_up(parse_config("", changes=changes))
        self.rig = build(config, seed=seed)
        self.told, self.guardian, self.error = [], Guarding(), None
        control = Ending(self.rig, stop_s, things(self.rig))
        tell = lambda message, numbers=b"": self.told.append((message, numbers))  # noqa: E731
        bench = ViewBench(
            self.rig,
            Silent(),
            control,
            tell,
            self.guardian,
            GaugeWatch(),
            wishes if isinstance(wishes, deque) else deque(wishes),
            True,
        )
        try:
            LiveView(config, bench, self.rig.clock.now).run()
        except RigError as error:
            self.error = error
        self.pictures = [message for message, _ in self.told if message["kind"] == "picture"]
        self.responses = [message for message, _ in self.told if message["kind"] == "response"]
        self.physics = getattr(self.rig, "physics", self.rig)

    def check(self):
        """Verdicts of the check by name."""
        assert self.pictures[-1]["check"]["state"] == "done"
        return {v["name"]: v for v in self.pictures[-1]["check"]["verdicts"]}


def tapped(*changes, side="middle", **more):
    return Viewed(*changes, wishes=[{"do": "check", "side": side}], **more)


@pytest.mark.parametrize("build", [simulated_rig, emulated_rig])
def test_stop_takes_the_surfaces_apart(build):
    viewed = Viewed(stop_s=2.0, build=build)
    assert isinstance(viewed.error, SessionAborted)
    assert viewed.error.__notes__ == ["the surfaces are apart"]
    assert viewed.physics.micrometer.knob_um == pytest.approx(-100.0, abs=0.1)  # rig.limits.clearance_um
    assert viewed.guardian.told == ["start", True, False, "dismiss"]
    assert not [message for message, _ in viewed.told if message["kind"] == "alarm"]


def test_ten_pictures_a_second_each_whole():
    viewed = Viewed(stop_s=4.0)
    assert len(viewed.pictures) >= 5 * (4.0 - 1.5)  # a second for the gauge's zero, and what connecting takes
    message, numbers = next(told for told in reversed(viewed.told) if told[0]["kind"] == "picture")
    values = np.frombuffer(numbers, dtype="<f4")
    assert values.size == 2 * message["points"] + 2 * message["bins"]
    assert message["points"] == 1250  # 50 ms
    a = message["levels"][0]
    assert a["noise"] == pytest.approx(0.001, rel=0.15)
    assert a["noise"] == pytest.approx(values[: message["points"]].std(), rel=0.3)
    assert not a["overloaded"]
    assert message["next"].startswith("Quiet enough for a session.")


def test_what_a_page_wishes_is_shown():
    shown = {"do": "view", "averages": 3, "span_ms": 1000.0, "triggered": True, "level": 0.2}
    viewed = Viewed(wishes=[shown, {"do": "tap"}], stop_s=4.0)
    message = viewed.pictures[-1]
    assert (message["averages"], message["count"], message["triggered"], message["level"]) == (3, 3, True, 0.2)
    assert 1000 < message["points"] <= 2000  # 25,000 samples, as many as a screen has columns
    assert message["first_ms"] == pytest.approx(-100.0)


HAMMER = "rig.wiring.hammer={input: 3}"


def taps(times, *more):
    """Return what is done to have the lower mass tapped at times, and other wishes at theirs."""
    wishes = deque()
    every = [(t, "tap") for t in times] + list(more)
    return wishes, lambda rig: [(t, lambda what=what: wishes.append({"do": what})) for t, what in sorted(every)]


def test_the_hammer_s_force_is_shown_and_each_tap_gives_a_response_and_their_average():
    wishes, things = taps([2.0, 4.0, 6.0])
    viewed = Viewed(HAMMER, wishes=wishes, things=things, stop_s=8.0)
    message, numbers = next(told for told in reversed(viewed.told) if told[0]["kind"] == "picture")
    assert np.frombuffer(numbers, "<f4").size == 3 * message["points"] + 2 * message["bins"]
    assert message["hammer"]["reach"] == pytest.approx(5 / 22.5e-3 / 10)
    assert [told["taps"] for told in viewed.responses] == [0, 1, 2, 3]
    first, last = viewed.responses[1], viewed.responses[-1]
    assert first["coherence"] == []
    assert max(picture["hammer"]["peak"] for picture in viewed.pictures) > 0.05
    # far above its mode on the tube spring a struck mass answers as a free one: 1/m2, within the sensitivities' errors
    line = round(2500 / last["bin_hz"]) - 1
    mean = last["mean"]
    assert mean["h1"][line] == pytest.approx(1 / RigSettings().moving_masses()[1], rel=0.08)
    assert last["last"][line] == pytest.approx(mean["h1"][line], rel=0.02)
    assert 0.98 < last["coherence"][line] <= 1
    for i in range(line):
        assert mean["h2"][i] == pytest.approx(mean["h1"][i] / last["coherence"][i], rel=1e-4)
        assert mean["hv"][i] == pytest.approx(math.sqrt(mean["h1"][i] * mean["h2"][i]), rel=1e-4)
    assert first["mean"]["h2"][:line] == pytest.approx(first["mean"]["h1"][:line], rel=1e-4)
    dark = [i for i, value in enumerate(mean["h1"]) if value is None]
    assert (dark[0] + 1) * last["bin_hz"] == pytest.approx(last["excited_hz"], abs=2 * last["bin_hz"])
    assert len(last["force"]) == len(mean["h1"])
    assert None not in last["force"]


def test_the_last_tap_can_be_left_out_and_the_average_begun_anew():
    wishes, things = taps([2.0, 4.0], (6.0, "drop"), (6.5, "reset"), (7.0, "drop"))
    viewed = Viewed(HAMMER, wishes=wishes, things=things, stop_s=8.0)
    assert [told["taps"] for told in viewed.responses] == [0, 1, 2, 1, 0, 0]
    assert viewed.responses[3]["mean"] == viewed.responses[1]["mean"]


def test_a_dead_hammer_is_told_and_without_one_nothing_is():
    dead = Viewed(HAMMER, "sim_backend.hammer={gain: 0}", wishes=[{"do": "tap"}], stop_s=4.0)
    assert "hammer's channel shows nothing at all" in dead.pictures[-1]["next"]
    assert [told["taps"] for told in dead.responses] == [0]
    without = Viewed(wishes=[{"do": "tap"}, {"do": "drop"}], stop_s=3.0)
    assert without.responses == []
    assert (without.pictures[-1]["forces"], without.pictures[-1]["hammer"]) == (0, None)


@pytest.mark.parametrize("change", WRONG)
def test_each_fault_is_named(change):
    name, says = WRONG[change]
    verdicts = tapped(change).check()
    assert verdicts[name]["passed"] is False
    assert re.search(says, verdicts[name]["says"])
    others = [n for n, v in verdicts.items() if v["passed"] is False and n != name]
    assert not others or name in ("noise", "saturation")


@pytest.mark.parametrize("seed", range(1, SEEDS + 1))
def test_nothing_is_wrong_with_a_healthy_rig(seed):
    viewed = tapped(seed=seed)
    verdicts = viewed.check()
    assert {name: v["says"] for name, v in verdicts.items() if not v["passed"]} == {}
    assert len(verdicts) == 9
    numbers = viewed.pictures[-1]["check"]["numbers"]
    assert numbers["gain"] == pytest.approx(1.0, abs=4 * numbers["gain_half"])
    assert viewed.pictures[-1]["next"] == "Wiring and noise are as a session needs them: end the view."


@pytest.mark.parametrize(("swapped", "side", "passed"), [(False, "a", True), (False, "b", True), (True, "a", False)])
def test_a_tap_beside_one_tells_whether_the_cables_are_swapped(swapped, side, passed):
    alike = "rig.wiring.accelerometer_b={input: 1, polarity: 1}"
    sides = tapped(alike, f"sim_backend.sensors.swapped={str(swapped).lower()}", side=side).check()["sides"]
    assert sides["passed"] is passed
    assert ("the cables are swapped" in sides["says"]) is swapped


def test_without_a_tap_it_says_so():
    viewed = tapped("daq.trigger.timeout_s=1", "sim_backend.sensors={a: {gain: 0}, b: {gain: 0}}")
    assert "neither A nor B saw a tap within 1 s" in viewed.check()["channels"]["says"]


@pytest.mark.parametrize("build", [simulated_rig, emulated_rig])
def test_a_load_over_the_limit_is_an_alarm_and_taken_off(build):
    def turned(rig):
        physics = getattr(rig, "physics", rig)
        return [(2.0, lambda: physics.push(150.0 + 4.0)), (2.5, lambda: physics.push(150.0 + 11.0))]

    viewed = Viewed(NO_PLAY, things=turned, stop_s=10.0, build=build)
    (alarm,) = [message for message, _ in viewed.told if message["kind"] == "alarm"]
    assert "over the limit of 1100 mN" in alarm["text"]
    assert "over the limit of 1100 mN" in str(viewed.error)
    assert viewed.error.__notes__ == ["the surfaces are apart"]
    assert viewed.physics.true_load_mn() == 0.0
    assert viewed.rig.clock.now() < 5.0


def test_a_load_near_the_limit_is_told():
    viewed = Viewed(NO_PLAY, things=lambda rig: [(2.0, lambda: rig.push(150.0 + 6.1))], stop_s=3.0)
    assert viewed.pictures[-1]["next"].endswith("of 1100 mN: turn no further.")


def test_a_gauge_that_goes_silent_ends_it_with_the_surfaces_apart():
    viewed = Viewed(things=lambda rig: [(2.0, lambda: setattr(rig.load_cell, "fault", "dropout"))], stop_s=30.0)
    assert "no reading" in str(viewed.error)
    assert viewed.physics.micrometer.knob_um == pytest.approx(-100.0, abs=0.1)


def test_it_does_not_begin_where_the_surfaces_may_touch():
    viewed = Viewed("rig.limits.expected_contact_um=-5", "sim_backend.contact_position_um=100")
    assert "take them apart, then begin" in str(viewed.error)
    assert viewed.error.__notes__ == ["nothing was moved"]
    assert viewed.physics.micrometer.knob_um == 0.0


def test_a_zero_that_was_read_under_load_is_noticed():
    viewed = Viewed(
        "sim_backend.contact_position_um=-3",
        things=lambda rig: [(2.0, lambda: rig.push(-20.0))],
        stop_s=3.0,
    )
    assert "was not free when the view began" in viewed.pictures[-1]["next"]


def test_the_end_without_a_load_moves_nothing_and_with_one_is_refused():
    viewed = Viewed(wishes=[{"do": "end"}])
    assert viewed.error is None
    assert viewed.physics.micrometer.knob_um == 0.0
    assert viewed.guardian.told == ["start", True, False, "dismiss"]
    wishes = deque()
    loaded = Viewed(
        wishes=wishes,
        things=lambda rig: [(2.0, lambda: rig.push(152.0))],
        stop_s=3.0,
    )
    assert isinstance(loaded.error, SessionAborted)


def test_a_micrometer_turned_by_hand_is_turned_back_by_who_turned_it():
    hand = "rig.parts.stage=hand"
    viewed = Viewed(hand, NO_PLAY, things=lambda rig: [(2.0, lambda: rig.push(162.0))], stop_s=10.0)
    assert "over the limit" in str(viewed.error)
    assert viewed.error.__notes__ == ["the surfaces are apart"]
    assert viewed.physics.true_load_mn() == 0.0


def test_nobody_is_waited_for_when_the_console_has_gone():
    told = []
    people = PagePeople(lambda message, numbers=b"": told.append(message))
    people.lost()
    with pytest.raises(RigError, match="the console has gone"):
        people.operator.turn("Turn the micrometer 100 um away from contact.", -100.0, lambda: ("gauge 3 mV", False))
    with pytest.raises(RigError, match="the console has gone"):
        people.operator.wait_ready("Open the micrometer's clamp.")
    assert [message["kind"] for message in told] == ["ask", "live", "asked", "ask", "asked"]
