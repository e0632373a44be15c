"""Digital calibration certificates: what is written is complete and is read back; what is wrong or hostile is told."""

from __future__ import annotations

import os
import re
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibration.gauge import GaugeHistory
from calibration.settings import CalibrationSettings
from daq.errors import RecordingError
from daq.records import CalibrationPoints, RigDescription, Session
from mesotap.answers.certificate import Laboratory, certificate_xml
from mesotap.answers.certificate_check import read_certificate

LABORATORY = Laboratory("Laboratory for contacts", "Bremen", "DE")
SETTINGS = CalibrationSettings(latitude_deg=53.1, weight_class="M1")
SCHEMA = Path(os.environ.get("MESOTAP_DATA", Path(__file__).parents[4] / "shared" / "data")) / "dcc" / "dcc.xsd"


def session(**more) -> Session:
    rng = np.random.default_rng(1)
    load = np.array([0.0, 250, 500, 750, 1000, 1000, 750, 500, 250, 0.0])
    pre, post = (
        CalibrationPoints(load, 0.35 + 0.042 * load + 0.003 * rng.standard_normal(10), f"2026-03-0{day}T08:00:00Z")
        for day in (1, 2)
    )
    return Session(
        "2026-03-01T07:59:00Z", RigDescription(), (), pre, post, operator="A. Person", title="Gauge 7", **more
    )


def certificate(made: Session | None = None, laboratory: Laboratory = LABORATORY) -> bytes:
    return certificate_xml(made or session(), SETTINGS, laboratory, date(2026, 3, 3))


@pytest.fixture
def file(tmp_path) -> Path:
    path = tmp_path / "gauge.xml"
    path.write_bytes(certificate())
    return path


def test_a_certificate_is_read_back_without_a_fault(file):
    found = read_certificate(file)
    assert found.faults == ()
    assert (found.laboratory, found.begun, found.ended) == (LABORATORY.name, "2026-03-01", "2026-03-02")
    gauge = GaugeHistory(session().pre, session().post, SETTINGS).result()
    (sensitivity,) = (q for q in found.quantities if q.name == "Sensitivity")
    assert sensitivity.unit == r"\volt\newton\tothe{-1}"
    assert sensitivity.values[0] == pytest.approx(gauge.sensitivity_mv_per_mn.value)  # mV/mN is V/N
    assert sensitivity.uncertainties[0] == pytest.approx(gauge.sensitivity_mv_per_mn.half_width)
    (force,) = (q for q in found.quantities if q.name == "Force")
    assert len(force.values) == len(force.uncertainties) == 11
    assert force.values[-1] == pytest.approx(1.0, abs=1e-3)


def test_it_says_that_it_supports_the_standard_and_is_none_of_an_accredited_laboratory(file):
    text = file.read_text()
    assert "Supports a calibration after ISO/IEC 17025" in text
    assert "no certificate of an accredited laboratory" in text


def test_the_same_calibration_has_the_same_identifier_and_another_has_not():
    def identifier(content):
        return re.search(rb"uniqueIdentifier>([^<]+)<", content).group(1)

    assert identifier(certificate()) == identifier(certificate())
    other = certificate(laboratory=Laboratory("Another", "Bremen", "DE"))
    assert identifier(certificate()) != identifier(other)


def test_the_schema_of_ptb_finds_nothing(file):
    if not SCHEMA.is_file():
        pytest.skip(f"PTB's schema is not at {SCHEMA}; it is under the LGPL and not part of this program")
    found = read_certificate(file, SCHEMA)
    assert found.by_schema
    assert found.faults == ()


def test_a_schema_is_held_against_a_certificate(file, tmp_path):
    schema = tmp_path / "dcc.xsd"
    schema.write_text(
        '<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" targetNamespace="https://ptb.de/dcc">'
        '<xs:element name="digitalCalibrationCertificate" type="xs:integer"/></xs:schema>'
    )
    found = read_certificate(file, schema)
    assert found.faults
    assert found.faults[0].startswith("schema: ")


def test_what_is_no_schema_is_told(file, tmp_path):
    wrong = tmp_path / "dcc.xsd"
    wrong.write_text("<nothing/>")
    with pytest.raises(RecordingError, match="cannot be used as a schema"):
        read_certificate(file, wrong)


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("<dcc:items>.*</dcc:items>", "", "items is missing"),
        ("<dcc:uniqueIdentifier>.*?</dcc:uniqueIdentifier>", "", "uniqueIdentifier is missing or empty"),
        (">DE</dcc:countryCodeISO3166_1>", ">Germany</dcc:countryCodeISO3166_1>", "two capital letters"),
        ("2026-03-01</dcc:begin", "2026-03-09</dcc:begin", "ends .* before it begins"),
        ("2026-03-03</dcc:issue", "2026-02-03</dcc:issue", "issued .* before the calibration ended"),
        ("2026-03-02</dcc:end", "yesterday</dcc:end", "not a date"),
        (r"<si:unit>\\volt</si:unit>", "<si:unit/>", "unit is missing or empty"),
        ("<si:value>[^<]*</si:value>", "<si:value>NaN</si:value>", "which is no number"),
        ("<si:coverageFactor>[^<]*", "<si:coverageFactor>-2", "coverage factor is not positive"),
        ("<si:coverageProbability>[^<]*", "<si:coverageProbability>95", "not between 0 and 1"),
        ("<si:uncertaintyXMLList>[^ ]* ", "<si:uncertaintyXMLList>", "10 uncertainties for 11 values"),
        ('schemaVersion="3.2.1"', 'schemaVersion="latest"', "schemaVersion"),
    ],
)
def test_a_fault_is_named(file, before, after, words):
    text, count = re.subn(before, lambda _: after, file.read_text(), count=1, flags=re.DOTALL)
    assert count
    file.write_text(text)
    assert re.search(words, " | ".join(read_certificate(file).faults))


BOMB = '<!DOCTYPE a [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><a>&b;</a>'
OUTSIDE = '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]><a>&x;</a>'


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (BOMB, "declares a document type, an entity"),
        (OUTSIDE, "declares a document type, an entity"),
        ("<a>" * 500 + "</a>" * 500, "is no digital calibration certificate|nested"),
        ("<dcc:a", "is not XML"),
        ("", "is not XML"),
        ("<html/>", "is no digital calibration certificate"),
        ('<?xml version="1.0" encoding="no-such"?><a/>', "is not XML"),
    ],
)
def test_hostile_xml_is_refused_in_a_sentence(tmp_path, content, words):
    path = tmp_path / "hostile.xml"
    path.write_text(content)
    with pytest.raises(RecordingError, match=words) as caught:
        read_certificate(path)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_told(tmp_path):
    with pytest.raises(RecordingError, match=r"none\.xml: there is no such file"):
        read_certificate(tmp_path / "none.xml")


def test_a_session_without_a_calibration_has_nothing_to_certify():
    bare = Session("2026-03-01T07:59:00Z", RigDescription(), ())
    with pytest.raises(RecordingError, match="no usable calibration"):
        certificate(bare)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(operator=st.text(max_size=30), title=st.text(max_size=30), statement=st.text(min_size=1, max_size=20))
def test_texts_of_any_kind_make_a_certificate_that_is_read(tmp_path, operator, title, statement):
    made = Session(**{**{f: getattr(session(), f) for f in session().__slots__}, "operator": operator, "title": title})
    path = tmp_path / "gauge.xml"
    path.write_bytes(certificate(made, Laboratory(statement.strip() or "x", "y", "DE")))
    read_certificate(path)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(place=st.floats(0, 1), junk=st.binary(min_size=1, max_size=12))
def test_damaged_certificates_are_read_or_refused(file, tmp_path, place, junk):
    content = certificate_bytes()
    at = int(place * (len(content) - len(junk)))
    path = tmp_path / "damaged.xml"
    path.write_bytes(content[:at] + junk + content[at + len(junk) :])
    try:
        read_certificate(path)
    except RecordingError as error:
        assert "\n" not in str(error)


_MADE: list[bytes] = []


def certificate_bytes() -> bytes:
    if not _MADE:
        _MADE.append(certificate())
    return _MADE[0]
