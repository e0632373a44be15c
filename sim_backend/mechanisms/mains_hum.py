"""The mains hums in the records, with a phase of its own in each."""

from __future__ import annotations

from sim_backend.mechanisms.kinds import Quantity, Tones

NAME = "amplitude_m_s2"
MAINS_HZ = (50.0, 60.0)
MOST_NAMED = 3  # lines
LINES = (1.0, 2.0, 3.0, 13.0, 16.0, 123.0, 12345.0, 123456789.0)  # each digit a multiple of the mains frequency


def _shown(mains_hz: float, multiples: str) -> str:
    """Name the lines; a long row of multiples by its last one."""
    hertz = [f"{int(k) * mains_hz:.0f}" for k in multiples]
    if len(hertz) > MOST_NAMED:
        return f"{hertz[0]} Hz and some of its multiples up to {hertz[-1]} Hz"
    return " and ".join(hertz) + " Hz"


MECHANISM = Tones(
    id="mains_hum",
    component="sensor chain",
    summary="50 or 60 Hz and harmonics",
    source="ground loops",
    parameters=(Quantity(NAME, "m/s2", 0.0, 1e3, "amplitude of the loudest line"),),
    strength=NAME,
    trials=lambda scale: [
        {"mains_hz": base, "lines": lines, NAME: 0.0}
        for base in MAINS_HZ
        for lines in LINES
        if lines % 10 * base <= scale.shown_hz
    ],
    lines=lambda values: [int(k) * values["mains_hz"] for k in str(int(values["lines"]))],
    statement=lambda values, name: (
        f"The mains hums in the records: {_shown(values['mains_hz'], str(int(values['lines'])))}, the loudest line "
        f"with {1e3 * values[NAME]:.3g} mm/s2."
    ),
)
