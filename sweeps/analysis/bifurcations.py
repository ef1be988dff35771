"""The bifurcations along an axis of a sweep: where the class of the motion changes, and why.

From the periodic orbit on either side of a change its branch is followed to the other side
(`vibroimpact.orbits.branches`). If the branch ends between them, or loses its stability, that is
the bifurcation. If it does not, the attractor goes on, and the motion of the sweep has only come
into the basin of another.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import product
from pathlib import Path

import numpy as np
import xarray as xr

from sweeps.analysis import tables
from sweeps.analysis.regimes import Change, cascades, changes, labels, ratio
from sweeps.analysis.selection import Selection, chosen_axes, config_of, oscillator_of, select
from sweeps.errors import Refused
from sweeps.store import DIRECTION
from sweeps.text import shown_count, shown_range, table
from vibroimpact.orbits.branches import branch
from vibroimpact.orbits.periodic import periodic_orbit
from vibroimpact.oscillator import Oscillator

#: Up to so many bifurcations are listed one by one; of more, each kind in a line.
_MOST_ROWS = 40
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
        osc = oscillator_of(point)
        x, v = (float(point[name][-1]) for name in ("poincare_x", "poincare_v"))
        try:
            orbit = periodic_orbit(osc, min(x, osc.clearance), v, m, self._phase)
            if (orbit.m, orbit.q) != (m, q) or not orbit.stable:
                return None
            low, high = sorted((start, end))
            special = branch(orbit, self._axis, low, high).special
        except ValueError:  # no orbit is found, or it cannot be followed
            return None
        # Both walks begin at an end of the range, so that one of them is over at once.
        following = special[1:] if start < end else special[-2::-1]
        return (following[0].kind, following[0].value) if following else None


def describe(axis: str, bifurcations: Sequence[Bifurcation]) -> str:
    """Write bifurcations as a table: one by one, or of a map each kind in a line."""
    if not bifurcations:
        return f"the class of the motion does not change along {axis}"
    if is_summary(bifurcations):
        return _summary(axis, bifurcations)
    lines = [_row(axis, item) for item in bifurcations]
    return "\n".join([table(lines), *_cascades(axis, bifurcations)])


def is_summary(bifurcations: Sequence[Bifurcation]) -> bool:
    """Whether there are too many of them to be described one by one."""
    return len(bifurcations) > _MOST_ROWS and bool(bifurcations[0].at)


def _row(axis: str, item: Bifurcation) -> list[str]:
    change = item.change
    unknown = f"{shown_count(change.between, 'point')} between of no known class"
    return [
        *(f"{name} = {_shown(value)}" for name, value in item.at.items()),
        f"{axis} = {change.low:.12g} .. {change.high:.12g}",
        f"width {change.high - change.low:.1e}",
        f"{change.before} -> {change.after}",
        item.kind,
        "" if np.isnan(item.value) else f"at {item.value:.12g}",
        unknown if change.between else "",
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
        for (kind, pair), items in ordered[:_MOST_ROWS]
    ]
    lines = [table([head, *rows])]
    if len(ordered) > _MOST_ROWS:
        lines.append(f"and {len(ordered) - _MOST_ROWS:,} rarer pairs of classes")
    lines.append(f"{len(bifurcations):,} changes along {axis}")
    return "\n".join(lines)


def _cascades(axis: str, bifurcations: Sequence[Bifurcation]) -> Iterator[str]:
    """Yield a line for each run of flips: where they are, and the ratios of their distances."""
    lines: dict[tuple[tuple[str, float | str], ...], list[Change]] = {}
    for item in bifurcations:
        lines.setdefault(tuple(item.at.items()), []).append(item.change)
    for at, line in lines.items():
        for run in cascades(line):
            flips = ", ".join(f"{0.5 * (change.low + change.high):.9g}" for change in run)
            ratios = ", ".join(f"{ratio(run[i : i + 3]):.4g}" for i in range(len(run) - 2))
            where = [f"{name} = {_shown(value)}" for name, value in at]
            text = f"cascade: {axis} = {flips}; ratios of the distances {ratios}"
            yield ", ".join([*where, text])


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
