"""What reaches a terminal: texts of files, names and settings are shown, and nothing in them acts on what shows them.

A name may hold a line end, a sequence that moves the cursor or retitles the window, or a mark that turns the direction
of reading. All that is printed passes here: `escape` for a text within a line, `SafeConsole` for whatever else there
is, `say` and `complain` for plain lines.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from contextlib import suppress

from rich import markup
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from daq.errors import one_line


def escape(text: object) -> str:
    """Return a text of somebody else on one line, with nothing in it that a terminal or rich acts on."""
    shown = markup.escape(one_line(str(text)))
    return f"{shown}\\" if shown.endswith("\\") and not shown.endswith("\\\\") else shown


def plain_lines(text: str) -> str:
    """Return text with its line ends, and nothing else in it that a terminal acts on."""
    return "\n".join(one_line(line) for line in text.split("\n"))


class SafeConsole(Console):
    """A console that prints no control characters but its own, and leaves it to `main` that nobody reads any more."""

    def on_broken_pipe(self) -> None:
        """Have whoever runs the command line know."""
        raise BrokenPipeError

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Render as `Console` does, texts made plain."""
        for segment in super().render(renderable, options):
            if segment.control or segment.text.isprintable():
                yield segment
            else:
                yield Segment(plain_lines(segment.text), segment.style)


def say(text: str) -> None:
    """Print lines to standard output."""
    sys.stdout.write(plain_lines(text) + "\n")


def complain(text: str) -> None:
    """Print lines to standard error, if that is still there."""
    with suppress(OSError):
        sys.stderr.write(plain_lines(text) + "\n")
        sys.stderr.flush()


def let_go_of_the_dead() -> None:
    """Have what is left for an output that is gone go nowhere, instead of failing when the program ends."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def survive_any_text() -> None:
    """Have standard output and error write what their coding cannot as escapes, rather than fail."""
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="backslashreplace")
