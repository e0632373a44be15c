"""Part of the contact slips: rate-independent hysteresis of sliders in parallel (Jenkins one, Iwan many)."""

from __future__ import annotations

from sim_backend.mechanisms.mechanism import Mechanism, Quantity, geometric, law

SLIDERS = 8  # in place of a continuous distribution of slip forces


@law
def force_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """Sliders of one stiffness; p[4] stiffness of all, p[5] largest slip force of all, p[6] number of sliders.

    Slip forces are spread evenly between zero and the largest; a single slider has the largest. The stuck state is
    part of the linear stiffness. Memory: the sliders' forces, then the deformation.
    """
    count = int(p[6])
    k = p[4] / count
    step = d - before[SLIDERS]
    for i in range(count):
        limit = p[5] / count * (1.0 if count == 1 else 2.0 * (i + 0.5) / count)
        f = min(max(before[i] + k * step, -limit), limit)
        after[i] = f
        force += f
    after[SLIDERS] = d
    return force - p[4] * d


MECHANISM = Mechanism(
    id="micro_slip",
    component="contact",
    acts="contact",
    summary="rate-independent hysteresis of partial slip",
    source="Jenkins, Iwan, Masing: sliders with springs in parallel",
    parameters=(
        Quantity("slip_stiffness_share", "1", 0.0, 0.9, "share of k_c that slides"),
        Quantity("slip_reach_share", "1", 1e-7, 10.0, "deformation at which it slides, over P / k_c", log=True),
    ),
    strength="slip_stiffness_share",
    trials=lambda scale: [
        {"slip_stiffness_share": 1e-3, "slip_reach_share": r * scale.deformation / scale.static, "sliders": n}
        for n in (1, SLIDERS)
        for r in geometric(0.08, 1.2, 5)
    ],
    law=force_law,
    constants=lambda values, rest: (
        values["slip_stiffness_share"] * rest.stiffness,
        values["slip_stiffness_share"] * values["slip_reach_share"] * rest.preload,
        values["sliders"],
    ),
    statement=lambda values: (
        f"{100 * values['slip_stiffness_share']:.2g} % of the contact stiffness slips once its share of the force "
        f"exceeds {100 * values['slip_stiffness_share'] * values['slip_reach_share']:.2g} % of the load; it dissipates "
        "whatever the rate."
    ),
)
