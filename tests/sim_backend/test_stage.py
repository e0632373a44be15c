from __future__ import annotations

from sim_backend.clock import VirtualClock
from sim_backend.settings import SimulatedStage as Settings
from sim_backend.stage import SimulatedStage


class Running(VirtualClock):
    """A clock that goes on whenever it is looked at, as a real one does."""

    def now(self) -> float:
        self.time_s += 1e-3
        return self.time_s


def test_whoever_is_told_of_a_move_sees_one_position_while_the_clock_goes_on():
    seen: list[tuple[float, float]] = []
    clock = Running()

    def moved() -> None:
        seen.append((stage.carriage_um, stage.knob_um))

    stage = SimulatedStage(Settings(backlash_um=0.0, speed_um_per_s=50.0), clock, moved)
    stage.begin(1000.0)  # 20 s: 20,000 looks at the clock
    positions = [stage.knob_um for _ in range(10)]
    assert len(seen) == 10
    assert [knob for _, knob in seen] == [carriage for carriage, _ in seen] == positions
    assert positions == sorted(positions)
