"""Drivers that others wrote for Newport's controllers, at the emulated ones: over a pseudo-terminal, in real time.

Two independent readings of the same manuals. What works for them here is what they found to work on real controllers.
QMI is part of the development environment; hvl_ccb pins its own pymodbus, so that it is tried by ``make witness`` in an
environment of its own.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from sim_backend.clock import RunningClock
from sim_backend.emulators.newport import EmulatedController
from sim_backend.emulators.newport_parameters import ControllerModel
from sim_backend.emulators.ports import PtyPort
from sim_backend.settings import SimulatedStage as StageSettings
from sim_backend.stage import SimulatedStage

SPEED_UM_PER_S = 20000.0
SAVING_S = 0.2
PATIENCE_S = 120.0  # for a move to end on a busy machine

pytestmark = [pytest.mark.filterwarnings("ignore::DeprecationWarning"), pytest.mark.filterwarnings("ignore:.*xdrlib")]


class Plugged:
    """A controller behind a pseudo-terminal."""

    def __init__(self, folder: Path, **model) -> None:
        clock = RunningClock()
        self.stage = SimulatedStage(StageSettings(speed_um_per_s=SPEED_UM_PER_S), clock, lambda: None)
        self.controller = EmulatedController(
            self.stage,
            ControllerModel(saving_s=SAVING_S, ideal_speed_mm_per_s=SPEED_UM_PER_S * 1e-3, **model),
            SPEED_UM_PER_S,
            clock,
        )
        self.port = PtyPort(self.controller, folder / "port" / "stage")
        self.port.plug()


def wait_until(reached: Callable[[], bool]) -> None:
    late = time.monotonic() + PATIENCE_S
    while not reached():
        assert time.monotonic() < late
        time.sleep(0.01)


# --- QMI, TU Delft ---------------------------------------------------------------------------------------------


@pytest.fixture
def plugged(tmp_path) -> Iterator[Plugged]:
    found = Plugged(tmp_path)
    yield found
    found.port.unplug()


@pytest.fixture
def qmi_driver(plugged, monkeypatch):
    conex = pytest.importorskip("qmi.instruments.newport.conex_cc", reason="the package qmi is not installed")
    from qmi.core.context import QMI_Context
    from qmi.instruments.newport.actuators import LinearActuator

    monkeypatch.setattr(conex.Newport_ConexCC, "COMMAND_EXEC_TIME", 0.01)
    monkeypatch.setattr(conex.Newport_ConexCC, "PW0_EXEC_TIME", 2 * SAVING_S)
    actuator = LinearActuator(0, 12, SPEED_UM_PER_S * 1e-3, 1e-6, 2e-4, 60, 3e-5)
    port = f"serial:{plugged.port.path}"
    driver = conex.Newport_ConexCC(QMI_Context("witness"), "stage", port, "number", {1: actuator})
    driver.open()
    yield driver
    driver.close()


def state(driver) -> str:
    errors, says = driver.get_positioner_error_and_state()
    assert errors == []
    return says


def home(driver) -> None:
    driver.home_search()
    assert state(driver) == "HOMING."
    wait_until(lambda: state(driver) == "READY from HOMING.")


def test_qmi_reads_who_it_is_and_that_it_knows_no_place_yet(qmi_driver):
    assert (qmi_driver.get_idn().model, qmi_driver.get_idn().version) == ("CONEX-CC", "2.0.1")
    assert state(qmi_driver) == "NOT REFERENCED from RESET"


def test_qmi_moves_nothing_before_home_is_found(qmi_driver, plugged):
    exceptions = pytest.importorskip("qmi.core.exceptions")
    with pytest.raises(exceptions.QMI_InstrumentException, match="NOT REFERENCED"):
        qmi_driver.move_absolute(1.0)
    assert plugged.stage.knob_um == 0.0


def test_qmi_finds_home_at_the_end_of_the_travel(qmi_driver, plugged):
    home(qmi_driver)
    assert qmi_driver.get_position() == pytest.approx(0.0, abs=1e-6)
    assert plugged.stage.knob_um == pytest.approx(-2000.0)


def test_qmi_moves_there_by_so_much_and_is_told_how_long_it_takes(qmi_driver, plugged):
    home(qmi_driver)
    qmi_driver.move_absolute(0.5)
    wait_until(lambda: state(qmi_driver) == "READY from MOVING.")
    assert qmi_driver.get_position() == pytest.approx(0.5, abs=1e-6)
    qmi_driver.move_relative(0.1)
    wait_until(lambda: state(qmi_driver) == "READY from MOVING.")
    assert plugged.stage.knob_um == pytest.approx(-1400.0, abs=1e-3)
    assert qmi_driver.get_motion_time(1.0) >= 1.0 / (SPEED_UM_PER_S * 1e-3)


def test_qmi_stops_a_move_on_its_way(qmi_driver):
    home(qmi_driver)
    qmi_driver.move_absolute(11.0)
    assert state(qmi_driver) == "MOVING."
    qmi_driver.stop_motion()
    assert state(qmi_driver) == "READY from MOVING."
    assert 0.0 < qmi_driver.get_position() < 11.0


def test_qmi_is_refused_a_target_beyond_the_software_limit(qmi_driver):
    exceptions = pytest.importorskip("qmi.core.exceptions")
    home(qmi_driver)
    qmi_driver._actuators[1].TRAVEL_RANGE = SimpleNamespace(min=0, max=20)  # or the driver refuses it first
    with pytest.raises(exceptions.QMI_InstrumentException, match="Displacement out of limits"):
        qmi_driver.move_absolute(15.0)


def test_qmi_sets_a_velocity_that_is_lost_at_reset(qmi_driver):
    home(qmi_driver)
    before = qmi_driver.get_velocity()
    qmi_driver.set_velocity(1.0)
    assert qmi_driver.get_velocity() == 1.0
    qmi_driver.reset()
    assert qmi_driver.get_velocity() == before


def test_qmi_configures_a_home_where_it_stands(qmi_driver, plugged):
    qmi_driver.set_home_search_type(1)
    assert qmi_driver.get_home_search_type() == 1
    qmi_driver.home_search()
    assert state(qmi_driver) == "READY from HOMING."
    assert plugged.stage.knob_um == 0.0


# --- hvl_ccb, ETH Zurich -----------------------------------------------------------------------------------------


@pytest.fixture
def stepper(tmp_path) -> Iterator[Plugged]:
    found = Plugged(tmp_path, kind="smc100pp", address=2, lowest_mm=-2.0, highest_mm=10.0)
    yield found
    found.port.unplug()


@pytest.fixture
def hvl_driver(stepper):
    newport = pytest.importorskip(
        "hvl_ccb.dev.newport", reason="the package hvl_ccb is not installed: make witness", exc_type=ImportError
    )
    link = newport.NewportSMC100PPSerialCommunication({"port": str(stepper.port.path), "timeout": 1})
    settings = {
        "address": 2,
        "user_position_offset": 0,
        "exit_configuration_wait_sec": 2 * SAVING_S,
        "home_search_polling_interval": 0.05,
        "move_wait_sec": 0.5,
        "negative_software_limit": -2,
        "positive_software_limit": 10,
    }
    driver = newport.NewportSMC100PP(link, settings)
    yield driver
    driver.com.close()


def test_hvl_ccb_configures_homes_and_moves(hvl_driver, stepper):
    hvl_driver.start()
    sent = {line.strip("0123456789.-?")[:2] for line in stepper.controller.sent}
    assert {"ZT", "PW", "OR", "VA", "HT"} <= sent
    assert hvl_driver.get_state() is hvl_driver.StateMessages.READY_FROM_HOMING
    assert hvl_driver.get_motor_configuration() == {**hvl_driver.config.motor_config, "backlash_compensation": 0.0}
    hvl_driver.move_to_absolute_position(1.5)
    assert hvl_driver.get_position() == pytest.approx(1.5, abs=1e-6)
    hvl_driver.move_to_relative_position(-0.5)
    assert hvl_driver.get_position() == pytest.approx(1.0, abs=1e-6)
    assert hvl_driver.get_state() is hvl_driver.StateMessages.READY_FROM_MOVING
    hvl_driver.stop_motion()


def test_hvl_ccb_is_told_of_a_power_cut_by_the_nul(hvl_driver, stepper):
    hvl_driver.start()
    stepper.controller.cut_power()
    stepper.controller.restore_power()
    assert hvl_driver.get_state() is hvl_driver.StateMessages.NO_REF_FROM_RESET


def test_hvl_ccb_reads_the_motors_errors(hvl_driver, stepper):
    newport = pytest.importorskip("hvl_ccb.dev.newport", exc_type=ImportError)
    hvl_driver.start()
    stepper.controller.fails_next = 0x04
    hvl_driver.move_to_absolute_position(1.5)
    with pytest.raises(newport.NewportMotorError, match="Peak current limit"):
        hvl_driver.get_state()
    assert hvl_driver.get_state() is hvl_driver.StateMessages.NO_REF_FROM_MOVING


def test_hvl_ccb_is_refused_what_a_dc_controller_alone_has(hvl_driver, stepper):
    newport = pytest.importorskip("hvl_ccb.dev.newport", exc_type=ImportError)
    hvl_driver.start()
    with pytest.raises(newport.NewportControllerError, match="not allowed for PP version"):
        hvl_driver.com.send_command(2, "KP", 1)
