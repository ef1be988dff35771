"""The page of a picture: its size, title, limits and look."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes

from sweeps.arguments import require_all
from sweeps.errors import Refused
from sweeps.plotting.pixels import widened
from vibroimpact.inputs import FLAG, TEXT, Allowed, integer, is_number, number


@dataclass(frozen=True)
class Page:
    """The size, title, limits and look of a picture.

    Attributes
    ----------
    width : float, optional
        Width of the figure [inch], by default from matplotlib's ``figure.figsize``.
    height : float, optional
        Height of the figure [inch], by default the height of its panels, title and legend, up to
        that of a printed page, 9 inches.
    dpi : int, optional
        Pixels per inch, by default matplotlib's ``savefig.dpi``.
    title : str, optional
        Title instead of the name, the parameters and the record of the sweep; may be empty.
    xlim, ylim : (float, float), optional
        Limits of the first panel, by default those of the data; the ordinate of a diagram or of a
        motion fits the data within `xlim`.
    xlabel, ylabel : str, optional
        Labels of the axes of the first panel instead of meaning, symbol and unit; may be empty. A
        unit in brackets, as ``gap [mm]``, is that of the ticks.
    legend, marks : bool
        Whether there is a legend; whether a map or a diagram marks motions on their way to
        m/q, bifurcations and other special points of orbits and curves, and jumps. Points that
        failed are always marked.
    grey : bool
        Whether the picture is drawn without colour: in greys, hatches, markers and dashes, with
        boundaries and names. Pictures of tables, maps of other quantities than the class, and
        points with a color are not.

    Examples
    --------
    >>> import sweeps
    >>> omega = {"start": 2.6, "stop": 2.7, "num": 20}
    >>> scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": omega, "f": 1.0}}
    >>> ds = sweeps.open_sweep(sweeps.run_sweep(scene, "flip.h5", overwrite=True))
    >>> from sweeps import plotting
    >>> page = plotting.Page(width=3.4, title="", xlim=(2.62, 2.68))
    >>> plotting.bifurcation(ds, page=page).savefig("column.pdf")
    """

    width: float | None = None
    height: float | None = None
    dpi: int | None = None
    title: str | None = None
    xlim: tuple[float, float] | None = None
    ylim: tuple[float, float] | None = None
    xlabel: str | None = None
    ylabel: str | None = None
    legend: bool = True
    marks: bool = True
    grey: bool = False

    def __post_init__(self) -> None:
        """Refuse a size, title or limit that is not allowed."""
        require_all({name: one for name, one in vars(self).items() if one is not None}, _OF_PAGE)

    def refuse_looks(self, looks: Collection[str]) -> None:
        """Refuse a page with a look that is not among the `looks` of a picture."""
        for name, usual, which in (
            (
                "marks",
                True,
                "only maps and diagrams can leave out marks",
            ),
            ("grey", False, "a picture of a table cannot be grey"),
        ):
            if getattr(self, name) != usual and name not in looks:
                raise Refused(which)

    def set_limits(self, panel: Axes) -> None:
        """Set the given limits; raise Refused if they contain no data."""
        for name, given, ends in (
            ("xlim", self.xlim, panel.dataLim.intervalx),
            ("ylim", self.ylim, panel.dataLim.intervaly),
        ):
            if given is None:
                continue
            if given[1] < ends[0] or ends[1] < given[0]:
                raise Refused(
                    f"there is nothing to draw with {name} = {given[0]:g}:{given[1]:g}; the data "
                    f"range from {ends[0]:.6g} to {ends[1]:.6g}"
                )
            (panel.set_xlim if name == "xlim" else panel.set_ylim)(given)

    def fit_ordinate(self, panel: Axes, *ranges: tuple[float, float]) -> None:
        """Fit the ordinate to the lines, and to further ranges, within the given abscissa."""
        if self.xlim is None:
            return
        low, high = self.xlim
        data = panel.transData  # an `axhline` has another transform
        lines = [line for line in panel.lines if line.get_transform() == data]
        points = [np.asarray(line.get_xydata()) for line in lines]
        seen = [y[(low <= x) & (x <= high)] for x, y in (each.T for each in points)]
        values = np.concatenate([*seen, *ranges, ()])
        values = values[np.isfinite(values)]
        if values.size:
            bottom, top = widened(float(values.min()), float(values.max()))
            margin = mpl.rcParams["axes.ymargin"] * (top - bottom)
            panel.set_ylim(bottom - margin, top + margin)


#: Least and greatest width and height of a picture [inch].
LEAST, MOST = 1.0, 40.0
_LENGTH = number(lambda inches: LEAST <= inches <= MOST, f"inches, from {LEAST:g} to {MOST:g}")
_LIMITS = Allowed(
    lambda value: (
        isinstance(value, Sequence)
        and len(value) == 2
        and all(map(is_number, value))
        and value[0] < value[1]
    ),
    "two numbers of which the first is smaller, as (2.4, 3.0)",
)
_OF_PAGE = {
    "width": _LENGTH,
    "height": _LENGTH,
    "dpi": integer(1),
    "title": TEXT,
    "xlim": _LIMITS,
    "ylim": _LIMITS,
    "xlabel": TEXT,
    "ylabel": TEXT,
    "legend": FLAG,
    "marks": FLAG,
    "grey": FLAG,
}

PAGE = Page()
