"""``certificate write`` and ``certificate check``: the gauge's calibration as a digital calibration certificate."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.console import Console

from daq.errors import RecordingError
from daq.records import Session
from mesotap.answers.certificate import Laboratory, certificate_xml
from mesotap.answers.certificate_check import Certificate, read_certificate
from mesotap.answers.rounding import significant
from mesotap.commands.files import config_for
from mesotap.commands.outputs import make_ready, write_json
from mesotap.commands.recordings import opened as opened_file
from mesotap.configuration.config import ConfigError
from mesotap.operator.tables import Table
from mesotap.operator.terminal import escape
from mesotap.report.report import written

SHOWN_VALUES = 3


def write_certificate(
    source: Path,
    output: Path,
    laboratory: Laboratory,
    config_path: Path | None,
    changes: Sequence[str],
    json_path: Path | None,
    console: Console,
) -> None:
    """Write the certificate of the gauge of a session; never over a file that is there."""
    if not re.fullmatch("[A-Z]{2}", laboratory.country):
        raise ConfigError(
            f"--country {laboratory.country}: give the two capital letters of ISO 3166-1, such as DE or US"
        )
    for option, text in (("--laboratory", laboratory.name), ("--city", laboratory.city)):
        if not text.strip():
            raise ConfigError(f"{option}: is empty; say who calibrated, and where")
    if output.exists():
        raise RecordingError(f"{output}: exists already and is left as it is; name another file")
    make_ready(output, None)
    opened = opened_file(source, None)
    if not isinstance(opened, Session):
        raise RecordingError(f"{source}: is not a session, so it holds no calibration of the gauge")
    config = config_for(opened, config_path, changes, console)
    content = certificate_xml(opened, config.calibration, laboratory, datetime.now(UTC).date())
    page = written(output, content.decode())
    console.print(f"certificate {escape(page)}", highlight=False, soft_wrap=True)
    write_json(json_path, {"written": str(page)})


def check_certificate(file: Path, schema: Path | None, json_path: Path | None, console: Console) -> None:
    """Print what a certificate holds and what is wrong with it.

    Raises
    ------
    RecordingError
        Something is wrong with it.
    """
    found = read_certificate(file, schema)
    _show(file, found, console)
    write_json(json_path, _as_json(file, found))
    if found.faults:
        raise RecordingError(f"{file}: {len(found.faults)} faults, the first: {found.faults[0]}")


def _show(file: Path, found: Certificate, console: Console) -> None:
    shown = Table(
        title=f"{escape(file)}: {escape(found.identifier)}, {escape(found.laboratory)}, {escape(found.ended)}"
    )
    for heading in ("quantity", "values", "unit", "expanded uncertainty"):
        shown.add_column(heading)
    for quantity in found.quantities:
        shown.add_row(escape(quantity.name), _few(quantity.values), escape(quantity.unit), _few(quantity.uncertainties))
    console.print(shown)
    for fault in found.faults:
        console.print(f"- {escape(fault)}", highlight=False)
    against = "the schema and the rules of this program" if found.by_schema else "the rules of this program, no schema"
    console.print(f"{len(found.faults)} faults, held against {against}", highlight=False)
    if found.signed:
        console.print("it is signed; the signature was not verified", highlight=False)


def _few(values: Sequence[float]) -> str:
    words = [significant(v, 5) for v in values[:SHOWN_VALUES]]
    return ", ".join(words) + (f", ... ({len(values)})" if len(values) > SHOWN_VALUES else "")


def _as_json(file: Path, found: Certificate) -> dict[str, Any]:
    return {
        "format": "mesotap-certificate",
        "version": 1,
        "source": str(file),
        "identifier": found.identifier,
        "schema_version": found.schema_version,
        "laboratory": found.laboratory,
        "begun": found.begun,
        "ended": found.ended,
        "signed": found.signed,
        "validated_by_schema": found.by_schema,
        "quantities": [
            {
                "name": q.name,
                "unit": q.unit,
                "values": list(q.values),
                "expanded_uncertainties": list(q.uncertainties),
            }
            for q in found.quantities
        ],
        "faults": list(found.faults),
    }
