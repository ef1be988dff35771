"""The common style of the pictures: colours by their meaning, and matplotlib's settings.

Any two colours of one picture can be told apart with normal colour vision, deuteranopia and
protanopia: they differ by at least 10 in CIEDE2000.
"""

import logging
from typing import Any, NamedTuple

import matplotlib as mpl

from vibroimpact.points.regimes import ON_ITS_WAY, Regime
from vibroimpact.status import Evidence, Status

# From Okabe and Ito's palette.
BLUE, VERMILION, ORANGE = "#0072B2", "#D55E00", "#E69F00"
WHITE = "#FFFFFF"

STATUS_COLOURS = {
    Status.PENDING: "#ACA59E",
    Status.UNRESOLVED: "#666666",
    Status.NON_FINITE: "#333333",
}


class Look(NamedTuple):
    """The look of an attractor, a class or a regime: its cells, and its lines and dots in ink."""

    colour: str
    ink: str
    hatch: str = ""
    marker: str = "o"
    dash: str | tuple[float, tuple[float, ...]] = "-"


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
#: In grey the hatch says m, and the darker, the more impacts.
_HATCHES = {1: "", 2: "////", 3: "....", 4: "\\\\\\\\", 8: "xxxx"}
#: The marker and the dashes of lines and dots in grey, by the hatch of the cells.
_SHAPES: dict[str, tuple[str, str | tuple[float, tuple[float, ...]]]] = {
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
_GREYS = (("#FFFFFF", "#999999"), ("#D2D2D2", "#4D4D4D"), ("#A8A8A8", "#000000"))
REST = VERMILION
#: Colours of the marks in a diagram: motions whose kept impacts are less than a repetition, and
#: motions that are not on their orbit yet.
PARTIAL, APPROACHING = "only part of a repetition", ON_ITS_WAY
MARKS = {PARTIAL: "#009E73", APPROACHING: "#8A2BE2"}
#: Colours of the regimes that are not periodic.
REGIMES = {
    Regime.REST: REST,
    Regime.CHAOTIC: "#000000",
    Regime.UNBOUNDED: "#7A4A12",
    Regime.UNKNOWN: "#CCCCCC",
}


def _grey(greys: tuple[str, str], hatch: str) -> Look:
    """Return a look in grey."""
    return Look(*greys, hatch, *_SHAPES[hatch])


#: Looks in grey of the classes, of all other classes, and of the regimes.
GREY_CLASSES = {
    (m, q): _grey(_GREYS[sum(own == m and fewer < q for own, fewer in CLASSES)], _HATCHES[m])
    for m, q in CLASSES
}
GREY_OTHER = Look("#E9E9E9", "#999999", "", ".", (0.0, (1.0, 3.0)))
GREY_REGIMES = {
    Regime.REST: Look("#7A7A7A", "#7A7A7A", "", "d", (0.0, (2.0, 1.0))),
    Regime.CHAOTIC: Look("#000000", "#000000", "", ".", (0.0, (6.0, 3.0))),
    Regime.UNBOUNDED: _grey(_GREYS[0], "||||"),
    Regime.UNKNOWN: Look("#4A4A4A", "#4A4A4A", "", ".", (0.0, (6.0, 3.0))),
}
#: Colours of the outcomes with a result in a map of ``status``.
RESULTS = {
    Status.COMPUTED: "#56B4E9",
    Status.CERTIFIED: BLUE,
    Status.CUT_SHORT: ORANGE,
    Status.UNBOUNDED: REST,
}

#: Colours of the evidence for a class.
EVIDENCE = {
    Evidence.REPEATS: BLUE,
    Evidence.FREE: "#56B4E9",
    Evidence.CAPTURED: "#009E73",
    Evidence.FALLING: "#F0E442",
    Evidence.NONE: "#000000",
    Evidence.UNSTABLE: "#4B0082",
    Evidence.UNREACHED: REST,
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

#: Colours of the two directions in which an axis was followed, and of points in both.
DIRECTION_COLOURS = (BLUE, ORANGE)
BOTH_COLOUR = "#333333"

#: Colours of the share of a column's points in a pixel, from the least share to 1. All ramps start
#: well away from white, so that a pixel with a single point is visible.
DENSITY = ("#A6CBE3", BLUE, "#00263D")
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
    "hatch.linewidth": 0.7,
    "agg.path.chunksize": 10000,
    "pdf.fonttype": 42,
    "ps.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "vibroimpact",  # the same picture gives the same bytes
    "savefig.dpi": 300,
}


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
