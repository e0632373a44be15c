"""Partial slip: hysteresis that does not depend on the rate.

Of a preloaded contact: sliders with springs in parallel (Jenkins one, Iwan many), measured by preload and k_c.

Of any other element: Masing's rule. The virgin curve lacks ``g(d) = s |d / D|^e D sign(d)`` of what the stuck joint
would carry. Iwan's sliders whose number grows as a power of their strength give it: the frequency falls as
amplitude^(e - 1), damping grows alike.
"""

from __future__ import annotations

from sim_backend.mechanisms.kinds import ForceLaw, Quantity, geometric, law

SLIDERS = 8  # in place of a continuous distribution of slip forces


@law
def sliders_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
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


SOFTENING, EXPONENT, REFERENCE = "slip_softening_n_per_m", "slip_exponent", "reference_deformation_m"
TURNS = 10  # reversals remembered; beyond, the oldest is forgotten
LAST, HEADING, DEPTH, FIRST = 0, 1, 2, 3  # memory: deformation, its direction, how many reversals; then the reversals


@law
def masing_law(force, d, v, t, p, before, after):  # type: ignore[no-untyped-def]
    """Masing hysteresis: p[4] = s, p[5] = e, p[6] = D. Memory: see above; of a reversal, deformation and force."""
    s, e, reference = p[4], p[5], p[6]
    for i in range(FIRST + 2 * TURNS):
        after[i] = before[i]
    depth = int(before[DEPTH])
    last, heading = before[LAST], before[HEADING]
    step = d - last
    way = heading
    if step > 0.0:
        way = 1.0
    elif step < 0.0:
        way = -1.0
    if heading != 0.0 and way != heading:
        if depth == 0:
            turned = -s * reference * (abs(last) / reference) ** e * (1.0 if last > 0.0 else -1.0)
        else:
            at, held = before[FIRST + 2 * (depth - 1)], before[FIRST + 2 * (depth - 1) + 1]
            half = 0.5 * abs(last - at) / reference
            turned = held - 2.0 * s * reference * half**e * (1.0 if last > at else -1.0)
        if depth == TURNS:
            for i in range(FIRST, FIRST + 2 * (TURNS - 1)):
                after[i] = after[i + 2]
            depth -= 1
        after[FIRST + 2 * depth] = last
        after[FIRST + 2 * depth + 1] = turned
        depth += 1
    # a loop that closes is forgotten: the motion goes on along the branch it had left
    while depth >= 2 and way * (d - after[FIRST + 2 * (depth - 2)]) > 0.0:
        depth -= 2
    if depth == 1 and d * after[FIRST] < 0.0 and abs(d) > abs(after[FIRST]):
        depth = 0
    after[LAST], after[HEADING], after[DEPTH] = d, way, depth
    if depth == 0:
        return force - s * reference * (abs(d) / reference) ** e * (1.0 if d > 0.0 else -1.0)
    at, held = after[FIRST + 2 * (depth - 1)], after[FIRST + 2 * (depth - 1) + 1]
    half = 0.5 * abs(d - at) / reference
    return force + held - 2.0 * s * reference * half**e * (1.0 if d > at else -1.0)


SLIDING = ForceLaw(
    id="micro_slip",
    component="contact",
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
    law=sliders_law,
    fits=("contact",),
    preloaded=True,
    constants=lambda values, rest: (
        values["slip_stiffness_share"] * rest.stiffness,
        values["slip_stiffness_share"] * values["slip_reach_share"] * rest.preload,
        values["sliders"],
    ),
    statement=lambda values, name: (
        f"{100 * values['slip_stiffness_share']:.2g} % of the contact stiffness slips once its share of the force "
        f"exceeds {100 * values['slip_stiffness_share'] * values['slip_reach_share']:.2g} % of the load; it dissipates "
        "whatever the rate."
    ),
)
MASING = ForceLaw(
    id="micro_slip",
    component="contact",
    summary="rate-independent hysteresis of partial slip",
    source="Iwan; Masing; Segalman's power law",
    parameters=(
        Quantity(SOFTENING, "N/m", 0.0, 1e25, "stiffness lost at the reference deformation"),
        Quantity(EXPONENT, "1", 1.1, 3.0, "exponent of the virgin curve"),
    ),
    strength=SOFTENING,
    trials=lambda scale: [
        {SOFTENING: 1e-4 * scale.force / scale.deformation, EXPONENT: e, REFERENCE: scale.deformation}
        for e in (1.3, 1.6, 2.0)
    ],
    law=masing_law,
    fits=("joint", "contact", "guide", "spring"),
    preloaded=False,
    constants=lambda values, rest: (values[SOFTENING], values[EXPONENT], values[REFERENCE]),
    statement=lambda values, name: (
        f"The {name} slips in part: with growing amplitude it softens and dissipates more, whatever the rate "
        f"(hysteresis with exponent {values[EXPONENT]:.2f})."
    ),
)
MECHANISM = (SLIDING, MASING)
