"""The exact curves over a map as a Dataset, and a summary: the borders of its tongues."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np
import xarray as xr

from sweeps.bifurcation.curve_search import CurveSearch
from sweeps.bifurcation.exact_branches import check_axis, with_special_points
from sweeps.errors import Refused
from sweeps.opened.doors import takes_sweep
from sweeps.opened.opened_sweep import OpenedSweep, Selection
from sweeps.text import choice_of, listed, near_miss, shown_count, suggestion
from vibroimpact.orbits.branches import Branch
from vibroimpact.orbits.continuation import lost_text
from vibroimpact.orbits.curves import CURVE_KINDS

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
    axes : sequence of str, optional
        Abscissa and ordinate, by default those of a map.
    at : mapping of str to float, optional
        Values of the other swept axes; by default the first.
    report : callable, optional
        Called before each curve with the share of the changes that have a curve or a reason; an
        exception that it raises ends the work.
    classes : collection of (int, int), optional
        m and q of the curves to follow, by default all; no others are followed on the way.
    kinds : collection of str, optional
        ``flip``, ``fold`` or ``graze``: the kinds of the curves to follow, by default all.

    Returns
    -------
    Dataset
        Along ``point``, curve after curve, each followed by its special points: the two axes,
        ``curve`` (the number of the curve), ``kind``, ``m`` and ``q`` of the curve, and
        ``special``, the kind of a special point, empty for all other points. The attribute
        ``changes`` counts the changes between periodic classes, of which one is among `classes`, if
        given; ``explained`` counts those with such a curve within one cell; ``curves_summary``
        says why the others have none.

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
    kinds = [kinds] if isinstance(kinds, str) else kinds
    for kind in kinds:
        if kind not in CURVE_KINDS:
            meant = suggestion(near_miss(kind, CURVE_KINDS))
            raise Refused(f"there is no curve of kind {kind!r}{meant}; {choice_of(CURVE_KINDS)}")
    chosen = [axes] if isinstance(axes, str) else axes
    across, up = sweep.map_axes(chosen, at)
    if len(chosen) == 1:
        raise Refused(f"curves are over two swept axes, not {across} alone")
    for axis in (across, up):
        check_axis(axis, sweep[axis].values, "the map")
    sweep.check_diagnostic("period")
    cut = sweep.cut(at, free=[across, up]).sortby([across, up]).transpose(across, up)
    phase = cut.config.record.phase
    names = [cut.nomenclature.parameter(axis) for axis in (across, up)]
    values = [cut[name].values for name in names]
    search = CurveSearch(cut.motions, names, values, phase, classes, kinds or CURVE_KINDS)
    reasons = search.run(report)
    found = _as_dataset(search.curves, names)
    of_pairs: dict[str, Counter[str]] = {}
    for i in np.flatnonzero(search.counted & ~search.explained).tolist():
        pair = " and ".join(f"{m}/{q}" for m, q in search.names[i])
        of_pairs.setdefault(reasons[i], Counter())[pair] += 1
    counts = int(search.counted.sum()), int((search.counted & search.explained).sum())
    found.attrs |= dict(zip(("changes", "explained"), counts, strict=True))
    found.attrs["summary"] = curves_summary(cut, search.curves, classes, *counts, of_pairs)
    return sweep.orbits_on_axes(found)


def _as_dataset(found: Sequence[Branch], axes: Sequence[str]) -> xr.Dataset:
    """Collect curves as the Dataset that `curves` returns."""
    rows = with_special_points(found, "curve", "special", axes)
    number = rows["curve"].values
    return rows.assign(
        kind=("point", np.array([curve.kind for curve in found], "U11")[number]),
        m=("point", np.array([curve.m for curve in found], int)[number]),
        q=("point", np.array([curve.q for curve in found], int)[number]),
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
    seen, kinds = cut.nomenclature, Counter(curve.kind for curve in curves)
    counted = listed([f"{kinds[kind]} of {kind}s" for kind in CURVE_KINDS if kinds[kind]]) or "none"
    lines = [f"{shown_count(len(curves), 'exact curve')}: {counted}"]
    found = {(curve.m, curve.q) for curve in curves}
    if missing := [f"{m}/{q}" for m, q in classes if (m, q) not in found]:
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
                    f"{seen.name(name)} = {seen.value(name, value):g}" for name, value in values
                )
                why = lost_text(len(curve.values), point.orbit.speeds)
                name = f"{curve.kind}s of {curve.m}/{curve.q}"
                lines.append(f"a curve of {name} is lost at {where}: {why}")
    return "\n".join(lines)
