"""Where a session stands: a function of what is on disk, so that to resume is to start."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.hits import with_chosen
from daq.records import CalibrationPoints, Impact, RigDescription, Session, ZeroReading
from mesotap import __version__
from mesotap.configuration.config import Config
from mesotap.session.hand_verdicts import BY_HAND, IMPACT
from mesotap.session.states import Event, State, follow
from rig.hardware_log import Repetition, added
from rig.settings import RigSettings

SAFE = "safe"  # journal event: the surfaces were taken apart before the plan was done
NO_TAP = "no tap"  # nothing was felt in time
STARTED = "started"
HARDWARE = "hardware"  # what had to be repeated in one run of the program
ZERO = "zero"  # the gauge was read while the surfaces were apart
VERSION = "version"  # another version of the program went on
NOTES = (NO_TAP, STARTED, HARDWARE, VERSION, BY_HAND)  # what changes nothing of where the session stands


REPETITION = tuple(item.name for item in fields(Repetition))


def elapsed_of(entry: dict[str, Any]) -> NDArray[np.float64] | None:
    """Return the times of the readings of a calibration's entry since the first, s; None if it has none."""
    elapsed = entry.get("elapsed_s")
    return None if elapsed is None else np.array(elapsed, dtype=np.float64)


@dataclass(slots=True)
class Progress:
    """The state of a session after its journal.

    Attributes
    ----------
    state
        What to do next.
    load_set
        Step of the load plan.
    pre, post
        Calibrations done so far.
    contact
        Position (um) and load (mN) where contact was felt, None while apart.
    felt_before
        The same of the last contact on which a load was set, also when the surfaces are apart again.
    doubtful
        Whether the last exit did not see the surfaces apart: where they are is found out before anything goes on.
    load_mn
        Load at which the stage was locked.
    checkpoint
        The rig's own state after the last event.
    truths
        What a simulated rig was set to at each load.
    zeros
        Readings of the gauge without load, between the calibrations.
    hardware
        What had to be repeated in all runs that came to an end; None where none has told.
    """

    state: State = State.CONNECT
    load_set: int = 0
    pre: CalibrationPoints | None = None
    post: CalibrationPoints | None = None
    contact: tuple[float, float] | None = None
    felt_before: tuple[float, float] | None = None
    doubtful: bool = False
    load_mn: float = float("nan")
    checkpoint: dict[str, Any] = field(default_factory=dict)
    truths: list[dict[str, Any]] = field(default_factory=list)
    zeros: list[ZeroReading] = field(default_factory=list)
    hardware: tuple[Repetition, ...] | None = None

    @property
    def was_loaded(self) -> bool:
        """Whether a load was ever set, without which there is no tap."""
        return math.isfinite(self.load_mn)

    def apply(self, entry: dict[str, Any]) -> None:
        """Take in one entry of the journal."""
        name = entry["event"]
        self.checkpoint = entry.get("rig", self.checkpoint)
        if name == SAFE:
            self.doubtful = bool(entry.get("troubles"))
            if self.doubtful:
                return  # nobody knows: resume looks at the load
            self.contact = None
            if self.state in (State.SET_LOAD, State.LOCK, State.TAP):
                self.state = State.APPROACH
            return
        if name == ZERO:
            self.zeros.append(ZeroReading(float(entry["voltage_mv"]), str(entry["time"])))
            return
        if name == HARDWARE:
            told = tuple(Repetition(**{k: r[k] for k in REPETITION}) for r in entry["repeated"])
            self.hardware = added(self.hardware or (), told)
        if name == IMPACT or name in NOTES:
            return
        event = Event(name)
        if event is Event.CALIBRATED:
            points = CalibrationPoints(
                np.array(entry["load_mn"], dtype=np.float64),
                np.array(entry["voltage_mv"], dtype=np.float64),
                str(entry["time"]),
                elapsed_s=elapsed_of(entry),
            )
            if self.state is State.PRE_CALIBRATION:
                self.pre = points
            else:
                self.post = points
        elif event is Event.CONTACT:
            position, load = entry["position_um"], entry["load_mn"]
            self.contact = (float("nan") if position is None else float(position), float(load))
        elif event is Event.LOADED:
            self.load_mn = float(entry["load_mn"])
            self.felt_before = self.contact
            if entry.get("truth"):
                self.truths = [t for t in self.truths if t["load_set"] != self.load_set]
                self.truths.append({"load_set": self.load_set, **entry["truth"]})
        elif event is Event.LOAD_DONE:
            self.load_set += 1
        elif event is Event.APART:
            self.contact = None
        self.state = follow(self.state, event)


def progress_of(events: Iterable[dict[str, Any]]) -> Progress:
    """Return where a journal leaves a session."""
    progress = Progress()
    for entry in events:
        progress.apply(entry)
    return progress


def describe_rig(settings: RigSettings) -> RigDescription:
    """`/rig` of the session file, from the configuration."""
    k1, k2 = settings.spring_stiffness()
    m1, m2 = settings.moving_masses()
    declared, inertia = settings.filter, settings.springs.inertia()
    own = None if inertia is None else inertia.own_mode
    return RigDescription(
        m1_kg=m1,
        m2_kg=m2,
        k1_n_per_m=k1,
        k2_n_per_m=k2,
        sample_rate_hz=settings.wiring.sample_rate_hz,
        highpass_hz=declared.highpass_hz,
        highpass_order=declared.highpass_order,
        lowpass_hz=declared.lowpass_hz,
        lowpass_order=declared.lowpass_order,
        filter_family=declared.family,
        full_scale_m_s2=settings.wiring.full_scale_m_s2(),
        bits=settings.wiring.bits,
        tube_added_kg=0.0 if inertia is None else inertia.added_kg,
        tube_mode_kg=0.0 if own is None else own.mass_kg,
        tube_mode_hz=0.0 if own is None else own.frequency_hz,
    )


def chosen_of_surplus(impacts: Iterable[Impact], config: Config | None) -> tuple[Impact, ...]:
    """Return the impacts with the best of each load chosen, where a session takes more than it uses."""
    recorded = tuple(impacts)
    if config is None or not config.mesotap.surplus_impacts:
        return recorded
    return tuple(with_chosen(recorded, config.mesotap.impacts_per_load))


def assemble(header: dict[str, Any], config: Config, progress: Progress, impacts: Iterable[Impact]) -> Session:
    """Make the session from what is on disk; complete if the plan was carried out to its end."""
    recorded = chosen_of_surplus(impacts, config)
    rig = describe_rig(config.rig)
    if recorded:
        # what the recorder's clock really gave: 25.6 kHz where 25 was asked of an NI 9234
        rig = replace(rig, sample_rate_hz=recorded[0].sample_rate_hz)
    return Session(
        created=str(header["created"]),
        rig=rig,
        impacts=recorded,
        pre=progress.pre,
        post=progress.post,
        zeros=tuple(progress.zeros),
        operator=config.mesotap.operator,
        specimen=config.mesotap.specimen,
        title=config.mesotap.title,
        software=f"mesotap {__version__}" + (" (simulated rig)" if header.get("simulated") else ""),
        complete=progress.state in (State.FILE, State.DONE),
        config=str(header["config"]),
        hardware=progress.hardware,
    )
