"""Fits a legend: columns, height, what is left out."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import partial

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.legend import Legend
from matplotlib.lines import Line2D

from sweeps.plotting.style import user_style

#: Greatest share of the height that a legend takes, if it has one.
SHARE = 0.2
#: A legend always has the entries that cover at least this share of a map.
COMMON = 0.02
#: Greatest share of the width, since texts are up to a tenth wider at other numbers of pixels per
#: inch, and most columns.
WIDTH, _MOST_COLUMNS = 0.9, 8
#: Length of an entry that is broken into two lines where there is little room.
_LONG_ENTRY = 24
#: Sizes of the texts of a legend that has a greatest height.
_SMALL = {"fontsize": "small", "title_fontsize": "small"}


def fit_legend(
    make: Callable[..., Legend],
    handles: Sequence[Artist],
    title: str | None,
    rooms: Sequence[tuple[float, float]],
    shares: Mapping[Artist, float] | None = None,
    shrinks: bool = False,
) -> Legend:
    """Return the legend that `make` makes of as many entries as have room."""
    # The `rooms` are the usual and the greatest width and height [px]. Given the `shares` of a map,
    # entries that explain little are left out to fit the usual room. A legend that `shrinks` is
    # small if it is higher than usual, and then long entries have two lines, so that more columns
    # fit; another is always small. If it is too large for the greatest room, all entries but one
    # can be left out: those that explain least first, and of equals the last. So is the title,
    # unless it shrinks.
    usual, most = rooms
    widest = usual[0] / WIDTH
    if title is not None:
        legend = make(handles=[], title=title, **_SMALL)
        if legend.get_window_extent().width > widest:
            title = "\n".join(map(in_two_lines, title.split("\n")))
        legend.remove()
    forms: list[tuple[Sequence[Artist], Mapping[str, str]]] = [(handles, _SMALL)]
    if shrinks:
        forms = [(handles, {}), *forms, (_broken(handles), _SMALL)]

    def share(handle: Artist) -> float:
        return 1.0 if shares is None else shares[handle]

    heights = list[float]()
    for entries, sizes in forms:
        rare = [handle for handle in reversed(entries) if share(handle) < COMMON]
        rare.sort(key=share)
        legend = _fitted(partial(make, title=title, **sizes), entries, rare, usual, shares)
        size, room = legend.get_window_extent(), (widest, usual[1]) if shrinks else most
        if size.width <= room[0] and size.height <= room[1]:
            return legend
        legend.remove()
        heights.append(size.height if size.width <= widest else math.inf)
    entries, sizes = forms[heights.index(min(heights))]
    spare = sorted(reversed(entries), key=share)[:-1]
    make = partial(make, title=title if shrinks else None, **sizes)
    return _fitted(make, entries, spare, most, shares)


def _broken(handles: Sequence[Artist]) -> list[Artist]:
    """Return entries of which those that are long have two lines."""
    broken = [*map(copy, handles)]
    for entry in broken:
        text = str(entry.get_label())
        if len(text) > _LONG_ENTRY and "\n" not in text:
            entry.set_label(in_two_lines(text))
    return broken


def in_two_lines(text: str) -> str:
    """Break a text at the space nearest to its middle, if any is outside of formulas."""
    spaces = [at for at, c in enumerate(text) if c == " " and text[:at].count("$") % 2 == 0]
    at = min(spaces, key=lambda space: abs(space - len(text) / 2), default=len(text))
    return f"{text[:at]}\n{text[at + 1 :]}".strip()


def legend_within(
    panel: Axes, handles: Sequence[Artist], title: str | None, shares: Mapping[Artist, float] | None
) -> None:
    """Put a legend into a panel of any figure, with at most a fifth of the height of the panel."""
    box = panel.get_window_extent()
    settings = {name: value for name, value in user_style().items() if name.startswith("legend.")}
    with mpl.rc_context({**settings, "legend.frameon": mpl.rcParams["legend.frameon"]}):
        # Matplotlib would look for the best place of every legend that is tried.
        make = partial(panel.legend, loc="upper right")
        room = WIDTH * box.width, SHARE * box.height
        legend = fit_legend(make, handles, title, [room, room], shares)
        legend.set_loc(mpl.rcParams["legend.loc"])


def _sort_key(handle: Artist) -> int:
    """Return 0 for a class m/q, else the length of a label."""
    text = str(handle.get_label())
    return 0 if text[0].isdigit() and "/" in text else len(text)


def _fitted(
    make: Callable[..., Legend],
    handles: Sequence[Artist],
    spare: Sequence[Artist],
    room: tuple[float, float],
    shares: Mapping[Artist, float] | None = None,
) -> Legend:
    """Return a legend of as many columns and entries as fit; the first `spare` ones go first."""
    # A further entry counts what is left out. With their `shares` of a map, the classes come first,
    # and then entries of one length are beside each other, so that more columns fit.
    width, height = room
    if shares is not None:
        handles = sorted(handles, key=lambda handle: -shares[handle])
        handles.sort(key=_sort_key)

    def without(count: int) -> Legend:
        entries = [handle for handle in handles if handle not in spare[:count]]
        if count:
            entries.append(Line2D([], [], linestyle="", label=f"{count} more"))
        for columns in range(min(_MOST_COLUMNS, len(entries)), 1, -1):
            legend = make(handles=entries, ncols=columns)
            if legend.get_window_extent().width <= width:
                return legend
            legend.remove()
        return make(handles=entries, ncols=1)

    def fits(count: int) -> bool:
        legend = without(count)
        fit = legend.get_window_extent().height <= height
        legend.remove()
        return bool(fit)

    legend = without(0)
    if spare and legend.get_window_extent().height > height:
        legend.remove()
        legend = without(bisect_left(range(len(spare)), True, lo=1, key=fits))
    legend.get_title().set_multialignment("center")
    return legend
