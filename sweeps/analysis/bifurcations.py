"""The bifurcations along an axis of a sweep: where the class of the motion changes, and why.

The branch of the periodic orbit on each side of a change is followed to the other side
(`vibroimpact.orbits.branches`). If the branch ends or loses its stability between the sides, this
is the bifurcation. Otherwise the attractor persists, and the motion of the sweep has only moved
into the basin of another one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from itertools import pairwise, product, starmap
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from sweeps.analysis.doors import takes_sweep
from sweeps.analysis.exact_branches import branches, wide_branches
from sweeps.analysis.explanations import explain
from sweeps.analysis.grouping import STARTS
from sweeps.analysis.motions import motions_of
from sweeps.analysis.regimes import Change, cascades, changes, labels
from sweeps.analysis.rig import on_axis
from sweeps.analysis.selection import (
    Selection,
    check_diagnostic,
    chosen_axes,
    config_of,
    headed,
    select,
    swept_axes,
)
from sweeps.config.rig import model_name
from sweeps.store import DIRECTION
from sweeps.text import shortest, shown_count, shown_range, table

if TYPE_CHECKING:
    import pandas as pd

#: Most bifurcations of a map that are listed one by one, and most of those without an exact value;
#: more are summarized with a line for each kind.
MOST_ROWS, _MOST_INEXACT = 40, 12
#: Explanations of the kinds that are not standard terms.
_MEANINGS = {
    "basin": "the motion of one side is stable on the other, too, but the start reaches another",
    "unknown": "the motions could not be followed to where one of them ends",
}
#: What the table has of a change besides its `Change`; `down`: the line was followed downwards.
_OWN = ("kind", "value", "orbit", "down")


@takes_sweep({})
def bifurcations(
    dataset: xr.Dataset, axis: str | None = None, at: Selection | None = None
) -> pd.DataFrame:
    """Find where the class of the motion changes along an axis, on every line of the grid, and why.

    Parameters
    ----------
    dataset : Dataset
        From `sweeps.open_sweep`, with ``period``.
    axis : str, optional
        The swept parameter along which to look, by default the one with most values.
    at : mapping of str to float, optional
        Values of other swept axes; those that are left out are taken with all their values.

    Returns
    -------
    DataFrame
        A row for each change of class between two neighbouring values of the axis, in the order of
        the grid, and with increasing values of the axis on each line. The columns are:

        - the values of the other axes;
        - ``kind``: ``flip``, ``fold`` or ``graze`` if a branch of periodic orbits ends or loses its
          stability in this way; ``rest``, ``chaotic`` or ``unbounded`` if such a regime begins or
          ends; ``basin`` if the attractor before the change exists on both sides and is stable;
          ``unknown`` otherwise;
        - ``value``: the value of the axis at a flip, fold or graze, to rounding; NaN if not known;
        - ``low`` and ``high``: the nearest values of the axis with known classes;
        - ``before`` and ``after``: the classes there, for example ``1/1``, ``rest`` or ``chaotic``;
        - ``between``: the number of points between them whose class is unknown;
        - ``orbit``: the class of the orbit that bifurcates at ``value``.

        Where ``value`` is NaN, ``vibroimpact zoom`` with ``low`` and ``high`` narrows the interval.
        If points of unknown class lie between two classes, and no bifurcation leads from one to the
        other, there are two rows, in which the unknown class is ``?``.

        Its attributes are ``axis``, and ``unclassified``, the number of points of unknown class.

    Raises
    ------
    Refused
        If there is no such axis or value, or the classes were not recorded.

    Examples
    --------
    >>> import sweeps
    >>> omega = {"start": 2.6, "stop": 2.7, "num": 20}
    >>> scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": omega, "f": 1.0}}
    >>> ds = sweeps.open_sweep(sweeps.run_sweep(scene, "flip.h5", overwrite=True))
    >>> found = sweeps.bifurcations(ds)
    >>> found[["kind", "value", "before", "after"]].round(6).values.tolist()
    [['flip', 2.663945, '1/1', '2/2']]
    """
    along, found = find_bifurcations(dataset, axis, at)
    named = found.assign(before=found["before"].map(str), after=found["after"].map(str))
    named = named[
        [*_others(found), "kind", "value", "low", "high", "before", "after", "between", "orbit"]
    ]
    named.attrs = {"axis": along, "unclassified": found.attrs["unclassified"]}
    return named


def find_bifurcations(
    dataset: xr.Dataset, axis: str | None = None, at: Selection | None = None
) -> tuple[str, pd.DataFrame]:
    """Return the axis, and the table of `bifurcations` with a `Label` for each class."""
    import pandas as pd

    (along,) = chosen_axes(dataset, [axis] if axis else [], at, 1, "list of bifurcations")
    check_diagnostic(dataset, "period")
    free = [str(name) for name in dataset["status"].dims if name not in (at or {})]
    data = select(dataset, at, free=[along, *free])
    other_axes = [str(name) for name in data["status"].dims if name != along]
    data = data.sortby(along)
    rows, unclassified, phase = [], 0, config_of(dataset).record.phase
    for index in product(*(range(data.sizes[name]) for name in other_axes)):
        line = data.isel(dict(zip(other_axes, index, strict=True))).load()
        motions, down = motions_of(line), _is_followed_down(line, along)
        classes = labels(line)
        unclassified += classes.count(None)
        values = line[along].values
        for change in changes(values, classes):
            here = {name: line[name].item() for name in other_axes}
            for part, *own in explain(motions, phase, along, values, change, down):
                named = dict(zip(_OWN, (*own, down), strict=True))
                rows.append(here | vars(part) | named)
    columns = [*other_axes, *(field.name for field in fields(Change)), *_OWN]
    found = pd.DataFrame(rows, columns=columns)
    found["value"] = on_axis(dataset, along, found["value"].to_numpy(float))
    heads = {name: headed(name, dataset[name]) for name in (*other_axes, along)}
    found.attrs |= {"unclassified": unclassified, "heads": heads}
    return along, found


def _is_followed_down(line: xr.Dataset, axis: str) -> bool:
    """Whether the line was followed downwards: each point started from the next greater value."""
    config = config_of(line)
    if config.follow is None or config.follow.axis != model_name(axis):
        return False
    way = line[DIRECTION].item() if DIRECTION in line.coords else config.follow.direction
    return bool(way == "down")


def _heads(axis: str, found: pd.DataFrame) -> list[str]:
    """Return the heads of the columns of the other axes, and of the axis."""
    return [found.attrs["heads"][name] for name in (*_others(found), axis)]


def _others(found: pd.DataFrame) -> list[str]:
    """Return the names of the other axes, which are the first columns."""
    return list(found.columns[: list(found).index("low")])


def describe(axis: str, found: pd.DataFrame) -> str:
    """Write bifurcations as tables, those with an exact value first; for a map, a row per kind."""
    if found.empty:
        return f"the class of the motion does not change along {axis}"
    if is_summary(found):
        return "\n".join([_summary(axis, found), *_meanings(found)])
    inexact = found["value"].isna()
    listed, others = found[~inexact], found[inexact]
    parts = []
    if len(others) <= _MOST_INEXACT:
        listed = found.loc[[*listed.index, *others.index]]
    if len(listed):
        head = [*_heads(axis, found), "kind", "orbit", "classes", "between", ""]
        parts.append(table([head, *map(_row, listed.to_dict("records"))]))
    if len(listed) < len(found):
        parts.append(f"{len(others)} changes without an exact value\n{_summary(axis, others)}")
    lines = [*_cascades(axis, found), *_meanings(others)]
    return "\n\n".join([*parts, *(["\n".join(lines)] if lines else [])])


def describe_unclassified(dataset: xr.Dataset, found: pd.DataFrame) -> str:
    """Write how many points have no known class, so that the list says nothing about them."""
    if not found.attrs["unclassified"]:
        return ""
    number = shown_count(found.attrs["unclassified"], "point")
    text = f"unknown or without a result: {number}"
    return text if "lyapunov" in dataset else f"{text}; Lyapunov exponents tell which are chaotic"


def narrowing(file: Path, axis: str, found: pd.DataFrame) -> str:
    """Write the command that narrows the first change listed without an exact value, if any."""
    inexact = found[found["value"].isna()]
    if inexact.empty or is_summary(found):
        return ""
    low, high = (shortest(float(inexact[name].iat[0])) for name in ("low", "high"))
    which = f"the {'' if len(inexact) == 1 else 'first '}change without an exact value"
    command = f"vibroimpact zoom {quote(str(file))} {axis}={low}:{high}"
    return f"to narrow {which}: {command}"


def _meanings(found: pd.DataFrame) -> list[str]:
    kinds = set(found["kind"])
    return [f"{kind}: {text}" for kind, text in _MEANINGS.items() if kind in kinds]


def is_summary(found: pd.DataFrame) -> bool:
    """Whether a map has too many bifurcations to list them one by one."""
    return len(found) > MOST_ROWS and bool(_others(found))


def _row(item: dict[str, Any]) -> list[str]:
    at = list(item.values())[: list(item).index("low")]
    between = item["between"]
    return [
        *map(_label, at),
        "" if np.isnan(item["value"]) else f"{item['value']:.12g}",
        item["kind"],
        item["orbit"],
        _pair(item),
        f"{item['low']:.12g} .. {item['high']:.12g}",
        f"{shown_count(between, 'point')} unknown" if between else "",
    ]


def _pair(item: Mapping[str, Any]) -> str:
    """Write the classes in the order of the axis; the arrow points where the line was followed."""
    return f"{item['before']} {'<-' if item['down'] else '->'} {item['after']}"


def _label(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.6g}"


def _summary(axis: str, found: pd.DataFrame) -> str:
    """Write a row for each kind and pair of classes, the most frequent first."""
    others = _others(found)
    pairs = [_pair(item) for item in found.to_dict("records")]
    groups = list(found.assign(pair=pairs).groupby(["kind", "pair"], sort=False))
    rows = [
        [
            *group,
            f"{len(items):,}",
            shown_range([*items["low"], *items["high"]]),
            *(shown_range(items[name]) for name in others),
        ]
        for group, items in sorted(groups, key=lambda one: -len(one[1]))
    ]
    *heads, of_axis = _heads(axis, found)
    lines = [table([["kind", "classes", "times", of_axis, *heads], *rows[:MOST_ROWS]])]
    if len(rows) > MOST_ROWS:
        lines.append(f"and {len(rows) - MOST_ROWS:,} rarer pairs of classes")
    if others:
        lines.append(f"{len(found):,} changes along {axis}")
    return "\n".join(lines)


def _cascades(axis: str, found: pd.DataFrame) -> Iterator[str]:
    """Yield a line for each cascade of flips: their values and the ratios of their distances."""
    others, names = _others(found), [field.name for field in fields(Change)]
    values = found["value"].fillna(0.5 * (found["low"] + found["high"]))
    for at, line in found.groupby(others, sort=False) if others else [((), found)]:
        value_of = dict(zip(starmap(Change, line[names].values), values[line.index], strict=True))
        for run in cascades(list(value_of)):
            places = np.array([value_of[change] for change in run])
            flips = ", ".join(f"{value:.9g}" for value in places)
            ratios = ", ".join(f"{a / b:.4g}" for a, b in pairwise(np.diff(places)))
            where = [f"{name} = {_label(value)}" for name, value in zip(others, at, strict=True)]
            text = f"cascade: {axis} = {flips}; ratios of the distances {ratios}"
            yield ", ".join([*where, text])


def special_points(found: xr.Dataset) -> pd.DataFrame:
    """Return the flips, folds and grazes of `branches`, each once, in the order of their values.

    At a graze, q includes the grazing impact.
    """
    import pandas as pd

    (axis,) = found.coords
    columns = {name: found[name].values for name in ("kind", "m", "q", "branch")}
    frame = pd.DataFrame(columns | {"value": found[axis].values})
    frame = frame[frame["kind"].isin(["flip", "fold", "graze"])].sort_values("value", kind="stable")
    step = frame.groupby(["kind", "m", "q"])["value"].diff()
    return frame[~(step <= 1e-10 * frame["value"].abs().clip(lower=1.0))]


def describe_branches(
    dataset: xr.Dataset, axis: str, at: Selection | None = None, **chosen: Any
) -> str:
    """List the bifurcations on all branches of the motions along one line of a sweep.

    A row has the value to twelve digits, the kind, and m/q. If there are many, those on branches
    that are stable over less than 1 % of the axis are only counted. The text is empty if the sweep
    has several lines, or if the axis is a start or has a single value.
    """
    uncut = [name for name in swept_axes(dataset) if name != axis and name not in (at or {})]
    if uncut or axis in STARTS or dataset.sizes[axis] == 1:
        return ""
    found = branches(dataset, axis, at, **chosen)
    frame = special_points(found)
    wide = wide_branches(found)[frame["branch"].to_numpy()]
    shown = frame if len(frame) <= MOST_ROWS else frame[wide]
    rows = [
        [f"{point.value:.12g}", point.kind, f"{point.m}/{point.q}"] for point in shown.itertuples()
    ]
    head = [headed(axis, dataset[axis]), "kind", "class"]
    lines = ["", found.attrs["summary"], "", table([head, *rows])]
    if left := len(frame) - len(shown):
        lines.append(f"{left} more on branches that are stable over less than 1 % of the axis")
    return "\n".join(lines if rows else lines[:2])


def table_of(axis: str, found: pd.DataFrame) -> pd.DataFrame:
    """Return the bifurcations with the columns of the CSV file."""
    names = {
        "low": f"{axis}_low", "high": f"{axis}_high", "before": "before", "after": "after",
        "kind": "kind", "value": axis, "between": "unknown_between", "orbit": "orbit",
    }  # fmt: skip
    return found[[*_others(found), *names]].rename(columns=names)
