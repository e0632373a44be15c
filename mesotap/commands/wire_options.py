"""What a command was asked to keep of the dialogue with the devices."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from mesotap import __version__
from mesotap.configuration.config import Config
from rig.drivers.wire_record import WireFile


@dataclass(frozen=True, slots=True)
class WireOptions:
    """``--record-wire``, ``--record-samples`` and ``--log-wire``.

    Attributes
    ----------
    record
        File to record to; None for none.
    all_samples
        Whether all of a recorder's samples are kept in it, not only the first.
    log
        Whether ``session.log`` has every byte too.
    """

    record: Path | None = None
    all_samples: bool = False
    log: bool = False

    @contextmanager
    def begun(self, config: Config, command: str) -> Iterator[WireFile | None]:
        """Begin the recording that was asked for, end it on leaving; yields None if there is nothing to record.

        Raises
        ------
        RigError
            The file is there already, or cannot be begun.
        """
        if self.record is None and not self.log:
            yield None
            return
        header = {
            "software": f"mesotap {__version__}",
            "python": sys.version.split()[0],
            "created": datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            "command": command,
            "parts": config.rig.parts.model_dump(mode="json"),
            "wiring": config.rig.wiring.model_dump(mode="json"),
        }
        file = WireFile(self.record, header, self.all_samples)
        try:
            yield file
        finally:
            file.close()


NO_WIRE = WireOptions()
