"""What is said of a check by one tap, on measurements written down by hand."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from daq.channel_relation import ChannelRelation
from daq.settings import Quality
from daq.wiring_check import Line, WiringCheck
from mesotap.session.wiring_verdicts import wiring_verdicts
from rig.settings import Channel, Wiring

RATE = 25_000.0
WIRING = Wiring()
SAME = ChannelRelation(1.0, 0.001, 0.0, 0.01, 0.9999, 0.9995, 1.0, 1e6)
GOOD = WiringCheck(
    noise_m_s2=(0.001, 0.001),
    peak_m_s2=(1.0, 1.0),
    first_swing_m_s2=(1.0, 1.0),
    onset_m_s2=(0.3, 0.3),
    alive=(True, True),
    clipped=(False, False),
    lines=(None, None),
    relation=SAME,
    rotation=0.02,
)


def verdicts(found=GOOD, side=0, wiring=WIRING, **relation):
    if relation:
        found = replace(found, relation=replace(SAME, **relation))
    return {v.name: v for v in wiring_verdicts(found, wiring, Quality(), RATE, side)}


def wrong(found=GOOD, side=0, wiring=WIRING, **relation):
    """The sentences that are not good, by their name."""
    return {n: v.says for n, v in verdicts(found, side, wiring, **relation).items() if v.passed is False}


def opposite(**more):
    """A check in which the channels move against each other."""
    turned = replace(SAME, gain=-1.0, correlation=-0.9999, correlation_low=-1.0, correlation_high=-0.9995)
    return replace(GOOD, relation=turned, **more)


def test_nothing_is_wrong_where_all_is_good():
    assert wrong() == {}
    assert set(verdicts()) == {
        *("channels", "saturation", "strength", "polarity", "alike", "gain", "delay", "noise", "hum")
    }


@pytest.mark.parametrize(("swings", "name", "polarity"), [((1.0, -1.0), "B", 1), ((-1.0, 1.0), "A", -1)])
def test_whose_first_swing_is_down_is_the_one_upside_down(swings, name, polarity):
    (says,) = wrong(opposite(first_swing_m_s2=swings)).values()
    assert says.startswith(f"{name} sees the tap upside down, correlation -0.9999 (-1.0000 to -0.9995)")
    assert says.endswith(f"set rig.wiring.accelerometer_{name.lower()}.polarity to {polarity}")  # as it is not now


def test_both_upside_down_are_swapped_cables_only_where_the_polarities_differ():
    down = replace(GOOD, first_swing_m_s2=(-1.0, -1.0))
    assert "their cables are on each other's input" in wrong(down)["polarity"]
    alike = Wiring(accelerometer_b=Channel(input=1, polarity=1))
    assert "cables" not in wrong(down, wiring=alike)["polarity"]
    assert "both have the wrong" in wrong(down, wiring=alike)["polarity"]


@pytest.mark.parametrize("relation", [{"sign_chi2": 24.0}, {"correlation": 0.4}, {"gain": -1.0, "correlation": -0.4}])
def test_a_polarity_that_is_not_certain_is_not_told(relation):
    says = wrong(**relation)["polarity"]
    assert says.startswith("cannot be told from this tap")
    assert "upside down" not in says


@pytest.mark.parametrize(
    ("alive", "noise", "says"),
    [
        ((False, True), (0.001, 0.001), r"^A does not see the tap: .*rig\.wiring\.accelerometer_a\.input \(0\)$"),
        ((True, False), (0.001, 0.0), r"^B does not see the tap \(not even noise\): .*accelerometer_b\.input \(1\)$"),
        ((False, False), (0.001, 0.001), r"^A and B do not see the tap: .*_a\.input \(0\) and .*_b\.input \(1\)$"),
    ],
)
def test_a_dead_channel(alive, noise, says):
    found = replace(GOOD, alive=alive, noise_m_s2=noise, relation=None, rotation=float("nan"))
    assert re.search(says, wrong(found)["channels"])
    assert "polarity" not in verdicts(found)


def test_a_clipped_channel_says_so_and_nothing_of_gain():
    found = replace(GOOD, clipped=(False, True), relation=None)
    assert wrong(found)["saturation"].startswith("B clipped: tap more gently")
    assert "gain" not in verdicts(found)


def test_a_weak_tap():
    assert (
        "only 12 times the noise (at least 20): tap harder"
        in wrong(replace(GOOD, peak_m_s2=(0.012, 0.012)))["strength"]
    )


@pytest.mark.parametrize(
    ("gain", "half", "says"),
    [
        (1.04, 0.001, ""),  # two sensitivities of 1.5 % each: 4.2 % at 95 %
        (1.06, 0.03, ""),
        (0.94, 0.001, "do not explain: tap once more in the middle"),
        (1.36, 0.001, "no tap of a session would be used"),  # 0.36 / 2.36 is more than 15 %
        (-10.0, 0.01, "no tap of a session would be used"),
    ],
)
def test_gains(gain, half, says):
    found = verdicts(gain=gain, gain_half=half)["gain"]
    assert found.passed is (not says)
    assert says in found.says


@pytest.mark.parametrize(
    ("delay", "half", "says"),
    [(0.4, 0.01, ""), (-0.7, 0.3, ""), (2.0, 0.1, "B comes later, 2.00"), (-1.0, 0.1, "A comes later, 1.00")],
)
def test_delays(delay, half, says):
    found = verdicts(delay_samples=delay, delay_half=half)["delay"]
    assert found.passed is (not says)
    assert says in found.says


def test_where_the_mass_rotated_gain_and_delay_are_not_judged():
    found = replace(GOOD, rotation=0.3, relation=replace(SAME, gain=2.0, delay_samples=5.0))
    assert list(wrong(found)) == ["alike"]
    assert "tap in the middle" in wrong(found)["alike"]
    assert not {"gain", "delay"} & set(verdicts(found))


@pytest.mark.parametrize(
    ("onset", "side", "passed", "says"),
    [
        ((0.4, 0.2), 1, True, "A, beside which you tapped, saw the more"),
        ((0.4, 0.2), -1, False, "tapped beside B, and A saw the more"),
        ((0.2, 0.4), -1, True, "B, beside which you tapped, saw the more"),
        ((0.2, 0.4), 1, False, "tapped beside A, and B saw the more"),
        ((0.31, 0.30), 1, None, "tap nearer to A"),
        ((0.0, 0.0), -1, None, "tap nearer to B"),
    ],
)
def test_sides(onset, side, passed, says):
    found = verdicts(replace(GOOD, onset_m_s2=onset), side)["sides"]
    assert (found.passed, says in found.says, "swapped" in found.says) == (passed, True, passed is not True)


def test_noise_and_hum_are_held_to_what_a_session_takes():
    loud = replace(GOOD, noise_m_s2=(0.001, 0.03), peak_m_s2=(3.0, 3.0))
    assert "B over 0.02: wait until the bench is quiet" in wrong(loud)["noise"]
    assert wrong(replace(GOOD, lines=(Line(50.0, 0.0019), None))) == {}
    assert "B 0.003 m/s2 rms at 60 Hz: check the shield" in wrong(replace(GOOD, lines=(None, Line(60.0, 0.003))))["hum"]
