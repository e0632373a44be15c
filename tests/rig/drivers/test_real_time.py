"""The drivers as a configuration makes them, in real time over real ports: nothing here knows of virtual time."""

from __future__ import annotations

import math
import time

import pytest

from mesotap.configuration.config import parse_config
from mesotap.session.bench import emulated_rig
from rig import DeviceError
from rig.drivers import assembly
from rig.drivers.amplifier import ModbusLoadCell
from rig.drivers.motor_stage import MotorStage
from rig.wall_clock import WallClock
from tests.mesotap.benches import small_config

PATIENT = "reply_timeout_s: 2.0"  # a busy machine is not what is tried here
STEPS_PER_S = 200  # of the physics' time, which has to stand while the physics is looked at
CONTACT_UM = 12.0
CLOSE = ("sim_backend.contact_position_um=12", "rig.limits.expected_contact_um=12")


@pytest.fixture
def bench():
    """The emulated devices on their ports, with time that passes by itself, and the drivers configured for them."""
    rig = emulated_rig(small_config(*CLOSE), wires=True)
    clock = rig.physics.clock
    clock.now = lambda: math.floor(time.monotonic() * STEPS_PER_S) / STEPS_PER_S
    clock.sleep = lambda seconds: time.sleep(max(seconds, 0.0))
    for port in rig.ports:
        port.plug()
    amplifier, stage = (port.path for port in rig.ports)
    parts = parse_config(
        f"""
rig:
  parts:
    load_cell: {{driver: modbus-rtu, preset: seneca-ze-sg3, port: {amplifier}, {PATIENT}}}
    stage: {{driver: conex-cc, resolution_um: 0.02, port: {stage}, {PATIENT}}}
"""
    ).rig.parts
    cell, motor = assembly.amplifier(parts.load_cell, WallClock()), assembly.motor_stage(parts.stage, 0.5, WallClock())
    yield rig, cell, motor
    motor.close()
    cell.close()
    for port in rig.ports:
        port.unplug()


def test_the_stage_closes_the_contact_and_the_gauge_shows_it(bench):
    rig, cell, stage = bench
    assert isinstance(cell, ModbusLoadCell)
    assert isinstance(stage, MotorStage)
    assert "CONEX-CC 2.0.1, at 0.00 um" in stage.connect()
    assert "2 mV/V at 10" in cell.connect()
    apart = cell.read()
    stage.unlock()
    stage.move_by(CONTACT_UM - 1.0)

    def felt() -> bool:
        return cell.read().voltage_mv - apart.voltage_mv > 1.0

    where = stage.advance(10.0, 0.5, felt).position_um
    assert where < CONTACT_UM + 9.0
    assert 15.0 < rig.physics.true_load_mn() < 200.0
    assert rig.physics.micrometer.knob_um == where
    stage.lock()
    assert stage.read().locked
    stage.unlock()
    assert stage.move_by(-10.0).position_um == pytest.approx(where - 10.0)
    assert rig.physics.true_load_mn() == 0.0


def test_a_cable_pulled_from_a_moving_stage_is_told(bench):
    rig, _, stage = bench
    stage.connect()
    stage.unlock()
    rig.ports[1].unplug()
    with pytest.raises(DeviceError, match=r"micrometer stage on .*: the connection is gone .*; put the cable back"):
        stage.move_by(0.5)
