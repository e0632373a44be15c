"""What the catalogue knows of a folder as it is at this moment, for who would else read the folder."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

from mesotap.catalogue.entry import Entry
from mesotap.catalogue.reading import signature_of
from mesotap.catalogue.store import Catalogue, CatalogueError, usual_place


@contextlib.contextmanager
def catalogued(index: Path | None = None) -> Iterator[Callable[[Path], Entry | None]]:
    """Give a function that returns a session folder's entry, None where the catalogue has none that is up to date.

    Without a catalogue, or with one that cannot be used, it knows nothing: whoever asks reads the folder.
    """
    with contextlib.ExitStack() as opened:
        catalogue: Catalogue | None = None
        place = index or usual_place()
        with contextlib.suppress(CatalogueError, OSError, RuntimeError):
            if place.is_file():
                catalogue = opened.enter_context(Catalogue(place, read_only=True))

        def entry_at(folder: Path) -> Entry | None:
            if catalogue is None:
                return None
            with contextlib.suppress(CatalogueError):
                kept = catalogue.kept(folder.resolve())
                if kept is not None and kept.entry.stands and kept.signature == signature_of(folder.resolve()):
                    return kept.entry
            return None

        yield entry_at
