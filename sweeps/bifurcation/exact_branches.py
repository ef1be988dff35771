"""`branches`: orders seeds by class, fills the Dataset; adds special points, also for curves.

Every periodic motion in the file is a seed: Newton's method finds its orbit, and the branch of the
orbit is followed, with the branches that begin at its flips and grazes
(`sweeps.bifurcation.branch_set`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from itertools import groupby
from typing import Any

import numpy as np
import xarray as xr

from sweeps.bifurcation.branch_set import BranchSet, with_short_chords
from sweeps.errors import Refused
from sweeps.opened.coordinates import COORDINATES, orbit_coordinates
from sweeps.opened.doors import orbits_on_axes, takes_sweep
from sweeps.opened.motions import orbit_at
from sweeps.opened.opened_sweep import START_AXES, OpenedSweep, Selection
from sweeps.store.variables import DIRECTION
from sweeps.text import listed, shown_count
from vibroimpact.orbits.branches import Branch
from vibroimpact.orbits.curves import CURVE_KINDS
from vibroimpact.orbits.orbit import Orbits
from vibroimpact.orbits.periodic import OrbitError
from vibroimpact.points.regimes import Regime

#: Shares of the work, measured, that are done when the branches are found, and are smooth lines.
_SEARCH, _SMOOTH = 0.5, 0.9
#: Most forcing periods of an orbit that is followed, and most branches that are followed.
LONGEST_ORBIT, MOST_BRANCHES = 8, 60
#: Most classes that the summary names.
_MOST_NAMES = 8
#: Largest distance of a branch from the lines between its points, as a share of the ranges: a
#: seventh of a pixel of a picture.
CHORD_TOLERANCE = 1e-4


@takes_sweep({})
def branches(
    sweep: OpenedSweep,
    axis: str | None = None,
    at: Selection | None = None,
    report: Callable[[float], object] = lambda share: None,
    *,
    classes: Collection[tuple[int, int]] = (),
    most: int = MOST_BRANCHES,
) -> xr.Dataset:
    """Follow the orbits of the periodic motions of a sweep along one axis.

    The branches of the motions in the file come first, starting with the most frequent class. The
    branches that begin at their flips and grazes come next.

    Parameters
    ----------
    sweep : Dataset
        From `sweeps.open_sweep`.
    axis : str, optional
        A swept parameter of the oscillator, by default the longest axis.
    at : mapping of str to float, optional
        Values of the other swept axes; by default the first.
    report : callable, optional
        Called before each branch, and for each one found, with the share of the work that is done;
        an exception that it raises ends the work.
    classes : collection of (int, int), optional
        m and q of the branches to return, by default all of at most 8 periods. Those of other
        classes are followed, too, because branches of these classes may begin there.
    most : int, optional
        Most branches to follow; with `classes`, of these and as many of all others.

    Returns
    -------
    Dataset
        Along ``point``, branch after branch, each followed by its special points:

        - the axis, ``branch`` (the number of the branch), ``m``, ``q`` and ``stable``: whether both
          multipliers are inside the unit circle, False at a flip, a fold and a graze;
        - ``kind`` of a special point: ``flip``, ``fold``, ``graze`` or an end of the branch; empty
          for all other points. The orbit of a graze has the impact of speed zero. At the flip in
          which a branch ends it is the orbit of half the period;
        - ``criticality`` of a flip: ``supercritical`` or ``subcritical``, as of a `PeriodicOrbit`;
        - ``multipliers`` (``point``, ``multiplier``): the Floquet multipliers, complex, the larger
          one first;
        - ``impact_phase``, ``impact_v`` (``point``, ``impact``), NaN beyond q impacts;
        - ``poincare_x``, ``poincare_v``, ``poincare_height`` (``point``, ``section``), NaN beyond m
          periods.

        The attribute ``summary`` says what was found, and ``given_up`` what was not followed.
        ``range`` holds the ends of the axis, and ``phase`` is the phase of the section; the other
        parameters are attributes, too. ``chosen`` is 1 if `classes` or `most` are given: then a
        diagram draws all branches.

    Raises
    ------
    Refused
        If there is no such axis, or the orbits do not depend on it.

    Examples
    --------
    >>> ds = sweeps.open_sweep("flip.h5")  # of the example of `run_sweep`
    >>> found = sweeps.branches(ds, "omega")
    >>> flips = found.where(found.kind == "flip", drop=True)
    >>> flips.omega.values.round(6)
    array([2.663945, 2.663945])
    """
    (axis,) = sweep.chosen_axes([] if axis is None else [axis], at, 1, "branch")
    lines = [line.motions for line in lines_of(sweep, axis, at)]
    name, phase = sweep.nomenclature.parameter(axis), sweep.spec.phase
    orbits = branches_of(lines, name, phase, report, classes=classes, most=most)
    orbits.attrs["chosen"] = int(bool(classes) or most != MOST_BRANCHES)
    return orbits_on_axes(sweep, orbits)


def branches_of(
    lines: Sequence[np.ndarray],
    axis: str,
    phase: float,
    report: Callable[[float], object],
    *,
    classes: Collection[tuple[int, int]] = (),
    most: int = MOST_BRANCHES,
) -> xr.Dataset:
    """Follow the orbits of motions along one axis, and return the Dataset of `branches`.

    Each line has motions of dtype ``MOTION`` at increasing values of the axis, a parameter of the
    model; `phase` is that of their section.
    """
    low = min(float(line["point"][axis][0]) for line in lines)
    high = max(float(line["point"][axis][-1]) for line in lines)
    search = partial(report, 0.0)
    tree = BranchSet(axis, low, high, phase, most, LONGEST_ORBIT, classes, search)
    left_out: dict[str, Counter[tuple[int, int]]] = {}
    for motion, length in _seeds(lines):
        mq = int(motion["m"]), int(motion["q"])
        reason = f"of more than {LONGEST_ORBIT} periods"
        if mq[0] <= LONGEST_ORBIT or mq in classes:
            try:
                is_added = tree.add(orbit_at(motion, phase))
                reason = "" if is_added else f"beyond the first {shown_count(most, 'branch')}"
            except OrbitError as error:
                reason = f"of which {error}"
        if reason and tree.is_chosen(*mq):
            left_out.setdefault(reason, Counter())[mq] += length
    tree.grow()
    tree.branches = [grown for grown in tree.branches if tree.is_chosen(grown.m, grown.q)]
    return _as_dataset(tree, phase, left_out, report)


def _seeds(lines: Sequence[np.ndarray]) -> list[tuple[np.void, int]]:
    """Return the middle motion and the length of each run of a class, in the order to follow.

    The longest runs of all classes come first, in the order of the frequency of the classes; then
    come the second longest runs, and so on.
    """
    points: Counter[tuple[int, int]] = Counter()
    runs = []
    for line in lines:
        begin = 0
        for (regime, m, q), run in groupby(line[["regime", "m", "q"]].tolist()):
            mq, length = (m, q), len(list(run))
            if regime == Regime.PERIODIC:
                runs.append((mq, line[begin + length // 2], length))
                points[mq] += length
            begin += length
    counts: Counter[tuple[int, int]] = Counter()
    ordered = []
    for mq, motion, length in sorted(runs, key=lambda run: -run[2]):
        ordered.append((counts[mq], -points[mq], (motion, length)))
        counts[mq] += 1
    return [run for *_, run in sorted(ordered, key=lambda item: item[:2])]


def _as_dataset(
    tree: BranchSet,
    phase: float,
    left_out: Mapping[str, Counter[tuple[int, int]]],
    report: Callable[[float], object],
) -> xr.Dataset:
    """Collect the branches found as the Dataset that `branches` returns."""
    items = _smooth(tree, phase, report)
    groups: list[Orbits] = []
    stable, critical = [np.zeros(0, bool)], list[str]()
    for item in items:
        groups += [item.orbits, *(point.orbit.alone for point in item.special)]
        stable += [item.stable, np.zeros(len(item.special), bool)]
        critical += [""] * len(item.values) + [point.orbit.criticality for point in item.special]
    records, multipliers = [], [np.empty((0, 2), complex)]
    for number, group in enumerate(groups):
        report(_SMOOTH + (1.0 - _SMOOTH) * number / len(groups))
        records.append(orbit_coordinates(group, phase))
        multipliers.append(group.multipliers)
    rows = with_special_points(items, "branch", "kind", (tree.parameter,))
    at_end = ~np.isin(rows["kind"].values, ["", *CURVE_KINDS])  # not at a bifurcation
    within = (np.abs(np.concatenate(multipliers)) < 1.0).all(axis=1)
    sizes = np.array([len(group.points) for group in groups], int)
    m, q = np.array([(group.m, group.phases.shape[1]) for group in groups], int).reshape(-1, 2).T
    data: dict[str, Any] = {
        "m": ("point", np.repeat(m, sizes)),
        "q": ("point", np.repeat(q, sizes)),
        "stable": ("point", np.concatenate(stable) | (at_end & within)),
        "criticality": ("point", np.array(critical, "U13")),
        "multipliers": (("point", "multiplier"), np.concatenate(multipliers)),
    }
    for name, variable in COORDINATES.items():
        data[name] = ("point", variable.dimension), _padded([record[name] for record in records])
    lines = _summary(tree, left_out)
    attributes = {
        "summary": "\n".join(lines), "given_up": "; ".join(lines[1:]), "phase": phase,
        "range": [tree.low, tree.high],
    }  # fmt: skip
    return rows.assign(data).assign_attrs(attributes)


def _smooth(tree: BranchSet, phase: float, report: Callable[[float], object]) -> list[Branch]:
    """Add points to the branches until a picture of any coordinate shows smooth lines."""

    def ordinates(orbits: Orbits) -> list[np.ndarray]:
        values = orbit_coordinates(orbits, phase)
        values["impact_phase"] = values["impact_phase"] % (2.0 * np.pi)
        return list(values.values())

    records = zip(*(ordinates(item.orbits) for item in tree.branches), strict=True)
    columns = [np.concatenate([values.ravel() for values in record]) for record in records]
    # Where nothing meets the stop, no orbit has an impact.
    extents = [(float(np.ptp(column)) if column.size else 0.0) or 1.0 for column in columns]

    def scaled(orbits: Orbits) -> np.ndarray:
        pairs = zip(ordinates(orbits), extents, strict=True)
        return np.concatenate([y / extent for y, extent in pairs], axis=1)

    items = []
    for number, item in enumerate(tree.branches):
        report(_SEARCH + (_SMOOTH - _SEARCH) * number / len(tree.branches))
        items.append(with_short_chords(item, tree.low, tree.high, scaled, CHORD_TOLERANCE))
    return items


def with_special_points(
    paths: Sequence[Branch], noun: str, special: str, axes: Sequence[str]
) -> xr.Dataset:
    """Return the points of branches or curves along ``point``, each followed by its special points.

    The variable `noun` is the number of the branch or curve, and `special` the kind of a special
    point. The attributes are the parameters that all have in common.
    """
    numbers, kinds, values = list[int](), list[str](), list[Any]()
    for number, item in enumerate(paths):
        values += [*item.values, *(point.value for point in item.special)]
        kinds += [""] * len(item.values) + [point.kind for point in item.special]
        numbers += [number] * (len(values) - len(numbers))
    columns = np.array(values, float).reshape(-1, len(axes)).T
    data = {noun: ("point", np.array(numbers, int)), special: ("point", np.array(kinds, "U11"))}
    coordinates = {axis: ("point", column) for axis, column in zip(axes, columns, strict=True)}
    fixed = vars(paths[0].oscillator).items() if paths else ()
    return xr.Dataset(data, coordinates, {name: v for name, v in fixed if name not in axes})


def _padded(tables: Sequence[np.ndarray]) -> np.ndarray:
    """Stack tables of different widths, padded with NaN."""
    width = max((table.shape[1] for table in tables), default=0)
    stacked, begin = np.full((sum(map(len, tables)), width), np.nan), 0
    for table in tables:
        stacked[begin : begin + len(table), : table.shape[1]] = table
        begin += len(table)
    return stacked


def _summary(tree: BranchSet, left_out: Mapping[str, Counter[tuple[int, int]]]) -> list[str]:
    """Write lines on the branches found, and on the motions and branches not followed."""
    classes = {(branch.m, branch.q) for branch in tree.branches}
    names = listed([f"{m}/{q}" for m, q in sorted(classes)][:_MOST_NAMES])
    names += ", ..." if len(classes) > _MOST_NAMES else ""
    noun = "branch" if len(tree.branches) == 1 else "branches"
    lines = [
        f"{len(tree.branches)} exact {noun} of {names}" if names else "no exact branch is found"
    ]
    for reason, motions in left_out.items():
        texts = [
            f"{m}/{q} ({shown_count(count, 'point')})" for (m, q), count in motions.most_common()
        ]
        more = f" and {len(texts) - _MOST_NAMES} more" if len(texts) > _MOST_NAMES else ""
        lines.append(f"without an exact branch, {reason}: {listed(texts[:_MOST_NAMES])}{more}")
    if missing := [f"{m}/{q}" for m, q in tree.classes if (m, q) not in classes]:
        lines.append(f"no orbit of {listed(missing)} is found")
    if tree.given_up:
        counted = [f"{reason} ({count})" for reason, count in sorted(tree.given_up.items())]
        lines.append(f"branches not followed: {'; '.join(counted)}")
    return lines


def wide_branches(exact: xr.Dataset) -> np.ndarray:
    """Return which branches are stable over more than a hundredth of the axis, by their numbers."""
    (axis,), (low, high) = exact.coords, exact.attrs["range"]
    stable, number = exact["stable"].values, exact["branch"].values
    stable = stable & (exact["kind"].values == "")
    within = stable[1:] & stable[:-1] & (np.diff(number) == 0)
    steps = np.abs(np.diff(exact[axis].values)) * within
    sums = np.bincount(number[1:], steps, 1 + number.max(initial=-1))
    return sums > 0.01 * (high - low)


def check_axis(axis: str, values: np.ndarray, picture: str) -> None:
    """Refuse an axis on which the orbits do not depend, and one with a single value."""
    if axis in START_AXES:
        raise Refused(
            f"the exact orbits do not depend on {axis}; draw {picture} without exact orbits"
        )
    if np.ptp(values) == 0.0:
        raise Refused(
            f"{axis} has the single value {values[0]:g}: exact orbits are followed over a range"
        )


def lines_of(sweep: OpenedSweep, axis: str, at: Selection | None = None) -> list[OpenedSweep]:
    """Return the points along an axis, sorted, once for each direction of a followed sweep."""
    line = sweep.cut(at, free=[axis, DIRECTION])
    check_axis(axis, line[axis].values, "it")
    return line.sortby(axis).each_direction
