"""Whether what a selection leaves may be scatter of the constants from impact to impact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.policy import POLICY
from analysis.mismatch.ring_downs.fit import fit
from analysis.mismatch.ring_downs.selecting import _may_be_scatter
from analysis.mismatch.selection import LeftOver, Selection
from tests.analysis.mismatch.ring_downs.selections import screening, scripted
from tests.analysis.ring_downs import problem_of, session_of, with_law


@pytest.mark.parametrize(("scatter", "left", "may_be"), [(2e-3, 0.5, True), (2e-3, 3.0, False), (0.0, 0.5, False)])
def test_all_is_looked_for_again_where_constants_of_each_impact_take_a_good_part_of_what_is_left(
    scatter: float, left: float, may_be: bool
) -> None:
    rng, record = np.random.default_rng(3), with_law()

    def scattering(rig, load, pulse):  # type: ignore[no-untyped-def]
        return record(replace(rig, kc=rig.kc * (1 + scatter * rng.standard_normal())), load, pulse)

    linear = fit(problem_of(session_of(scattering, noise=0.02)))
    gained = max(linear.objective - sum(r.size for r in linear.residuals), 100.0)  # nearly all that is beyond noise
    over = LeftOver(left / POLICY.scatter_share * gained, 0.0, 1.0)
    found = Selection(scripted(), linear, screening(), (), None, linear, screening(), over)
    assert _may_be_scatter(found) == may_be
