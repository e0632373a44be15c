"""One tap of the simulated rig, as a session of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from daq.records import Session
from daq.trigger import record_impact
from mesotap import __version__
from mesotap.configuration.config import Config, effective_text
from mesotap.session.bench import simulated_rig, truth_now
from mesotap.session.impacts import judged_impact
from mesotap.session.progress import describe_rig
from rig import GaugeScale
from rig.interlock import Interlock


@dataclass(frozen=True, slots=True)
class SimulatedTap:
    """A session of one impact, what the rig was set to, and what its parts said when they were opened."""

    session: Session
    truth: Mapping[str, Any]
    said: tuple[str, ...]


def simulated_tap(config: Config, load_mn: float, seed: int | None) -> SimulatedTap:
    """Approach, load, lock and record one tap.

    Parameters
    ----------
    load_mn
        Preload; within the limits of the configuration.
    seed
        Of the simulated rig; that of the configuration where None.
    """
    rig = simulated_rig(config, seed=seed)
    scale = GaugeScale(rig.true_parameters()["sensitivity_mv_per_mn"], config.sim_backend.gauge.offset_mv)
    lines = rig.open()
    with Interlock(rig, config.rig.limits, scale, config.rig.spring_stiffness()) as interlock:
        interlock.approach()
        interlock.set_load(load_mn, config.mesotap.load_tolerance_mn)
        interlock.lock()
        before = interlock.read_load()
        record = record_impact(rig.accelerometers, rig.impactor, rig.clock, config.daq.trigger, before[0])
        impact = judged_impact(record, before, interlock.read_load(), (0, 0, load_mn), config, rig.accelerometers)
        truth = truth_now(rig)
    rig.close()
    session = Session(
        created=record.time,
        rig=describe_rig(config.rig),
        impacts=(impact,),
        operator=config.mesotap.operator,
        specimen=config.mesotap.specimen,
        title="one simulated ring-down",
        software=f"mesotap {__version__} (simulated rig)",
        complete=True,
        config=effective_text(config),
    )
    return SimulatedTap(session, truth, tuple(lines))
