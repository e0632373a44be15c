"""The recorder or amplifier filters more than declared. Free ringing hides it wholly: it is listed, never named."""

from __future__ import annotations

from sim_backend.mechanisms.mechanism import Mechanism, Quantity

MECHANISM = Mechanism(
    id="undeclared_filter",
    component="sensor chain",
    summary="the recorder or amplifier filters more than declared",
    source="anti-aliasing filter",
    parameters=(Quantity("corner_hz", "Hz", 1.0, 1e6, "corner of the filter", log=True),),
    strength=None,
    trials=lambda scale: [],
    statement=lambda values: (
        "A filter that is not declared changes amplitude and phase of each mode and nothing else: free ringing cannot "
        "show it, and nothing reported depends on it."
    ),
)
