"""Eq. 9 fitted to frequency responses: what it finds, what it says of its uncertainty, and how often that is right."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.frequency_response.estimators import ForceError
from analysis.frequency_response.impacts import of_hits
from analysis.frequency_response.two_mass import LOWER, UPPER, Seen, TwoMassFit, TwoMassModel, fit_two_mass
from tests.analysis.frequency_response.hits_of_two import K1, K2, M1, M2, RATE, hits, receptance

KC, CC = 8.0e6, 2.3
BAND = (60.0, 4000.0)
TRANSFER = (Seen(0, LOWER),)
START = TwoMassModel(M1, M2, K1, K2, 1.05 * KC, 5.0)


def _fit(records, seen=TRANSFER, scale_error=0.0, start=START) -> TwoMassFit:
    measured = of_hits(records, RATE, [f"channel {i}" for i in range(len(records[0].response))])
    found = measured.response
    return fit_two_mass(measured.spectra, found.frequency_hz, seen, start, BAND, found.decay_per_s, scale_error)


def test_the_model_is_the_closed_form() -> None:
    s = 2j * np.pi * np.linspace(100, 4000, 50)
    model = TwoMassModel(M1, M2, K1, K2, KC, CC, c=4.0)
    for seen in (UPPER, LOWER):
        closed = s**2 * receptance(s, M1, M2, KC, CC, seen=seen, c=4.0)
        assert model.accelerance(s, UPPER, seen) == pytest.approx(closed)


def test_the_transfer_response_tells_stiffness_and_the_sum_of_the_masses() -> None:
    found = _fit(hits(np.random.default_rng(1), KC, CC))
    assert found.contact_stiffness.value == pytest.approx(KC, rel=4e-3)
    assert found.contact_damping.value == pytest.approx(CC, rel=0.05)
    assert found.mass_sum.value == pytest.approx(M1 + M2, rel=4e-3)
    assert found.spring_sum.value == pytest.approx(K1 + K2, rel=5e-3)
    assert found.upper_mass is None
    assert "only their sum" in found.not_identified


def test_with_the_driving_point_both_masses_are_told_apart() -> None:
    """Masses that are far from those the fit begins with."""
    records = hits(np.random.default_rng(2), KC, CC, m1=0.15, m2=0.08, seen=(0, 1))
    start = TwoMassModel(0.115, 0.115, K1, K2, 0.9 * KC, 5.0)
    found = _fit(records, (Seen(0, UPPER), Seen(1, LOWER)), start=start)
    assert found.upper_mass is not None
    assert found.lower_mass is not None
    assert found.upper_mass.value == pytest.approx(0.15, rel=4e-3)
    assert found.lower_mass.value == pytest.approx(0.08, rel=4e-3)
    assert found.contact_stiffness.value == pytest.approx(KC, rel=4e-3)


def test_the_sensitivity_goes_into_masses_and_stiffness_and_is_in_their_interval() -> None:
    found = _fit(hits(np.random.default_rng(1), KC, CC, gain=1.03), scale_error=0.02)
    for estimate, truth in ((found.contact_stiffness, KC), (found.mass_sum, M1 + M2)):
        assert estimate.value == pytest.approx(1.03 * truth, rel=4e-3)
        assert estimate.standard_error == pytest.approx(0.02 * estimate.value, rel=0.05)
        assert estimate.low < truth < estimate.high


def test_a_band_without_lines_is_refused() -> None:
    measured = of_hits(hits(np.random.default_rng(1), KC, CC, count=1, samples=600), RATE, ["x"])
    with pytest.raises(ForceError, match="too few to fit"):
        fit_two_mass(measured.spectra, measured.response.frequency_hz, [Seen(0, LOWER)], START, (100.0, 200.0))


@pytest.mark.long
def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """200 loads of six hits: the random part by leaving one hit out, and the sensitivity drawn for each load."""
    rng = np.random.default_rng(11)
    inside = {"kc": 0, "sum": 0, "random": 0}
    errors = []
    pool = hits(rng, KC, CC, count=40, scatter=4e-4, force_noise=0.0, noise=0.0)
    for _ in range(200):
        chosen = rng.choice(len(pool), 6, replace=False)
        gain = 1 + 0.02 * rng.standard_normal()
        records = [
            type(pool[i])(
                gain * pool[i].force + 3e-3 * rng.standard_normal(pool[i].force.size),
                pool[i].response + 1e-2 * rng.standard_normal(pool[i].response.shape),
                pool[i].name,
            )
            for i in chosen
        ]
        found = _fit(records, scale_error=0.02)
        random = _fit([type(r)(r.force / gain, r.response, r.name) for r in records])
        inside["kc"] += found.contact_stiffness.low < KC < found.contact_stiffness.high
        inside["sum"] += found.mass_sum.low < M1 + M2 < found.mass_sum.high
        inside["random"] += random.contact_stiffness.low < KC < random.contact_stiffness.high
        errors.append(random.contact_stiffness.value / KC - 1)
    # 95 % of 200: 190, with a standard deviation of 3
    assert 180 <= inside["kc"] <= 200
    assert 180 <= inside["sum"] <= 200
    assert inside["random"] >= 180
    assert abs(np.mean(errors)) < 5e-4  # the bias, which `METHOD_ERROR` allows for
