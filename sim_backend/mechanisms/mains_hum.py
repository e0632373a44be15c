"""The mains hums in the records, with a phase of its own in each."""

from __future__ import annotations

from sim_backend.mechanisms.mechanism import Mechanism, Quantity

NAME = "amplitude_m_s2"

MECHANISM = Mechanism(
    id="mains_hum",
    component="sensor chain",
    summary="50 or 60 Hz and harmonics",
    source="ground loops",
    parameters=(Quantity(NAME, "m/s2", 0.0, 1e3, "amplitude of the strongest line"),),
    strength=NAME,
    trials=lambda scale: [{"line_hz": base * k, NAME: 0.0} for base in (50.0, 60.0) for k in (1, 2, 3)],
    lines=lambda values: (values["line_hz"],),
    statement=lambda values: (
        f"The mains hums in the records: {values['line_hz']:.0f} Hz with {1e3 * values[NAME]:.2g} mm/s2."
    ),
)
