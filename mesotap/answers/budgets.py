"""Uncertainty budgets for other programs and for the page: each source of each number of each load."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from analysis.results import LoadResult, SessionResults
from calibration.budget import Budget, Contribution
from mesotap.answers.rounding import UNKNOWN, significant

COLUMNS = (
    "load_set",
    "target_load_mn",
    "quantity",
    "unit",
    "source",
    "input_value",
    "input_unit",
    "input_standard_uncertainty",
    "sensitivity",
    "distribution",
    "degrees_of_freedom",
    "contribution",
    "share_percent",
)
TOTAL = "combined"  # the source in the row that holds the number itself
SHOWN = ("load_mn", "f2_hz", "zeta2", "contact_stiffness_n_per_m", "contact_damping_n_s_per_m")


@dataclass(frozen=True, slots=True)
class BudgetRow:
    """One source of a number, as the page prints it."""

    source: str
    value: str
    uncertainty: str
    sensitivity: str
    contribution: str
    share: str
    dof: str


@dataclass(frozen=True, slots=True)
class ShownBudget:
    """One number with its sources, as the page prints them: ``unit`` that of contributions."""

    quantity: str
    unit: str
    value: str
    uncertainty: str
    dof: str
    coverage: str
    rows: tuple[BudgetRow, ...]


def budgets_json(load: LoadResult) -> dict[str, Any]:
    """Return the budgets of a load by quantity; degrees of freedom are null where they are infinite."""
    return {
        budget.quantity: {
            "unit": budget.unit,
            "value": _finite(budget.value),
            "standard_uncertainty": _finite(budget.standard_uncertainty),
            "degrees_of_freedom": _finite(budget.dof),
            "coverage_factor": _finite(budget.coverage_factor),
            "contributions": [
                {
                    "source": part.source,
                    "input_value": _finite(part.value),
                    "input_unit": part.unit,
                    "input_standard_uncertainty": _finite(part.standard_uncertainty),
                    "sensitivity": _finite(part.sensitivity),
                    "distribution": part.distribution,
                    "degrees_of_freedom": _finite(part.dof),
                    "contribution": _finite(part.uncertainty),
                    "share": _finite(share),
                }
                for part, share in zip(budget.contributions, budget.shares, strict=True)
            ],
        }
        for budget in load.budgets
    }


def budget_rows(results: SessionResults) -> list[list[object]]:
    """Return a row for every source of every number, and one for the number itself, by `COLUMNS`."""
    rows: list[list[object]] = []
    for load in results.loads:
        place: list[object] = [load.load_set, _finite(load.target_load_mn)]
        for budget in load.budgets:
            for part, share in zip(budget.contributions, budget.shares, strict=True):
                rows.append(
                    [
                        *place,
                        *(budget.quantity, budget.unit, part.source, _finite(part.value), part.unit),
                        *(_finite(part.standard_uncertainty), _finite(part.sensitivity), part.distribution),
                        *(_finite(part.dof), _finite(part.uncertainty), _finite(100 * share)),
                    ]
                )
            rows.append(
                [
                    *place,
                    *(budget.quantity, budget.unit, TOTAL, _finite(budget.value), budget.unit),
                    *(_finite(budget.standard_uncertainty), 1.0, f"k = {budget.coverage_factor:.3f}"),
                    *(_finite(budget.dof), _finite(budget.standard_uncertainty), 100.0),
                ]
            )
    return rows


def shown_load(results: SessionResults) -> LoadResult | None:
    """Return the middle one of the loads whose contact stiffness has a budget; None without any."""
    loads = [load for load in results.loads if any(b.quantity == SHOWN[3] for b in load.budgets)]
    return loads[len(loads) // 2] if loads else None


def shown_budgets(load: LoadResult) -> list[ShownBudget]:
    """Return the budgets of a load as the page prints them, the largest contribution first."""
    by_name = {budget.quantity: budget for budget in load.budgets}
    return [_shown(by_name[name]) for name in SHOWN if name in by_name]


def _shown(budget: Budget) -> ShownBudget:
    parts = sorted(zip(budget.contributions, budget.shares, strict=True), key=lambda pair: -pair[1])
    return ShownBudget(
        budget.quantity,
        budget.unit,
        significant(budget.value, 7),
        significant(budget.standard_uncertainty, 3),
        _dof(budget.dof),
        f"{budget.coverage_factor:.2f}",
        tuple(_row(part, share) for part, share in parts),
    )


def _row(part: Contribution, share: float) -> BudgetRow:
    unit = "" if part.unit == "1" else f" {part.unit}"
    return BudgetRow(
        part.source,
        UNKNOWN if not math.isfinite(part.value) else significant(part.value, 7) + unit,
        significant(part.standard_uncertainty, 3) + unit,
        significant(part.sensitivity, 4),
        significant(part.uncertainty, 3),
        f"{100 * share:.1f}",
        _dof(part.dof),
    )


def _dof(dof: float) -> str:
    return "∞" if math.isinf(dof) or dof > 1e4 else significant(dof, 2)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
