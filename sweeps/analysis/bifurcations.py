"""The bifurcations along an axis of a sweep: where the class of the motion changes, and why.

From the periodic orbit on either side of a change its branch is followed to the other side
(`vibroimpact.orbits.branches`). If the branch ends between them, or loses its stability, that is
the bifurcation. If it does not, the attractor goes on, and the motion of the sweep has only come
into the basin of another.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import fields
from itertools import pairwise, product, starmap
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from sweeps.analysis.exact_branches import PeriodicPoints, branches, wide_branches
from sweeps.analysis.grouping import STARTS
from sweeps.analysis.regimes import Change, cascades, changes, labels
from sweeps.analysis.rig import in_si, rig_of
from sweeps.analysis.selection import (
    Selection,
    check_diagnostic,
    chosen_axes,
    config_of,
    select,
    swept_axes,
)
from sweeps.config.rig import si_name, si_values
from sweeps.store import DIRECTION
from sweeps.text import shown_count, shown_range, table
from vibroimpact.orbits.branches import branch

if TYPE_CHECKING:
    import pandas as pd

#: Up to so many bifurcations of a map are listed one by one; of more, each kind in a line. Of those
#: whose exact value is not known only so few.
MOST_ROWS, _MOST_INEXACT = 40, 12
#: What the kinds mean that are no standard terms.
_MEANINGS = {
    "basin": "the motion of one side is stable on the other, too: the start leads to another there",
    "unknown": "the motions could not be followed to where one of them ends",
}
#: What the end of a branch is called in the list: a flight that meets the stop begins in a graze.
_KINDS = {"flip": "flip", "fold": "fold", "graze": "graze", "penetration": "graze", "rest": "rest"}


def find_bifurcations(
    dataset: xr.Dataset, axis: str | None = None, at: Selection | None = None
) -> tuple[str, pd.DataFrame]:
    """Find the bifurcations along an axis, by default the longest, on every line of the grid.

    `at` is where to cut other axes; of the others every value is taken.

    Returns
    -------
    axis : str
    found : DataFrame
        A row for each change of class between two neighbouring values of the axis, in the order of
        the grid and on each line of increasing values of the axis: the values of the other axes;
        ``low``, ``high``, ``before``, ``after`` and ``between`` of the `Change`; ``value`` of the
        axis at a flip, fold or graze, to rounding, NaN where it is not known; and ``kind``:
        ``flip``, ``fold``, ``graze`` where a branch of periodic orbits ends or loses its stability
        so; ``rest``, ``chaos``, ``unbounded`` where that begins or ends; ``basin`` where the
        attractor of before exists on both sides and is stable; ``unknown`` otherwise.

    Raises
    ------
    Refused
        If there is no such axis or value, or the classes were not recorded.
    """
    import pandas as pd

    (along,) = chosen_axes(dataset, [axis] if axis else [], 1, "list of bifurcations")
    check_diagnostic(dataset, "period")
    free = [str(name) for name in dataset["status"].dims if name not in (at or {})]
    data = select(dataset, at, free=[along, *free])
    other_axes = [str(name) for name in data["status"].dims if name != along]
    data = data.sortby(along)
    rows = []
    for index in product(*(range(data.sizes[name]) for name in other_axes)):
        line = data.isel(dict(zip(other_axes, index, strict=True))).load()
        motions, down = PeriodicPoints.of(line), _is_followed_down(line, along)
        for change in changes(line[along].values, labels(line)):
            kind, value = _explain(motions, along, change, down)
            own = {"kind": kind, "value": value}
            rows.append({name: line[name].item() for name in other_axes} | vars(change) | own)
    columns = [*other_axes, *(field.name for field in fields(Change)), "kind", "value"]
    return along, pd.DataFrame(rows, columns=columns)


def _is_followed_down(line: xr.Dataset, axis: str) -> bool:
    """Whether each point of a line was started from that of the next greater value of the axis."""
    config = config_of(line)
    if config.follow is None or config.follow.axis != axis:
        return False
    way = line[DIRECTION].item() if DIRECTION in line.coords else config.follow.direction
    return bool(way == "down")


def _explain(motions: PeriodicPoints, axis: str, change: Change, down: bool) -> tuple[str, float]:
    """Return the kind of a change, and the value of the axis where it is known exactly."""
    if axis in STARTS:
        return "basin", np.nan
    sides = np.searchsorted(motions.points[axis], [change.low, change.high]).tolist()
    before, after = reversed(sides) if down else sides
    ends = [_end(motions, axis, before, after), _end(motions, axis, after, before)]
    (first, _), (second, _) = ends
    if first == "edge":
        return "basin", np.nan
    if change.kind in ("rest", "chaos", "unbounded"):
        return "basin" if second == "edge" else change.kind, np.nan
    exact = [(_KINDS[kind], value) for kind, value in ends if kind in _KINDS]
    return exact[0] if exact else (change.kind, np.nan)


def _end(motions: PeriodicPoints, axis: str, i: int, j: int) -> tuple[str, float]:
    """Return how the branch of the orbit at point i ends on its way to point j, and where.

    The kind is empty where there is no such branch.
    """
    if motions.m[i]:
        start, end = motions.points[axis][[i, j]].tolist()
        with suppress(ValueError):  # no orbit is found, or it cannot be followed
            orbit = motions.orbit(i)
            if (orbit.m, orbit.q) == (motions.m[i], motions.q[i]) and orbit.stable:
                special = branch(orbit, axis, *sorted((start, end))).special
                # Both walks begin at an end of the range, so that one of them is over at once.
                for point in special[1:] if start < end else special[-2::-1]:
                    return point.kind, point.value
    return "", np.nan


def as_read(dataset: xr.Dataset, axis: str, found: pd.DataFrame) -> tuple[str, pd.DataFrame]:
    """Return an axis and the bifurcations along it in the names and units of a rig, if any."""
    import pandas as pd

    rig, own = rig_of(dataset), si_name(axis, rig_of(dataset))
    columns = si_values(found, rig)
    for name in ("low", "high", "value"):
        columns[name] = si_values({axis: columns[name]}, rig)[own]
    return own, pd.DataFrame(columns)


def _others(found: pd.DataFrame) -> list[str]:
    """Name the other axes."""
    return list(found.columns[: list(found).index("low")])


def describe(axis: str, found: pd.DataFrame) -> str:
    """Write bifurcations as tables: those with an exact value first, or of a map each kind."""
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
        head = [*_others(found), axis, "kind", "classes", "between", ""]
        parts.append(table([head, *map(_row, listed.to_dict("records"))]))
    if len(listed) < len(found):
        parts.append(f"{len(others)} changes without an exact value\n{_summary(axis, others)}")
    lines = [*_cascades(axis, found), *_meanings(others)]
    return "\n\n".join([*parts, *(["\n".join(lines)] if lines else [])])


def _meanings(found: pd.DataFrame) -> list[str]:
    kinds = set(found["kind"])
    return [f"{kind}: {text}" for kind, text in _MEANINGS.items() if kind in kinds]


def is_summary(found: pd.DataFrame) -> bool:
    """Whether there are too many of them to be described one by one."""
    return len(found) > MOST_ROWS and bool(_others(found))


def _row(item: dict[str, Any]) -> list[str]:
    at = list(item.values())[: list(item).index("low")]
    between = item["between"]
    return [
        *map(_shown, at),
        "" if np.isnan(item["value"]) else f"{item['value']:.12g}",
        item["kind"],
        f"{item['before']} -> {item['after']}",
        f"{item['low']:.12g} .. {item['high']:.12g}",
        f"{shown_count(between, 'point')} of no known class" if between else "",
    ]


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.6g}"


def _summary(axis: str, found: pd.DataFrame) -> str:
    """Write a line for each kind and pair of classes, the most frequent first."""
    others = _others(found)
    pairs = [f"{a} -> {b}" for a, b in zip(found["before"], found["after"], strict=True)]
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
    lines = [table([["kind", "classes", "times", axis, *others], *rows[:MOST_ROWS]])]
    if len(rows) > MOST_ROWS:
        lines.append(f"and {len(rows) - MOST_ROWS:,} rarer pairs of classes")
    if others:
        lines.append(f"{len(found):,} changes along {axis}")
    return "\n".join(lines)


def _cascades(axis: str, found: pd.DataFrame) -> Iterator[str]:
    """Yield a line for each run of flips: where they are, and the ratios of their distances."""
    others, names = _others(found), [field.name for field in fields(Change)]
    values = found["value"].fillna(0.5 * (found["low"] + found["high"]))
    for at, line in found.groupby(others, sort=False) if others else [((), found)]:
        value_of = dict(zip(starmap(Change, line[names].values), values[line.index], strict=True))
        for run in cascades(list(value_of)):
            places = np.array([value_of[change] for change in run])
            flips = ", ".join(f"{value:.9g}" for value in places)
            ratios = ", ".join(f"{a / b:.4g}" for a, b in pairwise(np.diff(places)))
            where = [f"{name} = {_shown(value)}" for name, value in zip(others, at, strict=True)]
            text = f"cascade: {axis} = {flips}; ratios of the distances {ratios}"
            yield ", ".join([*where, text])


def on_branches(found: xr.Dataset) -> pd.DataFrame:
    """Return the flips, folds and grazes of `branches`, each once, in the order of their values.

    At a graze m and q are those with the impact that grazes.
    """
    import pandas as pd

    names = {
        "kind": "kind", "special_m": "m", "special_q": "q", "special_value": "value",
        "special_branch": "branch",
    }  # fmt: skip
    frame = pd.DataFrame({names[name]: found[name].values for name in names})
    frame = frame[frame["kind"].isin(["flip", "fold", "graze"])].sort_values("value", kind="stable")
    step = frame.groupby(["kind", "m", "q"])["value"].diff()
    return frame[~(step <= 1e-10 * frame["value"].abs().clip(lower=1.0))]


def describe_branches(
    dataset: xr.Dataset, axis: str, at: Selection | None = None, **chosen: Any
) -> str:
    """List the bifurcations on all branches of the motions along one line of a sweep.

    Each has a line: the value to twelve digits, the kind, and m/q; where there are many, those on
    branches that are hardly ever stable are counted only. The text is empty where there are several
    lines, or the axis is a start or has a single value.
    """
    uncut = [name for name in swept_axes(dataset) if name != axis and name not in (at or {})]
    if uncut or axis in STARTS or dataset.sizes[axis] == 1:
        return ""
    found = in_si(branches(dataset, axis, at, **chosen), dataset)
    (axis,) = map(str, found.coords)
    frame = on_branches(found)
    wide = wide_branches(found)[frame["branch"].to_numpy()]
    shown = frame if len(frame) <= MOST_ROWS else frame[wide]
    rows = [
        [f"{point.value:.12g}", point.kind, f"{point.m}/{point.q}"] for point in shown.itertuples()
    ]
    lines = ["", found.attrs["summary"], "", table([[axis, "kind", "class"], *rows])]
    if left := len(frame) - len(shown):
        lines.append(f"{left} more on branches that are stable over less than 1 % of the axis")
    return "\n".join(lines if rows else lines[:2])


def table_of(axis: str, found: pd.DataFrame) -> pd.DataFrame:
    """Return bifurcations with the columns of a CSV file."""
    names = {
        "low": f"{axis}_low", "high": f"{axis}_high", "before": "before", "after": "after",
        "kind": "kind", "value": axis, "between": "unknown_between",
    }  # fmt: skip
    return found[[*_others(found), *names]].rename(columns=names)
