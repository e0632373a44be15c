"""``session.log``: beside each session, what was done and what had to be done again, a line a record.

The log is a convenience. A disk that is full, a folder that may not be written or a link in its place costs lines of
the log and nothing else.
"""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Iterator
from datetime import UTC, datetime
from io import TextIOWrapper
from logging.handlers import RotatingFileHandler
from pathlib import Path

from daq.durable import open_plain
from daq.errors import one_line
from daq.records import Impact
from mesotap import __version__
from mesotap.session.runner import Observer
from mesotap.session.states import State
from rig.hardware_log import ROOT, HardwareLog

LOG_FILE = "session.log"
LARGEST_FILE = 2 * 2**20
"""Bytes of one file of the log: a session of a day without the wire takes about a tenth."""

OLDER_FILES = 2
"""Kept as ``session.log.1`` and ``.2`` beside it."""

LONGEST_LINE = 4000
LOG = logging.getLogger(f"{ROOT}.session")


class OneLine(logging.Formatter):
    """UTC time, level, logger and text on one line, with nothing in it that a terminal would act on."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line of a record."""
        when = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        text = record.getMessage()
        if record.exc_info:
            text += f" {self.formatException(record.exc_info)}"
        if len(text) > LONGEST_LINE:
            text = f"{text[:LONGEST_LINE]} ... ({len(text)} characters)"
        return f"{when} {record.levelname} {record.name} {one_line(text)}"


class SessionLogFile(RotatingFileHandler):
    """The file, of bounded size; what cannot be written is dropped."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, maxBytes=LARGEST_FILE, backupCount=OLDER_FILES, encoding="utf-8", delay=True)
        self.setFormatter(OneLine())

    def _open(self) -> TextIOWrapper:
        descriptor = open_plain(Path(self.baseFilename), os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        return TextIOWrapper(os.fdopen(descriptor, "ab"), encoding="utf-8", errors="backslashreplace")

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        """Go on without this record."""
        stream, self.stream = self.stream, None  # what is buffered must not fail again
        if stream is not None:
            with contextlib.suppress(OSError, ValueError):
                stream.close()


@contextlib.contextmanager
def session_log(folder: Path, wire: bool = False) -> Iterator[HardwareLog]:
    """Log to ``folder/session.log`` and count what has to be repeated; yields the counts.

    Parameters
    ----------
    folder
        Of the session.
    wire
        Whether every byte on every wire is logged too, at DEBUG.
    """
    logger = logging.getLogger(ROOT)
    before = logger.level
    counts, file = HardwareLog(), SessionLogFile(folder / LOG_FILE)
    logger.setLevel(logging.DEBUG if wire else logging.INFO)
    for handler in (counts, file):
        logger.addHandler(handler)
    LOG.info("mesotap %s works on %s", __version__, folder)
    try:
        yield counts
    except BaseException as error:
        said = "; ".join([str(error) or type(error).__name__, *getattr(error, "__notes__", ())])
        LOG.error("ended: %s", said)
        raise
    else:
        LOG.info("done")
    finally:
        logger.setLevel(before)
        for handler in (counts, file):
            logger.removeHandler(handler)
            with contextlib.suppress(OSError, ValueError):
                handler.close()


class Logged:
    """An observer that logs what another one shows.

    Parameters
    ----------
    observer
        The other.
    """

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self._state: State | None = None

    def progress(self, state: State, text: str) -> None:
        """Log a new state, and at DEBUG what goes on within it."""
        if state is not self._state:
            self._state = state
            LOG.info("%s: %s", state.value, text)
        else:
            LOG.debug("%s: %s", state.value, text)
        self._observer.progress(state, text)

    def impact(self, impact: Impact, accepted: int, wanted: int) -> None:
        """Log the verdict on a tap."""
        verdict = f"accepted, {accepted} of {wanted}" if impact.accepted else f"not used: {impact.reject_reason}"
        LOG.info("tap %s at %.0f mN: %s", impact.name, impact.target_load_mn, verdict)
        self._observer.impact(impact, accepted, wanted)
