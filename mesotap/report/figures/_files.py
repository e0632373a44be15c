"""Figures as files and inside a page: the same input gives the same bytes."""

from __future__ import annotations

import io
import re
from pathlib import Path

from markupsafe import escape
from matplotlib.figure import Figure

from daq.durable import write_whole
from mesotap.report.figures._style import house_style

# Without these entries neither the date nor matplotlib's version is in a file.
NO_METADATA: dict[str, dict[str, None]] = {
    "svg": dict.fromkeys(("Creator", "Date", "Format", "Type")),
    "pdf": dict.fromkeys(("Creator", "Producer", "CreationDate")),
    "png": {"Software": None},
}


def _rendered(figure: Figure, suffix: str) -> bytes:
    stream = io.BytesIO()
    with house_style():
        if figure.get_layout_engine() is not None:  # laid out once, not for every file
            figure.draw_without_rendering()
            figure.set_layout_engine(None)
        figure.savefig(stream, format=suffix, metadata=NO_METADATA[suffix])
    return stream.getvalue()


def save(figure: Figure, path: Path) -> Path:
    """Write a figure as ``.svg``, ``.pdf`` or ``.png`` (300 dpi), by the suffix of the path."""
    suffix = path.suffix.lower().lstrip(".")
    if suffix not in NO_METADATA:
        raise ValueError(f"{path}: a figure is written as .svg, .pdf or .png, not as {path.suffix or 'nothing'}")
    write_whole(path, _rendered(figure, suffix))
    return path


def inline_svg(figure: Figure, name: str, label: str) -> str:
    """Return a figure as an SVG element to stand inside an HTML page.

    Parameters
    ----------
    figure
        The figure.
    name
        Unique in the page: it keeps the ids of several figures apart.
    label
        What a screen reader says of the figure.
    """
    svg = _rendered(figure, "svg").decode()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"<!--.*?-->", "", svg, flags=re.DOTALL)
    used = set(re.findall(r"""(?:url\(#|href="#)([^)"]+)""", svg))
    svg = re.sub(r' id="([^"]+)"', lambda m: f' id="{name}-{m[1]}"' if m[1] in used else "", svg)
    svg = re.sub(r"""(url\(#|xlink:href="#)""", lambda m: m[1].removeprefix("xlink:") + f"{name}-", svg)
    svg = re.sub(r"\n\s*", "\n", svg)
    view_box = re.search(r'viewBox="[^"]+"', svg)
    opening = f'<svg {view_box[0] if view_box else ""} role="img" aria-label="{escape(label)}">'
    return opening + svg[svg.index(">") + 1 :].rstrip()
