"""The simulated hammer: the force of the tap that was made, and nothing else of the rig different for it."""

from __future__ import annotations

import numpy as np
import pytest

from daq.settings import Trigger
from daq.trigger import Record, record_impact
from rig.settings import Filter, Hammer, RigSettings, Wiring
from sim_backend.rig import SimulatedRig
from sim_backend.settings import BadTaps, SimBackendSettings, SimulatedHammer
from sim_backend.taps import Tap

FILTER = Filter(highpass_hz=0.01)  # whose tail after the pulse is nothing
NONE_BAD = BadTaps(double=0, too_hard=0, too_weak=0, off_centre=0, clipped=0)


def recorded(declared: Hammer | None, **settings) -> tuple[Record, Tap, SimulatedRig]:
    rig = SimulatedRig(
        RigSettings(wiring=Wiring(hammer=declared), filter=FILTER),
        SimBackendSettings(bad_taps=NONE_BAD, **settings),
        seed=4,
    )
    rig.stage.move_by(149.0)
    rig.stage.advance(10.0, 0.1, lambda: rig.true_load_mn() >= 400.0)
    record = record_impact(rig.accelerometers, rig.impactor, rig.clock, Trigger(), 400.0)
    return record, rig.impactor.history[-1], rig


def test_the_force_is_that_of_the_tap():
    record, tap, _ = recorded(
        Hammer(input=3, filtered=False), parameter_errors=False, hammer=SimulatedHammer(noise_n=0)
    )
    assert record.force is not None
    assert record.force.max() == pytest.approx(tap.peaks_n[0], rel=0.02)  # the top may lie between two samples
    impulse = record.force.sum() / record.sample_rate_hz
    assert impulse == pytest.approx(2 / np.pi * tap.peaks_n[0] * 3e-4, rel=0.02)  # of a half sine of 0.3 ms


def test_through_the_filter_it_comes_later_by_as_much_as_the_acceleration():
    plain = recorded(Hammer(input=3, filtered=False), hammer=SimulatedHammer(noise_n=0))[0].force
    passed = recorded(Hammer(input=3), hammer=SimulatedHammer(noise_n=0))[0].force
    centre = [float((f[200:300] @ np.arange(100)) / f[200:300].sum()) for f in (plain, passed)]
    # a Butterworth low-pass of order 4 delays by 2.613 / (2 pi corner), here 10 kHz; at 25 kHz that is 1.04 samples
    assert centre[1] - centre[0] == pytest.approx(1.04, abs=0.25)


def test_with_a_hammer_all_else_is_recorded_as_without():
    without, _, bare = recorded(None)
    with_one, _, rig = recorded(Hammer(input=3))
    assert without.force is None
    assert np.array_equal(without.acceleration, with_one.acceleration)
    assert np.array_equal(without.strain_mv, with_one.strain_mv)
    kept = rig.checkpoint()
    kept["accelerometers"]["rng"].pop("hammer")
    assert kept == bare.checkpoint()


def test_its_sensitivity_is_drawn_from_the_declared_uncertainty():
    gains = [
        SimulatedRig(
            RigSettings(wiring=Wiring(hammer=Hammer(input=3, sensitivity_uncertainty_percent=2.0))),
            SimBackendSettings(),
            seed=seed,
        ).accelerometers.signal.hammer.gain
        for seed in range(40)
    ]
    assert np.mean(gains) == pytest.approx(1.0, abs=0.01)
    assert np.std(gains) == pytest.approx(0.02, rel=0.35)


def test_a_rig_that_is_taken_up_again_hits_on_as_it_would_have():
    _, _, first = recorded(Hammer(input=3))
    kept = first.checkpoint()
    again = SimulatedRig(
        RigSettings(wiring=Wiring(hammer=Hammer(input=3)), filter=FILTER), SimBackendSettings(bad_taps=NONE_BAD), seed=4
    )
    again.restore(kept)
    forces = [record_impact(r.accelerometers, r.impactor, r.clock, Trigger(), 400.0).force for r in (first, again)]
    assert np.array_equal(*forces)
