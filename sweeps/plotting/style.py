"""Colours by their meaning, and matplotlib's settings.

Any two colours of one picture can be told apart with normal colour vision, deuteranopia and
protanopia: they differ by at least 10 in CIEDE2000. Dots and lines are darker than cells. A colour
without a meaning comes from the settings of matplotlib: `ground`, `ink`, and `data_colour` for data
of one kind.
"""

import logging
from typing import Any, NamedTuple, Self

import matplotlib as mpl
import numpy as np
from matplotlib.colors import Colormap, LinearSegmentedColormap, to_hex, to_rgb, to_rgba
from matplotlib.rcsetup import cycler

from vibroimpact.points.regimes import ON_ITS_WAY, Regime
from vibroimpact.status import Evidence, Status

# From Okabe and Ito's palette.
BLUE, VERMILION, ORANGE = "#0072B2", "#D55E00", "#E69F00"
DARK_ORANGE = "#BF7A00"  # for dots and lines
WHITE = "#FFFFFF"

STATUS_COLOURS = {
    Status.PENDING: "#ACA59E",
    Status.UNRESOLVED: "#666666",
    Status.NON_FINITE: "#333333",
}


#: Dashes of a line, as matplotlib takes them.
Dash = str | tuple[float, tuple[float, ...]]


class Look(NamedTuple):
    """The look of an attractor, a class or a regime: its cells, and its lines and dots in ink."""

    colour: str
    ink: str
    hatch: str = ""
    marker: str = "o"
    dash: Dash = "-"

    @classmethod
    def plain(cls, colour: str) -> Self:
        """Return a look that has nothing but a colour."""
        return cls(colour, colour)

    def on_ground(self) -> Self:
        """Return the look with lines and dots that are visible on the ground."""
        return self._replace(ink=visible(self.ink))


#: Names of exact orbits in a legend.
STABLE, UNSTABLE = "exact orbits, stable", "exact orbits, unstable"
#: Colours of the classes m/q, in every picture. The hue says m; the darker, the more impacts. These
#: are as many as can be told apart beside each other and the colours of regimes and outcomes.
CLASSES = {
    (1, 0): "#C6CFFD",
    (1, 1): "#4783EA",
    (1, 2): "#004C98",
    (2, 1): "#F1DA28",
    (2, 2): "#C2A548",
    (2, 3): "#3D2D02",
    (3, 1): "#E08BBC",
    (3, 2): "#D0558F",
    (3, 3): "#4F0C44",
    (4, 2): "#93D6A0",
    (4, 3): "#2F9C60",
    (4, 4): "#2A6643",
    (8, 6): "#BAA2FD",
    (8, 8): "#6E38E9",
}
#: Colour of all other classes.
OTHER_CLASS = "#EDEBD8"
#: The colours of dots and lines on paper, by that of the cells: their contrast with white is at
#: least 3, and those of classes, regimes and outcomes differ by at least 10, too.
INKS = {
    "#C6CFFD": "#7C7C91",
    "#4783EA": "#42679E",
    "#004C98": "#091C2C",
    "#F1DA28": "#969758",
    "#C2A548": "#857851",
    "#E08BBC": "#CC76BC",
    "#D0558F": "#9C3972",
    "#4F0C44": "#5F195E",
    "#93D6A0": "#739D7F",
    "#2F9C60": "#376A54",
    "#2A6643": "#0F4F31",
    "#BAA2FD": "#9F7DFC",
    "#6E38E9": "#6E2EF7",
    OTHER_CLASS: "#757B75",
    "#CCCCCC": "#909396",  # unknown, or no value
    STATUS_COLOURS[Status.PENDING]: "#8C8596",
    # Further attractors, evidence and outcomes, and a direction.
    "#1E8C8C": "#06707A",
    "#FA6478": "#FF35DF",
    "#5A506E": "#554186",
    "#A0F08C": "#70653A",
    "#B42846": "#822B53",
    "#56B4E9": "#169ED8",
    "#F0E442": "#85754C",
    ORANGE: "#B08C5A",
}
#: In grey the hatch says m, and the darker, the more impacts.
_HATCHES = {1: "", 2: "////", 3: "....", 4: "\\\\\\\\", 8: "xxxx"}
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
#: Greys of cells and inks, which are dark enough to be seen on paper.
_GREYS = (("#FFFFFF", "#949494"), ("#D2D2D2", "#4D4D4D"), ("#A8A8A8", "#000000"))
REST_COLOUR = VERMILION
#: Colours of the marks in a diagram: motions whose kept impacts are less than a repetition, and
#: motions that are not on their orbit yet.
PARTIAL, APPROACHING = "only part of a repetition", ON_ITS_WAY
MARKS = {PARTIAL: "#009E73", APPROACHING: "#8A2BE2"}
#: Colours of the regimes that are not periodic.
REGIMES = {
    Regime.REST: REST_COLOUR,
    Regime.CHAOTIC: "#000000",
    Regime.UNBOUNDED: "#7A4A12",
    Regime.UNKNOWN: "#CCCCCC",
}

#: The hatch of motions with rest in maps says after how many periods they repeat, 0: not known.
RESTS = {1: "", 2: "////", 3: "....", 4: "\\\\\\\\", 6: "xxxx", 0: "----"}
OTHER_RESTS = "++"


def _grey(greys: tuple[str, str], hatch: str) -> Look:
    """Return a look in grey."""
    return Look(*greys, hatch, *_SHAPES[hatch])


#: Looks in grey of the classes, of all other classes, and of the regimes.
GREY_CLASSES = {
    (m, q): _grey(_GREYS[sum(own == m and fewer < q for own, fewer in CLASSES)], _HATCHES[m])
    for m, q in CLASSES
}
GREY_OTHER = Look("#E9E9E9", "#949494", "", "+", (0.0, (1.0, 3.0)))
GREY_REGIMES = {
    Regime.REST: Look("#7A7A7A", "#7A7A7A", "", "d", (0.0, (2.0, 1.0))),
    Regime.CHAOTIC: Look("#000000", "#000000", "", ".", (0.0, (6.0, 3.0))),
    Regime.UNBOUNDED: _grey(_GREYS[0], "||||"),
    Regime.UNKNOWN: Look("#4A4A4A", "#4A4A4A", "..", "x", (0.0, (6.0, 3.0))),
}
#: Colours of the outcomes with a result in a map of ``status``.
RESULT_COLOURS = {
    Status.COMPUTED: "#56B4E9",
    Status.CERTIFIED: BLUE,
    Status.CUT_SHORT: ORANGE,
    Status.UNBOUNDED: REST_COLOUR,
}

#: Colours of the evidence for a class.
EVIDENCE = {
    Evidence.REPEATS: BLUE,
    Evidence.FREE: "#56B4E9",
    Evidence.CAPTURED: "#009E73",
    Evidence.FALLING: "#F0E442",
    Evidence.RELEASED: "#CC79A7",
    Evidence.NONE: "#000000",
    Evidence.UNSTABLE: "#4B0082",
    Evidence.UNREACHED: REST_COLOUR,
}
#: Colours of points without a value, and of dots that would be white.
NO_VALUE, PALE = "#CCCCCC", STATUS_COLOURS[Status.PENDING]

#: Colours of attractors that have not that of a class, and their looks in grey. They differ by at
#: least 9 from those of classes.
FURTHER = ("#1E8C8C", "#FA6478", "#5A506E", "#A0F08C", "#B42846")
_FURTHER_GREYS = (("#E9E9E9", "#737373"), ("#BDBDBD", "#282828"))
GREY_FURTHER = tuple(
    _grey(_FURTHER_GREYS[i % 2], hatch)
    for i, hatch in enumerate(("----", "oo", "++", "||||", "**"))
)

#: Looks in grey of what has none of its own: words, and a few values of an axis; of values that are
#: not on a scale of greys; and of failed points beside these.
GREY_SERIES = tuple(
    _grey(_FURTHER_GREYS[i % 2], hatch) for i, hatch in enumerate([*_SHAPES][: len(EVIDENCE)])
)
GREY_SPECIAL = (
    _grey((WHITE, "#949494"), ""),
    *(_grey((WHITE, "#000000"), hatch) for hatch in ("////", "xxxx", "....")),
)
GREY_FAILED = {
    Status.UNRESOLVED: _grey((WHITE, "#000000"), "||||"),
    Status.NON_FINITE: _grey((WHITE, "#000000"), "**"),
}

#: Colours of the two directions in which an axis was followed, and of points in both.
DIRECTION_COLOURS = (BLUE, DARK_ORANGE)
BOTH_COLOUR = "#333333"

#: The same in grey, where the markers say the direction, too.
GREY_DIRECTIONS = ("#000000", "#8C8C8C")
DIRECTION_MARKERS = ("^", "v")
DIRECTION_DASHES: tuple[Dash, Dash] = ("-", (0.0, (3.0, 1.5)))
#: Colours of the marks in a diagram, in grey.
GREY_MARKS = {PARTIAL: "#8C8C8C", APPROACHING: "#000000"}

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
    "axes.prop_cycle": cycler(
        color=[BLUE, DARK_ORANGE, "#009E73", VERMILION, "#56B4E9", "#CC79A7"]
    ),
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


def grey_style() -> dict[Any, Any]:
    """Return settings of matplotlib with which data without a meaning are grey."""
    greys = [mix(ink(), ground(), share) for share in (0.6, 1.0)]
    return {"axes.prop_cycle": cycler(color=greys)}


def grey_ramp(least: float) -> LinearSegmentedColormap:
    """Return the greys of numbers, each darker than those of less, or lighter on a dark ground.

    The first has a `least` share of the ink.
    """
    return LinearSegmentedColormap.from_list("grey", [mix(ink(), ground(), least), ink()])


def visible(colour: str) -> str:
    """Return the colour of dots or lines: of ``INKS``, or on a dark ground mixed with the ink."""
    if _luminance(ink()) <= 0.5:
        return INKS.get(colour, colour)
    mixed, share = colour, 0.0
    while share < 1.0 and _contrast(mixed, ground()) < _LEGIBLE:
        share += 0.1
        mixed = mix(ink(), colour, share)
    return mixed


def legible(ramp: Colormap) -> Colormap:
    """Return the colours of a ramp that dots can have."""
    colours = [one for one in map(to_hex, ramp(range(256))) if _contrast(one, ground()) >= _LEGIBLE]
    return LinearSegmentedColormap.from_list(ramp.name, colours) if colours else ramp


def hatch_on(colour: str) -> str:
    """Return the colour of the lines of a hatch on cells, white on dark ones."""
    return max((HATCH, WHITE), key=lambda lines: (_contrast(lines, colour) > 2.0, lines == HATCH))


def mix(colour: str, other: str, share: float) -> str:
    """Return a mixture of two colours, with this share of the first."""
    one, two = np.array(to_rgb(colour)), np.array(to_rgb(other))
    return to_hex(tuple((share * one + (1.0 - share) * two).clip(0.0, 1.0)))


def shades(colour: str, paper: str, dark: str) -> list[str]:
    """Return the colours of the share of a column's points in a pixel, from the least share to 1.

    They start well away from the paper, so that a pixel with a single point is visible.
    """
    return [mix(colour, paper, 0.35), colour, mix(dark, colour, 0.66)]


def _contrast(colour: str, other: str) -> float:
    """Return the contrast of two colours as WCAG 2 defines it, from 1 to 21."""
    low, high = sorted(_luminance(each) for each in (colour, other))
    return (high + 0.05) / (low + 0.05)


def _luminance(colour: str) -> float:
    """Return the relative luminance of a colour, from 0 to 1 (WCAG 2)."""
    rgb = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)]
    return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]


def _told(record: logging.LogRecord) -> bool:
    """Drop the warnings of a matplotlibrc: matplotlib gave them when it was imported."""
    return False


def user_style() -> dict[Any, Any]:
    """Return the settings of ``STYLE`` that no matplotlibrc sets and no style sheet changes."""
    log = logging.getLogger("matplotlib")
    log.addFilter(_told)
    try:
        named = mpl.rc_params_from_file(mpl.matplotlib_fname(), use_default_template=False)
    finally:
        log.removeFilter(_told)
    return {
        name: value
        for name, value in STYLE.items()
        if name not in named and mpl.rcParams[name] == mpl.rcParamsDefault[name]
    }


def dots_per_inch() -> float:
    """Return the resolution of a PNG, and of the pixels embedded in an SVG, a PDF or an EPS."""
    dpi = mpl.rcParams["savefig.dpi"]
    return float(mpl.rcParams["figure.dpi"] if dpi == "figure" else dpi)
