"""Section ``sim_backend`` of config.yaml: the simulated rig."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from pydantic import (
    Field,
    PrivateAttr,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    model_serializer,
    model_validator,
)

from rig.settings import Finite, NonNegative, Positive, Section

if TYPE_CHECKING:
    from sim_backend.acting import Acting

FOLDERS = "mechanisms"
"""What a validation's context holds the folders of a user's own mechanisms under."""
Rate = Annotated[float, Field(ge=0, le=1)]


STIFFNESS, OLD_STIFFNESS = "contact_stiffness_n_per_um", "contact_stiffness_mn_per_m"
LAWS: Final = {"hertz": ("hertz_stiffness",), "exponential": ("rough_surface_stiffness",)}


class SimulatedContact(Section):
    """k_c(P) and zeta_c(P) of the simulated specimen.

    Its force at amplitude is linear but for the mechanisms. ``table`` interpolates the three lists (power law between
    and beyond points); ``theory`` takes k_c(P) from the contact theory of section ``analysis`` and zeta_c(P) from the
    table.
    """

    stiffness: Literal["table", "theory"] = "table"
    load_mn: tuple[Positive, ...] = (264.9, 348.3, 431.6, 524.8, 549.4, 627.8, 784.8, 927.0)
    contact_stiffness_n_per_um: tuple[Positive, ...] = (3.95, 5.87, 7.03, 7.59, 8.04, 8.90, 9.50, 10.32)
    damping_ratio: tuple[Positive, ...] = (0.028, 0.012, 0.005, 0.0018, 0.0017, 0.0016, 0.0016, 0.0016)
    stiffness_scatter_percent: NonNegative = 0.04
    damping_scatter_percent: NonNegative = 2.0

    @model_validator(mode="before")
    @classmethod
    def _law_by_mechanisms(cls, given: Any) -> Any:
        """Say what to write in the place of the force law that this section once had; the linear one is as it was."""
        if isinstance(given, dict) and not given.keys().isdisjoint(("law", "can_part")):
            if given.get("law", "linear") == "linear" and given.get("can_part", False) is False:
                return {key: value for key, value in given.items() if key not in ("law", "can_part")}
            law = LAWS.get(str(given.get("law")), ())
            ids = (*law, *(("contact_loss",) if given.get("can_part") is True else ()))
            listed = ", ".join(f"{{id: {name}}}" for name in ids)
            instead = f"write mechanisms: [{listed}] in section sim_backend" if ids else "the contact is linear"
            raise ValueError(f"law and can_part are no settings of the contact: leave them out, and {instead}")
        return given

    @model_validator(mode="before")
    @classmethod
    def _one_meaning_of_mn(cls, given: Any) -> Any:
        """Read the key that once had MN/m as mn, which everywhere else is millinewton."""
        if not isinstance(given, dict) or OLD_STIFFNESS not in given:
            return given
        if STIFFNESS in given:
            raise ValueError(f"{OLD_STIFFNESS} is the former name of {STIFFNESS} (1 N/um is 1 MN/m): give one of them")
        return {STIFFNESS if key == OLD_STIFFNESS else key: value for key, value in given.items()}

    @model_validator(mode="after")
    def _table(self) -> SimulatedContact:
        n = len(self.load_mn)
        if n < 2 or len(self.contact_stiffness_n_per_um) != n or len(self.damping_ratio) != n:
            raise ValueError("load_mn, contact_stiffness_n_per_um and damping_ratio need one length, at least 2")
        if any(b <= a for a, b in zip(self.load_mn, self.load_mn[1:], strict=False)):
            raise ValueError("load_mn must grow")
        return self


class SimulatedPulse(Section):
    """The tap: a smooth pulse of this length and of a strength relative to the preload."""

    duration_ms: Annotated[float, Field(gt=0, le=20)] = 0.3
    shape: Literal["half_sine", "haversine", "triangle"] = "half_sine"
    peak_force_ratio: Positive = 0.45
    strength_scatter_percent: NonNegative = 20.0


class SimulatedMechanism(Section):
    """Physics beyond Eq. 9: a mechanism's id and its parameters (`mesotap mechanisms` lists both).

    ``at`` names the body or element that it acts on, where it can act on several; the first where it is left out.
    """

    id: str
    at: str | None = None
    parameters: dict[str, Finite] = Field(default_factory=dict)

    _folders: tuple[str, ...] = PrivateAttr(default=())

    @model_validator(mode="after")
    def _known(self, info: ValidationInfo) -> SimulatedMechanism:
        self._folders = tuple((info.context or {}).get(FOLDERS, ()))
        self.adopted()
        return self

    def adopted(self) -> Acting:
        """Return it as the simulation takes it."""
        from sim_backend.adopted import adopted  # compiles force laws: only where there are any

        return adopted(self.id, self.parameters, self._folders, self.at)


class BadTaps(Section):
    """Share of taps that go wrong, each kind by itself."""

    double: Rate = 0.03
    too_hard: Rate = 0.03
    too_weak: Rate = 0.03
    off_centre: Rate = 0.03
    clipped: Rate = 0.01


class SimulatedNoise(Section):
    """Noise of the accelerometer channels: white plus a low-frequency share (first-order, power above falls off)."""

    rms_m_s2: NonNegative = 0.001
    coloured_share: Rate = 0.3
    corner_hz: Positive = 500.0


class SimulatedSensor(Section):
    """What one accelerometer and its cable do that the section ``rig.wiring`` does not say."""

    gain: Finite = 1.0  # over the declared: -1 upside down, 0 dead
    delay_samples: Annotated[int, Field(ge=0, le=1000)] = 0
    hum_m_s2: NonNegative = 0.0  # amplitude of the mains line


class SimulatedSensors(Section):
    """Faults of the wiring, to be found before a session; none by default."""

    a: SimulatedSensor = SimulatedSensor()
    b: SimulatedSensor = SimulatedSensor()
    swapped: bool = False  # A's cable is on B's input
    mains_hz: Positive = 50.0


class SimulatedHammer(Section):
    """What an instrumented hammer does that the section ``rig.wiring`` does not say."""

    gain: Finite = 1.0  # over the declared: -1 with reversed sign, 0 dead, 4.448 declared in mV/lbf
    noise_n: NonNegative = 0.001


class SimulatedRecorder(Section):
    """Errors of the recorder's converters, up to so much either way; its calibration knows them."""

    gain_error_percent: Annotated[float, Field(ge=0, le=10)] = 0.0
    offset_error_codes: Annotated[float, Field(ge=0, le=1000)] = 0.0


class SimulatedGauge(Section):
    """Strain gauge and its drift."""

    offset_mv: Finite = 0.35
    noise_mv: Positive = 0.02
    drift_mv_per_hour: Finite = 0.0
    sensitivity_drift_percent_per_hour: Finite = 0.0
    weight_error_mn: NonNegative = 0.1
    weight_settling_s: NonNegative = 5.0


class SimulatedStage(Section):
    """Motor micrometer of the simulated rig."""

    resolution_um: Positive = 0.02
    backlash_um: NonNegative = 2.0
    speed_um_per_s: Positive = 50.0
    speed_away_um_per_s: Positive = 200.0  # when the surfaces are taken apart


class SimBackendSettings(Section):
    """Section ``sim_backend``."""

    seed: Annotated[int, Field(ge=0)] = 1
    contact_position_um: Finite = 150.0
    parameter_errors: bool = True
    tube_damping_ratio: NonNegative = 0.0
    contact: SimulatedContact = SimulatedContact()
    pulse: SimulatedPulse = SimulatedPulse()
    bad_taps: BadTaps = BadTaps()
    noise: SimulatedNoise = SimulatedNoise()
    sensors: SimulatedSensors = SimulatedSensors()
    recorder: SimulatedRecorder = SimulatedRecorder()
    gauge: SimulatedGauge = SimulatedGauge()
    stage: SimulatedStage = SimulatedStage()
    mechanisms: tuple[SimulatedMechanism, ...] = ()
    hammer: SimulatedHammer | None = None  # only where rig.wiring declares one

    @model_serializer(mode="wrap")
    def _without_absent(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out a hammer that nobody described: a file then reads as it did before there were any."""
        written: dict[str, Any] = handler(self)
        if written.get("hammer", "") is None:
            del written["hammer"]
        return written

    @model_validator(mode="after")
    def _each_once(self) -> SimBackendSettings:
        names = [m.id for m in self.mechanisms]
        if len(set(names)) < len(names):
            raise ValueError("mechanisms: each can be there once")
        return self
