"""Writes a figure to a file: formats, pixels, size, and metadata of how it was computed."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Mapping
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.spines import Spine
from matplotlib.text import Text

from sweeps.errors import Refused
from sweeps.plotting.style import dots_per_inch, in_style, without_log
from sweeps.store.replacing import check_target, writing
from sweeps.text import listed, near_misses, printable, shortened, suggestion
from vibroimpact import __version__

_TIFF = ("tiff", "tif")
#: Metadata fields of each format for the title, the program and a text.
_FIELDS = {
    "png": ("Title", "Software", "Description"),
    "svg": ("Title", "Creator", "Description"),
    "pdf": ("Title", "Creator", "Subject"),
    "eps": ("", "Creator", ""),  # the others are comments of the file
    **dict.fromkeys(_TIFF, ("269", "305", "270")),  # numbers of TIFF's tags
}
#: Metadata that leave out the dates, so that the same picture always gives the same bytes.
_NO_DATES = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}, "eps": {}}
FORMATS = tuple(_FIELDS)
#: Endings of animations.
ANIMATED = (".gif", ".mp4")
#: A figure must have fewer pixels than this each way; as many both ways take ten seconds.
_MOST_PIXELS = 2**14
#: Most characters of a comment in one line: by Adobe's conventions, a line has at most 255.
_MOST_IN_LINE = 240


def description(attributes: Mapping[str, Any], command: str) -> tuple[str, str, str]:
    """Return title, program and text for the metadata of a picture, drawn by a `command` or not."""
    # The command may name files that are not in UTF-8.
    about = {
        name.removesuffix("_version"): value
        for name, value in attributes.items()
        if name.endswith("_version") or name == "numerics"
    }
    text = "computed with " + ", ".join(f"{name} {value}" for name, value in about.items())
    text += f"\ncommand: {printable(command)}" if command else ""
    text += f"\nconfiguration:\n{attributes['configuration']}"
    program = f"vibroimpact {__version__}, matplotlib {mpl.__version__}"
    return str(attributes.get("name", "")), program, text


def refuse_replacing(data: str | Path, output: Path, what: str = "picture") -> None:
    """Refuse to replace a file that is read with an output."""
    if os.path.isfile(data) and os.path.exists(output) and os.path.samefile(output, data):
        raise Refused(f"the {what} {output} would replace the data; give another output")


def check_picture(output: Path, *data: str | Path, animated: bool = False) -> None:
    """Refuse a path to which no picture of the `data`, files that are read, can be written."""
    for file in data:
        refuse_replacing(file, output)
    ending = output.suffix.lower()
    allowed = [*(f".{name}" for name in FORMATS), *(ANIMATED if animated else ())]
    if ending not in allowed:
        meant = suggestion(near_misses(ending, allowed))
        raise Refused(f"{output} must end in one of {listed(allowed)}{meant}")
    if ending == ".mp4" and shutil.which(mpl.rcParams["animation.ffmpeg_path"]) is None:
        raise Refused(f"{output} needs the program ffmpeg, which is not found; a .gif needs none")
    check_target(output, "picture")
    settings = mpl.matplotlib_fname()
    if not settings.startswith(mpl.get_data_path()):
        _check_settings(settings)


@cache
def _check_settings(file: str) -> None:
    """Refuse settings of the user with which a simple figure cannot be drawn."""
    figure = Figure()
    figure.add_subplot().set_title("$x$")
    with in_style():
        _check_size(figure)
        try:
            figure.draw_without_rendering()  # texts are measured at the dpi of the figure
            figure.savefig(BytesIO(), format="png")
        except Exception as error:  # for example text.usetex without LaTeX
            reason = shortened(str(error), 200)
            raise Refused(
                f"matplotlib cannot draw with the settings in {file}: {reason}; correct them"
            ) from None


def _check_size(figure: Figure, kind: str = "png") -> None:
    """Refuse a figure of too many pixels, which one of vectors has where parts are pixels."""
    width, height = figure.get_size_inches() * dots_per_inch()
    pixels = kind in ("png", *_TIFF) or any(artist.get_rasterized() for artist in figure.findobj())
    if pixels and max(width, height) >= _MOST_PIXELS:
        raise Refused(
            f"a picture of {width:.0f} x {height:.0f} pixels is too large; expected: less than "
            f"{_MOST_PIXELS} each way, by a lower dpi or a smaller width"
        )


def save(figure: Figure, output: Path, description: tuple[str, ...] = ()) -> None:
    """Write a figure, with its `description` as metadata, to a file, whole or not at all."""
    kind = output.suffix.lower().lstrip(".")
    _check_size(figure, kind)
    about = dict(zip(_FIELDS[kind], description, strict=False))
    image = BytesIO()  # on a full disk, matplotlib would raise errors that do not say so
    if kind == "eps":
        _make_opaque(figure)
    pixels = kind in _TIFF
    # About transparency, for which `_make_opaque` has cared.
    silent = without_log("matplotlib.backends.backend_ps", "transparency")
    with silent:
        fields = {} if pixels else {**about, **_NO_DATES[kind]}
        figure.savefig(image, format="png" if pixels else kind, metadata=fields)
    content = _as_tiff(image, about) if pixels else image.getvalue()
    if kind == "eps":
        title, _, text = description or ("", "", "")
        content = _with_comments(content, title, text)
    with writing(output, "picture") as draft:
        draft.write(content)


def save_chart(output: Path, picture: Callable[..., Figure], *measured: object) -> None:
    """Write the figure that `picture` makes of measurements to a file, in the style of all."""
    with in_style():
        save(picture(*measured), output)


def _as_tiff(png: BytesIO, about: Mapping[str, str]) -> bytes:
    """Return a picture as TIFF with what it is `about`, compressed and without transparency."""
    from PIL import Image

    tiff, tags = BytesIO(), {int(tag): text.encode() for tag, text in about.items()}
    with Image.open(png) as image:
        options = {"compression": "tiff_lzw", "dpi": image.info["dpi"], "tiffinfo": tags}
        image.convert("RGB").save(tiff, "tiff", **options)
    return tiff.getvalue()


def _make_opaque(figure: Figure) -> None:
    """Prepare a figure for PostScript, so that it looks as in the other formats."""
    # In each panel, what consists of pixels and all that is below it become one image. Labels,
    # ticks and frame are drawn above it. Transparent lines get the colour that they have on white
    # paper.
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


def _with_comments(image: bytes, title: str, text: str) -> bytes:
    """Return a file without its date, with a title, and with a text as comments."""
    head, separator, body = image.partition(b"%%EndComments\n")
    head = re.sub(rb"(?m)^%%CreationDate:.*\n", b"", head)
    named = _comment("%%", f"Title: {title}") if title else b""
    comments = b"".join(_comment("%", f" {line}") for line in text.splitlines())
    return head + named + separator + comments + body


def _comment(prefix: str, line: str) -> bytes:
    """Return a comment of PostScript, in further lines that begin with a plus if it is long."""
    escaped = "".join(c if " " <= c <= "~" else ascii(c)[1:-1] for c in line)
    lines = [escaped[i : i + _MOST_IN_LINE] for i in range(0, len(escaped), _MOST_IN_LINE)]
    return (prefix + f"\n{prefix}+".join(lines) + "\n").encode("ascii")
