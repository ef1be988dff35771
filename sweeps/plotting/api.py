"""`plot`: the kinds of pictures by name, and a figure in a file: formats, pixels, metadata."""

from __future__ import annotations

import os
import re
import shutil
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

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

from sweeps import plotting
from sweeps.config.groups import STARTS
from sweeps.errors import Refused
from sweeps.grid import TABLE
from sweeps.opened.doors import takes_sweep
from sweeps.opened.opened_sweep import START_AXES, OpenedSweep, Selection
from sweeps.plotting.page import PAGE, PICTURE_ARGUMENTS, Page
from sweeps.plotting.style import STYLE, dots_per_inch, user_style, without_log
from sweeps.store.replacing import check_target, writing
from sweeps.store.variables import DIRECTION
from sweeps.text import choice_of, listed, near_miss, printable, shortened, suggestion
from vibroimpact import __version__
from vibroimpact.inputs import PATH, TEXT


class Kind(NamedTuple):
    """A kind of picture."""

    function: str  # of this room, which is imported when it draws: some need the compiler
    options: tuple[str, ...] = ()  # of the function, other than `at`
    axes: int = 0  # number of axes that it chooses if not given, besides those shown always
    shown: tuple[str, ...] = ()  # axes that it always shows

    def draw(self, *arguments: Any, **options: Any) -> Figure:
        """Draw a picture of the kind."""
        figure: Figure = getattr(plotting, self.function)(*arguments, **options)
        return figure


#: The pictures by name.
KINDS: Mapping[str, Kind] = {
    "bifurcation": Kind(
        "bifurcation",
        ("axes", "coordinate", "exact", "below", "color", "overlay"),
        axes=1,
        shown=(DIRECTION,),
    ),
    "attractors": Kind("attractor_diagram", ("axes", "coordinate"), axes=1, shown=START_AXES),
    "basins": Kind("basins", ("beside",), shown=STARTS),
    "integrity": Kind("integrity", ("panels",), shown=("x0", "v0")),
    "map": Kind("parameter_map", ("axes", "quantity", "exact", "overlay"), axes=2),
    "section": Kind("section", ("color",)),
    "impacts": Kind("impacts", ("color",)),
    "trajectory": Kind("trajectory", ("periods", "color", "fps")),
    "table": Kind(
        "table_panels", ("axes", "quantity", "color", "overlay", "panels"), shown=(TABLE,)
    ),
}


@takes_sweep({**PICTURE_ARGUMENTS, "kind": TEXT, "output": PATH})
def plot(
    sweep: OpenedSweep,
    output: str | Path,
    kind: str | None = None,
    at: Selection | None = None,
    *,
    page: Page = PAGE,
    command: str = "",
    **options: Any,
) -> Path:
    """Draw a picture of an opened sweep and write it to a file.

    The metadata of the picture contain the versions, the numerics and the configuration.

    Parameters
    ----------
    sweep : Dataset
        From `sweeps.open_sweep`.
    output : str or Path
        The picture; its ending must be .png, .svg, .pdf, .eps, .tiff or .tif, or for an animation
        of a `trajectory` .gif or .mp4, which needs the program ffmpeg.
    kind : str, optional
        One of ``KINDS``, by default the result of `default_kind`.
    at : mapping of str to float, optional
        Values of the swept axes that are not drawn. The nearest grid value is used; the default is
        the first. If an axis was followed up and down, ``direction`` selects one direction; by
        default a `bifurcation` without a color and `attractors` show both, and other pictures show
        the first.
    page : Page, optional
        Size, title and limits.
    command : str
        The command that draws the picture, for its metadata.
    **options
        Those of the kind, as ``KINDS[kind].options`` lists them: ``color`` of `bifurcation`, or
        ``fps`` of `animate`. With None the picture chooses.

    Returns
    -------
    Path
        `output`.

    Raises
    ------
    Refused
        If the request does not fit the file, or the picture cannot be written to `output`.

    Examples
    --------
    >>> ds = sweeps.open_sweep("flip.h5")  # of the example of `run_sweep`
    >>> sweeps.plotting.plot(ds, "flip.png").name
    'flip.png'
    """
    output = Path(output)
    read = [str(sweep.data.encoding.get("source", "")), options.get("overlay")]
    check_picture(output, *(file for file in read if isinstance(file, str | Path)), animated=True)
    options = {name: value for name, value in options.items() if value is not None}
    kind = default_kind(sweep, at, **options) if kind is None else kind
    check_options(kind, options, output)
    style = user_style() | ({} if page.dpi is None else {"savefig.dpi": page.dpi})
    about = description(sweep.attrs, command)
    with mpl.rc_context(style):
        if is_animated(output):
            from sweeps.plotting.animation import save_animation

            save_animation(sweep, output, about, at=at, page=page, **options)
        else:
            save(KINDS[kind].draw(sweep, at=at, page=page, **options), output, about)
    return output


def is_animated(output: Path) -> bool:
    """Whether a picture is an animation, by its ending."""
    return output.suffix.lower() in ANIMATED


def check_options(kind: str, options: Iterable[str], output: Path) -> None:
    """Refuse a kind that is no picture, and options that it or the kind of file does not take."""
    check_kind(kind)
    if is_animated(output) and (kind != "trajectory" or "color" in options):
        several = f"the picture {kind}" if kind != "trajectory" else "several motions"
        raise Refused(
            f"{output} is not allowed for {several}; expected: the motion of one point, with the "
            f"picture trajectory and without color, or an ending of a picture, as .png"
        )
    if "fps" in options and not is_animated(output):
        raise Refused(f"fps is not allowed for {output}; expected: {' or '.join(ANIMATED)}")
    for option in options:
        kinds = [name for name, taker in KINDS.items() if option in taker.options]
        if not kinds:
            every = dict.fromkeys(name for taker in KINDS.values() for name in taker.options)
            meant = suggestion(near_miss(option, every))
            raise Refused(f"there is no option {option}{meant}; {choice_of(every)}")
        if kind not in kinds:
            other = "; a diagram shows it as color or below" if option == "quantity" else ""
            raise Refused(
                f"{option} can be chosen for {' or '.join(kinds)} only, not for {kind}{other}"
            )


def check_kind(kind: str) -> None:
    """Refuse a name that is not a kind of picture."""
    if kind not in KINDS:
        meant = suggestion(near_miss(kind, KINDS))
        raise Refused(f"there is no picture {kind!r}{meant}; choose one of {listed(KINDS)}")


def default_kind(sweep: OpenedSweep, at: Selection | None = None, **options: Any) -> str:
    """Return the kind of picture that shows most of a sweep; the arguments are those of `plot`.

    The first case that applies counts:

    - for a table ``table``, or ``trajectory`` if a row, `periods` or `fps` are given;
    - with a `quantity` ``map``, and with `periods` or `fps` ``trajectory``;
    - if x0, v0 or phase was swept and the period recorded: ``attractors`` if a parameter was swept,
      too, and no start chosen, ``basins`` if only starts were, and two of them are not chosen;
    - if two parameters were swept, the period recorded, and neither chosen: ``map``;
    - if an axis was swept ``bifurcation``;
    - if a trajectory was recorded ``trajectory``, else ``section``.
    """
    if TABLE in sweep.grid:
        return "trajectory" if at or {"periods", "fps"} & options.keys() else "table"
    for option, kind in (("quantity", "map"), ("periods", "trajectory"), ("fps", "trajectory")):
        if option in options:
            return kind
    axes = sweep.axes
    chosen = {*(at or {}), *options.get("axes", ())} - {DIRECTION}
    starts = {*STARTS} & {*axes}
    if starts and "period" in sweep and not {"exact", "below", "color"} & options.keys():
        if {*axes} - {*START_AXES}:
            if not starts & chosen:
                return "attractors"
        elif len(starts - chosen) == 2 and not options.keys() - {"overlay"}:
            return "basins"
    only_adds = options.keys() <= {"exact", "overlay"}
    both = len(axes) == 2 and all(sweep.sizes[name] > 1 for name in axes)
    if both and "period" in sweep and not starts and not chosen and only_adds:
        return "map"
    if axes:
        return "bifurcation"
    return "trajectory" if "trajectory_x" in sweep else "section"


def silent_cuts(
    sweep: OpenedSweep,
    kind: str,
    at: Selection | None = None,
    axes: Sequence[str] = (),
    color: str | None = None,
) -> dict[str, float | str]:
    """Return the swept axes that a picture cuts without being asked, with their first values."""
    shown = {*KINDS[kind].shown}
    if color is not None:
        shown |= set() if KINDS[kind].axes else {*sweep.axes}  # sections of all points
        shown = shown - {DIRECTION} | {DIRECTION} & {color}
    fixed = {*shown, *(at or {}), *axes}
    left = [name for name in sweep.grid if name not in fixed and sweep.sizes[name] > 1]
    axes_left = [name for name in left if name != DIRECTION]
    longest = sorted(axes_left, key=lambda name: -sweep.sizes[name])
    drawn = longest[: max(0, KINDS[kind].axes - len(axes))]
    return {name: sweep[name][0].item() for name in left if name not in drawn}


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
    """Return title, program and text for the metadata of a picture, from the attributes of a file.

    `command` is the command that draws it, or ``""``. It may name files that are not in UTF-8.
    """
    about = {
        name.removesuffix("_version"): value
        for name, value in attributes.items()
        if name.endswith("_version") or name == "numerics"
    }
    text = "computed with " + ", ".join(f"{name} {value}" for name, value in about.items())
    text += f"\ncommand: {printable(command)}" if command else ""
    text += f"\nconfiguration:\n{attributes['configuration']}"
    program = f"vibroimpact {__version__}, matplotlib {mpl.__version__}"
    return attributes.get("name", ""), program, text


def refuse_replacing(data: str | Path, output: Path, what: str = "picture") -> None:
    """Refuse to replace a file that is read with an output."""
    if os.path.isfile(data) and os.path.exists(output) and os.path.samefile(output, data):
        raise Refused(f"the {what} {output} would replace the data; give another output")


def check_picture(output: Path, *data: str | Path, animated: bool = False) -> None:
    """Refuse a path to which no picture of the `data`, files that are read, can be written.

    Raises Refused if it is a file with the data, if its ending is not one of ``FORMATS``, or of an
    animation where these are allowed, if no file can be written there, or if matplotlib cannot draw
    with the settings of the user.
    """
    for file in data:
        refuse_replacing(file, output)
    ending = output.suffix.lower()
    allowed = [*(f".{name}" for name in FORMATS), *(ANIMATED if animated else ())]
    if ending not in allowed:
        meant = suggestion(near_miss(ending, allowed))
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
    with mpl.rc_context(user_style()):
        _check_size(figure)
        try:
            figure.savefig(BytesIO(), format="png")
        except Exception as error:  # for example text.usetex without LaTeX
            reason = shortened(str(error), 200)
            raise Refused(
                f"matplotlib cannot draw with the settings in {file}: {reason}; correct them"
            ) from None


def _check_size(figure: Figure, kind: str = "png") -> None:
    """Refuse a figure of too many pixels, which one of vectors has where parts are pixels."""
    width, height = figure.get_size_inches() * dots_per_inch()
    pixels = kind in ("png", *_TIFF) or any(part.get_rasterized() for part in figure.findobj())
    if pixels and max(width, height) >= _MOST_PIXELS:
        raise Refused(
            f"a picture of {width:.0f} x {height:.0f} pixels is too large; expected: less than "
            f"{_MOST_PIXELS} each way, by a lower dpi or a smaller width"
        )


def save(figure: Figure, output: Path, description: tuple[str, ...] = ()) -> None:
    """Write a figure, with its `description` as metadata, to a file, either whole or not at all.

    Raises Refused if the figure is too large, and the errors of `writing`.
    """
    kind = output.suffix.lower().lstrip(".")
    _check_size(figure, kind)
    about = dict(zip(_FIELDS[kind], description, strict=False))
    image = BytesIO()  # on a full disk, matplotlib would raise errors that do not say so
    if kind == "eps":
        _make_opaque(figure)
    pixels = kind in _TIFF
    # About transparency, for which `_make_opaque` has cared.
    silent = without_log("matplotlib.backends.backend_ps", "transparency")
    with warnings.catch_warnings(), silent:
        # The name of a sweep may have characters that the font lacks, drawn as boxes.
        warnings.filterwarnings("ignore", "Glyph", UserWarning)
        fields = {} if pixels else {**about, **_NO_DATES[kind]}
        figure.savefig(image, format="png" if pixels else kind, metadata=fields)
    content = _as_tiff(image, about) if pixels else image.getvalue()
    if kind == "eps":
        title, _, text = description or ("", "", "")
        content = _with_comments(content, title, text)
    with writing(output, "picture") as draft:
        draft.write(content)


def save_chart(output: Path, picture: Callable[..., Figure], *measured: object) -> None:
    """Write the figure that `picture` makes of measurements to a file, in the common style."""
    with mpl.rc_context(STYLE):
        save(picture(*measured), output)


def _as_tiff(png: BytesIO, about: Mapping[str, str]) -> bytes:
    """Return a picture as TIFF with what it is `about`, compressed and without transparency."""
    from PIL import Image

    tiff, tags = BytesIO(), {int(tag): text.encode() for tag, text in about.items()}
    with Image.open(png) as image:
        look = {"compression": "tiff_lzw", "dpi": image.info["dpi"], "tiffinfo": tags}
        image.convert("RGB").save(tiff, "tiff", **look)
    return tiff.getvalue()


def _make_opaque(figure: Figure) -> None:
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


def _with_comments(image: bytes, title: str, text: str) -> bytes:
    """Return a file without its date, with a title, and with a text as comments."""
    head, mark, body = image.partition(b"%%EndComments\n")
    head = re.sub(rb"(?m)^%%CreationDate:.*\n", b"", head)
    named = _comment("%%", f"Title: {title}") if title else b""
    comments = b"".join(_comment("%", f" {line}") for line in text.splitlines())
    return head + named + mark + comments + body


def _comment(mark: str, line: str) -> bytes:
    """Return a comment of PostScript, in further lines that begin with a plus if it is long."""
    escaped = "".join(one if " " <= one <= "~" else ascii(one)[1:-1] for one in line)
    parts = [escaped[i : i + _MOST_IN_LINE] for i in range(0, len(escaped), _MOST_IN_LINE)]
    return (mark + f"\n{mark}+".join(parts) + "\n").encode("ascii")
