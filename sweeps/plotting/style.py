"""`Look`: colours by their meaning, hatches, markers, dashes; ramps, inks; matplotlib's settings.

Any two colours of one picture can be told apart with normal colour vision, deuteranopia and
protanopia: they differ by at least 10 in CIEDE2000. Dots and lines are darker than cells. A colour
without a meaning comes from the settings of matplotlib: `ground`, `ink`, and `data_colour` for data
of one kind.
"""

import logging
import threading
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple, Self

import matplotlib as mpl
import numpy as np
from matplotlib.colors import Colormap, LinearSegmentedColormap, to_hex, to_rgb, to_rgba
from matplotlib.rcsetup import cycler

from vibroimpact.points.regimes import ON_ITS_WAY, Regime
from vibroimpact.status import Evidence, Status

# From Okabe and Ito's palette.
BLUE, VERMILION, ORANGE = "#0072B2", "#D55E00", "#E69F00"
GREEN, PURPLE, SKY, YELLOW = "#009E73", "#CC79A7", "#56B4E9", "#F0E442"
DARK_ORANGE = "#BF7A00"  # for dots and lines
WHITE, BLACK = "#FFFFFF", "#000000"

#: One thread draws at a time: all share matplotlib's settings and its reader of formulas.
_LOCK = threading.RLock()

STATUS_COLOURS = {
    Status.PENDING: "#ACA59E",
    Status.UNRESOLVED: "#666666",
    Status.NON_FINITE: "#333333",
}


#: Dashes of a line, as matplotlib takes them.
Dash = str | tuple[float, tuple[float, ...]]
#: What has a look: a class m/q, None for all others, a regime, or a colour of further attractors.
LookKey = tuple[int, int] | None | Regime | str


class Look(NamedTuple):
    """The look of an attractor, a class or a regime: of its cells, and of its lines and dots."""

    colour: str  # of the cells
    dots: str  # colour of the lines and dots
    hatch: str = ""
    marker: str = "o"
    dash: Dash = "-"

    @classmethod
    def plain(cls, colour: str) -> Self:
        """Return a look that has nothing but a colour."""
        return cls(colour, colour)


#: Names of exact orbits in a legend.
STABLE, UNSTABLE = "exact orbits, stable", "exact orbits, unstable"
#: The marker and the dashes of lines and dots in grey, by the hatch of the cells.
_SHAPES: dict[str, tuple[str, Dash]] = {
    "": ("o", "-"),
    "////": ("^", (0.0, (3.0, 1.0))),
    "....": ("s", (0.0, (1.0, 1.0))),
    "\\\\\\\\": ("v", (0.0, (3.0, 1.0, 1.0, 1.0))),
    "xxxx": ("X", (0.0, (2.0, 2.0))),
    "----": ("<", (0.0, (6.0, 1.5))),
    "oo": (">", (0.0, (1.0, 2.0))),
    "++": ("P", (0.0, (3.0, 1.0, 1.0, 1.0, 1.0, 1.0))),
    "||||": ("D", (0.0, (6.0, 1.0, 1.0, 1.0))),
    "**": ("*", (0.0, (3.0, 1.0, 3.0, 1.0, 1.0, 1.0))),
}
#: Colour of the lines of a hatch.
HATCH = "#333333"
REST_COLOUR = VERMILION
#: Colours of the marks in a diagram: motions whose kept impacts are less than a repetition, and
#: motions that are not on their orbit yet; those in grey.
PARTIAL, APPROACHING = "only part of a repetition", ON_ITS_WAY
MARKS = {PARTIAL: (GREEN, "#8C8C8C"), APPROACHING: ("#4B0082", "#000000")}

#: The hatch of motions with rest in maps says after how many periods they repeat, 0: not known.
RESTS = {1: "", 2: "////", 3: "....", 4: "\\\\\\\\", 6: "xxxx", 0: "----"}
OTHER_RESTS = "++"


#: Greys of cells and inks, which are dark enough to be seen on paper: of classes, and of others.
_GREYS = (
    *(("#FFFFFF", "#949494"), ("#D2D2D2", "#4D4D4D"), ("#A8A8A8", "#000000")),
    *(("#E9E9E9", "#737373"), ("#BDBDBD", "#282828"), ("#FFFFFF", "#000000")),
)
#: Dashes of motions without a class.
_LONG = (0.0, (6.0, 3.0))


def _grey(number: int, hatch: str) -> Look:
    """Return a look in one of the greys."""
    return Look(*_GREYS[number], hatch, *_SHAPES[hatch])


#: A row for each class m/q, all other classes, the regimes that are not periodic, and attractors
#: that have not the look of a class: the colour of cells, that of dots and lines on paper, and the
#: look in grey. The hue and the hatch say m; the darker, the more impacts. These are as many
#: colours as can be told apart beside each other and those of outcomes; those of further attractors
#: differ by at least 9 from those of classes. The contrast of dots with white is at least 3.
_ROWS: dict[LookKey, tuple[str, str, Look]] = {
    (1, 0): ("#C6CFFD", "#7C7C91", _grey(0, "")),
    (1, 1): ("#4783EA", "#42679E", _grey(1, "")),
    (1, 2): ("#004C98", "#091C2C", _grey(2, "")),
    (2, 1): ("#F1DA28", "#969758", _grey(0, "////")),
    (2, 2): ("#C2A548", "#857851", _grey(1, "////")),
    (2, 3): ("#3D2D02", "#3D2D02", _grey(2, "////")),
    (3, 1): ("#E08BBC", "#CC76BC", _grey(0, "....")),
    (3, 2): ("#D0558F", "#9C3972", _grey(1, "....")),
    (3, 3): ("#4F0C44", "#5F195E", _grey(2, "....")),
    (4, 2): ("#93D6A0", "#739D7F", _grey(0, "\\\\\\\\")),
    (4, 3): ("#2F9C60", "#376A54", _grey(1, "\\\\\\\\")),
    (4, 4): ("#2A6643", "#0F4F31", _grey(2, "\\\\\\\\")),
    (8, 6): ("#BAA2FD", "#9F7DFC", _grey(0, "xxxx")),
    (8, 8): ("#6E38E9", "#6E2EF7", _grey(1, "xxxx")),
    None: ("#EDEBD8", "#757B75", Look("#E9E9E9", "#949494", "", "+", (0.0, (1.0, 3.0)))),
    Regime.REST: (VERMILION, VERMILION, Look("#7A7A7A", "#7A7A7A", "", "d", (0.0, (2.0, 1.0)))),
    Regime.CHAOTIC: (BLACK, BLACK, Look(BLACK, BLACK, "", ".", _LONG)),
    Regime.UNBOUNDED: ("#7A4A12", "#7A4A12", _grey(0, "||||")),
    Regime.UNKNOWN: ("#CCCCCC", "#909396", Look("#4A4A4A", "#4A4A4A", "..", "x", _LONG)),
    "#1E8C8C": ("#1E8C8C", "#06707A", _grey(3, "----")),
    "#FA6478": ("#FA6478", "#FF35DF", _grey(4, "oo")),
    "#5A506E": ("#5A506E", "#554186", _grey(3, "++")),
    "#A0F08C": ("#A0F08C", "#70653A", _grey(4, "||||")),
    "#B42846": ("#B42846", "#822B53", _grey(3, "**")),
}
#: The looks of the rows, in colour and in grey.
LOOKS = {key: (Look.plain(colour), grey) for key, (colour, _, grey) in _ROWS.items()}
#: Colours of the classes, of the regimes and of further attractors.
CLASSES = {key: row[0] for key, row in _ROWS.items() if isinstance(key, tuple)}
REGIMES = {key: row[0] for key, row in _ROWS.items() if isinstance(key, Regime)}
FURTHER = tuple(key for key in _ROWS if isinstance(key, str))
#: The colours of dots and lines on paper, by that of the cells.
DOT_COLOURS = {colour: dots for colour, dots, _ in _ROWS.values()} | {
    STATUS_COLOURS[Status.PENDING]: "#8C8596",
    SKY: "#169ED8",  # evidence and outcomes
    YELLOW: "#85754C",
    ORANGE: "#B08C5A",
}
#: Colours of the outcomes with a result in a map of ``status``.
RESULT_COLOURS = {
    Status.COMPUTED: SKY,
    Status.CERTIFIED: BLUE,
    Status.CUT_SHORT: ORANGE,
    Status.UNBOUNDED: REST_COLOUR,
}

#: Colours of the evidence for a class.
EVIDENCE = {
    Evidence.REPEATS: BLUE,
    Evidence.FREE: SKY,
    Evidence.CAPTURED: GREEN,
    Evidence.FALLING: YELLOW,
    Evidence.RELEASED: PURPLE,
    Evidence.NONE: "#000000",
    Evidence.UNSTABLE: "#4B0082",
    Evidence.UNREACHED: REST_COLOUR,
}
#: Colours of points without a value, and of dots that would be white.
NO_VALUE, PALE = "#CCCCCC", STATUS_COLOURS[Status.PENDING]

#: Looks in grey of what has none of its own: words, and a few values of an axis; of values that are
#: not on a scale of greys; and of failed points beside these.
GREY_SERIES = tuple(_grey(3 + i % 2, hatch) for i, hatch in enumerate([*_SHAPES][:8]))
GREY_SPECIAL = (_grey(0, ""), *(_grey(5, hatch) for hatch in ("////", "xxxx", "....")))
GREY_FAILED = {Status.UNRESOLVED: _grey(5, "||||"), Status.NON_FINITE: _grey(5, "**")}

#: Looks of the two directions in which an axis was followed, in colour and in grey, and the colour
#: of points in both.
DIRECTION_LOOKS = tuple(
    (Look(up, up, marker="^"), Look(down, down, marker="v", dash=(0.0, (3.0, 1.5))))
    for up, down in ((BLUE, DARK_ORANGE), (BLACK, "#8C8C8C"))
)
BOTH_COLOUR = "#333333"

LEAST_SHARE = 1e-3

#: Settings of matplotlib. Text sizes follow ``font.size``. A picture is higher than
#: ``figure.figsize`` by the height of its title, its legend and the panels below it.
STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": "medium",
    "figure.titlesize": "medium",
    "figure.figsize": [5.0, 3.2],
    "axes.linewidth": 0.6,
    "legend.frameon": False,
    "legend.borderpad": 0.2,
    "legend.labelspacing": 0.3,
    "legend.handlelength": 1.4,
    "legend.handletextpad": 0.5,
    "legend.columnspacing": 1.0,
    "axes.formatter.offset_threshold": 5,  # number of leading digits that all labels share
    "axes.prop_cycle": cycler(color=[BLUE, DARK_ORANGE, GREEN, VERMILION, SKY, PURPLE]),
    "image.cmap": "cividis",
    "hatch.linewidth": 0.7,
    "agg.path.chunksize": 10000,
    "pdf.fonttype": 42,
    "ps.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "vibroimpact",  # the same picture gives the same bytes
    "savefig.dpi": 300,
}


#: Least contrast of texts, dots and lines with their ground (WCAG 2).
_LEGIBLE = 3.0


def ground() -> str:
    """Return the colour of the panels in the settings of the user."""
    for name in ("axes.facecolor", "figure.facecolor"):
        if to_rgba(mpl.rcParams[name])[3] > 0.0:
            return to_hex(mpl.rcParams[name])
    return WHITE


def ink() -> str:
    """Return the colour of texts, or black or white if texts are not legible on the ground."""
    text = to_hex(mpl.rcParams["text.color"])
    if _contrast(text, ground()) >= _LEGIBLE:
        return text
    return max(("#000000", WHITE), key=lambda colour: _contrast(colour, ground()))


def data_colour(number: int = 0) -> str:
    """Return the colour of data without a meaning, by their number in ``axes.prop_cycle``."""
    return to_hex(f"C{number}")


def grey_ramp() -> LinearSegmentedColormap:
    """Return the greys of numbers, each darker than those of less, or lighter on a dark ground."""
    return LinearSegmentedColormap.from_list("grey", [mix(ink(), ground(), 0.1), ink()])


def dot_colour(colour: str) -> str:
    """Return the colour of dots and lines whose cells have a colour, lighter on a dark ground."""
    if _luminance(ink()) <= 0.5:
        return DOT_COLOURS.get(colour, colour)
    mixed, share = colour, 0.0
    while share < 1.0 and _contrast(mixed, ground()) < _LEGIBLE:
        share += 0.1
        mixed = mix(ink(), colour, share)
    return mixed


def legible(ramp: Colormap) -> Colormap:
    """Return the colours of a ramp that dots can have."""
    colours = [c for c in map(to_hex, ramp(range(256))) if _contrast(c, ground()) >= _LEGIBLE]
    return LinearSegmentedColormap.from_list(ramp.name, colours) if colours else ramp


def hatch_on(colour: str) -> str:
    """Return the colour of the lines of a hatch on cells, white on dark ones."""
    return max((HATCH, WHITE), key=lambda lines: (_contrast(lines, colour) > 2.0, lines == HATCH))


def mix(colour: str, other: str, share: float) -> str:
    """Return a mixture of two colours, with this share of the first."""
    first, second = np.array(to_rgb(colour)), np.array(to_rgb(other))
    return to_hex(tuple((share * first + (1.0 - share) * second).clip(0.0, 1.0)))


def shades(colour: str, paper: str, dark: str) -> list[str]:
    """Return the colours of shares from the least, which is visible in a single pixel, to 1."""
    return [mix(colour, paper, 0.35), colour, mix(dark, colour, 0.66)]


def _contrast(colour: str, other: str) -> float:
    """Return the contrast of two colours as WCAG 2 defines it, from 1 to 21."""
    low, high = sorted(_luminance(each) for each in (colour, other))
    return (high + 0.05) / (low + 0.05)


def _luminance(colour: str) -> float:
    """Return the relative luminance of a colour, from 0 to 1 (WCAG 2)."""
    rgb = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)]
    return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]


@contextmanager
def without_log(name: str, text: str = "") -> Iterator[None]:
    """Leave out the messages of a logger that contain a text."""
    log = logging.getLogger(name)

    def is_other(record: logging.LogRecord) -> bool:
        return text not in record.getMessage()

    log.addFilter(is_other)
    try:
        yield
    finally:
        log.removeFilter(is_other)


def user_style() -> dict[Any, Any]:
    """Return the settings of ``STYLE`` that no matplotlibrc sets and no style sheet changes."""
    with without_log("matplotlib"):  # which warned of a matplotlibrc when it was imported
        named = mpl.rc_params_from_file(mpl.matplotlib_fname(), use_default_template=False)
    return {
        name: value
        for name, value in STYLE.items()
        if name not in named and mpl.rcParams[name] == mpl.rcParamsDefault[name]
    }


@contextmanager
def in_style(
    settings: Mapping[Any, Any] = {}, *, common: bool = True, grey: bool = False
) -> Iterator[None]:
    """Draw in the `common` style or not, with settings, in grey or not; other threads wait."""
    with _LOCK, mpl.rc_context((user_style() if common else {}) | dict(settings)):
        if grey:  # also data without a meaning
            greys = [mix(ink(), ground(), share) for share in (0.6, 1.0)]
            mpl.rcParams["axes.prop_cycle"] = cycler(color=greys)
        with warnings.catch_warnings():  # of characters in the name of a sweep that the font lacks
            warnings.filterwarnings("ignore", "Glyph", UserWarning)
            yield


def dots_per_inch() -> float:
    """Return the resolution of a PNG, and of the pixels embedded in an SVG, a PDF or an EPS."""
    dpi = mpl.rcParams["savefig.dpi"]
    return float(mpl.rcParams["figure.dpi"] if dpi == "figure" else dpi)
