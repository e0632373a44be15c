"""What a session's own configuration declares of its rig, with its uncertainties."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping

import yaml

from analysis.mismatch.answer import LOAD_SCALE
from calibration.gauge import GaugeHistory
from calibration.settings import CalibrationSettings
from daq.records import Session
from mesotap.configuration.config import ConfigError, parse_config
from mesotap.configuration.yaml_text import NOT_YAML
from rig.settings import Masses, RigSettings, Springs


def rig_settings(session: Session) -> RigSettings:
    """Return the rig of the configuration that was in force; the program's own where a session keeps none.

    Which device stood behind a part does not matter any more, and its driver may not be installed here. A configuration
    of another version may hold keys that this one does not know: then its masses and springs count.
    """
    if not session.config.strip():
        return RigSettings()
    try:
        return parse_config(session.config).rig
    except ConfigError:
        pass
    try:
        content = yaml.safe_load(session.config)
        rig = content.get("rig", {}) if isinstance(content, dict) else {}
        with contextlib.suppress(ValueError):
            return RigSettings.model_validate({key: value for key, value in rig.items() if key != "parts"})
        known = {
            name: {key: value for key, value in rig[name].items() if key in section.model_fields}
            for name, section in (("masses", Masses), ("springs", Springs))
            if name in rig
        }
        return RigSettings.model_validate(known)
    except (*NOT_YAML, ValueError):
        return RigSettings()


def header_uncertainty(session: Session) -> Mapping[str, float]:
    """Return the standard errors of the masses (kg) and springs (N/m) in a session's header, by its names.

    Beside these, where the gauge was calibrated, the relative one that all loads have in common.
    """
    rig = rig_settings(session)
    share = rig.springs.uncertainty_percent / 100
    inertia = rig.springs.inertia()
    mass = math.hypot(rig.masses.uncertainty_kg, 0.0 if inertia is None else inertia.uncertainty_kg)
    load = _error_of_loads(session)
    return {
        "m1_kg": mass,
        "m2_kg": mass,
        "k1_n_per_m": share * session.rig.k1_n_per_m,
        "k2_n_per_m": share * session.rig.k2_n_per_m,
    } | ({} if load is None else {LOAD_SCALE: load})


def _error_of_loads(session: Session) -> float | None:
    """Return the relative standard error of the largest load by the session's calibrations; None without one."""
    try:
        settings = parse_config(session.config).calibration if session.config.strip() else CalibrationSettings()
    except ConfigError:
        settings = CalibrationSettings()
    history = GaugeHistory(session.pre, session.post, settings, session.zeros)
    read = [(i.load_before_mn, i.time) for i in session.impacts if i.accepted and math.isfinite(i.load_before_mn)]
    if not read:
        return None
    largest, time = max(read)
    line = history.scale_at(time)
    if line is None:
        return None
    load = history.load_at(line.offset_mv + line.sensitivity_mv_per_mn * largest, time)
    return None if load is None or load.value <= 0 else load.standard_error / load.value
