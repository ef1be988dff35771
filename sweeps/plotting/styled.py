"""What the public functions of pictures have in common: style, axes in SI units, docstring."""

from __future__ import annotations

import functools
import inspect
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sweeps.arguments import is_path
from sweeps.errors import Refused
from sweeps.opened.doors import takes_sweep
from sweeps.opened.in_si import arguments_in_si
from sweeps.plotting.page import PAGE, Page
from sweeps.plotting.style import grey_style, user_style
from vibroimpact.inputs import TEXT, Allowed, integer
from vibroimpact.step.scheme import MOST_RECORDED

#: Docstring of the common parameters; `styled` appends it to the docstring of each picture.
_COMMON = """\
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


def _is_wanted(value: object) -> bool:
    return isinstance(value, str | xr.DataArray)


def _are_wanted(value: object) -> bool:
    return _is_wanted(value) or (isinstance(value, Sequence) and all(map(_is_wanted, value)))


def _are_orbits(value: object) -> bool:
    return isinstance(value, xr.Dataset) and "kind" in value and "point" in value.dims


def _are_panels(value: object, panels: Collection[int]) -> bool:
    if isinstance(value, Axes):
        return 1 in panels
    several = [*value] if isinstance(value, Sequence | np.ndarray) else []
    return len(several) in panels and all(isinstance(one, Axes) for one in several)


#: What the arguments of pictures may be, besides those of all functions of a sweep.
ARGUMENTS: Mapping[str, Allowed] = {
    "page": Allowed(lambda value: isinstance(value, Page), "a Page, as Page(width=3.4)"),
    "coordinate": TEXT,
    "exact": Allowed(_are_orbits, "the result of sweeps.branches, or for a map of sweeps.curves"),
    "below": Allowed(_are_wanted, "names or DataArrays, as ['lyapunov']"),
    "color": Allowed(_is_wanted, "a name or a DataArray"),
    "quantity": Allowed(_is_wanted, "a name or a DataArray"),
    "axes": Allowed(_are_wanted, "names of axes, as ['omega', 'R']"),
    "periods": integer(1, MOST_RECORDED),
    "overlay": Allowed(
        lambda value: is_path(value) or hasattr(value, "items"), "a CSV file or a DataFrame"
    ),
}


def styled(
    draw: Callable[..., Figure], panels: Collection[int] = (1,), looks: Collection[str] = ()
) -> Callable[..., Figure]:
    """Decorate a picture function: check its arguments, draw in the common style, document it.

    The first parameter of the function must be the dataset; `ax` has one of these numbers of
    `panels`. Of the looks of a page, the picture has only these `looks`.
    """
    panel = " or ".join("a panel" if one == 1 else f"{one} panels" for one in panels)
    of_panels = Allowed(lambda value: _are_panels(value, panels), f"{panel} of matplotlib")

    @takes_sweep({**ARGUMENTS, "ax": of_panels})
    @functools.wraps(draw)
    def _in_style(dataset: xr.Dataset, **options: Any) -> Figure:
        """Draw with the names of a rig, and in the common style unless `ax` has its own."""
        page = options.get("page", PAGE)
        page.refuse_looks(looks)
        if page.grey and options.get("color") is not None:
            raise Refused("color gives points colours, and in grey there is none; leave out one")
        with _style(options.get("ax") is None, page.grey):
            dataset, options = arguments_in_si(dataset, options)
            return draw(dataset, **options)

    _in_style.__doc__ = _documented(inspect.getdoc(draw) or "")
    return _in_style


@contextmanager
def _style(of_user: bool, grey: bool) -> Iterator[None]:
    """Draw in the common style and that of the user, if asked for, without warnings of glyphs."""
    with mpl.rc_context(user_style() if of_user else {}), warnings.catch_warnings():
        mpl.rcParams.update(grey_style() if grey else {})
        # The name of a sweep may have characters that the font lacks, drawn as boxes.
        warnings.filterwarnings("ignore", "Glyph", UserWarning)
        yield


def _documented(own: str) -> str:
    """Return a docstring with the common parameters, results and errors."""
    written, mark, example = own.partition("\n\nExamples\n--------")
    text, _, parameters = written.partition("\n\nParameters\n----------")
    head = "Parameters\n----------\ndataset : Dataset or str or Path"
    head += "\n    From `sweeps.open_sweep`, or the path of its file."
    return f"{text}\n\n{head}{parameters}\n{_COMMON}{mark}{example}"
