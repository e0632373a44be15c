"""The load behind a voltage between two calibrations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.gauge import GaugeHistory
from calibration.settings import CalibrationSettings
from daq.records import CalibrationPoints, ZeroReading

WEIGHTS = np.array([0.0, 100, 200, 400, 600, 800, 1000])
UP_DOWN = np.concatenate([WEIGHTS, WEIGHTS[::-1]])
EIGHT, NINE, TEN = "2024-05-01T08:00:00.000Z", "2024-05-01T09:00:00Z", "2024-05-01T10:00:00.5Z"
SETTINGS = CalibrationSettings(gravity_m_s2=9.81)
# nothing but the readings: weights without error, no drift but the one that is seen; of the force there remains 0.009 %
EXACT = SETTINGS.model_copy(
    update={
        "weight_uncertainty_mn": 0.0,
        "zero_drift_mn_per_root_hour": 0.0,
        "sensitivity_drift_percent_per_root_hour": 0.0,
    }
)


def line(time, offset=0.35, sensitivity=0.042, noise=0.0, rng=None, load=UP_DOWN):
    scatter = 0.0 if rng is None else rng.normal(0, noise, len(load))
    return CalibrationPoints(load, offset + sensitivity * load + scatter, time)


def test_slope_and_offset_are_interpolated_in_time():
    history = GaugeHistory(line(EIGHT), line("2024-05-01T10:00:00Z", 0.55, 0.043), SETTINGS)
    scale = history.scale_at("2024-05-01T08:30:00Z")
    assert scale.offset_mv == pytest.approx(0.40)
    assert scale.sensitivity_mv_per_mn == pytest.approx(0.04225)
    assert history.load_at(0.40 + 0.04225 * 500, "2024-05-01T08:30:00Z").value == pytest.approx(500)


def test_no_calibration_gives_no_load():
    history = GaugeHistory(None, None, SETTINGS)
    assert history.load_at(1.0, NINE) is None
    assert history.scale_at(NINE) is None
    assert history.result() is None
    assert history.notes


@pytest.mark.parametrize("which", ["before", "after"])
def test_one_calibration_holds_throughout_with_a_note(which):
    only = line(EIGHT, 0.4)
    history = GaugeHistory(only, None, SETTINGS) if which == "before" else GaugeHistory(None, only, SETTINGS)
    assert history.load_at(0.4 + 42.0, NINE).value == pytest.approx(1000)
    assert which in history.notes[0]
    result = history.result()
    assert result.drift_p_value is None
    assert not result.drifted
    assert which in result.statement


def test_an_unusable_calibration_counts_as_absent():
    broken = CalibrationPoints(np.array([100.0, 100.0]), np.array([4.2, 4.2]), TEN)
    history = GaugeHistory(line(EIGHT), broken, SETTINGS)
    assert history.post_fit is None
    assert "after the test cannot be used" in history.notes[0]
    assert history.load_at(0.35 + 21, NINE).value == pytest.approx(500)


@pytest.mark.parametrize("time", ["", "noon", "2024-13-01T00:00:00Z", None])
def test_a_time_that_cannot_be_read_is_midway(time):
    history = GaugeHistory(line(EIGHT, 0.3), line(TEN, 0.5), SETTINGS)
    fraction, note = history.fraction_at(time)
    assert fraction == 0.5
    assert "not an ISO 8601 time" in note
    assert history.scale_at(time).offset_mv == pytest.approx(0.4)


@pytest.mark.parametrize("time", ["0001-01-01T00:00:00+10:00", "2024-05-01T12:30:00Z", "1970-01-01T00:00:00Z"])
def test_a_clock_set_wrong_is_midway(time):
    fraction, note = GaugeHistory(line(EIGHT, 0.3), line(TEN, 0.5), SETTINGS).fraction_at(time)
    assert fraction == 0.5
    assert "far from both" in note


@pytest.mark.parametrize("times", [("x", TEN), (EIGHT, ""), (EIGHT, EIGHT), (TEN, EIGHT)])
def test_calibration_times_that_tell_nothing_mean_midway(times):
    history = GaugeHistory(line(times[0]), line(times[1]), SETTINGS)
    fraction, note = history.fraction_at(NINE)
    assert fraction == 0.5
    assert "cannot be told apart" in note


def test_times_with_and_without_fraction_and_zone_are_read():
    history = GaugeHistory(line("2024-05-01T08:00:00"), line("2024-05-01T12:00:00+02:00"), SETTINGS)
    assert history.fraction_at("2024-05-01T09:00:00.000Z") == (0.5, "")


@pytest.mark.parametrize(("time", "offset"), [("2024-05-01T07:00:00Z", 0.3), ("2024-05-01T11:00:00Z", 0.5)])
def test_outside_the_nearest_calibration_holds(time, offset):
    history = GaugeHistory(line(EIGHT, 0.3), line("2024-05-01T10:00:00Z", 0.5), SETTINGS)
    assert history.scale_at(time).offset_mv == pytest.approx(offset)
    assert history.fraction_at(time)[1]


def test_bridge_is_widest_midway_and_absent_without_drift():
    drifted = GaugeHistory(line(EIGHT, 0.35), line("2024-05-01T10:00:00Z", 0.35 + 0.42), EXACT)  # by 10 mN
    near = {"rel": 1e-3, "abs": 0.06}
    assert drifted.load_at(20.0, NINE).standard_error == pytest.approx(5.0, **near)
    assert drifted.load_at(20.0, EIGHT).standard_error == pytest.approx(0.0, **near)
    assert drifted.load_at(20.0, "2024-05-01T08:30:00Z").standard_error == pytest.approx(10 * np.sqrt(3 / 16), **near)
    assert drifted.load_at(20.0, "2024-05-01T11:00:00Z").standard_error == pytest.approx(10 * np.sqrt(1 / 2), **near)
    steady = GaugeHistory(line(EIGHT), line(TEN), EXACT)
    assert steady.load_at(20.0, NINE).standard_error == pytest.approx(0.0, **near)


def test_uncertainty_of_the_reading_is_propagated():
    history = GaugeHistory(line(EIGHT), line(TEN), EXACT)
    assert history.load_at(20.0, NINE, 0.021).standard_error == pytest.approx(0.5, rel=1e-2)


def shares(budget):
    return {c.source: c.uncertainty for c in budget.contributions}


def test_errors_of_weights_do_not_average_out_between_the_calibrations():
    history = GaugeHistory(line(EIGHT), line(TEN), SETTINGS)
    single = GaugeHistory(line(EIGHT), None, SETTINGS)
    midway, alone = (shares(h.budget_at(20.0, NINE))["weights, each by itself"] for h in (history, single))
    assert midway == pytest.approx(alone, rel=1e-6)


def test_unknown_gravity_counts_in_proportion_to_the_load():
    unknown = GaugeHistory(line(EIGHT), line(TEN), CalibrationSettings())
    for load in (200.0, 900.0):
        parts = shares(unknown.budget_at(0.35 + 0.042 * load, NINE))
        (part,) = (u for source, u in parts.items() if source.startswith("local gravity"))
        assert part / load == pytest.approx(0.055 / 2 / np.sqrt(3) / 9.8045, rel=1e-3)


def test_a_gauge_that_is_bent_is_read_by_its_curve():
    bent = 0.45 * WEIGHTS / 1000 * (1 - WEIGHTS / 1000)
    twice = np.concatenate([bent, bent[::-1]])
    both = [CalibrationPoints(UP_DOWN, 0.35 + 0.042 * UP_DOWN + twice, time) for time in (EIGHT, TEN)]
    load = GaugeHistory(*both, EXACT).load_at(0.35 + 21.0 + 0.45 / 4, NINE)
    assert load.value == pytest.approx(500.0, abs=1e-6)
    assert load.standard_error < 0.06


def test_a_loop_between_up_and_down_counts_as_either_of_its_sides():
    x = WEIGHTS / 1000
    loop = 0.021 * 4 * x * (1 - x)  # half a millinewton to either side at 500 mN
    voltage = 0.35 + 0.042 * UP_DOWN + np.concatenate([-loop, loop[::-1]])
    both = [CalibrationPoints(UP_DOWN, voltage, time) for time in (EIGHT, TEN)]
    history = GaugeHistory(*both, EXACT)
    load = history.load_at(0.35 + 0.042 * 400 + 0.021 * 0.96, NINE)  # 400 mN on the way down
    assert load.value == pytest.approx(400.48, abs=1e-3)
    assert shares(history.budget_at(0.35 + 0.042 * 400, NINE))["hysteresis"] == pytest.approx(0.48, rel=1e-2)
    assert load.low <= 400.0
    assert load.half_width < 0.60


def test_a_bump_is_followed_where_the_gauge_was_read_without_load():
    times = [f"2024-05-01T{8 + m // 60:02d}:{m % 60:02d}:00Z" for m in range(10, 120, 10)]
    bump = [0.042 * 1.2 * np.sin(np.pi * m / 120) for m in range(10, 120, 10)]
    zeros = [ZeroReading(0.35 + b, time) for b, time in zip(bump, times, strict=True)]
    calibrations = line(EIGHT), line("2024-05-01T10:00:00Z")
    voltage = 0.35 + 0.042 * (500 + 1.2)
    blind, seeing = (GaugeHistory(*calibrations, SETTINGS, z).load_at(voltage, NINE) for z in ((), zeros))
    assert blind.value == pytest.approx(501.2, abs=0.01)
    assert seeing.value == pytest.approx(500.0, abs=0.01)
    assert seeing.low < 500 < seeing.high


@pytest.mark.parametrize(
    ("zeros", "declared", "said"),
    [((), None, True), ((ZeroReading(0.35, NINE),), None, False), ((), 0.3, False)],
    ids=["nothing", "a reading", "declared"],
)
def test_it_is_said_where_a_drift_that_comes_and_goes_is_not_covered(zeros, declared, said):
    settings = SETTINGS.model_copy(update={"zero_drift_mn_per_root_hour": declared})
    statement = GaugeHistory(line(EIGHT), line(TEN), settings, zeros).result().statement
    assert ("came and went" in statement) is said


@pytest.mark.parametrize(
    ("declared", "standard", "source"),
    [
        ({"zero_limit_mn": 1.2}, 1.2 / np.sqrt(3), "zero between its readings, limits declared"),
        (
            {"zero_mn_per_k": 0.6, "temperature_uncertainty_k": 0.5},
            0.3,
            "temperature against the calibrations, zero",
        ),
    ],
)
def test_what_is_declared_of_the_zero_is_a_row_of_the_budget(declared, standard, source):
    settings = EXACT.model_copy(update=declared)
    history = GaugeHistory(line(EIGHT), line(TEN), settings)
    rows = {c.source: c.uncertainty for c in history.budget_at(0.35 + 42.0, NINE, 0.0).contributions}
    assert rows[source] == pytest.approx(standard)
    assert (
        "came and went"
        not in GaugeHistory(line(EIGHT), line(TEN), SETTINGS.model_copy(update=declared)).result().statement
    )


def test_a_bump_within_the_declared_limits_is_covered():
    rng = np.random.default_rng(21)
    limits, inside = 1.2, []
    settings = SETTINGS.model_copy(update={"zero_limit_mn": limits})
    history = GaugeHistory(line(EIGHT, noise=0.003, rng=rng), line(TEN, noise=0.003, rng=rng), settings)
    for _ in range(400):
        bump = limits * rng.uniform(-1, 1)
        found = history.load_at(0.35 + 0.042 * (500 + bump) + 0.003 * rng.standard_normal(), NINE, 0.003)
        inside.append(abs(found.value - 500) <= found.half_width)
    assert 0.92 <= np.mean(inside) <= 0.98


def test_zero_readings_whose_time_is_unknown_are_left_out():
    zeros = [ZeroReading(5.0, "noon"), ZeroReading(5.0, "2024-05-02T09:00:00Z"), ZeroReading(float("nan"), NINE)]
    history = GaugeHistory(line(EIGHT), line(TEN), SETTINGS, zeros)
    assert history.result().zero_readings == 0
    assert history.load_at(0.35 + 21.0, NINE).value == pytest.approx(500.0)


@given(st.floats(0.01, 1), st.floats(0.5, 2), st.floats(-5, 5), st.floats(-10, 50), st.integers(0, 120))
def test_a_load_lies_between_those_of_both_calibrations(sensitivity, change, drift, voltage, minute):
    first, second = line(EIGHT, 0.3, sensitivity), line("2024-05-01T10:00:00Z", 0.3 + drift, sensitivity * change)
    history = GaugeHistory(first, second, SETTINGS)
    load = history.load_at(voltage, f"2024-05-01T{8 + minute // 60:02d}:{minute % 60:02d}:00Z")
    ends = [history.pre_fit.scale.load_mn(voltage), history.post_fit.scale.load_mn(voltage)]
    assert min(ends) - 1e-6 <= load.value <= max(ends) + 1e-6
    assert load.low <= load.value <= load.high


def test_a_voltage_that_is_no_number_has_no_load():
    assert GaugeHistory(line(EIGHT), None, SETTINGS).load_at(float("nan"), NINE) is None


@pytest.mark.parametrize(
    "scenario", ["still", *(pytest.param(drifts, marks=pytest.mark.slow) for drifts in ("steady", "jump"))]
)
def test_load_intervals_cover(scenario):
    rng = np.random.default_rng(11)
    draws, hits = 500, 0
    drift = 0.0 if scenario == "still" else 0.3  # mV over the test
    for _ in range(draws):
        errors = rng.normal(0, 0.1, len(WEIGHTS)) * (WEIGHTS > 0)
        hung = np.concatenate([WEIGHTS + errors, (WEIGHTS + errors)[::-1]])
        pre = CalibrationPoints(UP_DOWN, 0.35 + 0.042 * hung + rng.normal(0, 0.005, len(hung)), EIGHT)
        post = CalibrationPoints(
            UP_DOWN, 0.35 + drift + 0.042 * hung + rng.normal(0, 0.005, len(hung)), "2024-05-01T10:00:00Z"
        )
        tau = rng.uniform()
        time = f"2024-05-01T{8 + int(tau * 120) // 60:02d}:{int(tau * 120) % 60:02d}:00Z"
        share = {"still": 0.0, "steady": int(tau * 120) / 120, "jump": float(rng.uniform() < tau)}[scenario]
        load = rng.uniform(50, 1000)
        voltage = 0.35 + drift * share + 0.042 * load + rng.normal(0, 0.005)
        estimate = GaugeHistory(pre, post, SETTINGS).load_at(voltage, time, 0.005)
        hits += estimate.low <= load <= estimate.high
    assert hits / draws > 0.92
    if scenario == "still":
        assert hits / draws < 0.985


@pytest.mark.slow
def test_a_random_walk_is_covered_as_far_as_one_increment_can_tell():
    # Bridge over the increment of a walk of unknown size is Student's t with one degree of freedom.
    rng = np.random.default_rng(12)
    draws, hits = 400, 0
    for _ in range(draws):
        half, end = np.cumsum(rng.normal(0, 5.0, 2))  # mN
        history = GaugeHistory(line(EIGHT), line("2024-05-01T10:00:00Z", 0.35 + 0.042 * end), EXACT)
        estimate = history.load_at(0.35 + 0.042 * (500 + half), NINE)
        hits += estimate.low <= 500 <= estimate.high
    assert 0.92 < hits / draws < 0.98


def test_result_is_the_line_midway():
    rng = np.random.default_rng(13)
    history = GaugeHistory(line(EIGHT, 0.3, 0.0418, 0.01, rng), line(TEN, 0.5, 0.0422, 0.01, rng), SETTINGS)
    result = history.result()
    assert result.drifted
    assert result.drift_p_value < 0.01
    assert result.sensitivity_mv_per_mn.value == pytest.approx(0.042, rel=1e-3)
    assert result.sensitivity_mv_per_mn.low < 0.042 < result.sensitivity_mv_per_mn.high
    assert "differ" in result.statement


def test_published_sensitivity_is_within_its_interval():
    rng = np.random.default_rng(14)
    result = GaugeHistory(line(EIGHT, noise=0.02, rng=rng), line(TEN, noise=0.02, rng=rng), SETTINGS).result()
    assert result.sensitivity_mv_per_mn.low < 0.042 < result.sensitivity_mv_per_mn.high  # Sec. 3.2
    assert not result.drifted


@given(
    st.lists(st.sampled_from([0.0, 100.0, 250.0, 500.0, 1000.0]), min_size=2, max_size=14),
    st.lists(st.floats(-50, 50), min_size=14, max_size=14),
    st.floats(-100, 100),
)
def test_whatever_the_points_a_load_is_a_number_or_none(weights, errors, voltage):
    load = np.array(weights)
    points = CalibrationPoints(load, 0.35 + 0.042 * load + np.array(errors[: len(load)]), EIGHT)
    found = GaugeHistory(points, line(TEN), SETTINGS).load_at(voltage, NINE)
    assert np.isfinite([found.value, found.standard_error, found.half_width]).all()
    assert found.half_width > 0


def test_more_readings_than_anybody_takes_are_no_calibration():
    many = np.linspace(0, 1000, 3000)
    history = GaugeHistory(CalibrationPoints(many, 0.042 * many, EIGHT), None, SETTINGS)
    assert "3000 readings" in history.notes[0]
