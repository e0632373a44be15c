"""Section ``analysis`` of config.yaml: the method, and surfaces and materials for the theory beside the measurement."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from rig.settings import NonNegative, Positive, Section


class Material(Section):
    """One body's elasticity and hardness."""

    youngs_modulus_gpa: Positive = 192.92
    poisson_ratio: Annotated[float, Field(gt=-1, le=0.5)] = 0.29
    hardness_gpa: Positive = 2.96


class SphereContact(Section):
    """Sphere on flat (Table 2), both rough; the asperities are those of Table 4, since none are published for it."""

    geometry: Literal["sphere"] = "sphere"
    upper: Material = Material()
    lower: Material = Material()
    radius_um: Positive = 793.75
    roughness_rq_um: Positive = 0.471
    asperity_radius_um: Positive = 2.402
    asperity_density_per_um2: Positive = 0.1256


class FlatContact(Section):
    """Two nominally flat rough surfaces (Table 4, combined)."""

    geometry: Literal["flat"] = "flat"
    upper: Material = Material()
    lower: Material = Material()
    nominal_area_mm2: Positive = 1.824
    roughness_rq_um: Positive = 0.189
    asperity_radius_um: Positive = 2.402
    asperity_density_per_um2: Positive = 0.1256


Contact = Annotated[SphereContact | FlatContact, Field(discriminator="geometry")]
PRESETS: dict[str, SphereContact | FlatContact] = {"paper-flat": FlatContact(), "paper-sphere": SphereContact()}


class TapScatter(Section):
    """Section ``analysis.tap_scatter``: how much single taps scatter, in %, where a session has one a load.

    Of the contact mode it is what the paper saw in eight taps (Sec. 5): 2.6 % of k_c, so half of it of f2, and 11.1 %
    of the damping.
    """

    f1_percent: NonNegative = 0.05
    f2_percent: NonNegative = 1.3
    zeta1_percent: NonNegative = 11.1
    zeta2_percent: NonNegative = 11.1

    def relative(self, quantity: str) -> float:
        """Return the relative standard deviation of ``f1_hz``, ``f2_hz``, ``zeta1`` or ``zeta2``."""
        return float(getattr(self, f"{quantity.removesuffix('_hz')}_percent")) / 100


class AnalysisSettings(Section):
    """Section ``analysis``."""

    method: Literal["ml", "era"] = "ml"
    springs: Literal["measured", "declared"] = "measured"
    spring_asymmetry_percent: NonNegative = 1.0
    tap_scatter: TapScatter = TapScatter()
    contact: Contact = PRESETS["paper-flat"]
    mechanisms: tuple[str, ...] = ()  # folders of mechanisms of one's own, beside those of the program

    @field_validator("mechanisms")
    @classmethod
    def _from_anywhere(cls, folders: tuple[str, ...]) -> tuple[str, ...]:
        """Make paths absolute: a session may be resumed from another folder."""
        return tuple(str(Path(folder).absolute()) for folder in folders)

    @field_validator("contact", mode="before")
    @classmethod
    def _preset(cls, value: Any) -> Any:
        """Let a name stand for one of the paper's specimens."""
        if not isinstance(value, str):
            return value
        if value not in PRESETS:
            raise ValueError(
                f"{value!r} is not a preset; allowed are {', '.join(PRESETS)}, or keys with geometry: sphere or flat"
            )
        return PRESETS[value]
