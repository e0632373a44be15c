"""``analyze --driving-point``: both masses and their contact by a hammer, with the struck mass's own acceleration."""

from __future__ import annotations

from typing import Any

from rich.console import Console

from analysis.frequency_response.driving_point import TRIED, DrivingPoint, two_masses
from analysis.frequency_response.estimators import ForceError
from analysis.frequency_response.hits import is_lasting
from analysis.frequency_response.impacts import of_each_hit
from analysis.moving_masses import moving_masses
from daq.errors import RecordingError
from daq.exchange import Recording
from daq.exchange.units import newtons
from daq.records import RigDescription
from mesotap.answers.frequency_response import estimate_json
from mesotap.answers.rounding import with_uncertainty
from mesotap.commands.force_channel import ForceOptions, channel_called, force_of
from mesotap.configuration.config import Config
from mesotap.operator.tables import Table
from mesotap.operator.terminal import escape
from mesotap.session.progress import describe_rig

SENSITIVITIES = (
    "the uncertainty of the sensitivities is not in these intervals: an error of 1 % in response over force is one of "
    "1 % in all of them"
)
SHOWN = (
    ("mass struck, g", "upper_mass", 1e3),
    ("other mass, g", "lower_mass", 1e3),
    ("k_c, MN/m", "contact_stiffness", 1e-6),
    ("c_c, N s/m", "contact_damping", 1.0),
    ("k1 + k2, MN/m", "spring_sum", 1e-6),
)


def by_driving_point(recording: Recording, options: ForceOptions, config: Config) -> tuple[DrivingPoint, str, str]:
    """Return Eq. 9 fitted to both masses' responses, and the names of the struck one's channel and of the other's.

    Masses and springs of the configuration are where the fit begins.

    Raises
    ------
    RecordingError
        There is no force of hits, not one other channel besides, or nothing fits.
    """
    source = recording.source
    force = force_of(recording, options.channel)
    if force is None:
        raise RecordingError(
            f"{source}: has no channel in N, mN, kN, lbf or kgf: say with --force which is the hammer's"
        )
    driving = channel_called(recording, str(options.driving_point), "--driving-point")
    others = [i for i in range(len(recording.names)) if i not in (force, driving)]
    if driving == force:
        raise RecordingError(f"{source}: --driving-point {recording.names[driving]}: is the force itself")
    if len(others) != 1:
        raise RecordingError(
            f"{source}: --driving-point takes a force and the accelerations of two masses; besides these it has "
            f"{len(others) or 'no'} other channels"
        )
    units = recording.units or (recording.unit,) * len(recording.names)
    foreign = next((units[i] for i in (driving, *others) if units[i] not in ("m/s2", "")), None)
    if foreign is not None:
        raise RecordingError(f"{source}: --driving-point takes accelerations, not a channel in {foreign}")
    if is_lasting(recording.data[force]):
        raise RecordingError(f"{source}: --driving-point takes hits, and this force lasts")
    declared = describe_rig(config.rig)
    rig = RigDescription(declared.m1_kg, declared.m2_kg, declared.k1_n_per_m, declared.k2_n_per_m)
    moving, _ = moving_masses(declared, config.rig.masses, config.rig.springs)
    names = [recording.names[i] for i in (driving, *others)]
    pushed = recording.data[force] * (newtons(units[force]) or 1.0)
    try:
        rows = recording.data[[driving, *others]]
        measured = of_each_hit(pushed, rows, recording.rate_hz, names, "m/s2/N", True, options.segment_s)
        split = config.analysis.spring_asymmetry_percent / 100
        return two_masses(measured, rig, moving, 0, 1, split_error=split), names[0], names[1]
    except ForceError as error:
        raise RecordingError(f"{source}: --driving-point: {error}") from error


def show_driving_point(found: tuple[DrivingPoint, str, str], console: Console) -> None:
    """Print masses, contact and springs with their 95 % intervals."""
    answer, driving, other = found
    shown = Table(title=f"Eq. 9 by the hammer: {escape(driving)} on the mass struck, {escape(other)} on the other")
    for heading, _, _ in SHOWN:
        shown.add_column(heading, justify="right")
    shown.add_row(*(with_uncertainty(getattr(answer.fit, name), scale) for _, name, scale in SHOWN))
    console.print(shown)
    for said in said_of(answer):
        console.print(f"- {escape(said)}", highlight=False, soft_wrap=True)


def said_of(answer: DrivingPoint) -> list[str]:
    """Return what is to be known of such a fit, in sentences."""
    fit, (struck, other, stiffness) = answer.fit, (100 * change for change in answer.changes)
    hits = f"{fit.repeats} hits; the model misses {100 * fit.misfit:.2g} % of both responses (rms)"
    springs = (
        "the responses hardly tell k1 from k2, only their sum: their ratio is the declared one (rig.springs), known as "
        f"well as analysis.spring_asymmetry_percent says; with k1 {100 * TRIED:g} % stiffer against k2 the mass struck "
        f"would come out {struck:+.2g} %, the other {other:+.2g} %, k_c {stiffness:+.2g} %"
    )
    return [hits, springs, SENSITIVITIES]


def driving_point_json(found: tuple[DrivingPoint, str, str]) -> dict[str, Any]:
    """Return the same as JSON types."""
    answer, driving, other = found
    fit = answer.fit
    return {
        "channel": driving,
        "other": other,
        "struck_mass_kg": estimate_json(fit.upper_mass),
        "other_mass_kg": estimate_json(fit.lower_mass),
        "contact_stiffness_n_per_m": estimate_json(fit.contact_stiffness),
        "contact_damping_n_s_per_m": estimate_json(fit.contact_damping),
        "spring_sum_n_per_m": estimate_json(fit.spring_sum),
        "misfit": fit.misfit,
        "hits": fit.repeats,
        "notes": said_of(answer),
    }
