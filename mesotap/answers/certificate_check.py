"""Reading a digital calibration certificate that somebody else may have written, and what is wrong with it."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import fromstring

from daq.durable import cause_of, read_plain
from daq.errors import RecordingError, one_line
from mesotap.answers.certificate import DCC, SI

LARGEST_CERTIFICATE = 16 * 2**20  # bytes; one of a thousand points has a hundredth
DEEPEST = 100  # elements within each other; the schema's own nesting reaches 30
MOST_FAULTS = 20
REQUIRED = ("dccSoftware", "coreData", "items", "calibrationLaboratory", "respPersons", "customer")
SIGNATURE = "http://www.w3.org/2000/09/xmldsig#"
IMPORTED = ((SI, "SI_Format.xsd"), (SIGNATURE, "xmldsig-core-schema.xsd"))  # by the schema of a certificate
CORE = (
    "countryCodeISO3166_1",
    "usedLangCodeISO639_1",
    "mandatoryLangCodeISO639_1",
    "uniqueIdentifier",
    "beginPerformanceDate",
    "endPerformanceDate",
    "performanceLocation",
)


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity of a certificate: numbers in ``unit``, with expanded uncertainties where it states them."""

    name: str
    unit: str
    values: tuple[float, ...]
    uncertainties: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Certificate:
    """What a certificate says, and what is wrong with it, a sentence each.

    ``by_schema`` tells whether a schema was held against it; ``signed`` whether it has a signature, which is not
    verified.
    """

    identifier: str
    schema_version: str
    laboratory: str
    begun: str
    ended: str
    quantities: tuple[Quantity, ...]
    faults: tuple[str, ...]
    signed: bool
    by_schema: bool = False


def read_certificate(path: Path, schema: Path | None = None) -> Certificate:
    """Read and check a certificate.

    Entities, document types and references to other files are refused; nothing is fetched from anywhere.

    Parameters
    ----------
    path
        The XML file.
    schema
        ``dcc.xsd`` of the same version, with the schemas that it imports beside it, to validate against.

    Raises
    ------
    RecordingError
        It cannot be read, is not XML, is hostile, or is no certificate at all; or the schema cannot be used.
    """
    try:
        content = read_plain(path, LARGEST_CERTIFICATE)
    except FileNotFoundError as error:
        raise RecordingError(f"{path}: there is no such file") from error
    except OSError as error:
        raise RecordingError(f"{path}: {cause_of(error)}") from error
    root = _parsed(path, content)
    if root.tag != f"{{{DCC}}}digitalCalibrationCertificate":
        raise RecordingError(f"{path}: is no digital calibration certificate: its root is {one_line(root.tag)[:80]!r}")
    faults = [*_parts(root), *_dates(root)]
    quantities = []
    for quantity in root.iter(f"{{{DCC}}}quantity"):
        found, wrong = _quantity(quantity)
        faults += wrong
        quantities += found
    if schema is not None:
        faults += _by_schema(path, content, schema)
    core = f"{{{DCC}}}administrativeData/{{{DCC}}}coreData/{{{DCC}}}"
    laboratory = f"{{{DCC}}}administrativeData/{{{DCC}}}calibrationLaboratory/{{{DCC}}}contact/{{{DCC}}}name"
    return Certificate(
        identifier=_said(root, f"{core}uniqueIdentifier"),
        schema_version=one_line(root.get("schemaVersion", ""))[:20],
        laboratory=_said(root, f"{laboratory}/{{{DCC}}}content"),
        begun=_said(root, f"{core}beginPerformanceDate"),
        ended=_said(root, f"{core}endPerformanceDate"),
        quantities=tuple(quantities),
        faults=tuple(faults[:MOST_FAULTS]),
        signed=root.find(f"{{{SIGNATURE}}}Signature") is not None,
        by_schema=schema is not None,
    )


def _parsed(path: Path, content: bytes) -> ET.Element:
    try:
        root = fromstring(content, forbid_dtd=True, forbid_entities=True, forbid_external=True)
    except DefusedXmlException as error:
        raise RecordingError(
            f"{path}: declares a document type, an entity or another file, which no certificate needs: it is not read"
        ) from error
    except (ET.ParseError, ValueError, LookupError) as error:
        raise RecordingError(f"{path}: is not XML: {one_line(str(error))}") from error
    level, depth = [root], 0
    while level:
        depth += 1
        if depth > DEEPEST:
            raise RecordingError(f"{path}: its elements are nested more than {DEEPEST} deep: it is not read")
        level = [child for element in level for child in element]
    element: ET.Element = root
    return element


def _parts(root: ET.Element) -> Iterator[str]:
    version = root.get("schemaVersion", "")
    if not re.fullmatch(r"[23]\.\d+\.\d+(-[\w.]+)?", version):
        yield f"schemaVersion is {one_line(version)[:20]!r}, expected 2 or 3 with two more numbers"
    administrative = root.find(f"{{{DCC}}}administrativeData")
    if administrative is None:
        yield "administrativeData is missing"
        return
    for name in REQUIRED:
        if administrative.find(f"{{{DCC}}}{name}") is None:
            yield f"administrativeData: {name} is missing"
    core = administrative.find(f"{{{DCC}}}coreData")
    for name in CORE if core is not None else ():
        if not _said(core, f"{{{DCC}}}{name}"):
            yield f"coreData: {name} is missing or empty"
    country = _said(core, f"{{{DCC}}}countryCodeISO3166_1")
    if country and not re.fullmatch("[A-Z]{2}", country):
        yield f"coreData: countryCodeISO3166_1 is {country!r}, expected two capital letters"
    if root.find(f"{{{DCC}}}measurementResults/{{{DCC}}}measurementResult") is None:
        yield "measurementResults holds no measurementResult"


def _dates(root: ET.Element) -> Iterator[str]:
    core = root.find(f"{{{DCC}}}administrativeData/{{{DCC}}}coreData")
    days: dict[str, date] = {}
    for name in ("beginPerformanceDate", "endPerformanceDate", "issueDate"):
        text = _said(core, f"{{{DCC}}}{name}")
        if not text:
            continue
        try:
            days[name] = date.fromisoformat(text[:10])
        except ValueError:
            yield f"coreData: {name} is {text!r}, not a date"
    begun, ended, issued = (days.get(n) for n in ("beginPerformanceDate", "endPerformanceDate", "issueDate"))
    if begun is not None and ended is not None and ended < begun:
        yield f"coreData: the calibration ends ({ended}) before it begins ({begun})"
    if ended is not None and issued is not None and issued < ended:
        yield f"coreData: it was issued ({issued}) before the calibration ended ({ended})"


def _quantity(quantity: ET.Element) -> tuple[list[Quantity], list[str]]:
    """Numbers of one quantity and what is wrong with them."""
    name = _said(quantity, f"{{{DCC}}}name/{{{DCC}}}content") or "a quantity without a name"
    faults: list[str] = []
    found = []
    for kind, suffix in (("real", ""), ("realListXMLList", "XMLList")):
        for part in quantity.findall(f"{{{SI}}}{kind}"):
            values = _numbers(part, f"value{suffix}", name, faults)
            unit = _said(part, f"{{{SI}}}unit{suffix}")
            if not unit:
                faults.append(f"{name}: unit{suffix} is missing or empty")
            expanded = part.find(f"{{{SI}}}expandedUnc{suffix}")
            uncertainties: tuple[float, ...] = ()
            if expanded is not None:
                uncertainties = _numbers(expanded, f"uncertainty{suffix}", name, faults)
                faults += _coverage(expanded, suffix, name)
                if any(u < 0 for u in uncertainties):
                    faults.append(f"{name}: an uncertainty is negative")
                if len(uncertainties) not in (1, len(values)):
                    faults.append(f"{name}: {len(uncertainties)} uncertainties for {len(values)} values")
            found.append(Quantity(name, unit, values, uncertainties))
    return found, faults


def _coverage(expanded: ET.Element, suffix: str, name: str) -> list[str]:
    faults: list[str] = []
    factors = _numbers(expanded, f"coverageFactor{suffix}", name, faults)
    shares = _numbers(expanded, f"coverageProbability{suffix}", name, faults)
    if any(k <= 0 for k in factors):
        faults.append(f"{name}: a coverage factor is not positive")
    if any(not 0 < p <= 1 for p in shares):
        faults.append(f"{name}: a coverage probability is not between 0 and 1")
    return faults


def _numbers(parent: ET.Element, tag: str, name: str, faults: list[str]) -> tuple[float, ...]:
    text = parent.findtext(f"{{{SI}}}{tag}")
    if text is None or not text.strip():
        faults.append(f"{name}: {tag} is missing or empty")
        return ()
    values = []
    for word in text.split():
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            faults.append(f"{name}: {tag} holds {one_line(word)[:30]!r}, which is no number")
            return ()
        values.append(value)
    return tuple(values)


def _said(element: ET.Element | None, path: str) -> str:
    text = None if element is None else element.findtext(path)
    return one_line((text or "").strip())[:200]


def _by_schema(path: Path, content: bytes, schema: Path) -> list[str]:
    """What a schema finds; its imports are looked for beside it, and nowhere else."""
    try:
        import xmlschema
    except ImportError as error:
        raise RecordingError(
            "validating against a schema needs the library xmlschema: pip install 'mesotap[certificate]'"
        ) from error
    try:
        beside = [(space, schema.parent / name) for space, name in IMPORTED]
        found = xmlschema.XMLSchema(
            str(schema),
            locations=[(space, str(file)) for space, file in beside if file.is_file()],
            allow="local",
            defuse="always",
        )
        errors = [
            f"schema: {one_line(e.path or '')}: {one_line(str(e.reason))[:200]}"
            for e, _ in zip(found.iter_errors(content.decode("utf-8-sig")), range(MOST_FAULTS), strict=False)
        ]
    except (OSError, ValueError, xmlschema.XMLSchemaException) as error:
        raise RecordingError(
            f"{schema}: cannot be used as a schema for {path}: {one_line(str(error))[:200]}"
        ) from error
    return errors
