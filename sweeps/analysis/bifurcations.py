"""The bifurcations along an axis of a sweep: where the class of the motion changes, and why.

From the periodic orbit on either side of a change its branch is followed to the other side
(`vibroimpact.orbits.branches`). If the branch ends between them, or loses its stability, that is
the bifurcation. If it does not, the attractor goes on, and the motion of the sweep has only come
into the basin of another.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise, product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from sweeps.analysis import tables
from sweeps.analysis.exact_branches import branches, wide_branches
from sweeps.analysis.nearby_orbit import orbit_at
from sweeps.analysis.regimes import Change, cascades, changes, labels
from sweeps.analysis.rig import in_si, rig_of
from sweeps.analysis.selection import (
    Selection,
    chosen_axes,
    config_of,
    oscillator_of,
    select,
    swept_axes,
)
from sweeps.config.rig import si_name, si_values
from sweeps.errors import Refused
from sweeps.store import DIRECTION
from sweeps.text import shown_count, shown_range, table
from vibroimpact.orbits.branches import branch
from vibroimpact.oscillator import Oscillator

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
_NAMES = tuple(field.name for field in fields(Oscillator))


@dataclass(frozen=True)
class Bifurcation:
    """A change of the class of the motion between two neighbouring values of an axis.

    Attributes
    ----------
    at : mapping of str to float or str
        The values of the other axes.
    change : Change
    kind : str
        ``flip``, ``fold``, ``graze`` where a branch of periodic orbits ends or loses its stability
        so; ``rest``, ``chaos``, ``unbounded`` where that begins or ends; ``basin`` where the
        attractor of before exists on both sides and is stable; ``unknown`` otherwise.
    value : float
        Of the axis at the flip, fold or graze, to rounding; NaN where it is not known.
    """

    at: Mapping[str, float | str]
    change: Change
    kind: str
    value: float


def find_bifurcations(
    dataset: xr.Dataset, axis: str | None = None, at: Selection | None = None
) -> tuple[str, list[Bifurcation]]:
    """Find the bifurcations along an axis, by default the longest, on every line of the grid.

    Return the axis, and the bifurcations in the order of the grid, on each line of increasing
    values of the axis. `at` is where to cut other axes; of the others every value is taken. Raises
    Refused if there is no such axis or value, or the classes were not recorded.
    """
    (along,) = chosen_axes(dataset, [axis] if axis else [], 1, "list of bifurcations")
    if "period" not in dataset:
        raise Refused(
            "the file has no period: run the sweep again with record.diagnostics: [period]"
        )
    free = [str(name) for name in dataset["status"].dims if name not in (at or {})]
    data = select(dataset, at, free=[along, *free])
    other_axes = [str(name) for name in data["status"].dims if name != along]
    data = data.sortby(along)
    result = []
    for index in product(*(range(data.sizes[name]) for name in other_axes)):
        line = data.isel(dict(zip(other_axes, index, strict=True))).load()
        values = {name: line[name].item() for name in other_axes}
        orbits = _Orbits(line, along)
        for change in changes(line[along].values, labels(line)):
            result.append(Bifurcation(values, change, *orbits.explain(change)))
    return along, result


class _Orbits:
    """The periodic orbits on a line, and what becomes of them."""

    def __init__(self, line: xr.Dataset, axis: str) -> None:
        self._line, self._axis, config = line, axis, config_of(line)
        self._phase, self._down = config.record.phase, False
        if config.follow is not None and config.follow.axis == axis:
            way = line[DIRECTION].item() if DIRECTION in line.coords else config.follow.direction
            self._down = way == "down"

    def explain(self, change: Change) -> tuple[str, float]:
        """Return the kind of a change, and the value of the axis where it is known exactly."""
        if self._axis not in _NAMES:
            return "basin", np.nan
        sides = [(change.low, change.high), (change.high, change.low)]
        if self._down:
            sides.reverse()
        ends = [self._end(*side) for side in sides]
        if ends[0] is not None and ends[0][0] == "edge":
            return "basin", np.nan
        if change.kind in ("rest", "chaos", "unbounded"):
            at_other = ends[1] is not None and ends[1][0] == "edge"
            return ("basin", np.nan) if at_other else (change.kind, np.nan)
        exact_ends = [end for end in ends if end is not None and end[0] in _KINDS]
        if not exact_ends:
            return change.kind, np.nan
        kind, value = exact_ends[0]
        return _KINDS[kind], value

    def _end(self, start: float, end: float) -> tuple[str, float] | None:
        """Return how the branch of the orbit at `start` ends on its way to `end`, and where."""
        point = self._line.sel({self._axis: start})
        m, q = int(point["period"]), int(point["period_impacts"])
        if m == 0 or float(point["rest_fraction"]) > 0.0:
            return None
        x, v = (float(point[name][-1]) for name in ("poincare_x", "poincare_v"))
        try:
            orbit = orbit_at(oscillator_of(point), x, v, m, self._phase)
            if (orbit.m, orbit.q) != (m, q) or not orbit.stable:
                return None
            low, high = sorted((start, end))
            special = branch(orbit, self._axis, low, high).special
        except ValueError:  # no orbit is found, or it cannot be followed
            return None
        # Both walks begin at an end of the range, so that one of them is over at once.
        following = special[1:] if start < end else special[-2::-1]
        return (following[0].kind, following[0].value) if following else None


def as_read(
    dataset: xr.Dataset, axis: str, bifurcations: Sequence[Bifurcation]
) -> tuple[str, list[Bifurcation]]:
    """Return an axis and the bifurcations along it in the names and units of a rig, if any."""
    rig = rig_of(dataset)

    def shown(value: float) -> float:
        return float(si_values({axis: value}, rig)[si_name(axis, rig)])

    return si_name(axis, rig), [
        replace(
            item,
            at=si_values(item.at, rig),
            change=replace(item.change, low=shown(item.change.low), high=shown(item.change.high)),
            value=shown(item.value),
        )
        for item in bifurcations
    ]


def describe(axis: str, bifurcations: Sequence[Bifurcation]) -> str:
    """Write bifurcations as tables: those with an exact value first, or of a map each kind."""
    if not bifurcations:
        return f"the class of the motion does not change along {axis}"
    if is_summary(bifurcations):
        return "\n".join([_summary(axis, bifurcations), *_meanings(bifurcations)])
    exact = [item for item in bifurcations if not np.isnan(item.value)]
    others = [item for item in bifurcations if np.isnan(item.value)]
    listed = exact if len(others) > _MOST_INEXACT else [*exact, *others]
    parts = []
    if listed:
        head = [axis, "kind", "classes", "between", ""]
        parts.append(table([[*listed[0].at, *head], *map(_row, listed)]))
    if len(listed) < len(bifurcations):
        parts.append(f"{len(others)} changes without an exact value\n{_summary(axis, others)}")
    lines = [*_cascades(axis, bifurcations), *_meanings(others)]
    return "\n\n".join([*parts, *(["\n".join(lines)] if lines else [])])


def _meanings(bifurcations: Sequence[Bifurcation]) -> list[str]:
    kinds = {item.kind for item in bifurcations}
    return [f"{kind}: {text}" for kind, text in _MEANINGS.items() if kind in kinds]


def is_summary(bifurcations: Sequence[Bifurcation]) -> bool:
    """Whether there are too many of them to be described one by one."""
    return len(bifurcations) > MOST_ROWS and bool(bifurcations[0].at)


def _row(item: Bifurcation) -> list[str]:
    change = item.change
    return [
        *map(_shown, item.at.values()),
        "" if np.isnan(item.value) else f"{item.value:.12g}",
        item.kind,
        f"{change.before} -> {change.after}",
        f"{change.low:.12g} .. {change.high:.12g}",
        f"{shown_count(change.between, 'point')} of no known class" if change.between else "",
    ]


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.6g}"


def _summary(axis: str, bifurcations: Sequence[Bifurcation]) -> str:
    """Write a line for each kind and pair of classes, the most frequent first."""
    groups: dict[tuple[str, str], list[Bifurcation]] = {}
    for item in bifurcations:
        pair = f"{item.change.before} -> {item.change.after}"
        groups.setdefault((item.kind, pair), []).append(item)
    ordered = sorted(groups.items(), key=lambda group: -len(group[1]))
    head = ["kind", "classes", "times", axis, *bifurcations[0].at]
    rows = [
        [
            kind,
            pair,
            f"{len(items):,}",
            shown_range([item.change.low for item in items] + [item.change.high for item in items]),
            *(shown_range([item.at[name] for item in items]) for name in bifurcations[0].at),
        ]
        for (kind, pair), items in ordered[:MOST_ROWS]
    ]
    lines = [table([head, *rows])]
    if len(ordered) > MOST_ROWS:
        lines.append(f"and {len(ordered) - MOST_ROWS:,} rarer pairs of classes")
    if bifurcations[0].at:
        lines.append(f"{len(bifurcations):,} changes along {axis}")
    return "\n".join(lines)


def _cascades(axis: str, bifurcations: Sequence[Bifurcation]) -> Iterator[str]:
    """Yield a line for each run of flips: where they are, and the ratios of their distances."""
    lines: dict[tuple[tuple[str, float | str], ...], dict[Change, float]] = {}
    for item in bifurcations:
        middle = 0.5 * (item.change.low + item.change.high)
        value = middle if np.isnan(item.value) else item.value
        lines.setdefault(tuple(item.at.items()), {})[item.change] = value
    for at, line in lines.items():
        for run in cascades(list(line)):
            values = np.array([line[change] for change in run])
            flips = ", ".join(f"{value:.9g}" for value in values)
            ratios = ", ".join(f"{a / b:.4g}" for a, b in pairwise(np.diff(values)))
            where = [f"{name} = {_shown(value)}" for name, value in at]
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
    if uncut or axis in ("x0", "v0") or dataset.sizes[axis] == 1:
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


def write_csv(path: Path, axis: str, bifurcations: Sequence[Bifurcation]) -> None:
    """Write every bifurcation, with all digits."""
    other_axes = list(bifurcations[0].at) if bifurcations else []
    head = [f"{axis}_low", f"{axis}_high", "before", "after", "kind", axis, "unknown_between"]
    tables.write_csv(path, map(_numbers, bifurcations), [*other_axes, *head])


def _numbers(item: Bifurcation) -> list[object]:
    """Write a bifurcation with all digits."""
    change = item.change
    ends = [change.low, change.high, str(change.before), str(change.after)]
    return [*item.at.values(), *ends, item.kind, item.value, change.between]
