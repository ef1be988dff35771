"""The look that all pictures share: sizes of text and lines, as matplotlib's own settings."""

from typing import Any

#: Dots per inch of a PNG, and of what is drawn as pixels in an SVG or a PDF.
DPI = 300

STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "axes.linewidth": 0.6,
    "axes.formatter.useoffset": False,
    "agg.path.chunksize": 10000,
    "pdf.fonttype": 42,
    "svg.fonttype": "none",
}
