"""The mixed model: what closed forms say, and how often its intervals contain the truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analysis.mixed_model import TooFew, fit_mixed


def balanced(noise, groups=6, each=4, between=0.05, within=0.02):
    levels = np.repeat(np.arange(groups), each)
    y = 1.0 + between * noise.standard_normal(groups)[levels] + within * noise.standard_normal(groups * each)
    return y, [str(level) for level in levels]


def test_a_balanced_design_gives_what_the_analysis_of_variance_does():
    """Searle, Casella, McCulloch: REML of a balanced one-way layout is the moment estimate where that is positive."""
    y, levels = balanced(np.random.default_rng(2))
    rows = [str(i) for i in range(len(y))]
    fit = fit_mixed(y, np.ones((len(y), 1)), {"between": levels, "within": rows}, intervals=False)
    table = y.reshape(6, 4)
    within = float(np.var(table, axis=1, ddof=1).mean())
    between = (4 * float(np.var(table.mean(axis=1), ddof=1)) - within) / 4
    assert fit.scatters[1].value == pytest.approx(math.sqrt(within), rel=1e-3)
    assert fit.scatters[0].value == pytest.approx(math.sqrt(between), rel=1e-3)
    mean = fit.contrast([1.0])
    assert mean.value == pytest.approx(y.mean())
    assert mean.standard_error == pytest.approx(float(np.std(table.mean(axis=1), ddof=1)) / math.sqrt(6), rel=1e-3)
    assert mean.dof == pytest.approx(5, rel=1e-2)


def test_without_scatter_beyond_the_known_error_the_scatter_is_none():
    noise = np.random.default_rng(4)
    y = 2 + 0.1 * noise.standard_normal(40)
    fit = fit_mixed(y, np.ones((40, 1)), {"between": [str(i // 4) for i in range(40)]}, np.full(40, 0.2**2))
    assert fit.scatters[0].value == 0.0
    assert fit.scatters[0].low == 0.0
    assert fit.contrast([1.0]).standard_error == pytest.approx(0.2 / math.sqrt(40), rel=1e-6)


def test_effects_that_cannot_be_told_apart_are_refused():
    y = np.arange(4.0)
    with pytest.raises(TooFew, match="too few"):
        fit_mixed(y, np.ones((4, 2)), {"rows": list("abcd")})
    with pytest.raises(TooFew, match="too few"):
        fit_mixed(y[:1], np.ones((1, 1)), {"rows": ["a"]})


@pytest.mark.slow
def test_intervals_of_a_difference_contain_it_in_95_of_100():
    """Two groups of four specimens, two sessions each at two loads: 150 draws."""
    noise = np.random.default_rng(7)
    specimen = np.repeat(np.arange(8), 4)
    session = np.repeat(np.arange(16), 2)
    design = np.column_stack([specimen >= 4, np.arange(32) % 2 == 0, np.arange(32) % 2 == 1]).astype(float)
    levels = {"specimen": [str(s) for s in specimen], "session": [str(s) for s in session]}
    levels["load"] = [str(i) for i in range(32)]
    inside = 0
    for _ in range(150):
        y = 0.05 * noise.standard_normal(8)[specimen] + 0.03 * noise.standard_normal(16)[session]
        y = y + 0.01 * noise.standard_normal(32)
        found = fit_mixed(y, design, levels, np.full(32, 0.003**2), intervals=False).contrast([1.0, 0.0, 0.0])
        inside += found.low <= 0 <= found.high
    assert 0.90 <= inside / 150 <= 0.99
