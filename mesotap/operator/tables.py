"""Tables at the terminal that fold at any width: no number is cut, however narrow it is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import rich.table
from rich.console import Console, ConsoleOptions, RenderableType
from rich.measure import Measurement
from rich.table import Column
from rich.text import Text

LONGEST_WORD = 20  # letters that are kept together: every number, not every file name
ANY_WIDTH = 10_000
AROUND = 3  # letters of a column besides its text: a line and a blank on each side


class Table(rich.table.Table):
    """A table whose cells fold between words; where that is too wide, the columns go on in further tables beneath.

    Where not even two columns fit, every cell is a line of its own, "heading: text".

    Parameters
    ----------
    headings, options
        As those of `rich.table.Table`.
    keys
        How many columns, from the left, say what a row is of; further tables repeat them.
    """

    def __init__(self, *headings: str, keys: int = 1, **options: Any) -> None:
        super().__init__(*headings, **options)
        self._keys = keys

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        """Give the tables, or the lines, that fit the width."""
        limits = [self._limits(column, console, options) for column in self.columns]
        parts = self._parts([low for low, _ in limits], options.max_width)
        if parts is None:
            yield from self._lines(console)
            return
        for number, part in enumerate(parts):
            room = options.max_width - 1 - AROUND * len(part)
            shown = rich.table.Table(
                title=self.title if number == 0 else None,
                caption=self.caption if number == len(parts) - 1 else None,
                box=self.box,
                header_style=self.header_style,
            )
            for index, width in zip(part, shared([limits[i] for i in part], room), strict=True):
                column = self.columns[index]
                shown.add_column(column.header, justify=column.justify, overflow="fold", width=width)
            for row in zip(*(self.columns[i].cells for i in part), strict=True):
                shown.add_row(*row)
            yield shown

    def _limits(self, column: Column, console: Console, options: ConsoleOptions) -> tuple[int, int]:
        """Return the least width of a column that cuts no word, and the width at which nothing folds."""
        free = options.update_width(ANY_WIDTH)
        found = [Measurement.get(console, free, cell) for cell in (column.header, *column.cells)]
        return min(LONGEST_WORD, max(1, *(m.minimum for m in found))), max(1, *(m.maximum for m in found))

    def _parts(self, least: Sequence[int], width: int) -> list[list[int]] | None:
        """Return the columns of each table, the keys first; None where a key with one column is too wide."""
        keys = list(range(min(self._keys, len(least))))

        def wide(part: Sequence[int]) -> int:
            return 1 + sum(AROUND + least[i] for i in part)

        parts, part = [], keys
        for index in range(len(keys), len(least)):
            if wide([*part, index]) > width and len(part) > len(keys):
                parts.append(part)
                part = keys
            part = [*part, index]
        parts.append(part)
        return parts if all(wide(part) <= width for part in parts) else None

    def _lines(self, console: Console) -> Iterator[RenderableType]:
        if self.title:
            yield _text(self.title, console)
        for row in zip(*(column.cells for column in self.columns), strict=True):
            yield Text("")
            for column, cell in zip(self.columns, row, strict=True):
                yield Text.assemble(_text(column.header, console), ": ", _text(cell, console), overflow="fold")
        if self.caption:
            yield _text(self.caption, console)


def _text(cell: RenderableType, console: Console) -> Text:
    return cell if isinstance(cell, Text) else console.render_str(str(cell), overflow="fold")


def shared(limits: Sequence[tuple[int, int]], room: int) -> list[int]:
    """Return widths between the limits of columns that fill the room, the narrow columns served first.

    Examples
    --------
    >>> shared([(2, 4), (5, 30), (3, 40)], 30)
    [4, 13, 13]
    """

    def at(level: int) -> list[int]:
        return [min(most, max(least, level)) for least, most in limits]

    return next((at(level) for level in range(max(room, 0), 0, -1) if sum(at(level)) <= room), at(0))
