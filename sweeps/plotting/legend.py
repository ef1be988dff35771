"""The rule for legends: columns, height, what is left out."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
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

#: Greatest share of the height that a legend takes, if it has one.
SHARE = 0.2
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
    height: float,
    rarest: Sequence[str] | None = None,
    final: bool = False,
) -> Legend:
    """Put a legend below the panels of a figure, and return it.

    As many of the `rarest` entries are left out as its greatest height [px] asks for, and if the
    height is `final`, then the last ones, too.
    """
    make = partial(figure.legend, title=title, loc="outside lower center")
    if rarest is not None:
        make = partial(make, **_SMALL)
    return _fitted(make, handles, rarest, final, (_WIDTH * figure.bbox.width, height))


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
        legend = _fitted(make, entries, None, False, (_WIDTH * figure.bbox.width, height))
        if legend.get_window_extent().height <= height:
            break
        legends.append((legend.get_window_extent().height, len(legends)))
        legend.remove()
    else:
        make, entries = tried[min(legends)[1]]
        legend = _fitted(make, entries, None, True, (_WIDTH * figure.bbox.width, most))
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
    panel: Axes, handles: Sequence[Artist], title: str | None, rarest: Sequence[str] | None
) -> None:
    """Put a legend into a panel of any figure, with at most a fifth of the height of the panel.

    The rarest entries are left out first, then the title, then the last entries, but never all.
    """
    box = panel.get_window_extent()
    room = _WIDTH * box.width, SHARE * box.height
    look = {name: value for name, value in user_style().items() if name.startswith("legend.")}
    with mpl.rc_context({**look, "legend.frameon": mpl.rcParams["legend.frameon"]}):
        # Matplotlib would look for the best place of every legend that is tried.
        make = partial(panel.legend, loc="upper right", **_SMALL)
        legend = _fitted(partial(make, title=title), handles, rarest, False, room)
        size = legend.get_window_extent()
        if size.width > room[0] or size.height > room[1]:
            legend = _fitted(make, handles, rarest, True, room)
        legend.set_loc(mpl.rcParams["legend.loc"])


def _place(text: str) -> int:
    """Return 0 for a class, else the length of a label."""
    return 0 if text[0].isdigit() and "/" in text else len(text)


def _fitted(
    make: Callable[..., Legend],
    handles: Sequence[Artist],
    rarest: Sequence[str] | None,
    final: bool,
    room: tuple[float, float],
) -> Legend:
    """Return a legend with as many columns as its width allows, and as many entries as its height.

    The `rarest` classes are left out first and, if the height is `final`, then the last entries but
    one. A further entry says how many are left out. If there can be rare classes, the classes come
    first, and then entries of one length are beside each other, so that more columns fit.
    """
    width, height = room
    classes = rarest or ()
    labels = [str(handle.get_label()) for handle in reversed(handles)] if final else []
    spare = [*classes, *(text for text in labels if text not in classes)]
    spare = spare[:-1] if final else spare
    if rarest is not None:
        handles = sorted(handles, key=lambda handle: _place(str(handle.get_label())))

    def without(count: int) -> Legend:
        shown = [handle for handle in handles if handle.get_label() not in spare[:count]]
        if count:
            text = f"rarer classes: {count}" if count <= len(classes) else f"+{count}"
            shown.append(Line2D([], [], linestyle="", label=text))
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
