"""`bifurcations`, a DataFrame: a row for each change of class, bifurcation or crisis.

Along a single line of a sweep, crises and the other bifurcations of the exact branches are added.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from sweeps.bifurcation.class_changes import (
    NO_LABEL,
    Change,
    Explanation,
    changes_of_class,
    explain,
    least_difference,
)
from sweeps.bifurcation.crises import MOST_MOTIONS, Chaos, crisis
from sweeps.bifurcation.exact_branches import MOST_BRANCHES, branches, wide_branches
from sweeps.opened.doors import takes_sweep
from sweeps.opened.export import headed
from sweeps.opened.opened_sweep import START_AXES, OpenedSweep, Selection
from sweeps.store.variables import DIRECTION
from vibroimpact.orbits.curves import CURVE_KINDS
from vibroimpact.points.regimes import Label, Regime, labels_of

if TYPE_CHECKING:
    import pandas as pd

#: The columns of the table after those of the other axes.
TABLE_COLUMNS = (
    "kind", "value", "low", "high", "before", "after", "between", "orbit", "source",
    "x", "v", "impact_v", "multiplier_1", "multiplier_2", "criticality",
)  # fmt: skip


@takes_sweep({})
def bifurcations(
    sweep: OpenedSweep,
    axis: str | None = None,
    at: Selection | None = None,
    report: Callable[[float], object] = lambda share: None,
    *,
    classes: Collection[tuple[int, int]] = (),
    most: int = MOST_BRANCHES,
) -> pd.DataFrame:
    """Find where the class of the motion changes along an axis, and why.

    Parameters
    ----------
    sweep : Dataset
        From `sweeps.open_sweep`, with ``period``.
    axis : str, optional
        The swept parameter along which to look, by default the one with most values.
    at : mapping of str to float, optional
        Values of other swept axes; those that are left out are taken with all their values.
    report, classes, most
        As of `sweeps.branches`, for the bifurcations of the exact branches.

    Returns
    -------
    DataFrame
        A row for each change of class between two neighbouring values of the axis, on every line of
        the grid, in its order. If the sweep has a single line, or one for each direction, there is
        also a row for every other flip, fold and graze of `sweeps.branches`. The rows of a line are
        in the order of the axis; one without a value has its place at the middle of its interval in
        the parameter of the model. The columns are:

        - the values of the other axes; the direction is ``both`` for a bifurcation of the branches;
        - ``kind``: ``flip``, ``fold`` or ``graze``; ``crisis``, where chaos ends as it touches
          an unstable ``orbit``; ``rest``, ``chaotic`` or ``unbounded`` if such a regime begins or
          ends in another way; ``basin`` if the attractor before the change exists on both sides
          and is stable; ``unknown`` otherwise;
        - ``value``: the value of the axis at a flip, fold or graze, to rounding; NaN if not known;
        - ``low`` and ``high``: the nearest values of the axis on both sides of it, with known
          classes where the class changes;
        - ``before`` and ``after``: the classes of the motions there, for example ``1/1``,
          ``rest, 3 periods`` or ``chaotic``; for a bifurcation of the branches, those of the stable
          orbits that meet; ``?`` if not known, or if the motion ends before it reaches ``value``;
        - ``between``: the number of points between them whose class is unknown;
        - ``orbit``: the class of the orbit that bifurcates at ``value``; at a graze, q counts the
          impact of speed zero;
        - ``source``: ``exact`` if there is a value, else ``bracket``;
        - ``x`` and ``v``: a state of this orbit at the section of the record, from which
          `vibroimpact.periodic_orbit` starts; NaN if there is no value, as in the columns below;
        - ``impact_v``: its speeds before the impacts, a text with spaces between them;
        - ``multiplier_1`` and ``multiplier_2``: its Floquet multipliers, the larger one first;
          infinite and 0 at a graze, NaN where they are complex, which none is at a flip or fold;
        - ``criticality``: that of a flip, ``supercritical`` or ``subcritical``; else empty.

        Where ``value`` is NaN, ``vibroimpact zoom`` with ``low`` and ``high`` narrows the interval.
        If points of unknown class lie between two classes, and no bifurcation leads from one to the
        other, there are two rows. The unknown class is ``?``; a row ends beyond its value.

        Its attributes are ``axis``, ``unclassified``, the number of points of unknown class, and
        ``branches``, a summary of the exact branches.

    Raises
    ------
    Refused
        If there is no such axis or value, or the classes were not recorded.

    Examples
    --------
    >>> ds = sweeps.open_sweep("flip.h5")  # of the example of `run_sweep`
    >>> found = sweeps.bifurcations(ds)
    >>> found[["kind", "value", "before", "after"]].round(6).values.tolist()
    [['flip', 2.663945, '1/1', '2/2']]
    """
    return public_table(find_bifurcations(sweep, axis, at, report, classes=classes, most=most))


def public_table(changes: pd.DataFrame) -> pd.DataFrame:
    """Return the table of `find_bifurcations` as that of `bifurcations`."""
    table = changes.assign(before=changes["before"].map(str), after=changes["after"].map(str))
    table = table[[*changes.attrs["others"], *TABLE_COLUMNS]]
    table.attrs = {name: changes.attrs[name] for name in ("axis", "unclassified", "branches")}
    return table


def find_bifurcations(
    sweep: OpenedSweep,
    axis: str | None = None,
    at: Selection | None = None,
    report: Callable[[float], object] = lambda share: None,
    keep: Callable[[Callable[..., xr.Dataset]], Callable[..., xr.Dataset]] = lambda find: find,
    **chosen: Any,
) -> pd.DataFrame:
    """Return the table of `bifurcations` with a `Label` for each class, and three columns more.

    ``down`` says whether the line was followed downwards, and ``narrow`` whether the branch of a
    bifurcation is stable over less than 1 % of the axis. ``place`` is the value by which rows are
    in order. `keep` makes of a function one that keeps what it finds. Further attributes are
    ``others``, the names of the other axes, and ``heads``, their heads and that of the axis.
    """
    import pandas as pd

    (along,) = sweep.chosen_axes([] if axis is None else [axis], at, 1, "list of bifurcations")
    data = sweep.isel(sweep.indices(at or {}, free=[along])).sortby(along)
    sweep.check("period")
    others = [name for name in data.grid if name != along]
    data = data.transpose(*others, along)
    several = np.ptp(data[along].values) > 0.0
    is_line = {*others} <= {DIRECTION} and several and along not in START_AXES
    sections = None
    if is_line:
        sections = data.data[[name for name in ("poincare_x", "poincare_v") if name in data]]
        sections = sections.isel(section=slice(-MOST_MOTIONS, None), missing_dims="ignore")
    changes = keep(explained_changes)(data, along, sections, report)
    columns = {str(name): column.values.tolist() for name, column in changes.items()}
    for side in {"before", "after"} & {*columns}:
        columns[side] = [Label(Regime(regime), m, q) for regime, m, q in columns[side]]
    values = zip(*columns.values(), strict=True)
    rows: list[dict[str, Any]] = [dict(zip(columns, row, strict=True)) for row in values]
    summary = ""
    if is_line:
        exact = keep(branches)(sweep, along, at, report, **chosen)
        summary, direction = exact.attrs["summary"], dict.fromkeys(others, "both")
        rows += [direction | row for row in _of_branches(exact, data[along].values, rows)]
        lines = list(dict.fromkeys(tuple(row[name] for name in others) for row in rows))
        rows.sort(key=lambda row: (lines.index(tuple(row[name] for name in others)), row["place"]))
    names = [name for name in TABLE_COLUMNS if name != "source"]
    table = pd.DataFrame(rows, columns=[*others, *names, "down", "narrow", "place"])
    numbers = ("value", "low", "high", "place", "x", "v", "multiplier_1", "multiplier_2")
    table = table.astype({**dict.fromkeys(numbers, float), "between": int})
    table["source"] = np.where(table["value"].notna(), "exact", "bracket")
    table.attrs |= {
        "axis": along, "others": others, "branches": summary, **changes.attrs,
        "heads": [headed(name, sweep[name]) for name in (*others, along)],
    }  # fmt: skip
    return table


def explained_changes(
    data: OpenedSweep, along: str, sections: xr.Dataset | None, report: Callable[[float], object],
) -> xr.Dataset:  # fmt: skip
    """Return the rows for the changes of class on every line, each class as a triple of integers.

    Changes are explained with values of the model, and then converted to the units of the axis.
    Crises are sought if there are `sections`. The attribute is the number of unclassified points.
    """
    others = [name for name in data.grid if name != along]
    spec, nomenclature, parameter = data.spec, data.nomenclature, data.nomenclature.parameter(along)
    motions, coordinates = data.motions, data.data.coords.to_dataset()
    period, impacts = data.values(("period", "period_impacts")).values()
    rows, unclassified = list[dict[str, Any]](), 0
    for index in np.ndindex(motions.shape[:-1]):
        line, motion = coordinates.isel(dict(zip(others, index, strict=True))), motions[index]
        classes = labels_of(motion["regime"], period[index], impacts[index], line["R"].values)
        unclassified += classes.count(None)
        values, of_line = line[parameter].values, {name: line[name].item() for name in others}
        is_followed = spec.followed == parameter
        down = is_followed and of_line.get(DIRECTION, data.followed_directions[0]) == "down"
        of_line |= {"down": down, "narrow": False}
        changes = [*changes_of_class(values, classes)]
        for i, change in enumerate(changes):
            report(0.0)
            for each, reason in explain(motion, spec.phase, parameter, values, change, down):
                if sections is not None and reason.kind == "basin":
                    chaos = _ending(data, sections, index, parameter, changes, i)
                    if chaos and (saddle := crisis(chaos, report)):
                        reason = Explanation("crisis", orbit=saddle)
                row = of_line | vars(each) | {"kind": reason.kind, "value": reason.value}
                row |= {"orbit": reason.orbit, "criticality": ""}
                row |= _row_of(np.full(2, np.nan), np.empty(0), np.full(2, np.nan + 0j))
                if (orbit := reason.at) is not None:
                    row |= _row_of(orbit.sections(spec.phase)[0], orbit.speeds, orbit.multipliers)
                    row["criticality"] = orbit.criticality
                rows.append(row)
    table = {name: np.array([row[name] for row in rows]) for name in (rows[0] if rows else ())}
    if rows:
        low, value, high = (table[name] for name in ("low", "value", "high"))
        # The middle in the model: that in another unit is another value, with another place.
        place = np.where(np.isnan(value), 0.5 * (low + high), value)
        low, value, high, place = nomenclature.value(parameter, np.stack([low, value, high, place]))
        # The rounding of a conversion may move a value beyond its neighbours.
        table |= {"low": low, "value": value.clip(low, high), "high": high, "place": place}
    columns = {name: (("row", "label")[: each.ndim], each) for name, each in table.items()}
    return xr.Dataset(columns, attrs={"unclassified": unclassified})


def _ending(
    data: OpenedSweep, sections: xr.Dataset, line: tuple[int, ...], parameter: str,
    changes: Sequence[Change], i: int,
) -> Chaos | None:  # fmt: skip
    """Return the chaos that ends at the i-th change, if it is chaos on one side only."""
    points = data.motions[line]["point"]
    values, change = points[parameter], changes[i]
    chaotic = [label.regime == Regime.CHAOTIC for label in (change.before, change.after)]
    if sum(chaotic) != 1:
        return None
    data.check("poincare_x", "poincare_v")
    if chaotic[0]:
        last, next_value, first = change.low, change.high, changes[i - 1].low if i else values[0]
    else:
        last, next_value = change.high, change.low
        first = changes[i + 1].high if changes[i + 1 :] else values[-1]
    index = int(np.searchsorted(values, last))
    states = np.repeat(points[index], sections.sizes["section"])
    for name in "xv":
        states[f"{name}0"] = sections[f"poincare_{name}"].values[line][index]
    return Chaos(data.spec, states, parameter, first, next_value)


def _row_of(state: np.ndarray, speeds: np.ndarray, multipliers: np.ndarray) -> dict[str, Any]:
    """Return what the list has of an orbit that bifurcates: a state, the speeds, multipliers."""
    first, second = np.where(multipliers.imag == 0.0, multipliers.real, np.nan).tolist()
    return {
        "x": float(state[0]), "v": float(state[1]),
        "impact_v": " ".join(map(repr, speeds.tolist())),
        "multiplier_1": first, "multiplier_2": second,
    }  # fmt: skip


def _of_branches(
    exact: xr.Dataset, values: np.ndarray, listed: Sequence[Mapping[str, Any]]
) -> list[dict[str, Any]]:
    """Return rows for the bifurcations of `branches` that are not listed, each once."""
    rows = list[dict[str, Any]]()
    columns = ("poincare_x", "poincare_v", "impact_v", "multipliers")
    x, v, speeds, multipliers = (exact[name].values for name in columns)
    wide, near = wide_branches(exact), least_difference(values[0], values[-1])
    for kind, value, orbit, members in _special_points(exact, near):
        same = [row for row in listed if (row["kind"], row["orbit"]) == (kind, orbit)]
        values_listed = np.array([row["value"] for row in same])
        if (np.abs(values_listed - value) <= near).any():
            continue
        before, after = _classes_beside(exact, members)
        value = float(np.clip(value, values[0], values[-1]))  # beyond them by rounding
        at = int(np.clip(np.searchsorted(values, value), 1, len(values) - 1))
        low, high = values[at - 1 : at + 1].tolist()
        row = members[0]
        state = np.array([sections[row, 0] for sections in (x, v)])
        rows.append(
            {
                "kind": kind, "value": value, "low": low, "high": high, "place": value,
                "before": before, "after": after, "between": 0, "orbit": orbit, "down": False,
                "narrow": not wide[exact["branch"].values[members]].any(),
                "criticality": str(exact["criticality"].values[row]),
                **_row_of(state, speeds[row, : exact["q"].values[row]], multipliers[row]),
            }
        )  # fmt: skip
    return rows


def _special_points(exact: xr.Dataset, near: float) -> Iterator[tuple[str, float, str, np.ndarray]]:
    """Yield kind, value, orbit and rows of each bifurcation; values within `near` are the same."""
    (axis,) = exact.coords
    kinds, values, m, q = (exact[name].values for name in ("kind", axis, "m", "q"))
    rows = np.flatnonzero(np.isin(kinds, CURVE_KINDS))
    rows = rows[np.lexsort([values[rows], q[rows], m[rows], kinds[rows]])]
    names = np.stack([kinds[rows], m[rows].astype(str), q[rows].astype(str)])
    differ = (names[:, 1:] != names[:, :-1]).any(axis=0)
    apart = np.diff(values[rows]) > near
    for members in np.split(rows, 1 + np.flatnonzero(differ | apart)):
        if members.size:
            first = members[0]
            yield str(kinds[first]), float(values[first]), f"{m[first]}/{q[first]}", members


def _classes_beside(exact: xr.Dataset, members: np.ndarray) -> tuple[Label, Label]:
    """Return the classes of the stable orbits that meet at a bifurcation from both sides."""
    (axis,) = exact.coords
    values, branch, stable = (exact[name].values for name in (axis, "branch", "stable"))
    beside = [NO_LABEL, NO_LABEL]
    for member in members.tolist():
        path = np.flatnonzero((branch == branch[member]) & (exact["kind"].values == ""))
        at = int(np.argmin(np.abs(values[path] - values[member])))
        for near in path[[i for i in (at - 1, at + 1) if 0 <= i < len(path)]].tolist():
            side = int(values[near] > values[member])
            if stable[near] and beside[side] is NO_LABEL:
                m, q = (int(exact[name].values[near]) for name in ("m", "q"))
                beside[side] = Label(Regime.PERIODIC, m, q)
    return beside[0], beside[1]
