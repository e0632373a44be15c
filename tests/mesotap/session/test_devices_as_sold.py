"""Whole sessions on devices that step, convert, filter and wake up as those sold do."""

from __future__ import annotations

import pytest

from rig import RigError
from sim_backend.emulators.rig import EmulatedRig
from tests.mesotap.benches import new_runner, small_config

TOLERANCE_MN = 60.0  # what the largest of these steps allows on one tube spring


def sold(tmp_path, driver: str, actuator: str, referenced: bool = True, home: bool = False):
    """Return the impacts of a session with an actuator as sold and a ZE-SG3 that converts at its own rate."""
    stage = f"driver: {driver}, port: /dev/ttyUSB1, actuator: {actuator}, home_at_connect: {str(home).lower()}"
    config = small_config(f"rig.parts.stage={{{stage}}}", f"mesotap.load_tolerance_mn={TOLERANCE_MN}")
    rig = EmulatedRig(config.rig, config.sim_backend, seed=5, actuator=actuator, realistic=True, referenced=referenced)
    folder, runner = new_runner(tmp_path / "session", config, rig)
    with folder:
        runner.run()
        return config, folder.impacts()


PAIRS = [(driver, actuator) for driver in ("conex-cc", "smc100") for actuator in ("tra12cc", "trb6cc", "cma25ccl")]
QUICK = (("conex-cc", "tra12cc"), ("smc100", "cma25ccl"))


@pytest.mark.parametrize(
    ("driver", "actuator"), [pytest.param(*p, marks=() if p in QUICK else pytest.mark.slow) for p in PAIRS]
)
def test_a_session_reaches_its_loads_with_the_steps_of_an_actuator(tmp_path, driver, actuator):
    config, impacts = sold(tmp_path, driver, actuator)
    loads = sorted({impact.load_set for impact in impacts})
    assert len(loads) == len(config.mesotap.load_plan_mn)
    for impact in impacts:
        assert impact.load_before_mn == pytest.approx(config.mesotap.load_plan_mn[impact.load_set], abs=TOLERANCE_MN)


def test_a_controller_that_was_just_switched_on_is_not_moved_without_leave(tmp_path):
    with pytest.raises(RigError, match="it does not know where it is"):
        sold(tmp_path, "smc100", "trb6cc", referenced=False)


@pytest.mark.long
def test_a_controller_that_was_just_switched_on_finds_its_home_with_leave(tmp_path):
    _, impacts = sold(tmp_path, "smc100", "trb6cc", referenced=False, home=True)
    assert impacts
