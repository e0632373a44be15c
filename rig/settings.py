"""Section ``rig`` of config.yaml: masses, springs, wiring, filter, limits, and which part is which."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from rig.drivers.settings import NewportStage
from rig.parts import Parts
from rig.section import Finite, NonNegative, Positive, Section
from rig.tube import OwnMode, Tube

__all__ = [
    "STANDARD_GRAVITY",
    "Channel",
    "Filter",
    "Finite",
    "Hammer",
    "Limits",
    "Masses",
    "NonNegative",
    "Parts",
    "Positive",
    "RigSettings",
    "Section",
    "Springs",
    "TubeInertia",
    "TubeSettings",
    "Wiring",
]

STANDARD_GRAVITY = 9.80665  # m/s2
Row = TypeVar("Row")  # what belongs to one input
THICKEST_WALL = 0.1  # of the outer diameter: thicker rings shear and stretch by percents of their bending
SAFE_CLEARANCES = 2.0  # clearance over the travel that the springs need for the load limit: contacts are soft


class Masses(Section):
    """Upper and lower mass with everything screwed to them but the tube springs, kg; what a scale does not know."""

    m1_kg: Positive = 0.107
    m2_kg: Positive = 0.108
    uncertainty_kg: NonNegative = 0.00005


class TubeSettings(Section):
    """A tube spring, from which the mass that moves with each block is computed (`rig.tube`)."""

    youngs_modulus_gpa: Positive = 193.0
    poisson_ratio: Annotated[float, Field(gt=-1, lt=0.5)] = 0.29
    density_kg_per_m3: Positive = 7900.0
    outer_diameter_mm: Positive = 19.0
    wall_mm: Positive = 0.5
    length_mm: Positive = 30.0

    @model_validator(mode="after")
    def _thin(self) -> TubeSettings:
        if self.wall_mm > THICKEST_WALL * self.outer_diameter_mm:
            raise ValueError(
                f"wall_mm of {self.wall_mm:g} is more than {THICKEST_WALL:.0%} of outer_diameter_mm: no thin ring; "
                "give added_mass_kg instead"
            )
        return self

    def tube(self) -> Tube:
        """Return it in SI units."""
        return Tube(
            self.youngs_modulus_gpa * 1e9,
            self.poisson_ratio,
            self.density_kg_per_m3,
            (self.outer_diameter_mm - self.wall_mm) / 2 * 1e-3,
            self.wall_mm * 1e-3,
            self.length_mm * 1e-3,
        )


@dataclass(frozen=True, slots=True)
class TubeInertia:
    """What the tube springs add to Eq. 9: kg to each mass at rest, its standard error, and the tubes' own mode."""

    added_kg: float
    uncertainty_kg: float
    own_mode: OwnMode | None = None

    def added_mass(self, f_hz: float) -> float:
        """Return what moves with each block at ``f_hz``, kg."""
        return self.added_kg + (0.0 if self.own_mode is None else self.own_mode.added_mass(f_hz))


class Springs(Section):
    """Tube springs: their stiffness, given or identified from the system resonance (k1 = k2), and their inertia.

    The inertia, of which Eq. 9 has none, follows from ``tube``, or is ``added_mass_kg`` for each block; without either
    the springs count as massless. Its uncertainty is common to both blocks.
    """

    system_resonance_hz: Positive | None = None
    k1_n_per_m: Positive | None = None
    k2_n_per_m: Positive | None = None
    uncertainty_percent: NonNegative = 1.0
    tube: TubeSettings | None = None
    added_mass_kg: NonNegative | None = None
    added_mass_uncertainty_percent: NonNegative = 5.0  # a seat 2 mm wide, which no thin line is, moves this much more

    @model_validator(mode="after")
    def _one_way(self) -> Springs:
        given = (self.k1_n_per_m is not None) + (self.k2_n_per_m is not None)
        if given == 1 or (given == 2) == (self.system_resonance_hz is not None):
            raise ValueError("give either system_resonance_hz, or both k1_n_per_m and k2_n_per_m")
        if self.tube is not None and self.added_mass_kg is not None:
            raise ValueError("give either tube, from which the added mass follows, or added_mass_kg")
        return self

    def inertia(self) -> TubeInertia | None:
        """Return what the tube springs add to the masses; None where neither key says it."""
        share = self.added_mass_uncertainty_percent / 100
        if self.tube is not None:
            tube = self.tube.tube()
            added = tube.added_mass(0.0)
            return TubeInertia(added, share * added, tube.own_mode())
        return None if self.added_mass_kg is None else TubeInertia(self.added_mass_kg, share * self.added_mass_kg)


class Channel(Section):
    """One accelerometer's place on the recorder."""

    input: Annotated[int, Field(ge=0, le=31)]
    sensitivity_mv_per_g: Positive = 100.0
    sensitivity_uncertainty_percent: NonNegative = 1.5  # standard; of a certificate of back-to-back calibration about 1
    gain: Positive = 10.0
    polarity: Literal[1, -1] = 1

    def m_s2_per_volt(self) -> float:
        """Acceleration, m/s2, that a volt at the recorder's input means; negative when mounted the other way round."""
        return self.polarity * STANDARD_GRAVITY / (self.sensitivity_mv_per_g * 1e-3 * self.gain)


class Hammer(Section):
    """An instrumented hammer's place on the recorder; a push counts positive."""

    input: Annotated[int, Field(ge=0, le=31)]
    sensitivity_mv_per_n: Positive = 22.5
    sensitivity_uncertainty_percent: NonNegative = 1.5  # standard; certificates of small hammers say 3 % at k = 2
    gain: Positive = 10.0
    polarity: Literal[1, -1] = 1
    range_v: Positive = 5.0
    filtered: bool = True  # whether its signal passes the band-pass of section filter too
    largest_force_n: Positive | None = None  # what the transducer or the tip can take; the recorder's range besides

    def n_per_volt(self) -> float:
        """Force, N, that a volt at the recorder's input means."""
        return self.polarity / (self.sensitivity_mv_per_n * 1e-3 * self.gain)

    def reach_n(self) -> float:
        """Largest force that transducer, tip and recorder can hold, N."""
        range_n = self.range_v * abs(self.n_per_volt())
        return range_n if self.largest_force_n is None else min(range_n, self.largest_force_n)


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
    clock_accuracy_ppm: Annotated[float, Field(ge=0, le=10_000)] = 50.0  # limits; the NI 9234's (docs/uncertainty.md)
    hammer: Hammer | None = None

    @model_validator(mode="after")
    def _distinct(self) -> Wiring:
        used = self.inputs()
        if len(set(used)) < len(used):
            raise ValueError(f"two sensors share one input: {used}")
        return self

    @model_serializer(mode="wrap")
    def _without_absent(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out a hammer that is not there: a file then reads as it did before there were any."""
        written: dict[str, Any] = handler(self)
        if written.get("hammer", "") is None:
            del written["hammer"]
        return written

    def inputs(self) -> list[int]:
        """Inputs of accelerometers A and B, then those of strain gauge and hammer if the recorder samples them."""
        return [number for number, _, _ in self._wired()]

    def ranges_v(self) -> list[float]:
        """Range, plus and minus, of each of `inputs`, V."""
        return [range_v for _, range_v, _ in self._wired()]

    def units_per_volt(self) -> list[float]:
        """What a volt at each of `inputs` means: m/s2, mV of the bridge for the gauge, N for the hammer."""
        return [unit for _, _, unit in self._wired()]

    def _wired(self) -> list[tuple[int, float, float]]:
        """Input, range (V) and unit per volt of each sensor, in the order that `sorted_out` undoes."""
        both = [(c.input, self.input_range_v, c.m_s2_per_volt()) for c in (self.accelerometer_a, self.accelerometer_b)]
        if self.strain_gauge_input is not None:
            both.append((self.strain_gauge_input, self.strain_gauge_range_v, 1e3 / self.strain_gauge_gain))
        if self.hammer is not None:
            both.append((self.hammer.input, self.hammer.range_v, self.hammer.n_per_volt()))
        return both

    def sorted_out(self, rows: Sequence[Row]) -> tuple[Row | None, Row | None]:
        """Return what of a row for each of `inputs` is the strain gauge's, and what the hammer's; None for neither."""
        strain = 2 if self.strain_gauge_input is not None else None
        force = len(self.inputs()) - 1 if self.hammer is not None else None
        return (None if strain is None else rows[strain]), (None if force is None else rows[force])

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
        stage, port = self.parts.stage, getattr(self.parts.stage, "port", None)
        if port is not None and getattr(self.parts.load_cell, "port", None) == port:
            raise ValueError(f"parts.stage and parts.load_cell are both on {port}; each needs a port of its own")
        if not isinstance(stage, NewportStage):
            return self
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
        f1 = springs.system_resonance_hz or math.nan
        inertia = springs.inertia()
        moving = masses.m1_kg + masses.m2_kg + (0.0 if inertia is None else 2 * inertia.added_mass(f1))
        k = moving / 2 * (2 * math.pi * f1) ** 2
        return k, k

    def moving_masses(self) -> tuple[float, float]:
        """Return m1, m2 of Eq. 9 in kg: the blocks, with what the tube springs add to them at rest."""
        inertia = self.springs.inertia()
        added = 0.0 if inertia is None else inertia.added_kg
        return self.masses.m1_kg + added, self.masses.m2_kg + added
