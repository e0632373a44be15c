"""What had to be repeated to get a sound answer out of a device: logged when it happens, counted for the report.

Drivers only call `repeated`. Whoever wants the counts puts a `HardwareLog` on the logger ``mesotap`` for as long as
that matters; nobody has to.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from datetime import UTC, datetime

ROOT = "mesotap"
logging.getLogger(ROOT).addHandler(logging.NullHandler())  # a program that only imports this hears nothing of it

_DEVICE, _WHAT = "hardware_device", "hardware_what"


@dataclass(frozen=True, slots=True)
class Repetition:
    """One thing that one device had to be asked, sent or started again for.

    Attributes
    ----------
    device
        In the operator's words.
    what
        What happened, such as "a question was asked again".
    count
        How often.
    first, last
        When, ISO 8601 UTC.
    """

    device: str
    what: str
    count: int
    first: str
    last: str


def repeated(logger: logging.Logger, device: str, what: str, detail: str = "") -> None:
    """Log at WARNING that something had to be done again, or that something came that nobody waits for.

    Parameters
    ----------
    device
        What it is called in errors.
    what
        The kind of repetition, by which it is counted: no numbers or bytes in it.
    detail
        More for who reads the log.
    """
    logger.warning("%s: %s%s", device, what, f" ({detail})" if detail else "", extra={_DEVICE: device, _WHAT: what})


def added(*accounts: tuple[Repetition, ...]) -> tuple[Repetition, ...]:
    """Return the accounts of several runs as one, in the order in which things first happened."""
    total: dict[tuple[str, str], Repetition] = {}
    for entry in (entry for account in accounts for entry in account):
        key = (entry.device, entry.what)
        before = total.get(key, entry)
        count = entry.count + (before.count if key in total else 0)
        total[key] = Repetition(*key, count, min(before.first, entry.first), max(before.last, entry.last))
    return tuple(sorted(total.values(), key=lambda entry: entry.first))


class HardwareLog(logging.Handler):
    """Counts what `repeated` logs."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._seen: dict[tuple[str, str], Repetition] = {}

    def emit(self, record: logging.LogRecord) -> None:
        """Count a record, if it is of `repeated`."""
        key = (getattr(record, _DEVICE, ""), getattr(record, _WHAT, ""))
        if not key[1]:
            return
        now = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        before = self._seen.get(key)
        first, count = (now, 0) if before is None else (before.first, before.count)
        self._seen[key] = Repetition(*key, count + 1, first, now)

    def account(self) -> tuple[Repetition, ...]:
        """Return what was counted so far."""
        return added(tuple(self._seen.values()))
