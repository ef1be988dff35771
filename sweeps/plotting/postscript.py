"""EPS: pictures without transparency, which PostScript does not have, and files without a date."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.spines import Spine
from matplotlib.text import Text

#: Most characters of a comment in one line: by Adobe's conventions, a line has at most 255.
_LONGEST = 240


def make_opaque(figure: Figure) -> None:
    """Prepare a figure for PostScript, so that it looks as in the other formats.

    In each panel, what consists of pixels and all that is below it become one image. Labels, ticks
    and frame are drawn above it. Transparent lines get the colour that they have on white paper.
    """
    for panel in figure.axes:
        _make_one_image(panel)
    for line in figure.findobj(Line2D):
        alpha = line.get_alpha()
        if alpha is not None and not line.get_rasterized():
            colour = 1.0 - alpha * (1.0 - np.array(to_rgb(line.get_color())))
            line.set(color=tuple(colour), alpha=None)


def _make_one_image(panel: Axes) -> None:
    """Draw the pixels of a panel, and all that is below them, as one image."""
    pixels = [artist for artist in panel.get_children() if artist.get_rasterized()]
    if not pixels:
        return
    top = max(artist.get_zorder() for artist in pixels)
    above: tuple[type[Artist], ...] = (Axis, Spine, Text)
    for artist in panel.get_children():
        if isinstance(artist, above) and artist.get_zorder() <= top:
            artist.set_zorder(top + 0.5)
    panel.set_rasterization_zorder(top + 0.1)


@contextmanager
def without_warning() -> Iterator[None]:
    """Silence the warning of matplotlib about transparency, for which `make_opaque` has cared."""
    log = logging.getLogger("matplotlib.backends.backend_ps")
    log.addFilter(_is_other)
    try:
        yield
    finally:
        log.removeFilter(_is_other)


def _is_other(record: logging.LogRecord) -> bool:
    return "transparency" not in record.getMessage()


def with_comments(image: bytes, title: str, text: str) -> bytes:
    """Return a file without its date, with a title, and with a text as comments."""
    head, mark, body = image.partition(b"%%EndComments\n")
    head = re.sub(rb"(?m)^%%CreationDate:.*\n", b"", head)
    named = _comment("%%", f"Title: {title}") if title else b""
    comments = b"".join(_comment("%", f" {line}") for line in text.splitlines())
    return head + named + mark + comments + body


def _comment(mark: str, line: str) -> bytes:
    """Return a comment of PostScript, in further lines that begin with a plus if it is long."""
    escaped = "".join(one if " " <= one <= "~" else ascii(one)[1:-1] for one in line)
    parts = [escaped[i : i + _LONGEST] for i in range(0, len(escaped), _LONGEST)]
    return (mark + f"\n{mark}+".join(parts) + "\n").encode("ascii")
