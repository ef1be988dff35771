"""Measures the integrity of basins: discs, distances to the edge.

The measures are those of Soliman & Thompson (1989, J. Sound Vib. 135, 453-475) and Rega & Lenci
(2005, Nonlinear Anal. 63, 902-914). Nothing is known between the starts, so the accuracy of both
distances is their spacing.

Outside the basin are all starts that reach another attractor, have no result or are unknown, and
all beyond the window, where nothing is known: one more row of starts around it stands for them. A
measure that would be greater without this row is a lower bound: the edge of the window decided it.
No disturbance leads beyond the stop: where the window reaches it, nothing counts as outside, and
the stop cuts off the disc.
"""

from __future__ import annotations

import math

import numpy as np
import xarray as xr

from sweeps.attractor.attractors import COUNTED, attractors
from sweeps.errors import Refused
from sweeps.opened.doors import takes_sweep
from sweeps.opened.motions import run_on
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.store.variables import description_in
from sweeps.text import listed

#: The variables that `integrity` adds, with their meanings and units.
_BASIN_MEASURES = {
    "integrity_factor": ("radius of the largest disc in the basin", "length"),
    "disc_x": ("displacement at the centre of the disc", "length"),
    "disc_v": ("velocity at the centre of the disc", "length/time"),
    "factor_at_edge": ("whether the edge of the window decided the integrity factor", "1"),
    "local_integrity": ("distance to the nearest start outside the basin", "length"),
    "local_at_edge": ("whether the edge of the window decided the local integrity measure", "1"),
}
#: Share of a spacing by which evenly spaced values may differ.
_EVEN = 1e-6


@takes_sweep({})
def integrity(sweep: OpenedSweep) -> xr.Dataset:
    """Measure how large a disturbance each attractor takes, at every parameter point.

    Distances are sqrt(dx^2 + (dv / p)^2), right to one spacing of the starts.

    Parameters
    ----------
    sweep : Dataset
        An opened sweep over evenly spaced x0 and v0, with ``period`` and a section at
        the phase of the starts.

    Returns
    -------
    Dataset
        The result of `sweeps.attractors`, whose ``fraction`` is the global integrity measure, and
        in the same shape, with NaN for motions that are not counted as attractors:

        - ``integrity_factor`` [length]: the radius of the largest disc in the basin about a start
          (``disc_x``, ``disc_v``);
        - ``local_integrity`` [length]: the distance from the states of the attractor at the section
          to the nearest start outside the basin; 0 if it leaves the window by more than half a
          spacing of the starts;
        - ``factor_at_edge``, ``local_at_edge``: whether the edge of the window decided the measure,
          which is then a lower bound.

    Raises
    ------
    Refused
        If the file has no period or section, or not these axes; if the section is at another phase,
        or the sweep was followed.

    Examples
    --------
    >>> ds = sweeps.open_sweep("basins.h5")  # of the example of `attractors`
    >>> sweeps.integrity(ds)["integrity_factor"].values.round(3)
    array([1.091, 0.455])
    """
    refuse_unfit(sweep)
    return with_measures(sweep, attractors(sweep))


def with_measures(sweep: OpenedSweep, result: xr.Dataset) -> xr.Dataset:
    """Return the attractors found in a sweep with their measures."""
    spec = sweep.spec
    starts = result["attractor"].sortby(["x0", "v0"]).transpose(..., "x0", "v0")
    x, v = starts["x0"].values, starts["v0"].values
    grid = (-1, result.sizes["coexisting"])
    number, m = (result[name].values.reshape(grid) for name in ("number", "m"))
    at = np.nonzero(np.isin(result["motion"].values.reshape(grid), COUNTED))
    state = (result[name].values.reshape(grid)[at] for name in ("section_x", "section_v"))
    points = sweep.isel({"x0": 0, "v0": 0}).points[at[0]]
    points["x0"], points["v0"] = state
    periods = np.where(m[at] > 0, m[at], spec.periods)  # a record if m is not known
    sections, _ = run_on(spec, points, int(periods.max(initial=1)))
    measures = np.full((len(_BASIN_MEASURES), *number.shape), np.nan)
    for n, (i, k) in enumerate(zip(*at, strict=True)):
        basin = starts.values.reshape(-1, len(x), len(v))[i] == number[i, k]
        w = 1.0 / points["p"][n]
        states = sections[n, : periods[n]]
        measures[:, i, k] = measures_of(basin, x, v, w, points["clearance"][n], states)
    for (name, meaning), values in zip(_BASIN_MEASURES.items(), measures, strict=True):
        shaped = values.reshape(result["number"].shape)
        shaped = shaped == 1.0 if name.endswith("edge") else shaped
        result[name] = (result["number"].dims, shaped, description_in(sweep.attrs, *meaning))
    return result


def measures_of(
    basin: np.ndarray,
    x: np.ndarray,
    v: np.ndarray,
    weight: float,
    clearance: float,
    states: np.ndarray,
) -> tuple[float, ...]:
    """Return the measures, in the order of ``_BASIN_MEASURES``, of an attractor with states (n, 2).

    `basin` is the mask of the starts in its basin, over the increasing, evenly spaced values of x
    and v.
    """
    from scipy.ndimage import distance_transform_edt
    from scipy.spatial import KDTree

    step = np.array([x[1] - x[0], v[1] - v[0]])
    size = 2.0 ** math.frexp(step[0])[1]  # in which no square of a distance overflows or vanishes
    unit = np.array([1.0, weight]) / size
    # One more value at each end, at the same spacing.
    wide = [np.pad(values, 1, "reflect", reflect_type="odd") for values in (x, v)]
    # Beyond the stop nothing is outside the basin, also with starts in the middle of equal cells:
    # half a spacing, whatever its rounding.
    at_stop = clearance - x[-1] <= (0.5 + _EVEN) * step[0]
    beyond = np.maximum([x[0], v[0]] - states, states - [np.inf if at_stop else x[-1], v[-1]])
    measures = []
    for is_open in (False, True):  # the window: all beyond it counts as outside, or nothing
        inside = np.pad(basin, 1, constant_values=is_open)
        inside[-1] |= at_stop
        away = np.full(basin.shape, np.inf)
        if not inside.all():
            away = distance_transform_edt(inside, sampling=step * unit)[1:-1, 1:-1]
        starts = np.stack([c[k] for c, k in zip(wide, np.nonzero(~inside), strict=True)], axis=1)
        local = KDTree(starts * unit).query(states * unit)[0].min()
        if not is_open and (beyond > 0.5 * step).any():
            local = 0.0  # the start nearest to a state is not in the window
        measures.append((away, local))
    (away, local), (open_away, open_local) = measures
    disc = np.unravel_index(away.argmax(), away.shape)
    factor_at_edge, local_at_edge = open_away.max() > away[disc], open_local > local
    return size * away[disc], x[disc[0]], v[disc[1]], factor_at_edge, size * local, local_at_edge


def refuse_unfit(sweep: OpenedSweep) -> None:
    """Refuse a sweep whose starts are not a regular window at the phase of its section."""
    axes, spec = sweep.axes, sweep.spec
    if not {"x0", "v0"} <= set(axes):
        raise Refused(f"integrity needs x0 and v0 as axes; the file has {listed(axes) or 'none'}")
    if spec.followed is not None:
        raise Refused("integrity needs starts at every point: run the sweep again without follow")
    if "phase" in axes:
        raise Refused(
            f"integrity needs starts at one phase; fix phase at that of the section, {spec.phase:g}"
        )
    start, section = float(sweep["phase"]), spec.phase
    if section != start:
        raise Refused(
            f"the starts are at omega t = {start:g}, and the section is at {section:g}: run the "
            f"sweep again with record.phase: {start:g}"
        )
    for name in ("x0", "v0"):
        steps = np.diff(np.sort(sweep[name].values))
        if not len(steps):
            raise Refused(f"integrity needs two or more values of {name}; the file has one")
        if np.ptp(steps) > _EVEN * steps.max():
            raise Refused(f"the values of {name} are not evenly spaced; expected: start, stop, num")
