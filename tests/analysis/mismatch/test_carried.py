"""Rigs, records and signatures many at a time are what they are one by one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.mismatch import diagnosis, screen
from analysis.mismatch.fit import Fit, fit
from analysis.mismatch.linear import linear_rig, linear_rigs
from analysis.mismatch.model import Model, Variant
from analysis.mismatch.problem import Problem, Term
from daq.session_file import read_session
from mesotap.proof.generator.deck import Card, make
from sim_backend.arrangement import tester as two_masses
from sim_backend.mechanisms.mechanism import mechanisms
from sim_backend.recorder import analog_filter

LISTED = list(mechanisms().values())


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    folder: Path = tmp_path_factory.mktemp("session")
    card = Card(3, "single", ("hunt_crossley_damping",), (30.0,))
    make(11, card, folder)
    whole = diagnosis.tester_problem(read_session(folder / f"{card.name}.h5"))
    return whole.only([0, 1, 2, len(whole.recordings.records) - 1])


@pytest.fixture(scope="module")
def baseline(problem: Problem) -> Fit:
    with np.errstate(all="ignore"):  # of a trial step
        return fit(problem)


def test_rigs_solved_together_are_those_solved_alone(problem: Problem) -> None:
    rig = two_masses(0.107, 0.108, 5e5, 5e5, 1e6, 1.0, mass_uncertainty=1e-3, spring_uncertainty=1e-2)
    rig = mechanisms()["attached_mass"].extend(  # type: ignore[misc]
        rig, {"attached_mass_kg": 0.004, "mount_stiffness_n_per_m": 4e5, "mount_damping_n_s_per_m": 1.0}
    )
    rng = np.random.default_rng(1)
    values = {k: v * rng.uniform(0.7, 1.4, 12) for k, v in rig.declared().items()}
    values["cc"][5] = 2e4  # more than critical: as many modes, of another kind
    noise, rate = problem.recordings.noise, problem.recordings.sample_rate_hz
    together = linear_rigs(rig, values, problem.analog, noise, rate)
    assert len({r.poles.size for r in together}) == 2
    for i, found in enumerate(together):
        alone = linear_rig(rig, {k: float(v[i]) for k, v in values.items()}, problem.analog, noise, rate)
        for name in ("poles", "gains", "filtered", "drive", "direct", "weight"):
            np.testing.assert_allclose(getattr(found, name), getattr(alone, name), rtol=1e-9, err_msg=name)


def test_a_rig_without_filter_keeps_its_poles(problem: Problem) -> None:
    rig = two_masses(0.107, 0.108, 5e5, 5e5, 1e6, 0.0, mass_uncertainty=1e-3, spring_uncertainty=1e-2)
    from rig.settings import Filter

    found = linear_rig(rig, rig.declared(), analog_filter(Filter(family="none")), problem.recordings.noise, 25e3)
    # det(K - w^2 M) = 0 of the two masses
    m1, m2, k, kc = 0.107, 0.108, 5e5, 1e6
    squares = np.sort(np.roots([m1 * m2, -(m1 + m2) * (k + kc), (k + kc) ** 2 - kc**2]).real)
    np.testing.assert_allclose(found.poles.imag, np.sqrt(squares), rtol=1e-9)
    np.testing.assert_allclose(found.filtered, found.raw_gains, rtol=0)


@pytest.mark.parametrize("name", ["hunt_crossley_damping", "micro_slip", "clipping"])
def test_records_carried_together_are_those_carried_alone(problem: Problem, baseline: Fit, name: str) -> None:
    score = screen.screen(baseline, [mechanisms()[name]]).scores[0]
    terms = (Term(mechanisms()[name], score.term.values),)
    model = Model(problem, terms)
    constants = baseline.constants
    _, to = model.modes(constants)
    runs: list[Any] = []
    for record, amplitudes in zip(baseline.records, baseline.amplitudes, strict=True):
        for factor in np.linspace(0.5, 1.5, 12):
            runs.append((record, Variant(terms, factor * amplitudes, constants.at(record.group), to[record.group])))
    together = model.extra(runs)
    assert max(float(np.abs(one).max()) for one in together) > 0
    for run, found in zip(runs, together, strict=True):
        np.testing.assert_array_equal(found, model.extra([run])[0])


def test_scores_do_not_depend_on_how_records_are_shared_out(monkeypatch: pytest.MonkeyPatch, baseline: Fit) -> None:
    found = {}
    for parts in (1, 2, 3):
        monkeypatch.setattr(screen, "PARTS", parts)
        screening = screen.screen(baseline, LISTED)
        found[parts] = {(s.term.mechanism.id, str(s.term.values)): s.gain for s in screening.scores}
    for parts in (2, 3):
        assert found[parts].keys() == found[1].keys()
        np.testing.assert_allclose([found[parts][k] for k in found[1]], list(found[1].values()), rtol=1e-6, atol=1e-5)
