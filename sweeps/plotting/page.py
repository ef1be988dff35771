"""`Page`: size, title, limits, grey of a picture; `styled` decorates each function that draws one.

Then its arguments are checked, and it has the names of a rig, a common style and a common part of
its docstring.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sweeps.config.rig import Nomenclature
from sweeps.errors import Refused
from sweeps.opened.doors import in_si, orbits_on_axes, takes_sweep
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting.labels import LARGEST, check_units, in_own_unit, set_lim
from sweeps.plotting.pixels import points_in, widened
from sweeps.plotting.style import in_style
from sweeps.text import told_apart
from vibroimpact.inputs import FLAG, TEXT, Allowed, integer, is_number, number
from vibroimpact.step.scheme import MOST_RECORDED

#: The least and the greatest value of an axis.
Limits = tuple[float, float]
#: The figure that a picture function returns.
FigureT = TypeVar("FigureT", bound=Figure)


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
        Pixels per inch, at least 10; by default 130 in an animation, else ``savefig.dpi`` or 300.
    title : str, optional
        Title instead of the name, the parameters and the record of the sweep; may be empty.
    xlim, ylim : (float, float), optional
        Limits of the first panel, by default those of the data; the ordinate of a diagram or of a
        motion fits the data within `xlim`. A diagram with points that failed begins lower than
        `ylim` by 4 %, a table at `ylim`.
    xunit, yunit : str, optional
        The unit of the limits, by default that of the Dataset; empty: that of the ticks.
    xlabel, ylabel : str, optional
        Labels of the axes of the first panel instead of meaning, symbol and unit; may be empty. A
        unit in brackets, as ``gap [mm]``, is that of the ticks.
    legend, marks : bool
        Whether there is a legend; whether a map or a diagram marks motions on their way to
        m/q, bifurcations and other special points of orbits and curves, and jumps. Points that
        failed are always marked.
    grey : bool
        Whether the picture is drawn without colour: in greys, hatches, markers and dashes, a map
        with boundaries.

    Examples
    --------
    >>> ds = sweeps.open_sweep("flip.h5")  # of the example of `run_sweep`
    >>> page = sweeps.plotting.Page(width=3.4, title="", xlim=(2.62, 2.68))
    >>> sweeps.plotting.bifurcation(ds, page=page).savefig("column.pdf")
    """

    width: float | None = None
    height: float | None = None
    dpi: int | None = None
    title: str | None = None
    xlim: Limits | None = None
    ylim: Limits | None = None
    xunit: str | None = None
    yunit: str | None = None
    xlabel: str | None = None
    ylabel: str | None = None
    legend: bool = True
    marks: bool = True
    grey: bool = False

    def __post_init__(self) -> None:
        """Refuse a size, title or limit that is not allowed."""
        for name, value in vars(self).items():
            if value is not None:
                _OF_PAGE[name].checked(name, value, Refused)

    def set_limits(self, panel: Axes, fit: bool = False) -> Page:
        """Set the limits that are given; return the page with those of a panel, in its units."""
        limits, sides = dict[str, Any](), {"x": panel.xaxis, "y": panel.yaxis}
        for side, axis in sides.items():
            lim, unit, text = (getattr(self, f"{side}{word}") for word in ("lim", "unit", "label"))
            check_units(axis, f"{side}label", text or "", True)
            if lim is not None:
                name = f"{side}lim"
                limits[name] = lim if unit is None else in_own_unit(axis, name, lim, unit, text)
        page = replace(self, **limits, xunit=None, yunit=None)
        if fit:
            page.fit_ordinate(panel)
        for name, lim in limits.items():
            axis = sides[name[0]]
            least, most = axis.get_data_interval()
            if lim[1] < least or most < lim[0]:
                text = "there is nothing to draw with {} = {}:{}; the data range from {} to {}"
                raise Refused(text.format(name, *told_apart(*lim, least, most)))
            if axis.get_scale() == "log" and lim[0] <= 0.0:
                text = f"{name} = {lim[0]:g}:{lim[1]:g} is not allowed on a logarithmic axis"
                raise Refused(f"{text}; expected: limits greater than 0")
            set_lim(axis, *lim)
        return page

    def fit_ordinate(self, panel: Axes) -> None:
        """Fit the ordinate to lines and dots within the abscissa of the page."""
        if self.xlim is None:
            return
        (low, high), (x, y) = self.xlim, points_in(panel).T
        values = y[(low <= x) & (x <= high) & np.isfinite(y)]
        if values.size:
            bottom, top = widened(float(values.min()), float(values.max()))
            margin = mpl.rcParams["axes.ymargin"] * (top - bottom) if bottom < top else 0.05
            set_lim(panel.yaxis, bottom - margin, top + margin)


#: Least and greatest width and height of a picture [inch].
LEAST_INCHES, MOST_INCHES = 1.0, 40.0
_LENGTH = number(
    lambda inches: LEAST_INCHES <= inches <= MOST_INCHES,
    f"inches, from {LEAST_INCHES:g} to {MOST_INCHES:g}",
)
_LIMITS = Allowed(
    lambda value: (
        isinstance(value, Sequence)
        and len(value) == 2
        and all(map(is_number, value))
        and -LARGEST <= value[0] < value[1] <= LARGEST
    ),
    f"two numbers up to {LARGEST:g} of which the first is smaller, as (2.4, 3.0)",
)
_OF_PAGE = {
    "dpi": integer(10),
    **dict.fromkeys(("width", "height"), _LENGTH),
    **dict.fromkeys(("xlim", "ylim"), _LIMITS),
    **dict.fromkeys(("title", "xunit", "yunit", "xlabel", "ylabel"), TEXT),
    **dict.fromkeys(("legend", "marks", "grey"), FLAG),
}

PAGE = Page()
#: Frames per second of an animation, if no other number is given.
FPS = 25

#: Docstring of the overlay of some pictures.
_OVERLAY = """
overlay : str, Path, DataFrame or mapping of str to sequence, optional
    Points of a table to draw over the panels: a CSV file or columns, with the names of what the
    axes show, in the units of the picture unless a name has its own, as ``clearance [mm]``. On a
    map, a column with the name of a quantity that has a scale gives the points its colours. A
    column ``label`` names the points in the legend."""
#: Docstring of the common parameters; `styled` appends it to the docstring of each picture.
_COMMON_PARAMETERS = """\
at : mapping of str to float, optional
    Values of the swept axes that are not drawn. The nearest grid value is used; the default is the
    first. If an axis was followed both ways, ``direction`` selects one direction; by default, a
    picture that does not tell both apart shows the first.
page : Page, optional
    Size, title, limits and look.
ax : Axes, optional
    The panel to draw into, by default the panel of a new figure.

Returns
-------
Figure
    The figure of `ax`, or the new one.

Raises
------
Refused
    If the file lacks the requested data, or there is nothing to draw."""


def _is_name_or_array(value: object) -> bool:
    return isinstance(value, str | xr.DataArray)


def _are_names_or_arrays(value: object) -> bool:
    return isinstance(value, Sequence) and all(map(_is_name_or_array, value))


def _are_orbits(value: object) -> bool:
    return isinstance(value, xr.Dataset) and "kind" in value and "point" in value.dims


def _is_beside(value: object) -> bool:
    return isinstance(value, Mapping) and all(
        isinstance(name, str) and isinstance(several, Sequence) and all(map(is_number, several))
        for name, several in value.items()
    )


def _are_panels(value: object, panels: Collection[int]) -> bool:
    several = [*value] if isinstance(value, Sequence | np.ndarray) else [value]
    return len(several) in panels and all(map(_is_panel, several))


def _is_panel(value: object) -> bool:
    if not isinstance(value, Axes) or value.figure is None:  # None if it was removed
        return False
    return value.name == "rectilinear" and value.bbox.width * value.bbox.height > 0.0


#: What the arguments of pictures may be, besides those of all functions of a sweep.
PICTURE_ARGUMENTS: Mapping[str, Allowed] = {
    "page": Allowed(lambda value: isinstance(value, Page), "a Page, as Page(width=3.4)"),
    "coordinate": TEXT,
    "exact": Allowed(_are_orbits, "the result of sweeps.branches, or for a map of sweeps.curves"),
    "below": Allowed(_are_names_or_arrays, "names or DataArrays, as ['lyapunov']"),
    "color": Allowed(_is_name_or_array, "a name or a DataArray"),
    "quantity": Allowed(_is_name_or_array, "a name or a DataArray"),
    "axes": Allowed(_are_names_or_arrays, "names of axes, as ['omega', 'R']"),
    "beside": Allowed(_is_beside, "values of one axis, as {'omega': [2.5, 2.7]}"),
    "panels": Allowed(_are_names_or_arrays, "names, as ['basins']"),
    "periods": integer(1, MOST_RECORDED),
    "fps": integer(1, 50),  # a GIF counts hundredths of a second, and browsers no single ones
    "overlay": Allowed(
        lambda value: isinstance(value, str | Path) or hasattr(value, "items"),
        "a CSV file or a DataFrame",
    ),
}


def styled(
    draw: Callable[..., FigureT], panels: Collection[int] = (1,), marks: bool = False
) -> Callable[..., FigureT]:
    """Decorate a picture function: check its arguments, draw in the common style, document it."""
    # The first parameter of the function must be the dataset; `ax` has one of these numbers of
    # `panels`. Only with `marks` has the picture marks that can be left out.
    panel = "a panel" if max(panels) == 1 else f"{' or '.join(map(str, panels))} panels"
    of_panels = Allowed(
        lambda value: _are_panels(value, panels), f"{panel} of a figure, with two straight axes"
    )

    @takes_sweep({**PICTURE_ARGUMENTS, "ax": of_panels})
    @functools.wraps(draw)
    def _in_style(sweep: OpenedSweep, **options: Any) -> FigureT:
        """Draw with the names of a rig, and in the common style unless `ax` has its own."""
        page = options.get("page", PAGE)
        if not (page.marks or marks):
            raise Refused("only maps and diagrams can leave out marks")
        with in_style(common=options.get("ax") is None, grey=page.grey):
            sweep, options = _arguments_in_si(sweep, options)
            return draw(sweep, **options)

    _in_style.__doc__ = _documented(draw)
    return _in_style


def _arguments_in_si(
    sweep: OpenedSweep, options: Mapping[str, Any]
) -> tuple[OpenedSweep, dict[str, Any]]:
    """Return the arguments of a picture in SI units; those of a Python caller are the model's."""
    si = in_si(sweep)
    if si is sweep:
        return sweep, dict(options)
    nomenclature = si.nomenclature

    def number(quantity: Any) -> Any:
        """Return a name of the rig, or a DataArray over the axes of the rig."""
        if isinstance(quantity, xr.DataArray):
            name = str(quantity.name)
            if name not in sweep or not quantity.identical(sweep[name]):
                return _on_axes(si, quantity, nomenclature)
            quantity = name
        return nomenclature.name(quantity) if isinstance(quantity, str) else quantity

    converted = dict(options)
    for option, value in options.items():
        if option == "overlay":  # its columns have the names of the picture
            continue
        if option == "at" and value:
            converted[option] = nomenclature.selection(value)
        elif option == "beside" and value:
            several = {name: np.array(values) for name, values in value.items()}
            converted[option] = nomenclature.selection(several)
        elif option == "exact" and value is not None:
            converted[option] = orbits_on_axes(si, value)
        elif isinstance(value, str | xr.DataArray):
            converted[option] = number(value)
        elif option in ("below", "axes", "panels"):
            converted[option] = [number(each) for each in value]
    return si, converted


def _on_axes(sweep: OpenedSweep, values: xr.DataArray, nomenclature: Nomenclature) -> xr.DataArray:
    """Return numbers over parameters of the model over the axes of a dataset in SI units."""
    for name in map(str, values.dims):
        axis = nomenclature.name(name)
        if axis != name and axis in sweep.data.dims and np.array_equal(values[name], sweep[name]):
            coord = sweep[axis]
            values = values.assign_coords({axis: (name, coord.values, coord.attrs)})
            values = values.swap_dims({name: axis})
    return values


def _documented(draw: Callable[..., FigureT]) -> str:
    """Return the docstring of a picture with the common parameters, results and errors."""
    docstring, options = inspect.getdoc(draw) or "", inspect.signature(draw).parameters
    body, separator, example = docstring.partition("\n\nExamples\n--------")
    text, _, parameters = body.partition("\n\nParameters\n----------")
    head = "Parameters\n----------\nsweep : Dataset or str or Path"
    head += "\n    From `sweeps.open_sweep`, or the path of its file."
    parameters += _OVERLAY if "overlay" in options else ""
    return f"{text}\n\n{head}{parameters}\n{_COMMON_PARAMETERS}{separator}{example}"
