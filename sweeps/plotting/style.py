"""The look that all pictures share, as matplotlib's own settings."""

from typing import Any

import matplotlib as mpl

#: The smallest size of a text: an index in it, of 0.7 times the size, has 6 points still.
_SMALL = 8.6

STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "xtick.labelsize": _SMALL,
    "ytick.labelsize": _SMALL,
    "legend.fontsize": _SMALL,
    "legend.title_fontsize": _SMALL,
    "figure.titlesize": _SMALL,
    "axes.linewidth": 0.6,
    "axes.formatter.useoffset": False,
    "agg.path.chunksize": 10000,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
    "svg.hashsalt": "vibroimpact",  # the same picture gives the same bytes
    "savefig.dpi": 300,
}


def user_style() -> dict[Any, Any]:
    """Return the settings of ``STYLE`` that no matplotlibrc and no style sheet has changed."""
    return {
        name: value
        for name, value in STYLE.items()
        if mpl.rcParams[name] == mpl.rcParamsDefault[name]
    }


def dots_per_inch() -> float:
    """Return the resolution of a PNG, and of what is drawn as pixels in an SVG or a PDF."""
    dpi = mpl.rcParams["savefig.dpi"]
    return float(mpl.rcParams["figure.dpi"] if dpi == "figure" else dpi)
