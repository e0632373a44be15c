"""A gauge that loses its load while the stage stands, and `mesotap check` under load: both are watched."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from mesotap.commands import devices
from mesotap.configuration.config import effective_text
from mesotap.session.states import State
from rig import RigError
from sim_backend.emulators.disturbance import DisturbedWire, foreign_rtu
from tests.faults.bench import FaultyBench, quick_config
from tests.faults.cases import LEANING_UM, nobody_taps

SAFE_WITHIN_S = 0.5
DEAD, DROPPED, SHIFTED = ("scale", 0.0), ("offset", -85.0), ("offset", -4.2)


@pytest.mark.parametrize("after_s", [2.0, 2.037, 2.07])  # before, in the midst of and after a reading of the watch
def test_a_load_that_jumps_is_noticed_wherever_in_a_reading_it_does(tmp_path, after_s):
    bench = FaultyBench(tmp_path / "s", quick_config("mesotap.dwell_s=20"))

    def happen() -> None:
        bench.happens(bench.rig.clock.now())
        bench.rig.physics.load_cell.fault = SHIFTED

    bench.when(State.LOCK, 0, 1, lambda: bench.after(after_s, happen))
    outcome = bench.run()
    assert "while the stage stood still" in outcome.reads
    assert outcome.apart_s - outcome.made_s <= SAFE_WITHIN_S


@pytest.mark.parametrize("round_trip_s", [0.0, 0.05])
@pytest.mark.parametrize(
    ("state", "fault"),
    [(State.LOCK, DEAD), (State.LOCK, DROPPED), (State.LOCK, SHIFTED), (State.TAP, DEAD), (State.TAP, DROPPED)],
    ids=str,
)
def test_a_load_that_is_lost_is_noticed_and_nothing_is_pressed_after_it(tmp_path, round_trip_s, state, fault):
    bench = FaultyBench(tmp_path / "s", quick_config("mesotap.dwell_s=20"), round_trip_s=round_trip_s)

    def happen() -> None:
        bench.happens(bench.rig.clock.now())
        bench.rig.physics.load_cell.fault = fault

    def later() -> None:
        if state is State.TAP:
            nobody_taps(bench)
        bench.after(2.037, happen)

    bench.when(state, 0, 1, later)
    outcome = bench.run()
    assert "while the stage stood still" in outcome.reads
    assert "look whether the surfaces are apart" in outcome.reads, "a gauge that lost its load is no witness"
    assert outcome.apart_s - outcome.made_s <= SAFE_WITHIN_S
    assert bench.rig.physics.peak_true_load_mn < 330.0, "the first load of the plan is 300 mN"


@pytest.mark.parametrize("fault", ["over the limit", "does not answer"])
def test_check_watches_the_load_while_a_tap_is_waited_for(tmp_path, monkeypatch, fault):
    path = tmp_path / "c.yaml"
    path.write_text(effective_text(quick_config()))
    wire = DisturbedWire(foreign_rtu, 1)
    seen: dict[str, float] = {}

    def built(config, simulate, operator, seed, emulated, wire_file):
        from mesotap.session.bench import emulated_rig

        rig = emulated_rig(config, operator, seed=1, amplifier_wire=wire)
        clock = rig.clock
        rig.physics.impactor.tap = lambda *what, **more: seen.setdefault("asked", clock.now())
        sleep = clock.sleep

        def slept(seconds: float) -> None:
            sleep(seconds)
            if "asked" in seen and "made" not in seen and clock.now() > seen["asked"] + 2.0:
                seen["made"] = clock.now()
                rig.physics.push(LEANING_UM) if fault == "over the limit" else wire.inject("silent")
            if "made" in seen and rig.physics.true_load_mn() == 0.0:
                seen.setdefault("apart", clock.now())

        clock.sleep, clock.sleep_until = slept, lambda time_s: slept(time_s - clock.now())
        return rig

    monkeypatch.setattr(devices, "build_rig", built)
    told = io.StringIO()
    with pytest.raises(RigError, match="did not pass"):
        devices.check(path, [], False, True, 1, True, None, Console(file=told, width=300))
    assert fault in told.getvalue()
    assert seen["apart"] - seen["made"] <= SAFE_WITHIN_S
