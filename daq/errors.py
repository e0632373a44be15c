"""What a bad file or a bad setting raises: one sentence that names the file and the item."""

from __future__ import annotations


class RecordingError(ValueError):
    """A recording, session or exchange file cannot be used; the text says where, what, and what to do."""
