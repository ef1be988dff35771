"""The rule for legends: columns, height, what is left out."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Container, Mapping, Sequence
from copy import copy
from functools import partial
from statistics import median

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D

from sweeps.plotting.style import user_style
from vibroimpact.points.regimes import RESTING

#: Greatest share of the height that a legend takes, if it has one.
SHARE = 0.2
#: A legend always has the entries that cover at least this share of a map.
COMMON = 0.02
#: Greatest share of the width, since texts are up to a tenth wider at other numbers of pixels per
#: inch, and most columns.
_WIDTH, _MOST_COLUMNS = 0.9, 8
#: Length of an entry that is broken into two lines where there is little room.
_LONG_ENTRY = 24
#: Sizes of the texts of a legend that has a greatest height.
_SMALL = {"fontsize": "small", "title_fontsize": "small"}


def legend_below(
    figure: Figure,
    handles: Sequence[Artist],
    title: str | None,
    covered: Mapping[Artist, float],
    named: Callable[[], Container[str]],
    heights: Sequence[float],
) -> Legend:
    """Put a legend of a map below the panels of a figure, and return it.

    `heights` are those up to which nothing, and only what covers little, is left out [px].
    """
    make = partial(figure.legend, loc="outside lower center", **_SMALL)
    rooms = [(_WIDTH * figure.bbox.width, height) for height in heights]
    return _ranked(make, handles, title, covered, named, rooms)


def legend_of_all(
    figure: Figure, handles: Sequence[Artist], title: str | None, height: float, most: float
) -> Legend:
    """Put a legend with all entries below the panels of a figure, and return it.

    If it is higher than `height` [px], its texts are small, then short entries come first, so that
    more columns fit, and then long entries are broken into lines. Only if it is still higher than
    `most` are entries at its end left out.
    """
    plain = partial(figure.legend, title=title, loc="outside lower center")
    small = partial(plain, **_SMALL)
    lengths = [len(str(handle.get_label())) for handle in handles]
    short = sorted(handles, key=lambda handle: len(str(handle.get_label())) > median(lengths))
    tried = ((plain, handles), (small, handles), (small, short), (small, _broken(short)))
    legends = list[tuple[float, int]]()
    for make, entries in tried:
        legend = _fitted(make, entries, (), (_WIDTH * figure.bbox.width, height))
        if legend.get_window_extent().height <= height:
            break
        legends.append((legend.get_window_extent().height, len(legends)))
        legend.remove()
    else:
        make, entries = tried[min(legends)[1]]
        legend = _fitted(make, entries, entries[:0:-1], (_WIDTH * figure.bbox.width, most))
    return legend


def _broken(handles: Sequence[Artist]) -> list[Artist]:
    """Return entries of which those that are long have two lines."""
    broken = []
    for handle in handles:
        text = str(handle.get_label())
        # Spaces outside of formulas, and the one nearest to the middle.
        spaces = [at for at, one in enumerate(text) if one == " " and text[:at].count("$") % 2 == 0]
        entry = copy(handle)
        if len(text) > _LONG_ENTRY and spaces and "\n" not in text:
            at = min(spaces, key=lambda place: abs(place - len(text) / 2))
            entry.set_label(f"{text[:at]}\n{text[at + 1 :]}")
        broken.append(entry)
    return broken


def legend_within(
    panel: Axes,
    handles: Sequence[Artist],
    title: str | None,
    covered: Mapping[Artist, float] | None,
) -> None:
    """Put a legend into a panel of any figure, with at most a fifth of the height of the panel."""
    box = panel.get_window_extent()
    room = _WIDTH * box.width, SHARE * box.height
    look = {name: value for name, value in user_style().items() if name.startswith("legend.")}
    with mpl.rc_context({**look, "legend.frameon": mpl.rcParams["legend.frameon"]}):
        # Matplotlib would look for the best place of every legend that is tried.
        make = partial(panel.legend, loc="upper right", **_SMALL)
        legend = _ranked(make, handles, title, covered, tuple, [room, room])
        legend.set_loc(mpl.rcParams["legend.loc"])


def _ranked(
    make: Callable[..., Legend],
    handles: Sequence[Artist],
    title: str | None,
    covered: Mapping[Artist, float] | None,
    named: Callable[[], Container[str]],
    rooms: Sequence[tuple[float, float]],
) -> Legend:
    """Return a legend that names first what covers most.

    As many of the entries that have `covered` little of a map are left out as necessary for the
    first of the `rooms`. If the legend is too large for the second one, the title is left out, and
    then other entries but one: those with a name in the map, as `named` returns, come first.
    Without a map, all entries are others, and the last ones are left out first.
    """
    covered_by = dict.fromkeys(handles, 1.0) if covered is None else covered
    ordered = sorted(reversed(handles), key=covered_by.__getitem__)
    rare = [handle for handle in ordered if covered_by[handle] < COMMON]
    legend = _fitted(partial(make, title=title), handles, rare, rooms[0], covered)
    size = legend.get_window_extent()
    if size.width > rooms[1][0] or size.height > rooms[1][1]:
        legend.remove()
        seen = named()
        known = [handle for handle in ordered if handle.get_label() in seen]
        others = [handle for handle in ordered if handle not in {*rare, *known}]
        spare = [*rare, *(handle for handle in known if handle not in rare), *others][:-1]
        legend = _fitted(make, handles, spare, rooms[1], covered, known)
    return legend


def _is_class(handle: Artist) -> bool:
    """Whether an entry is a class m/q, or motions with rest."""
    text = str(handle.get_label())
    return text.startswith(RESTING) or (text[0].isdigit() and "/" in text)


def _place(handle: Artist) -> int:
    """Return 0 for a class m/q, else the length of a label."""
    text = str(handle.get_label())
    return 0 if _is_class(handle) and not text.startswith(RESTING) else len(text)


def _fitted(
    make: Callable[..., Legend],
    handles: Sequence[Artist],
    spare: Sequence[Artist],
    room: tuple[float, float],
    covered: Mapping[Artist, float] | None = None,
    known: Sequence[Artist] = (),
) -> Legend:
    """Return a legend with as many columns as its width allows, and as many entries as its height.

    The first of the `spare` entries are left out first; a further entry counts those that are not
    `known`. If it is known what they have `covered` of a map, the classes come first, and then
    entries of one length are beside each other, so that more columns fit.
    """
    width, height = room
    if covered is not None:
        handles = sorted(handles, key=lambda handle: -covered[handle])
        handles.sort(key=_place)

    def without(count: int) -> Legend:
        shown = [handle for handle in handles if handle not in spare[:count]]
        if left_out := [handle for handle in spare[:count] if handle not in known]:
            text = "rarer classes: " if covered and all(map(_is_class, left_out)) else "+"
            shown.append(Line2D([], [], linestyle="", label=f"{text}{len(left_out)}"))
        for columns in range(min(_MOST_COLUMNS, len(shown)), 1, -1):
            legend = make(handles=shown, ncols=columns)
            if legend.get_window_extent().width <= width:
                return legend
            legend.remove()
        return make(handles=shown, ncols=1)

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
