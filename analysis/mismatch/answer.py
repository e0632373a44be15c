"""What a diagnosis answers, for any rig: verdict, mechanisms, what is left over, limits, rivals, and what to do next.

The types hold what the contract ``mesotap-diagnosis`` 2 says, in SI units; how they are written is not their concern.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

from calibration.estimate import Estimate
from sim_backend.arrangement import LOWER, UPPER
from sim_backend.arrays import Real

Verdict = Literal["consistent", "missing_physics", "new_physics", "unexplained"]
Move = Literal["load", "tap", "rest", "swap_channels", "other_place", "input"]
LawKind = Literal["static", "rate", "memory", "time", "load", "sensor", "input", "clock", "dynamics"]
Symmetry = Literal["odd", "even", "none"]

TESTER: Final = "two-mass tester"
"""Name of the rig of Eq. 9."""
LOAD_SCALE: Final = "load_scale"
"""Constant by which all loads of sessions have to be multiplied: what they have in common may be wrong."""
TESTER_SCALES: Final = frozenset({"m1", "m2", LOAD_SCALE})
"""Constants of the tester that say how large forces are."""
LOAD_CELL: Final = "load cell"
"""Component whose mechanisms are no part of a ring-down."""


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate with its 95 % interval."""

    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True, slots=True)
class ContactAtRest:
    """Contact at one load in the limit of no motion: k_c (N/m), c_c (N s/m), and zeta2, which they give by Eq. 9."""

    load_n: float
    stiffness: Estimate
    damping: Estimate
    damping_ratio: Estimate


@dataclass(frozen=True, slots=True)
class RecordingFile:
    """A file that was diagnosed and the SHA-256 of its content."""

    file: str
    sha256: str


@dataclass(frozen=True, slots=True)
class Formula:
    """A closed form of a learned law.

    Attributes
    ----------
    evidence
        The logarithm of its Bayes factor over the free form.
    family, values
        Family of `sim_backend.learned.forms`, and all numbers in it, those that stayed fixed as well.
    """

    text: str
    parameters: Mapping[str, Interval]
    evidence: float
    family: str = ""
    values: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class LawTable:
    """A learned force, N, with its 95 % band on the grid of the axes; arrays of the shape that the axes span."""

    axes: Mapping[str, Real]
    force_n: Real
    low: Real
    high: Real


@dataclass(frozen=True, slots=True)
class Law:
    """What is known of a learned law.

    Attributes
    ----------
    conservative
        None where the recordings do not tell.
    exponents
        Of the power law nearest to it, by variable; None where it does not depend on the variable.
    formulas
        Empty where none is as good as the free form; ``curve`` is the key of a curve's family, which has none.
    valid
        Range of each variable that the recordings cover; beyond, the law is an extrapolation.
    """

    kind: LawKind
    symmetry: Symmetry
    conservative: bool | None
    exponents: Mapping[str, Interval | None]
    formulas: tuple[Formula, ...]
    valid: Mapping[str, tuple[float, float]]
    table: LawTable | None
    curve: str = ""


@dataclass(frozen=True, slots=True)
class Named:
    """A mechanism that the linear rig leaves out.

    Attributes
    ----------
    where, element
        Class of the component, and the rig's own name of the element that it acts in or the body that it is on; None
        where it is in none.
    fixed
        Values in it that were not fitted.
    law
        Of a learned one.
    """

    id: str
    probability: float
    where: str
    statement: str
    parameters: dict[str, Interval]
    indistinguishable_from: tuple[str, ...]
    fixed: dict[str, float] = field(default_factory=dict)
    element: str | None = None
    learned: bool = False
    law: Law | None = None

    @property
    def place(self) -> str:
        """Where it acts, in words: the class of the component with the rig's own name, or the body that it is on."""
        if self.element in (None, self.where):
            return self.where
        return str(self.element) if self.element in (UPPER, LOWER) else f"{self.where}: {self.element}"


@dataclass(frozen=True, slots=True)
class Location:
    """Where the recordings hold more than a model: component, channels, time (s), frequency (Hz), groups by label."""

    component: str
    element: str | None
    channels: tuple[str, ...]
    time_s: tuple[float, float]
    frequency_hz: tuple[float, float]
    groups: tuple[str, ...]
    why: str


@dataclass(frozen=True, slots=True)
class Remainder:
    """What the recordings hold beyond the linear rig with the mechanisms named.

    Attributes
    ----------
    share
        Of the chi-squared beyond chance that the linear rig misses; 0 where it misses nothing.
    chi_squared, p_value
        What forces and channels of any shape would still take away beyond chance, and its p-value.
    where
        None where nothing beyond noise is left.
    """

    share: float
    chi_squared: float
    p_value: float
    where: Location | None
    statement: str


@dataclass(frozen=True, slots=True)
class SetAside:
    """What took no part in the answer, an impact or samples of a recording; its group's label where it has one."""

    name: str
    group: str
    statement: str


@dataclass(frozen=True, slots=True)
class UpperLimit:
    """What the strength of a mechanism that is not named does not exceed, with this probability."""

    id: str
    parameter: str
    value: float
    unit: str
    probability: float


@dataclass(frozen=True, slots=True)
class Rival:
    """Another explanation; ``heldout_rms`` in the unit of the fit, None where it was not computed."""

    ids: tuple[str, ...]
    probability: float
    heldout_rms: float | None
    why: str


@dataclass(frozen=True, slots=True)
class ChannelErrors:
    """Errors of one channel on what was held out, rms in its ``unit``; see `FitSummary`.

    ``heldout_over_noise`` is how much larger than noise the errors of the best model are in what cannot be predicted of
    them, which coloured noise leaves at 1.
    """

    channel: str
    unit: str
    noise_rms: float
    heldout_rms_before: float
    heldout_rms_after: float | None
    heldout_over_noise: float


@dataclass(frozen=True, slots=True)
class FitSummary:
    """How well segments that took no part are predicted, rms in ``unit``, of all channels that have it.

    Attributes
    ----------
    noise_rms
        What cannot be predicted of the errors, of the same channels.
    heldout_rms_before, heldout_rms_after
        By the linear rig, NaN where nothing was held out; with the mechanisms named, None where none is.
    heldout_segments, segments, groups
        Segments held out, all segments, and the groups that they come in, such as loads.
    stretches
        Error before and after on each stretch of time that was declared as held out.
    steady_error
        Relative error of the force of held-out steady responses, before and after; None without any.
    channels
        The errors of each channel by itself, where recordings have several quantities.
    """

    unit: str
    noise_rms: float
    heldout_rms_before: float
    heldout_rms_after: float | None
    heldout_segments: int
    segments: int
    groups: int
    stretches: Mapping[str, tuple[float, float | None]] = field(default_factory=dict)
    steady_error: tuple[float, float | None] | None = None
    channels: tuple[ChannelErrors, ...] = ()


@dataclass(frozen=True, slots=True)
class NextExperiment:
    """What would part two explanations; load (N) and peak of the dynamic force over it where they say something."""

    load_n: float | None
    peak_force_ratio: float | None
    separates: tuple[str, str]
    why: str
    moves: tuple[Move, ...]


@dataclass(frozen=True, slots=True)
class FittedRig:
    """The rig as fitted with the mechanisms named.

    Attributes
    ----------
    constants
        With 95 % intervals: infinite where recordings do not determine them, of no width where they were not fitted.
    contact
        At each load.
    off
        By how many declared standard errors constants are off what was declared, where that is much: it was declared
        wrongly, or the constant stands in for something.
    also
        Other values of constants with which every channel shows exactly the same.
    """

    constants: Mapping[str, Interval]
    contact: tuple[ContactAtRest, ...] = ()
    off: Mapping[str, float] = field(default_factory=dict)
    also: tuple[Mapping[str, float], ...] = ()


@dataclass(frozen=True, slots=True)
class AtAmplitude:
    """Frequency (Hz) and damping ratio of a decay about one amplitude, in the channel's unit, and when (s)."""

    time_s: float
    amplitude: float
    frequency_hz: float
    damping_ratio: float


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer of a diagnosis.

    Attributes
    ----------
    p_value
        Under the linear model with its constants refitted.
    mechanisms
        Strongest first.
    complete_probability
        That these mechanisms and nothing else that could be seen made the recordings.
    loads_n
        Load (N) of each group by its label, ascending; empty where groups have none.
    far_off
        Whether the rig as declared misses most of the motion, so that its own constants must be wrong.
    fitted
        What a simulated rig needs to become the twin; None where nothing explains better than the linear rig.
    decay
        Of a free decay of one body: frequency and damping against amplitude.
    set_aside
        Impacts, or samples, that took no part.
    worse_than_zero
        That the linear rig predicts the recordings worse than zero does, and what to leave free; else empty.
    otherwise
        What the rig file would have to do for nothing to be left, such as ``says 'recording: {hold: zero}'``.
    """

    recordings: tuple[RecordingFile, ...]
    rig: str
    verdict: Verdict
    p_value: float
    mechanisms: tuple[Named, ...]
    complete_probability: float
    remainder: Remainder
    upper_limits: tuple[UpperLimit, ...]
    rivals: tuple[Rival, ...]
    location: Location | None
    fit: FitSummary
    next_experiment: NextExperiment | None
    loads_n: Mapping[str, float] = field(default_factory=dict)
    far_off: bool = False
    fitted: FittedRig | None = None
    decay: tuple[AtAmplitude, ...] = ()
    set_aside: tuple[SetAside, ...] = ()
    worse_than_zero: str = ""
    otherwise: str = ""
