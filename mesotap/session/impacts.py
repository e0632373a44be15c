"""From a record to an impact: the verdict, and what the journal says of it."""

from __future__ import annotations

from typing import Any

from daq.impact_group import digest_of
from daq.quality import judge
from daq.records import Impact
from daq.trigger import Record
from mesotap.configuration.config import Config
from rig import Accelerometers

Load = tuple[float, float]  # load, mN, and the bridge voltage behind it, mV


def judged_impact(
    record: Record,
    before: Load,
    after: Load,
    place: tuple[int, int, float],
    config: Config,
    recorder: Accelerometers,
) -> Impact:
    """Judge a record and make an impact of it.

    Parameters
    ----------
    before, after
        Load just before and after the tap.
    place
        Number of the impact, load set, target load in mN.
    """
    verdict = judge(
        record.acceleration,
        record.sample_rate_hz,
        record.pretrigger,
        preload_mn=(before[0] + after[0]) / 2,
        load_before_mn=before[0],
        load_after_mn=after[0],
        m2_kg=config.rig.moving_masses()[1],
        k2_n_per_m=config.rig.spring_stiffness()[1],
        full_scale_m_s2=recorder.full_scale_m_s2,
        bits=recorder.bits,
        quality=config.daq.quality,
    )
    number, load_set, target = place
    return Impact(
        number=number,
        load_set=load_set,
        target_load_mn=target,
        load_before_mn=before[0],
        load_after_mn=after[0],
        time=record.time,
        sample_rate_hz=record.sample_rate_hz,
        pretrigger=record.pretrigger,
        acceleration=record.acceleration,
        accepted=verdict.accepted,
        reject_reason=verdict.reason,
        strain_mv=record.strain_mv,
        force=record.force,
        voltage_before_mv=before[1],
        voltage_after_mv=after[1],
        extra={name: None if value != value else value for name, value in verdict.numbers.items()},  # NaN: unknown
    )


def impact_entry(impact: Impact) -> dict[str, Any]:
    """What the journal says of an impact."""
    return {
        "number": impact.number,
        "load_set": impact.load_set,
        "accepted": impact.accepted,
        "reject_reason": impact.reject_reason,
        "digest": digest_of(impact),
    }
