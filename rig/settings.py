"""Section ``rig`` of config.yaml: masses, springs, wiring, filter, limits, and which part is which."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from rig.drivers.settings import NewportStage
from rig.parts import Parts
from rig.section import Finite, NonNegative, Positive, Section

__all__ = [
    "STANDARD_GRAVITY",
    "Channel",
    "Filter",
    "Finite",
    "Limits",
    "Masses",
    "NonNegative",
    "Parts",
    "Positive",
    "RigSettings",
    "Section",
    "Springs",
    "Wiring",
]

STANDARD_GRAVITY = 9.80665  # m/s2
SAFE_CLEARANCES = 2.0  # clearance over the travel that the springs need for the load limit: contacts are soft


class Masses(Section):
    """Upper and lower mass with everything screwed to them, kg."""

    m1_kg: Positive = 0.107
    m2_kg: Positive = 0.108
    uncertainty_kg: NonNegative = 0.00005


class Springs(Section):
    """Stiffness of the tube springs: given, or identified from the system resonance (k1 = k2)."""

    system_resonance_hz: Positive | None = None
    k1_n_per_m: Positive | None = None
    k2_n_per_m: Positive | None = None
    uncertainty_percent: NonNegative = 1.0

    @model_validator(mode="after")
    def _one_way(self) -> Springs:
        given = (self.k1_n_per_m is not None) + (self.k2_n_per_m is not None)
        if given == 1 or (given == 2) == (self.system_resonance_hz is not None):
            raise ValueError("give either system_resonance_hz, or both k1_n_per_m and k2_n_per_m")
        return self


class Channel(Section):
    """One accelerometer's place on the recorder."""

    input: Annotated[int, Field(ge=0, le=31)]
    sensitivity_mv_per_g: Positive = 100.0
    gain: Positive = 10.0
    polarity: Literal[1, -1] = 1

    def m_s2_per_volt(self) -> float:
        """Acceleration, m/s2, that a volt at the recorder's input means; negative when mounted the other way round."""
        return self.polarity * STANDARD_GRAVITY / (self.sensitivity_mv_per_g * 1e-3 * self.gain)


class Wiring(Section):
    """Which input is which, and what a volt means."""

    accelerometer_a: Channel = Channel(input=0)
    accelerometer_b: Channel = Channel(input=1, polarity=-1)
    strain_gauge_input: Annotated[int, Field(ge=0, le=31)] | None = 2
    strain_gauge_gain: Positive = 1.0
    strain_gauge_range_v: Positive = 1.0
    input_range_v: Positive = 5.0
    bits: Annotated[int, Field(ge=8, le=32)] = 16
    sample_rate_hz: Positive = 25000.0

    @model_validator(mode="after")
    def _distinct(self) -> Wiring:
        used = self.inputs()
        if len(set(used)) < len(used):
            raise ValueError(f"two sensors share one input: {used}")
        return self

    def inputs(self) -> list[int]:
        """Inputs of accelerometers A and B, then that of the strain gauge if the recorder samples it."""
        both = [self.accelerometer_a.input, self.accelerometer_b.input]
        return both if self.strain_gauge_input is None else [*both, self.strain_gauge_input]

    def ranges_v(self) -> list[float]:
        """Range, plus and minus, of each of `inputs`, V."""
        return [self.input_range_v, self.input_range_v, self.strain_gauge_range_v][: len(self.inputs())]

    def units_per_volt(self) -> list[float]:
        """What a volt at each of `inputs` means: m/s2 for the accelerometers, mV of the bridge for the gauge."""
        scales = [self.accelerometer_a.m_s2_per_volt(), self.accelerometer_b.m_s2_per_volt()]
        return [*scales, 1e3 / self.strain_gauge_gain][: len(self.inputs())]

    def full_scale_m_s2(self) -> float:
        """Largest acceleration that both channels can hold, m/s2."""
        worst = max(c.sensitivity_mv_per_g * c.gain for c in (self.accelerometer_a, self.accelerometer_b))
        return self.input_range_v / (worst * 1e-3) * STANDARD_GRAVITY


class Filter(Section):
    """The analog band-pass ahead of the recorder (Sec. 4.1)."""

    family: Literal["butterworth", "none"] = "butterworth"
    highpass_hz: Positive = 10.0
    highpass_order: Annotated[int, Field(ge=1, le=8)] = 1
    lowpass_hz: Positive = 10000.0
    lowpass_order: Annotated[int, Field(ge=1, le=8)] = 4

    @model_validator(mode="after")
    def _passes_something(self) -> Filter:
        if self.family != "none" and self.highpass_hz >= self.lowpass_hz:
            raise ValueError(f"highpass_hz ({self.highpass_hz:g}) must lie below lowpass_hz ({self.lowpass_hz:g})")
        return self


LARGEST_LOAD_MN = 10_000.0  # ten times the paper's largest preload (Table 5: 927 mN): no specimen of this tester's size
LARGEST_STEP_UM = 5.0  # on tube springs of 0.27 MN/m in series 1.3 N: past the limit that ships in one step
LARGEST_STALENESS_S = 5.0  # a motor at 0.4 mm/s (Newport CMA25CCL) goes 2 mm in it
MOST_FROZEN = 100  # equal readings: at 100 a second, a second with a dead gauge
LARGEST_THRESHOLD_MN = 200.0  # a contact that presses more than this has long been made
LONGEST_TRAVEL_UM = 25_000.0  # of the longest actuator (Newport CMA25CCL)
LARGEST_BACKLASH_UM = 100.0  # a worn micrometer screw has 10


class Limits(Section):
    """What the interlock holds to; a bound where a number beyond reason would be no protection at all."""

    load_mn: Annotated[float, Field(gt=0, le=LARGEST_LOAD_MN)] = 1100.0
    largest_approach_step_um: Annotated[float, Field(gt=0, le=LARGEST_STEP_UM)] = 0.5
    stale_reading_s: Annotated[float, Field(gt=0, le=LARGEST_STALENESS_S)] = 0.5
    frozen_readings: Annotated[int, Field(ge=2, le=MOST_FROZEN)] = 3
    contact_threshold_mn: Annotated[float, Field(gt=0, le=LARGEST_THRESHOLD_MN)] = 15.0
    clearance_um: Annotated[float, Field(gt=0, le=LONGEST_TRAVEL_UM)] = 100.0
    largest_backlash_um: Annotated[float, Field(ge=0, le=LARGEST_BACKLASH_UM)] = 5.0
    expected_contact_um: Annotated[float, Field(ge=-LONGEST_TRAVEL_UM, le=LONGEST_TRAVEL_UM)] = 150.0
    search_beyond_um: Annotated[float, Field(gt=0, le=LONGEST_TRAVEL_UM)] = 3.0
    mechanical_stop_um: Annotated[float, Field(ge=-LONGEST_TRAVEL_UM, le=LONGEST_TRAVEL_UM)] | None = None


class RigSettings(Section):
    """Section ``rig``."""

    masses: Masses = Masses()
    springs: Springs = Springs(system_resonance_hz=356.0)
    wiring: Wiring = Wiring()
    filter: Filter = Filter()
    # the paper's gauge has 0.042: far outside of this no load, or any, would be seen
    gauge_sensitivity_mv_per_mn: Annotated[float, Field(ge=1e-4, le=100)] = 0.042
    limits: Limits = Limits()
    parts: Parts = Parts()

    @model_validator(mode="after")
    def _survivable(self) -> RigSettings:
        """Hold the search past the expected contact to what the specimen survives should the gauge be dead."""
        k1, k2 = self.spring_stiffness()
        mn_per_um = k1 * k2 / (k1 + k2) * 1e-3
        needed = SAFE_CLEARANCES * self.limits.load_mn / mn_per_um + self.limits.largest_backlash_um
        if self.limits.clearance_um < needed:
            raise ValueError(
                f"limits.clearance_um of {self.limits.clearance_um:g} would not take the surfaces apart from "
                f"{self.limits.load_mn:g} mN with {self.limits.largest_backlash_um:g} um of backlash; give at least "
                f"{needed:.3g}"
            )
        stage = self.parts.stage
        if isinstance(stage, NewportStage) and self.limits.largest_approach_step_um < stage.resolution_um:
            raise ValueError(
                f"limits.largest_approach_step_um of {self.limits.largest_approach_step_um:g} is less than a step of "
                f"the stage, {stage.resolution_um:g} um (parts.stage.resolution_um)"
            )
        worst = self.limits.search_beyond_um * mn_per_um
        if worst > self.limits.load_mn:
            raise ValueError(
                f"limits.search_beyond_um of {self.limits.search_beyond_um:g} could load the specimen with "
                f"{worst:.0f} mN if the gauge failed, more than limits.load_mn ({self.limits.load_mn:g})"
            )
        return self

    @model_validator(mode="after")
    def _within_reach(self) -> RigSettings:
        """Two devices need two ports, and the surfaces must meet within the stage's travel."""
        stage, gauge = self.parts.stage, self.parts.load_cell
        if isinstance(stage, str):
            return self
        if not isinstance(gauge, str) and getattr(gauge, "port", None) == stage.port:
            raise ValueError(f"parts.stage and parts.load_cell are both on {stage.port}; each needs a port of its own")
        reach_mm = stage.zero_mm + (self.limits.expected_contact_um + self.limits.search_beyond_um) * 1e-3
        if reach_mm > stage.highest_mm:
            raise ValueError(
                f"limits.expected_contact_um ({self.limits.expected_contact_um:g}) is looked for up to {reach_mm:g} mm "
                f"of the stage, past its parts.stage.highest_mm of {stage.highest_mm:g}; correct one of them or zero_mm"
            )
        return self

    def worst_unwatched_load_mn(self) -> float:
        """Load that two failures at once could make, mN.

        A gauge that dies with its noise, and a surface that lies higher than it was declared to: nothing but a
        mechanical stop ends the approach before the end of the search. Without one the surface is taken to lie no
        higher than where the approach begins.
        """
        k1, k2 = self.spring_stiffness()
        end = self.limits.expected_contact_um + self.limits.search_beyond_um
        if self.limits.mechanical_stop_um is not None:
            end = min(end, self.limits.mechanical_stop_um)
        return max(0.0, end) * k1 * k2 / (k1 + k2) * 1e-3

    def spring_stiffness(self) -> tuple[float, float]:
        """Return k1, k2 in N/m: as given, or each (m1 + m2) omega1^2 / 2 (Eq. 10 with a stiff contact)."""
        springs, masses = self.springs, self.masses
        if springs.k1_n_per_m is not None and springs.k2_n_per_m is not None:
            return springs.k1_n_per_m, springs.k2_n_per_m
        omega = 2 * math.pi * (springs.system_resonance_hz or math.nan)
        k = (masses.m1_kg + masses.m2_kg) / 2 * omega**2
        return k, k
