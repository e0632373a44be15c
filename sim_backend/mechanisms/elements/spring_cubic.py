"""A spring that stiffens or softens when it is deflected far: the law of the tube springs, in any spring."""

from __future__ import annotations

from dataclasses import replace

from sim_backend.mechanisms import tube_spring_cubic

NAME = "cubic_stiffness_n_per_m3"

MECHANISM = replace(
    tube_spring_cubic.MECHANISM,
    summary="a force of the cubed deflection",
    fits=("spring", "pendulum", "joint", "contact"),
    statement=lambda values: (
        f"The {{element}} {'stiffens' if values[NAME] > 0 else 'softens'} with deflection: a force of "
        f"{values[NAME]:.4g} times the cubed deflection adds to that of its linear stiffness."
    ),
)
