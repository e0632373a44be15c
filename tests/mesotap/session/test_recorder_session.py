"""A whole session with the recorder's driver on the emulated device, quiet and with faults on the wire."""

from __future__ import annotations

import numpy as np
import pytest

from mesotap.session.bench import simulated_rig
from mesotap.session.progress import NO_TAP, assemble
from mesotap.session.states import State
from rig import RigError
from rig.drivers.recorder_settings import Usb1608Settings
from rig.drivers.usb1608 import Usb1608
from sim_backend.emulators.usb1608 import EmulatedUsb1608
from sim_backend.rig import SimulatedRig
from tests.mesotap.benches import header_of, new_runner, runner_in, small_config


def over_the_wire(config) -> tuple[SimulatedRig, EmulatedUsb1608]:
    """The simulated rig, with its recorder behind a USB cable."""
    rig = simulated_rig(config)
    device = EmulatedUsb1608(rig.accelerometers.signal, rig.clock)
    driver = Usb1608(config.rig.wiring, Usb1608Settings(), rig.clock, device.bus)
    driver.connect()
    rig.accelerometers = driver
    return rig, device


def run(path, config, rig):
    folder, runner = new_runner(path, config, rig)
    with folder:
        runner.run()
        return assemble(header_of(config), config, runner.progress, folder.impacts()), folder.events()


def test_the_session_is_the_same_as_on_the_simulated_recorder(tmp_path):
    config = small_config(
        "sim_backend.bad_taps={double: 0.2, too_hard: 0.1, too_weak: 0.1, off_centre: 0.2, clipped: 0.2}"
    )
    simulated, _ = run(tmp_path / "a", config, simulated_rig(config))
    emulated, _ = run(tmp_path / "b", config, over_the_wire(config)[0])
    assert emulated.complete
    assert len(emulated.impacts) == len(simulated.impacts)
    for one, other in zip(simulated.impacts, emulated.impacts, strict=True):
        assert np.array_equal(one.acceleration, other.acceleration)
        assert np.array_equal(one.strain_mv, other.strain_mv)
        assert (one.time, one.accepted, one.reject_reason) == (other.time, other.accepted, other.reject_reason)
        assert one.load_after_mn == other.load_after_mn
    assert np.array_equal(simulated.post.voltage_mv, emulated.post.voltage_mv)


@pytest.mark.parametrize("fault", ["overrun", "stall", "hang", "truncated", "odd", "replug", "stopped"])
def test_a_fault_within_a_record_costs_one_tap_and_not_the_session(tmp_path, fault):
    config = small_config()
    rig, device = over_the_wire(config)
    rig.impactor.on_tap(
        lambda tap: device.inject(fault, tap.onset_s + 0.01) if len(rig.impactor.history) == 2 else None
    )
    session, events = run(tmp_path / "s", config, rig)
    assert session.complete
    assert sum(impact.accepted for impact in session.impacts) == 4
    lost = [event for event in events if event["event"] == NO_TAP]
    assert len(lost) == 1
    assert "samples while the tap was waited for" in lost[0]["reason"]


def test_a_cable_pulled_for_good_ends_with_the_surfaces_apart_and_the_session_goes_on_later(tmp_path):
    config = small_config()
    rig, device = over_the_wire(config)
    pulled = []

    def pull(tap) -> None:
        if len(rig.impactor.history) == 3 and not pulled:
            pulled.append(tap)
            device.inject("unplug", tap.onset_s)

    rig.impactor.on_tap(pull)
    folder, runner = new_runner(tmp_path / "s", config, rig)
    with folder:
        with pytest.raises(RigError, match="it is gone from the bus; check its cable and the hub"):
            runner.run()
        assert rig.true_load_mn() == 0.0
        kept = {number: folder.read_impact(number)[0].acceleration for number in folder.impact_numbers()}
        assert kept
        device.bus.plug(device)
        again = runner_in(folder, config, rig)
        assert again.run().state is State.FILE
        assert sum(impact.accepted for impact in folder.impacts()) == 4
        for number, acceleration in kept.items():
            assert np.array_equal(folder.read_impact(number)[0].acceleration, acceleration)


def test_the_session_says_the_rate_that_was_recorded(tmp_path):
    config = small_config("rig.wiring.sample_rate_hz=24690.0")
    session, _ = run(tmp_path / "s", config, over_the_wire(config)[0])
    assert session.rig.sample_rate_hz == session.impacts[0].sample_rate_hz == 40e6 / round(40e6 / 24690)
    assert session.rig.sample_rate_hz != 24690.0
