"""The look that all pictures share: their colours, by what they mean, and matplotlib's settings.

Every two colours are told apart with normal colour vision, deuteranopia and protanopia: they differ
by at least 10 in CIEDE2000.
"""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl

from sweeps.analysis.regimes import Regime
from vibroimpact.status import Status

# From Okabe and Ito's palette.
BLUE, VERMILION, ORANGE = "#0072B2", "#D55E00", "#E69F00"
WHITE = "#FFFFFF"

STATUS_COLOURS = {
    Status.PENDING: "#ACA59E",
    Status.UNRESOLVED: "#666666",
    Status.NON_FINITE: "#333333",
}

#: Of the most frequent period classes in a map: without vermilion and black.
PERIODIC = (BLUE, "#56B4E9", "#009E73", "#F0E442", ORANGE, "#CC79A7")
OTHER_PERIODIC = "#D3E4B4"
#: The classes m/q that have these colours in every picture; others have what is left there.
_NAMED = ((1, 1), (2, 2), (1, 2), (3, 3), (2, 1), (1, 0))
REST = VERMILION
#: Of the other regimes: their label and their colour.
REGIMES = {
    Regime.REST: ("with rest", REST),
    Regime.CHAOTIC: (r"chaotic, $\lambda_1 > 0$", "#000000"),
    Regime.NEUTRAL: ("quasi-periodic or unsettled", "#4B0082"),
    Regime.UNBOUNDED: ("unbounded", "#7A4A12"),
    Regime.UNDECIDED: ("undecided", "#CCCCCC"),
}
#: Of points with a result in a map of ``status``.
RESULTS = {
    Status.COMPUTED: PERIODIC[1],
    Status.CERTIFIED: PERIODIC[0],
    Status.SETTLED: PERIODIC[4],
    Status.UNBOUNDED: REST,
}

#: Of the periodic attractors, the most frequent first: neighbours in this order are far apart.
ATTRACTORS = (BLUE, ORANGE, "#009E73", "#CC79A7", "#56B4E9", "#F0E442")
OTHER_ATTRACTORS = OTHER_PERIODIC

#: Of the directions in which an axis was followed, and of what both directions meet.
DIRECTION_COLOURS = (BLUE, ORANGE)
BOTH_COLOUR = "#333333"

#: Of the share of a column's points in a pixel, from the least to 1. All ramps start well away from
#: white, so that a pixel met once is seen.
DENSITY = ("#A6CBE3", BLUE, "#00263D")
LEAST_SHARE = 1e-3

#: Sizes of text follow ``font.size``. A picture is higher than ``figure.figsize`` by what its title
#: and its legend take, and by the panels below it.
STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": "medium",
    "figure.titlesize": "medium",
    "figure.figsize": [5.0, 3.2],
    "axes.linewidth": 0.6,
    "axes.formatter.offset_threshold": 5,  # digits that all labels would share
    "agg.path.chunksize": 10000,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "vibroimpact",  # the same picture gives the same bytes
    "savefig.dpi": 300,
}


def class_colours(classes: Sequence[tuple[int, int]]) -> dict[tuple[int, int], str]:
    """Return a colour for each of some classes (m, q), no more than there are in ``PERIODIC``."""
    own = dict(zip(_NAMED, PERIODIC, strict=True))
    left = [colour for name, colour in own.items() if name not in classes]
    return {
        (m, q): own[m, q] if (m, q) in own else left.pop((m + 2 * q) % len(left))
        for m, q in classes
    }


def user_style() -> dict[Any, Any]:
    """Return the settings of ``STYLE`` that no matplotlibrc names and no style sheet changes."""
    named = mpl.rc_params_from_file(mpl.matplotlib_fname(), use_default_template=False)
    return {
        name: value
        for name, value in STYLE.items()
        if name not in named and mpl.rcParams[name] == mpl.rcParamsDefault[name]
    }


def dots_per_inch() -> float:
    """Return the resolution of a PNG, and of what is drawn as pixels in an SVG or a PDF."""
    dpi = mpl.rcParams["savefig.dpi"]
    return float(mpl.rcParams["figure.dpi"] if dpi == "figure" else dpi)
