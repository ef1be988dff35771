"""`curves`: seeks the borders of tongues on a map, and fills their Dataset.

From the middle of each large region of a class its orbit is followed along both axes until it first
flips, folds or grazes, and these bifurcations are followed in both parameters
(`vibroimpact.orbits.curves`). Then every change between two periodic classes is a seed: the orbit
on one side is followed to the other side. Beside a flip motions settle slowly, so a few cells
without a class may lie between the two. A change counts as explained if a curve of one of its
classes passes within one cell of it. For every other change a reason is given.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Container, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from sweeps.bifurcation.class_changes import cells_of_change, middles_of_regions, steps_between
from sweeps.bifurcation.exact_branches import check_axis, with_special_points
from sweeps.errors import Refused
from sweeps.opened.doors import orbits_on_axes, takes_sweep
from sweeps.opened.motions import first_special_point, orbit_of_motion
from sweeps.opened.opened_sweep import OpenedSweep, Selection
from sweeps.text import choice_of, listed, near_misses, shown_count, suggestion
from vibroimpact.orbits.branches import Branch
from vibroimpact.orbits.curves import CURVE_KINDS, bifurcation_curve
from vibroimpact.orbits.periodic import OrbitError
from vibroimpact.orbits.special_points import SpecialPoint, lost_text
from vibroimpact.points.regimes import Regime

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

#: Most curves that are followed.
MOST_CURVES = 400
#: Distances in cells: how far beyond a change its bifurcation is sought, and how near to a curve of
#: its kind a bifurcation counts as on the curve.
_CELLS, _ON = 0.5, 0.2


def separated(kind: str, m: int, q: int) -> set[tuple[int, int]]:
    """Return the classes beside a curve of a kind and of a class m/q."""
    if kind == "flip":
        return {(m, q), (2 * m, 2 * q)}
    if kind == "graze":
        return {(m, q), (1, 0) if q == 1 else (m, q - 1)}
    return {(m, q)}


class _UnaskedError(OrbitError):
    """There is a bifurcation, of a class or kind that was not asked for."""


class CurveSearch:
    """The search for the curves of one map, of the `chosen` classes, if any, and `kinds`.

    `motions`, of dtype ``MOTION``, are at the `values` of two `axes`, parameters of the model, and
    `phase` is that of their section.
    """

    def __init__(
        self,
        motions: np.ndarray,
        axes: Sequence[str],
        values: Sequence[np.ndarray],
        phase: float,
        chosen: Collection[tuple[int, int]],
        kinds: Collection[str],
    ) -> None:
        self._motions, self._axes, self._values, self._phase = motions, axes, values, phase
        self._chosen, self._kinds = chosen, kinds
        periodic = motions["regime"] == Regime.PERIODIC
        self._classes = np.stack([np.where(periodic, motions[name], 0) for name in "mq"], axis=2)
        self._cells = cells_of_change(self._classes, self._motions["regime"])
        sides = (self._classes[i, j].tolist() for i, j in self._cells.transpose(1, 2, 0))
        #: The two classes of each change, and which changes have a curve.
        self.names = [tuple(sorted(map(tuple, pair))) for pair in zip(*sides, strict=True)]
        self.explained = np.zeros(len(self._cells), bool)
        self._lines: list[tuple[Branch, cKDTree]] = []
        of_chosen = [any(mq in chosen for mq in pair) or not chosen for pair in self.names]
        #: The changes that are counted, and from which curves are sought.
        self.counted = np.array(of_chosen, bool)

    def _is_requested(self, kind: str, mq: tuple[int, int]) -> bool:
        """Whether a curve of a kind and of a class is asked for."""
        return kind in self._kinds and (not self._chosen or mq in self._chosen)

    @property
    def curves(self) -> list[Branch]:
        """The curves found."""
        return [curve for curve, _ in self._lines]

    def run(self, report: Callable[[float], object]) -> dict[int, str]:
        """Search from the large tongues, then from changes; return why some have no curve."""
        beside = set().union(*(separated(kind, *mq) for kind in self._kinds for mq in self._chosen))
        for cell, axis in middles_of_regions(self._classes):
            if self._chosen and tuple(self._classes[*cell]) not in beside:
                continue
            report(self._share(()))
            for point in self._borders(cell, axis):
                if not self._is_on_curve(point, axis, cell):
                    with suppress(OrbitError):  # the search from its changes reports the reason
                        self._follow(point)
        reasons: dict[int, str] = {}
        while (chosen := self._next(reasons)) is not None:
            report(self._share(reasons))
            try:
                self._follow(self._bifurcation(self._cells[chosen]))
                reasons[chosen] = "the curve found there is of other classes"
            except _UnaskedError as error:
                pair = self.names[chosen]  # its other changes are likely to be of the same kind
                reasons |= {i: str(error) for i, name in enumerate(self.names) if name == pair}
            except OrbitError as error:
                reasons[chosen] = str(error)
        return reasons

    def _share(self, reasons: Collection[int]) -> float:
        """Return the share of the counted changes that have a curve or a reason."""
        done = self.explained.copy()
        done[[*reasons]] = True
        return int((self.counted & done).sum()) / max(1, int(self.counted.sum()))

    def _borders(self, cell: np.ndarray, axis: int) -> Iterator[SpecialPoint]:
        """Yield the bifurcations to which the orbit of a cell leads on both sides."""
        values = self._values[axis]
        for end in values[[0, -1]]:
            if end == values[cell[axis]]:
                continue
            try:
                point = self._special_point(cell, axis, end)
            except OrbitError:
                continue
            if self._is_requested(point.kind, (point.orbit.m, point.orbit.q)):
                yield point

    def _is_on_curve(self, point: SpecialPoint, axis: int, cell: np.ndarray) -> bool:
        """Whether a bifurcation on the line through a cell lies on a curve found before."""
        at = cell.astype(float)
        at[axis] = np.interp(point.value, self._values[axis], np.arange(len(self._values[axis])))
        return any(
            (curve.kind, curve.m, curve.q) == (point.kind, point.orbit.m, point.orbit.q)
            and line.query(at, p=np.inf)[0] < _ON
            for curve, line in self._lines
        )

    def _next(self, reasons: Container[int]) -> int | None:
        """Return the next change to search from: of the most frequent pair, the middle one."""
        missing = np.flatnonzero(self.counted & ~self.explained).tolist()
        pairs = {i: self.names[i] for i in missing if i not in reasons}
        if not pairs:
            return None
        ((most, count),) = Counter(pairs.values()).most_common(1)
        return [i for i, pair in pairs.items() if pair == most][count // 2]

    def _special_point(self, cell: np.ndarray, axis: int, value: float) -> SpecialPoint:
        """Return the first one from the orbit of a cell; OrbitError if none is of its class."""
        orbit = orbit_of_motion(self._motions[*cell], self._phase)
        return first_special_point(orbit, self._axes[axis], float(value))

    def _bifurcation(self, cells: np.ndarray) -> SpecialPoint:
        """Return the bifurcation at a change, sought from both sides; OrbitError has the reason."""
        axis = int(np.flatnonzero(cells[0] != cells[1])[0])
        values = self._values[axis]
        cell_values = values[cells[:, axis]]
        beyond = cells[:, axis] + np.array([-_CELLS, _CELLS])
        low, high = np.interp(beyond, np.arange(len(values)), values)
        points: list[SpecialPoint] = []
        reason = "both motions are stable on both sides, and the start decides"
        for cell, limit in zip(cells, (high, low), strict=True):
            try:
                points.append(self._special_point(cell, axis, limit))
            except OrbitError as error:
                reason = str(error)
        bifurcations = [point for point in points if point.kind in CURVE_KINDS]
        requested = [p for p in bifurcations if self._is_requested(p.kind, (p.orbit.m, p.orbit.q))]
        if requested:
            middle = 0.5 * (cell_values[0] + cell_values[1])
            return min(requested, key=lambda point: abs(point.value - middle))
        if bifurcations:
            raise _UnaskedError("the curve there is of a class or kind that was not asked for")
        kinds = [point.kind for point in points if point.kind != "edge"]
        raise OrbitError(f"a branch ends there: {kinds[0]}" if kinds else reason)

    def _follow(self, point: SpecialPoint) -> None:
        """Follow a bifurcation in both parameters, and mark the changes that its curve explains."""
        if len(self._lines) >= MOST_CURVES:
            raise OrbitError(f"curves beyond the first {MOST_CURVES} are not followed")
        first, second = (
            (axis, float(values[0]), float(values[-1]))
            for axis, values in zip(self._axes, self._values, strict=True)
        )
        curve = bifurcation_curve(point.orbit, point.kind, first, second)
        line = self._line(curve)
        self._lines.append((curve, line))
        beside = separated(curve.kind, curve.m, curve.q)
        separated_rows = np.array([not beside.isdisjoint(pair) for pair in self.names], bool)
        rows = np.flatnonzero(separated_rows & ~self.explained)
        owners, middles = steps_between(self._cells[rows])
        distances, _ = line.query(middles, p=np.inf)
        self.explained[rows[owners[distances <= 1.0]]] = True

    def _line(self, curve: Branch) -> cKDTree:
        """Return points along a curve, at most a quarter of a cell apart, in units of cells."""
        from scipy.spatial import cKDTree

        columns = zip(curve.values.T, self._values, strict=True)
        line = np.stack(
            [np.interp(column, values, np.arange(len(values))) for column, values in columns], 1
        )
        steps = np.ceil(4.0 * np.abs(np.diff(line, axis=0)).max(axis=1, initial=0.0)).astype(int)
        along = np.concatenate([[0], np.cumsum(np.maximum(steps, 1))])
        points = np.arange(along[-1] + 1)
        return cKDTree(np.stack([np.interp(points, along, column) for column in line.T], axis=1))


#: Most pairs of classes that are named with a reason.
_EXAMPLES = 3


@takes_sweep({})
def curves(
    sweep: OpenedSweep,
    axes: Sequence[str] = (),
    at: Selection | None = None,
    report: Callable[[float], object] = lambda share: None,
    *,
    classes: Collection[tuple[int, int]] = (),
    kinds: Collection[str] = (),
) -> xr.Dataset:
    """Follow the bifurcations between the periodic motions of a map.

    Parameters
    ----------
    sweep : Dataset
        From `sweeps.open_sweep`, with ``period``.
    axes : str or sequence of str, optional
        Abscissa and ordinate, by default those of a map.
    at : mapping of str to float, optional
        Values of the other swept axes; by default the first.
    report : callable, optional
        Called before each curve with the share of the changes that have a curve or a reason; an
        exception that it raises ends the work.
    classes : collection of (int, int), optional
        m and q of the curves to follow, by default all; no others are followed on the way.
    kinds : str or collection of str, optional
        ``flip``, ``fold`` or ``graze``: the kinds of the curves to follow, by default all.

    Returns
    -------
    Dataset
        Along ``point``, curve after curve, each followed by its special points: the two axes,
        ``curve`` (the number of the curve), ``kind``, ``m`` and ``q`` of the curve, and
        ``special``, the kind of a special point, empty for all other points. The attribute
        ``changes`` counts the changes between periodic classes, of which one is among `classes`, if
        given; ``explained`` counts those with such a curve within one cell; ``summary`` says why
        the others have none.

    Raises
    ------
    Refused
        If the sweep does not have two such axes, the orbits do not depend on one of them, or a
        kind is unknown.

    Examples
    --------
    >>> import sweeps
    >>> R = {"start": 0.6, "stop": 0.9, "num": 12}
    >>> omega = {"start": 2.5, "stop": 2.8, "num": 12}
    >>> scene = {"oscillator": {"h": 0.1, "R": R, "omega": omega, "f": 1.0}}
    >>> ds = sweeps.open_sweep(sweeps.run_sweep(scene, "map.h5", overwrite=True))
    >>> found = sweeps.curves(ds)
    >>> ends = found.where((found.kind == "flip") & (found.special == "edge"), drop=True)
    >>> ends.R.values.round(6)[:2]
    array([0.9, 0.6])
    """
    for kind in kinds:
        if kind not in CURVE_KINDS:
            meant = suggestion(near_misses(kind, CURVE_KINDS))
            raise Refused(f"there is no curve of kind {kind!r}{meant}; {choice_of(CURVE_KINDS)}")
    across, up = sweep.map_axes(axes, at)
    if len(axes) == 1:
        raise Refused(f"curves are over two swept axes, not {across} alone")
    for axis in (across, up):
        check_axis(axis, sweep[axis].values, "the map")
    sweep.check("period")
    cut = sweep.cut(at, free=[across, up]).sortby([across, up]).transpose(across, up)
    phase = cut.spec.phase
    names = [cut.nomenclature.parameter(axis) for axis in (across, up)]
    values = [cut[name].values for name in names]
    search = CurveSearch(cut.motions, names, values, phase, classes, kinds or CURVE_KINDS)
    reasons = search.run(report)
    table = _as_dataset(search.curves, names)
    of_pairs: dict[str, Counter[str]] = {}
    for i in np.flatnonzero(search.counted & ~search.explained).tolist():
        pair = " and ".join(f"{m}/{q}" for m, q in search.names[i])
        of_pairs.setdefault(reasons[i], Counter())[pair] += 1
    counts = int(search.counted.sum()), int((search.counted & search.explained).sum())
    table.attrs |= dict(zip(("changes", "explained"), counts, strict=True))
    table.attrs["summary"] = curves_summary(cut, search.curves, classes, *counts, of_pairs)
    return orbits_on_axes(sweep, table)


def _as_dataset(paths: Sequence[Branch], axes: Sequence[str]) -> xr.Dataset:
    """Collect curves as the Dataset that `curves` returns."""
    rows = with_special_points(paths, "curve", "special", axes)
    number = rows["curve"].values
    return rows.assign(
        kind=("point", np.array([curve.kind for curve in paths], "U11")[number]),
        m=("point", np.array([curve.m for curve in paths], int)[number]),
        q=("point", np.array([curve.q for curve in paths], int)[number]),
    )


def curves_summary(
    cut: OpenedSweep,
    curves: Sequence[Branch],
    classes: Collection[tuple[int, int]],
    total: int,
    explained: int,
    reasons: Mapping[str, Counter[str]],
) -> str:
    """Write lines on the curves found in a cut, and on the reasons why changes have no curve."""
    nomenclature, kinds = cut.nomenclature, Counter(curve.kind for curve in curves)
    counted = listed([f"{kinds[kind]} of {kind}s" for kind in CURVE_KINDS if kinds[kind]]) or "none"
    lines = [f"{shown_count(len(curves), 'exact curve')}: {counted}"]
    followed = {(curve.m, curve.q) for curve in curves}
    if missing := [f"{m}/{q}" for m, q in classes if (m, q) not in followed]:
        lines.append(f"no curve of {listed(missing)} is found")
    between = "between periodic classes"
    if classes:
        between = f"from or to {listed([f'{m}/{q}' for m, q in classes])}"
    if total:
        lines.append(
            f"{explained:,} of {shown_count(total, 'change')} {between} "
            f"({100.0 * explained / total:.1f} %) have a curve within one cell"
        )
    else:
        lines.append(f"there is no change {between}")
    for reason, pairs in sorted(reasons.items(), key=lambda item: -item[1].total()):
        named = [pair for pair, _ in pairs.most_common(_EXAMPLES)]
        dots = ", ..." if len(pairs) > _EXAMPLES else ""
        lines.append(f"  {pairs.total():,}: {reason} ({', '.join(named)}{dots})")
    for curve in curves:
        for point in curve.special:
            if point.kind == "lost":
                values = zip(curve.parameters, point.value.tolist(), strict=True)
                where = ", ".join(
                    f"{nomenclature.name(name)} = {nomenclature.value(name, value):g}"
                    for name, value in values
                )
                why = lost_text(len(curve.values), point.orbit.speeds)
                name = f"{curve.kind}s of {curve.m}/{curve.q}"
                lines.append(f"a curve of {name} is lost at {where}: {why}")
    return "\n".join(lines)
