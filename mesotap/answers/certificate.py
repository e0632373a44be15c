"""A digital calibration certificate of the strain gauge, in the XML of PTB's DCC 3.2.1 with quantities by D-SI 2.1.

The names of elements and their order are those of the schema (https://ptb.de/dcc/v3.2.1/dcc.xsd), which is not part of
this program (docs/certificate.md).
"""

from __future__ import annotations

import uuid
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date, datetime

import numpy as np

from calibration.estimate import LEVEL, Estimate
from calibration.gauge import GaugeHistory
from calibration.settings import CalibrationSettings
from daq.errors import RecordingError
from daq.records import CalibrationPoints, Session
from mesotap import __version__

DCC, SI = "https://ptb.de/dcc", "https://ptb.de/si"
SCHEMA_VERSION = "3.2.1"
VOLT, NEWTON, PER_NEWTON = r"\volt", r"\newton", r"\volt\newton\tothe{-1}"
UNSTATED = "not stated"
NAMESPACE = uuid.UUID("5e2f4c8e-7a1b-4f0e-9d53-6f6d65736f74")  # of identifiers, which follow from what is certified
DISCLAIMER = (
    "Supports a calibration after ISO/IEC 17025: quantities and uncertainties are laid out for it. "
    "This document was made by a program from a session's own data, is not signed, and is no certificate of an "
    "accredited laboratory."
)


@dataclass(frozen=True, slots=True)
class Laboratory:
    """Who calibrated, where: name, city, country (two letters, ISO 3166-1)."""

    name: str
    city: str
    country: str


def certificate_xml(session: Session, settings: CalibrationSettings, laboratory: Laboratory, issued: date) -> bytes:
    """Return the certificate of the gauge as a session calibrated it.

    Parameters
    ----------
    session
        With at least one calibration.
    settings
        What is declared of weights, gravity and drift.
    laboratory
        Goes into the administrative part.
    issued
        Date of issue.

    Raises
    ------
    RecordingError
        The session holds no calibration that can be used.
    """
    history = GaugeHistory(session.pre, session.post, settings, session.zeros)
    result = history.result()
    done = [
        (when, points)
        for when, points, fit in (
            ("before", session.pre, history.pre_fit),
            ("after", session.post, history.post_fit),
        )
        if points is not None and fit is not None
    ]
    if result is None or not done:
        raise RecordingError(
            f"{session.source or 'session'}: there is no usable calibration to certify: {'; '.join(history.notes)}"
        )
    for prefix, space in (("dcc", DCC), ("si", SI)):
        ET.register_namespace(prefix, space)
    root = ET.Element(_dcc("digitalCalibrationCertificate"), {"schemaVersion": SCHEMA_VERSION})
    _administrative(root, session, laboratory, [points for _, points in done], issued)
    measurement = _add(_add(root, "measurementResults"), "measurementResult")
    _text(_add(measurement, "name"), "Calibration of the strain gauge with dead weights")
    _methods(measurement, settings)
    _conditions(measurement, settings)
    results = _add(measurement, "results")
    line = _result(results, "Line of the gauge midway between the calibrations", result.statement or None)
    _real(line, "Sensitivity", result.sensitivity_mv_per_mn, PER_NEWTON, 1.0)
    _real(line, "Voltage without load", result.offset_mv, VOLT, 1e-3)
    for when, points in done:
        _points(results, f"Readings of the calibration {when} the test", points)
    _curve(results, history, done[0][1])
    ET.indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="utf-8") + b"\n"


def _administrative(
    root: ET.Element,
    session: Session,
    laboratory: Laboratory,
    calibrations: Sequence[CalibrationPoints],
    issued: date,
) -> None:
    part = _add(root, "administrativeData")
    software = _add(_add(part, "dccSoftware"), "software")
    _text(_add(software, "name"), "mesotap")
    _add(software, "release", __version__)
    core = _add(part, "coreData")
    _add(core, "countryCodeISO3166_1", laboratory.country)
    _add(core, "usedLangCodeISO639_1", "en")
    _add(core, "mandatoryLangCodeISO639_1", "en")
    days = [_day(points.time) or _day(session.created) or issued for points in calibrations]
    content = b"".join(p.load_mn.tobytes() + p.voltage_mv.tobytes() for p in calibrations)
    name = f"{session.created} {laboratory.name} {content.hex()}"
    _add(core, "uniqueIdentifier", str(uuid.uuid5(NAMESPACE, name)))
    _add(core, "beginPerformanceDate", min(days).isoformat())
    _add(core, "endPerformanceDate", max(days).isoformat())
    _add(core, "performanceLocation", "laboratory")
    _add(core, "issueDate", issued.isoformat())
    item = _add(_add(part, "items"), "item")
    _text(_add(item, "name"), "Strain gauge bridge on the tube spring of a contact-resonance tester, with amplifier")
    identification = _add(_add(item, "identifications"), "identification")
    _add(identification, "issuer", "calibrationLaboratory")
    _add(identification, "value", _plain(session.title) or "strain gauge of the tester")
    contact = _add(_add(part, "calibrationLaboratory"), "contact")
    _contact(contact, laboratory)
    person = _add(_add(part, "respPersons"), "respPerson")
    _text(_add(_add(person, "person"), "name"), _plain(session.operator) or UNSTATED)
    _add(person, "mainSigner", "true")
    _contact(_add(part, "customer"), laboratory)
    statement = _add(_add(part, "statements"), "statement")
    _text(_add(statement, "declaration"), DISCLAIMER)


def _methods(measurement: ET.Element, settings: CalibrationSettings) -> None:
    method = _add(_add(measurement, "usedMethods"), "usedMethod")
    _text(_add(method, "name"), "Dead weights, upwards and downwards")
    weights = (
        f"class {settings.weight_class} of OIML R 111"
        if settings.weight_class is not None
        else f"standard uncertainty {settings.weight_uncertainty_mn:g} mN each"
    )
    _text(
        _add(method, "description"),
        f"Weights of {weights}; curve with one curvature, offset and sensitivity followed between the calibrations. "
        "Uncertainties combine weights, local gravity, buoyancy of the air, scatter of the readings, misfit of the "
        "curve, hysteresis, resolution and drift.",
    )
    _add(method, "norm", "JCGM 100:2008")
    _add(method, "norm", "JCGM 101:2008")


def _conditions(measurement: ET.Element, settings: CalibrationSettings) -> None:
    gravity = settings.gravity
    condition = _add(_add(measurement, "influenceConditions"), "influenceCondition")
    _text(_add(condition, "name"), "Local gravity")
    _text(_add(condition, "description"), f"Known {gravity.source}.")
    coverage = 0.95 * 3**0.5 if gravity.distribution == "rectangular" else None
    estimate = Estimate(gravity.value, gravity.standard_uncertainty, coverage=coverage)
    _real(_add(condition, "data"), "Acceleration of free fall", estimate, r"\metre\second\tothe{-2}", 1.0)


def _points(results: ET.Element, name: str, points: CalibrationPoints) -> None:
    table = _add(_result(results, name, f"In the order of recording, about {points.time}."), "list")
    _values(table, "Force of the weights", points.load_mn * 1e-3, NEWTON)
    _values(table, "Voltage of the bridge", points.voltage_mv * 1e-3, VOLT)


def _curve(results: ET.Element, history: GaugeHistory, points: CalibrationPoints) -> None:
    """Force that the gauge means, with its expanded uncertainty, at voltages over the range of the weights."""
    scale = history.scale_at("")
    if scale is None:
        return
    span = np.linspace(float(points.load_mn.min()), float(points.load_mn.max()), 11)
    voltage = scale.offset_mv + scale.sensitivity_mv_per_mn * span
    found = [history.load_at(float(v), "") for v in voltage]
    loads = [load for load in found if load is not None]
    table = _add(
        _result(results, "Force by voltage", "By the curve midway between the calibrations, without the reading."),
        "list",
    )
    _values(table, "Voltage of the bridge", voltage * 1e-3, VOLT)
    _values(table, "Force", np.array([load.value for load in loads]) * 1e-3, NEWTON, loads, 1e-3)


def _result(results: ET.Element, name: str, description: str | None) -> ET.Element:
    result = _add(results, "result")
    _text(_add(result, "name"), name)
    if description:
        _text(_add(result, "description"), description)
    return _add(result, "data")


def _real(parent: ET.Element, name: str, estimate: Estimate, unit: str, scale: float) -> None:
    quantity = _add(parent, "quantity")
    _text(_add(quantity, "name"), name)
    real = ET.SubElement(quantity, _si("real"))
    ET.SubElement(real, _si("value")).text = _number(estimate.value * scale)
    ET.SubElement(real, _si("unit")).text = unit
    expanded = ET.SubElement(real, _si("expandedUnc"))
    ET.SubElement(expanded, _si("uncertainty")).text = _number(estimate.half_width * scale)
    ET.SubElement(expanded, _si("coverageFactor")).text = _number(_factor(estimate))
    ET.SubElement(expanded, _si("coverageProbability")).text = f"{LEVEL:g}"


def _values(
    parent: ET.Element,
    name: str,
    values: np.ndarray,
    unit: str,
    estimates: Sequence[Estimate] = (),
    scale: float = 1.0,
) -> None:
    quantity = _add(parent, "quantity")
    _text(_add(quantity, "name"), name)
    content = ET.SubElement(quantity, _si("realListXMLList"))
    ET.SubElement(content, _si("valueXMLList")).text = " ".join(map(_number, values))
    ET.SubElement(content, _si("unitXMLList")).text = unit
    if estimates:
        expanded = ET.SubElement(content, _si("expandedUncXMLList"))
        widths = (_number(e.half_width * scale) for e in estimates)
        ET.SubElement(expanded, _si("uncertaintyXMLList")).text = " ".join(widths)
        ET.SubElement(expanded, _si("coverageFactorXMLList")).text = " ".join(_number(_factor(e)) for e in estimates)
        ET.SubElement(expanded, _si("coverageProbabilityXMLList")).text = f"{LEVEL:g}"


def _factor(estimate: Estimate) -> float:
    return estimate.half_width / estimate.standard_error if estimate.standard_error > 0 else 2.0


def _contact(parent: ET.Element, laboratory: Laboratory) -> None:
    _text(_add(parent, "name"), laboratory.name)
    location = _add(parent, "location")
    _add(location, "city", laboratory.city)
    _add(location, "countryCode", laboratory.country)


def _text(parent: ET.Element, text: str) -> None:
    _add(parent, "content", _plain(text)).set("lang", "en")


def _plain(text: str) -> str:
    """Return a text without what XML cannot hold, and with single blanks."""
    kept = "".join(c if c.isprintable() or c.isspace() else "\N{REPLACEMENT CHARACTER}" for c in text)
    return " ".join(kept.encode("utf-8", "replace").decode().split())


def _number(value: float) -> str:
    """Return a number as xs:decimal with an exponent, as D-SI writes it."""
    return f"{float(value):.9g}"


def _add(parent: ET.Element, name: str, text: str | None = None) -> ET.Element:
    child = ET.SubElement(parent, _dcc(name))
    child.text = text
    return child


def _dcc(name: str) -> str:
    return f"{{{DCC}}}{name}"


def _si(name: str) -> str:
    return f"{{{SI}}}{name}"


def _day(time: str) -> date | None:
    try:
        return datetime.fromisoformat(time).date()
    except (TypeError, ValueError):
        return None
