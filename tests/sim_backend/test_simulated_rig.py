"""The simulated rig as a rig: its parts, its faults, its truth, its checkpoint."""

import json
import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rig import RigError
from rig.settings import RigSettings, Wiring
from sim_backend.rig import SimulatedRig
from sim_backend.settings import (
    BadTaps,
    SimBackendSettings,
    SimulatedContact,
    SimulatedGauge,
    SimulatedMechanism,
    SimulatedNoise,
    SimulatedPulse,
    SimulatedStage,
)

GOOD = BadTaps(double=0, too_hard=0, too_weak=0, off_centre=0, clipped=0)
SILENT = SimulatedNoise(rms_m_s2=0)


def simulated(seed=None, rig_settings=None, contact_stiffness=None, **changes):
    options = {"bad_taps": GOOD, **changes}
    return SimulatedRig(rig_settings or RigSettings(), SimBackendSettings(**options), contact_stiffness, seed=seed)


def parting(*laws):
    return tuple(SimulatedMechanism(id=name) for name in (*laws, "contact_loss"))


def bring_to(rig, load_mn):
    rig.stage.move_by(149.0 - rig.stage.read().position_um)
    rig.stage.advance(10.0, 0.1, lambda: rig.true_load_mn() >= load_mn)
    return rig


def record(rig, load_mn=500.0, blocks=60):
    rig.accelerometers.start()
    rig.impactor.tap(load_mn)
    read = [rig.accelerometers.read_block() for _ in range(blocks)]
    rig.accelerometers.stop()
    return np.hstack([b.acceleration for b in read]), np.hstack([b.strain_mv for b in read])


# --- opening, time


def test_opening_names_each_part():
    lines = simulated().open()
    assert [line.split(":")[0] for line in lines] == [
        f"simulated {part}" for part in ("load cell", "stage", "accelerometers", "impactor", "dead weights")
    ]


def test_time_passes_only_by_doing_something():
    rig = simulated()
    assert rig.clock.now() == rig.clock.now()
    rig.clock.sleep(61.5)
    assert rig.clock.now() == 61.5
    assert rig.clock.utc() == "2026-01-01T00:01:01.500Z"


def test_realtime_takes_as_long_as_it_says():
    rig = SimulatedRig(RigSettings(), SimBackendSettings(), realtime=True)
    start = time.perf_counter()
    rig.clock.sleep(0.05)
    assert time.perf_counter() - start >= 0.05


# --- stage and load


def test_load_and_stage_position_are_in_equilibrium():
    rig = bring_to(simulated(parameter_errors=False, stage=SimulatedStage(backlash_um=0)), 500)
    past = (rig.stage.read().position_um - 150.0) * 1e-6
    k1, k2 = RigSettings().spring_stiffness()
    load = rig.true_load_mn() * 1e-3
    assert 0 < past - load / k1 - load / k2 < 3e-6  # the contact's own approach
    rig.stage.move_by(0.1)
    stiffness = 1 / (1 / k1 + 1 / k2 + 1 / rig.truth_at_load(load)["contact_stiffness_n_per_m"])
    assert rig.true_load_mn() * 1e-3 - load == pytest.approx(stiffness * 0.1e-6, rel=0.02)


def test_backlash_has_to_be_used_up_before_the_load_falls():
    rig = bring_to(simulated(stage=SimulatedStage(backlash_um=2.0)), 500)
    load = rig.true_load_mn()
    rig.stage.move_by(-1.9)
    assert rig.true_load_mn() == load
    rig.stage.move_by(-0.5)
    assert rig.true_load_mn() < load


def test_stage_stops_at_multiples_of_its_resolution_and_needs_time():
    rig = simulated(stage=SimulatedStage(resolution_um=0.02, speed_um_per_s=50))
    reading = rig.stage.move_by(10.013)
    assert reading.position_um == pytest.approx(10.02)
    assert reading.time_s > 0.2


def test_clamped_stage_refuses_to_move():
    rig = simulated()
    rig.stage.lock()
    assert rig.stage.read().locked
    with pytest.raises(RigError, match="clamped"):
        rig.stage.move_by(1.0)
    with pytest.raises(RigError, match="clamped"):
        rig.stage.advance(1.0, 0.1, lambda: False)
    rig.stage.unlock()
    assert rig.stage.move_by(1.0).position_um == pytest.approx(1.0)


def test_advance_asks_before_the_first_step_and_after_each():
    rig, asked = simulated(), []
    rig.stage.advance(1.0, 0.3, lambda: asked.append(rig.stage.read().position_um) or False)
    assert asked == pytest.approx([0, 0.3, 0.6, 0.9, 1.0])
    assert rig.stage.advance(1.0, 0.3, lambda: True).position_um == pytest.approx(1.0)


def test_what_stop_raises_ends_the_advance():
    def stop():
        raise RigError("enough")

    rig = simulated()
    with pytest.raises(RigError, match="enough"):
        rig.stage.advance(10.0, 0.5, stop)
    assert rig.stage.read().position_um == 0.0


def test_contact_may_be_nearer_than_expected():
    rig = simulated(contact_position_um=100.0)
    rig.stage.move_by(103.0)
    assert rig.true_load_mn() > 100


def test_largest_load_is_remembered():
    rig = bring_to(simulated(), 700)
    highest = rig.true_load_mn()
    rig.stage.move_by(-50)
    assert rig.true_load_mn() == 0
    assert rig.peak_true_load_mn == highest


def test_physics_keeps_its_micrometer_when_the_stage_is_put_into_a_hand():
    rig = bring_to(simulated(), 300)
    load, rig.stage = rig.true_load_mn(), None
    assert rig.true_load_mn() == load
    assert rig.checkpoint()["stage"]["knob_um"] > 150
    assert any("simulated stage" in line for line in rig.open())


def test_contact_stiffness_may_be_a_function():
    rig = simulated(contact_stiffness=lambda p: 5e6 * p ** (1 / 3))
    assert rig.truth_at_load(0.5)["contact_stiffness_n_per_m"] == pytest.approx(5e6 * 0.5 ** (1 / 3))
    assert rig.truth_at_load(0.5)["zeta2"] > 0


# --- load cell and weights


def test_reading_is_offset_plus_sensitivity_times_weight():
    rig = simulated()
    truth = rig.true_parameters()["sensitivity_mv_per_mn"]
    rig.weights.place(800.0)
    reading = rig.load_cell.read(10.0)
    assert reading.samples == 1000
    assert reading.voltage_mv == pytest.approx(0.35 + truth * 800, abs=0.01)
    assert reading.spread_mv == pytest.approx(0.02, rel=0.2)
    rig.weights.place(0.0)
    assert rig.load_cell.read(10.0).voltage_mv == pytest.approx(0.35, abs=0.003)


def test_the_same_weight_weighs_the_same_again():
    rig = simulated()
    rig.weights.place(300.0)
    first = rig.load_cell.true_voltage()
    rig.weights.place(600.0)
    rig.weights.place(300.0)
    assert rig.load_cell.true_voltage() == first
    assert 0 < abs(rig.weights.true_load_mn - 300.0) < 0.15


def test_weights_need_the_surfaces_apart():
    rig = bring_to(simulated(), 200)
    with pytest.raises(RigError, match="apart"):
        rig.weights.place(100.0)


@pytest.mark.parametrize("load", [-1.0, math.nan, math.inf])
def test_impossible_weights_are_refused(load):
    with pytest.raises(RigError, match="no weight"):
        simulated().weights.place(load)


def test_even_the_shortest_reading_has_a_spread():
    assert simulated().load_cell.read(1e-3).spread_mv > 0


def test_gauge_drifts():
    rig = simulated(gauge=SimulatedGauge(drift_mv_per_hour=0.5, sensitivity_drift_percent_per_hour=1.0, noise_mv=1e-6))
    before = rig.true_parameters()["sensitivity_mv_per_mn"]
    rig.clock.sleep(7200 - 5)
    rig.weights.place(500.0)
    expected = 0.35 + 1.0 + before * 1.02 * rig.weights.true_load_mn
    assert rig.load_cell.read().voltage_mv == pytest.approx(expected, rel=1e-4)


def test_faults_of_the_load_cell():
    rig = bring_to(simulated(), 400)
    cell = rig.load_cell
    good = cell.read()
    cell.fault = "frozen"
    readings = [cell.read() for _ in range(3)]
    assert {r.voltage_mv for r in readings} == {good.voltage_mv}
    assert all(r.spread_mv == 0 for r in readings)
    cell.fault = ("scale", 0.5)
    assert cell.read().voltage_mv - 0.35 == pytest.approx((good.voltage_mv - 0.35) / 2, abs=0.05)
    cell.fault = ("offset", -3.0)
    assert cell.read().voltage_mv == pytest.approx(good.voltage_mv - 3, abs=0.05)
    cell.fault = "nan"
    assert math.isnan(cell.read().voltage_mv)
    cell.fault = "late"
    assert cell.read().time_s < rig.clock.now() - 1
    cell.fault = "dropout"
    with pytest.raises(RigError, match="does not answer"):
        cell.read()
    with pytest.raises(RigError, match="does not answer"):
        rig.open()
    cell.fault = None
    assert cell.read().voltage_mv == pytest.approx(good.voltage_mv, abs=0.05)


# --- truth


def test_without_parameter_errors_the_rig_is_as_declared():
    declared = RigSettings()
    truth = simulated(parameter_errors=False).true_parameters()
    assert (truth["m1"], truth["m2"]) == (declared.masses.m1_kg, declared.masses.m2_kg)
    assert (truth["k1"], truth["k2"]) == declared.spring_stiffness()
    assert truth["sensitivity_mv_per_mn"] == declared.gauge_sensitivity_mv_per_mn


def test_parameter_errors_have_the_declared_size():
    drawn = [simulated(seed=i).true_parameters() for i in range(300)]
    k, _ = RigSettings().spring_stiffness()
    assert np.std([d["m1"] for d in drawn]) == pytest.approx(5e-5, rel=0.2)
    assert np.std([d["k1"] / k for d in drawn]) == pytest.approx(0.01, rel=0.2)
    assert np.std([d["sensitivity_mv_per_mn"] / 0.042 for d in drawn]) == pytest.approx(0.015, rel=0.2)
    assert max(abs(d["k1"] / d["k2"] - 1) for d in drawn) < 0.0051


def test_truth_at_a_load_of_the_table():
    truth = simulated(parameter_errors=False).truth_at_load(0.5248)
    assert truth["load_mn"] == pytest.approx(524.8)
    assert truth["contact_stiffness_n_per_m"] == pytest.approx(7.59e6)
    assert truth["f1_hz"] == pytest.approx(356, rel=1e-3)
    assert truth["f2_hz"] == pytest.approx(1925, rel=2e-3)
    # the tube springs stiffen the mode, so its ratio is a little below that of the free masses
    assert truth["zeta2"] == pytest.approx(0.0018, rel=0.05)


def test_tube_damping_shows_in_the_system_mode():
    truth = simulated(tube_damping_ratio=0.004).truth_at_load(0.5)
    assert truth["zeta1"] == pytest.approx(0.004, rel=0.02)


# --- taps


def spectrum_peak(signal, rate, low, high):
    spectrum = np.abs(np.fft.rfft(signal * np.hanning(len(signal)), 8 * len(signal)))
    f = np.fft.rfftfreq(8 * len(signal), 1 / rate)
    inside = (f > low) & (f < high)
    return f[inside][np.argmax(spectrum[inside])]


def test_record_rings_at_the_true_frequencies():
    rig = bring_to(simulated(noise=SILENT), 500)
    a, _ = record(rig)
    truth = rig.truth_at_load(rig.true_load_mn() * 1e-3)
    start = np.argmax(np.abs(a[0]) > 0.01) + 20
    assert spectrum_peak(a[0, start : start + 8000], 25000, 200, 600) == pytest.approx(truth["f1_hz"], rel=1e-3)
    assert spectrum_peak(a[0, start : start + 8000], 25000, 1000, 4000) == pytest.approx(truth["f2_hz"], rel=1e-3)


def test_both_accelerometers_see_a_centred_tap_alike():
    a, _ = record(bring_to(simulated(noise=SILENT), 500))
    assert np.array_equal(a[0], a[1])
    assert np.max(np.abs(a)) > 0.5


def test_tap_comes_soon_but_not_at_once():
    rig = bring_to(simulated(noise=SILENT), 500)
    for _ in range(10):
        a, _ = record(rig, blocks=25)
        first = np.argmax(np.abs(a[0]) > 0.01) / 25000
        assert 0.05 < first < 0.2 + 1e-3


def test_contact_force_reaches_the_chosen_share_of_the_preload():
    pulse = SimulatedPulse(peak_force_ratio=0.5, strength_scatter_percent=0)
    rig = bring_to(simulated(pulse=pulse, noise=SILENT, gauge=SimulatedGauge(noise_mv=1e-9)), 500)
    load = rig.true_load_mn()
    a, strain = record(rig, load)
    truth = rig.true_parameters()
    # m2 a2 + k2 x2, as the recorder can know it; the filter's delay of some 40 us spoils it a little
    dynamic_mn = (strain - strain[0]) / truth["sensitivity_mv_per_mn"]
    force = truth["m2"] * a[0] * 1e3 + dynamic_mn
    assert np.max(np.abs(force)) / load == pytest.approx(0.5, abs=0.1)


def test_strain_gauge_sees_static_and_dynamic_load():
    rig = bring_to(simulated(noise=SILENT, gauge=SimulatedGauge(noise_mv=1e-9)), 500)
    a, strain = record(rig)
    truth = rig.true_parameters()
    step = 312.5 / 2**15
    static = 0.35 + truth["sensitivity_mv_per_mn"] * rig.true_load_mn()
    assert strain[0] == pytest.approx(static, abs=0.501 * step)
    # in the system mode alone a2 = -omega1^2 x2
    x2 = (strain - strain[0]) / truth["sensitivity_mv_per_mn"] * 1e-3 / truth["k2"]
    f1 = rig.truth_at_load(rig.true_load_mn() * 1e-3)["f1_hz"]
    late = slice(10000, 14000)
    expected = np.std(x2[late]) * (2 * np.pi * f1) ** 2
    assert np.std(a[0, late]) == pytest.approx(expected, rel=0.15)


def test_no_strain_channel_unless_it_is_wired():
    rig = simulated(rig_settings=RigSettings(wiring=Wiring(strain_gauge_input=None)))
    rig.accelerometers.start()
    assert rig.accelerometers.read_block().strain_mv is None


def test_blocks_follow_each_other_and_take_their_time():
    rig = simulated()
    rig.clock.sleep(1.0)
    rig.accelerometers.start()
    blocks = [rig.accelerometers.read_block() for _ in range(5)]
    assert [b.first_sample for b in blocks] == [0, 256, 512, 768, 1024]
    assert rig.clock.now() == pytest.approx(1.0 + 5 * 256 / 25000)


def test_recorder_gives_whole_codes():
    rig = simulated()
    rig.accelerometers.start()
    codes = rig.accelerometers.read_block().acceleration / (rig.accelerometers.full_scale_m_s2 / 2**15)
    assert codes == pytest.approx(np.round(codes), abs=1e-9)
    assert np.ptp(codes) > 1


def test_reading_without_starting_is_refused():
    with pytest.raises(RigError, match="not streaming"):
        simulated().accelerometers.read_block()


def test_faults_of_the_recorder():
    rig = simulated()
    rig.accelerometers.start()
    rig.accelerometers.fault = "gap"
    assert rig.accelerometers.read_block().first_sample == 256
    assert rig.accelerometers.read_block().first_sample == 512
    rig.accelerometers.fault = "silence"
    with pytest.raises(RigError, match="sent nothing"):
        rig.accelerometers.read_block()


def test_tap_before_the_start_of_the_stream_is_still_heard():
    rig = bring_to(simulated(noise=SILENT), 500)
    rig.impactor.tap(500.0)
    rig.accelerometers.start()
    a = np.hstack([rig.accelerometers.read_block().acceleration for _ in range(25)])
    assert np.max(np.abs(a)) > 0.5


def test_the_tester_is_at_rest_when_the_next_stream_starts():
    rig = bring_to(simulated(noise=SILENT), 500)
    record(rig, blocks=22)
    rig.accelerometers.start()
    assert not np.any(rig.accelerometers.read_block().acceleration)


def test_a_tap_with_the_surfaces_apart_leaves_the_lower_mass_alone():
    rig = simulated(noise=SILENT)
    a, _ = record(rig)
    assert not np.any(a)


def test_impacts_scatter_as_told():
    contact = SimulatedContact(stiffness_scatter_percent=0.5, damping_scatter_percent=4.0)
    rig = bring_to(simulated(contact=contact), 500)
    for _ in range(100):
        rig.impactor.tap(500.0)
    taps = list(rig.impactor.history)
    assert np.std([t.stiffness_factor for t in taps]) == pytest.approx(0.005, rel=0.3)
    assert np.std([t.damping_factor for t in taps]) == pytest.approx(0.04, rel=0.3)
    assert np.std([t.peaks_n[0] for t in taps]) / np.mean([t.peaks_n[0] for t in taps]) == pytest.approx(0.2, rel=0.3)


@pytest.mark.parametrize("load", [math.nan, -1.0, math.inf])
def test_a_tap_for_an_unknown_load_is_refused(load):
    with pytest.raises(RigError, match="must be known"):
        simulated().impactor.tap(load)


def bad(kind):
    rig = bring_to(simulated(bad_taps=BadTaps(**{**GOOD.model_dump(), kind: 1.0}), noise=SILENT), 500)
    a, _ = record(rig)
    assert rig.impactor.history[-1].kinds == (kind,)
    return rig, a


def test_double_taps_have_a_second_weaker_impact():
    rig, _ = bad("double")
    tap = rig.impactor.history[-1]
    assert 1.5e-3 <= tap.delays_s[1] <= 6e-3
    assert 0.3 <= tap.peaks_n[1] / tap.peaks_n[0] <= 0.6


def test_off_centre_taps_rock_the_mass():
    _, a = bad("off_centre")
    first = np.argmax(np.abs(a[0]) > 0.01)
    early = a[:, first : first + 40]
    assert np.max(np.abs(early[0] - early[1])) > 0.4 * np.max(np.abs(early.mean(axis=0)))
    late = a[:, first + 2500 : first + 3000]
    assert np.max(np.abs(late[0] - late[1])) < 0.05 * np.max(np.abs(late))


def test_too_hard_taps_exceed_the_preload():
    rig, a = bad("too_hard")
    assert np.max(np.abs(a)) * rig.true_parameters()["m2"] > 0.9 * rig.true_load_mn() * 1e-3


def test_too_weak_taps_hardly_show():
    _, a = bad("too_weak")
    assert np.max(np.abs(a)) < 0.1


def test_clipped_taps_reach_the_end_of_the_scale():
    rig, a = bad("clipped")
    step = rig.accelerometers.full_scale_m_s2 / 2**15
    assert np.max(np.abs(a)) >= rig.accelerometers.full_scale_m_s2 - step


def test_bad_taps_come_at_their_rates_and_half_as_often_after_a_hint():
    rig = bring_to(simulated(bad_taps=BadTaps(double=0.4, too_hard=0, too_weak=0, off_centre=0, clipped=0)), 500)

    def share(hint):
        kinds = []
        for _ in range(200):
            rig.impactor.tap(500.0, hint)
            kinds.append("double" in rig.impactor.history[-1].kinds)
        return np.mean(kinds)

    assert share("") == pytest.approx(0.4, abs=0.12)
    assert share("double hit") == pytest.approx(0.2, abs=0.1)


@pytest.mark.parametrize("laws", [(), ("hertz_stiffness",), ("rough_surface_stiffness",)])
@pytest.mark.parametrize("load", [60.0, 900.0])
def test_every_law_survives_every_kind_of_tap(laws, load):
    every = BadTaps(double=0.5, too_hard=0.3, too_weak=0.2, off_centre=0.5, clipped=0.3)
    rig = bring_to(simulated(mechanisms=parting(*laws), bad_taps=every), load)
    for _ in range(4):
        a, strain = record(rig, load, blocks=25)
        assert np.all(np.isfinite(a))
        assert np.all(np.isfinite(strain))


# --- the same again, and from a checkpoint


def do(rig, operation):
    """Do one thing and return what came of it, as plain numbers."""
    kind, amount = operation
    try:
        if kind == "read":
            r = rig.load_cell.read(0.02 + 0.1 * amount)
            return [r.time_s, r.voltage_mv, r.spread_mv, r.samples]
        if kind == "move":
            return [rig.stage.move_by(4 * amount - 1.5).position_um, rig.true_load_mn()]
        if kind == "approach":
            return [rig.stage.move_by(151.0 + 2 * amount - rig.stage.read().position_um).position_um]
        if kind == "lock":
            (rig.stage.lock if amount > 0.5 else rig.stage.unlock)()
            return [float(rig.stage.read().locked)]
        if kind == "weight":
            rig.weights.place(1000 * amount)
            return [rig.load_cell.true_voltage()]
        if kind == "strike":
            rig.impactor.tap(1000 * amount)
            return [rig.clock.now()]
        if kind == "fault":
            rig.load_cell.fault = "frozen" if amount > 0.5 else None
            return []
        a, strain = record(rig, 600 * amount, blocks=8)
        return [*a.ravel(), *strain]
    except RigError as e:
        return [str(e)]


operations = st.lists(
    st.tuples(
        st.sampled_from(["read", "move", "approach", "lock", "weight", "strike", "fault", "record"]), st.floats(0, 1)
    ),
    max_size=8,
)
RESTLESS = SimBackendSettings(
    gauge=SimulatedGauge(drift_mv_per_hour=3.0, sensitivity_drift_percent_per_hour=2.0),
    bad_taps=BadTaps(double=0.3, too_hard=0.3, too_weak=0.2, off_centre=0.4, clipped=0.2),
)


@settings(max_examples=40, deadline=None)
@given(operations, operations, st.integers(0, 3))
def test_a_restored_rig_goes_on_bit_for_bit(before, after, seed):
    rig = SimulatedRig(RigSettings(), RESTLESS, seed=seed)
    for operation in before:
        do(rig, operation)
    kept = json.loads(json.dumps(rig.checkpoint(), allow_nan=False))
    other = SimulatedRig(RigSettings(), RESTLESS, seed=seed)
    other.restore(kept)
    for operation in after:
        assert do(rig, operation) == do(other, operation)
    assert rig.checkpoint() == other.checkpoint()
    assert rig.true_load_mn() == other.true_load_mn()
    assert rig.clock.utc() == other.clock.utc()


def test_nonlinear_taps_are_restored_too():
    rigs = [bring_to(simulated(mechanisms=parting("hertz_stiffness")), 400) for _ in range(2)]
    rigs[0].impactor.tap(400.0)
    rigs[1].restore(json.loads(json.dumps(rigs[0].checkpoint())))
    first, second = (record(r, 400.0, blocks=10) for r in rigs)
    assert np.array_equal(first[0], second[0])


def test_a_checkpoint_of_another_seed_is_refused():
    with pytest.raises(RigError, match="not of this simulated rig"):
        simulated(seed=2).restore(simulated(seed=3).checkpoint())


def test_the_same_seed_gives_the_same_records_and_another_seed_others():
    first, again, other = (record(bring_to(simulated(seed=s), 500), blocks=25)[0] for s in (5, 5, 6))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_closing_twice_is_harmless():
    rig = simulated()
    rig.accelerometers.start()
    rig.close()
    rig.close()
    with pytest.raises(RigError, match="not streaming"):
        rig.accelerometers.read_block()
