"""Control charts: scores that are independent and normal, false alarms, and how soon a change is told."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from analysis.control_charts import chart, first_alarms, run_lengths


def test_scores_of_a_steady_quantity_are_standard_normal_and_independent():
    noise = np.random.default_rng(3)
    scores = np.array([chart(5 + 0.1 * noise.standard_normal(12)).scores[2:] for _ in range(400)])
    clean = scores[~np.isnan(scores).any(axis=1)]
    assert stats.kstest(clean.ravel(), "norm").pvalue > 0.01
    assert abs(np.corrcoef(clean[:, :-1].ravel(), clean[:, 1:].ravel())[0, 1]) < 0.06


def test_units_do_not_matter():
    values = 1 + 0.01 * np.random.default_rng(1).standard_normal(40)
    values[20:] += 0.03
    assert [a.at for a in chart(values).alarms] == [a.at for a in chart(1e6 * values - 7).alarms]


def test_a_change_is_told_once_with_its_size_and_since_when():
    noise = np.random.default_rng(2)
    values = 100 + noise.standard_normal(80)
    values[40:] -= 3
    (alarm,) = chart(values).alarms
    assert not alarm.upwards
    assert abs(alarm.since - 40) <= 3  # the CUSUM may have left zero by chance a little before
    assert alarm.at <= 45
    assert alarm.change is not None
    assert -3.5 < alarm.change.value < -1.5


def test_alarms_of_many_rows_are_those_of_each():
    values = np.random.default_rng(4).standard_normal((40, 60))
    values[:, 30:] += 1.5
    each = [min([a.at for a in chart(row).alarms], default=60) for row in values]
    assert list(first_alarms(values)) == each


@pytest.mark.parametrize("values", [[], [1.0], [1.0, 2.0], [3.0] * 9])
def test_too_few_or_equal_values_raise_no_alarm(values):
    assert chart(values).alarms == ()


@pytest.mark.slow
def test_one_false_alarm_in_370_values_or_fewer():
    lengths = run_lengths(0.0, 0, 400, 2500, seed=5)
    rate = np.sum(lengths <= 2500) / np.sum(np.minimum(lengths, 2500))
    assert 1 / rate > 370 * 0.9
    assert 1 / rate < 600


@pytest.mark.slow
def test_half_a_percent_is_told_within_ten_sessions_where_they_scatter_by_a_quarter():
    assert np.mean(run_lengths(0.5 / 0.25, 20, 500, 200, seed=6)) < 10
