"""Reads the coordinates of a `PointMotion` or continues it: at sections, impacts, in time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NoReturn, Self, TypeVar

import numpy as np
import xarray as xr

from sweeps.errors import Refused
from sweeps.grid import Grid, block_points
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.store.variables import TRAJECTORIES, VARIABLES, Variable
from sweeps.text import shown_count
from vibroimpact.oscillator import Oscillator
from vibroimpact.points.stages import RunSpec
from vibroimpact.status import Status
from vibroimpact.step.scheme import MOST_PERIODS

if TYPE_CHECKING:
    from vibroimpact.orbits.orbit import Orbits

#: Most values of a variable that are read at a time.
_VALUES_READ = 500_000

_Values = TypeVar("_Values", xr.DataArray, np.ndarray)


def values_at_point(point: OpenedSweep, names: tuple[str, ...]) -> list[np.ndarray]:
    """Read variables at one point, without padding; refuse a point that has no values."""
    columns = np.array([point[name].values for name in names])
    columns = columns[:, np.isfinite(columns).all(axis=0)]
    if not columns.size:
        refuse_unrecorded(point["status"].item(), names[0])
    return list(columns)


def refuse_unrecorded(status: int, name: str) -> NoReturn:
    """Refuse a point that has no value of a variable, and say why."""
    reason = Status(status).meaning if Status(status).failed else f"no {name} was recorded"
    raise Refused(f"there is nothing to draw at this point: {reason}")


#: The coordinates by name. The height is not in a file, but computed from x and the clearance.
COORDINATES: Mapping[str, Variable] = {
    "poincare_x": VARIABLES["poincare_x"],
    "poincare_v": VARIABLES["poincare_v"],
    "poincare_height": Variable("section", "length", "height above the stop", r"\sigma - x"),
    "impact_v": VARIABLES["impact_v"],
    "impact_phase": VARIABLES["impact_phase"],
}
#: The results from which coordinates are computed that are not in a file.
SOURCES = {"poincare_height": "poincare_x"}
#: What a diagram can have as ordinate: also the extremes of a motion, with one value each.
ORDINATES: Mapping[str, Variable] = {
    **COORDINATES,
    "peak_to_peak": Variable(
        "value", "length", "peak-to-peak displacement", r"x_\mathrm{pp}", diagnostic="extremes"
    ),
    "x_min": replace(VARIABLES["x_min"], dimension="value"),
    "x_max": replace(VARIABLES["x_max"], dimension="value"),
}


def coordinate_in(record: Mapping[Any, _Values], coordinate: str) -> _Values:
    """Return a coordinate at the points of a sweep, recorded or computed from x.

    `record` is a Dataset, or results by name and ``clearance``, which broadcasts against x.
    """
    if coordinate != "poincare_height":
        return record[coordinate]
    return -record["poincare_x"] + record["clearance"]  # with the dimensions of x in their order


def orbit_coordinates(orbits: Orbits, phase: float) -> dict[str, np.ndarray]:
    """Return the coordinates of orbits by name, in time order, shapes (n, m) and (n, q).

    The phases of the impacts increase. `phase` is the phase of the section [rad].
    """
    x, v = np.moveaxis(orbits.sections(phase), 2, 0)
    values = (x, v, orbits.points["clearance"][:, None] - x, orbits.speeds, orbits.phases)
    return dict(zip(COORDINATES, values, strict=True))


def records(sweep: OpenedSweep, name: str, at: np.ndarray) -> np.ndarray:
    """Return a coordinate at points given in C order, shape (k, record), reading in chunks."""
    width = sweep.sizes[ORDINATES[name].dimension]
    result = np.empty((len(at), width))
    for chunk, cut in in_chunks(sweep.data, width):
        rows = np.flatnonzero((at >= cut.start) & (at < cut.stop))
        if len(rows):
            values = coordinate_in(chunk, name).values.reshape(-1, width)
            result[rows] = values[at[rows] - cut.start]
    return result


def in_chunks(dataset: xr.Dataset, width: int) -> Iterator[tuple[xr.Dataset, slice]]:
    """Yield chunks of points with `width` values each, with the slice of all points in C order."""
    sizes, stop = dataset["status"].sizes, 0
    grid = Grid({str(name): np.empty(length) for name, length in sizes.items()}, {})
    for block in grid.blocks(max(1, _VALUES_READ // max(1, width))):
        start, stop = stop, stop + block_points(block)
        yield dataset.isel(dict(zip(sizes, block, strict=True))), slice(start, stop)


#: Most forcing periods of a motion that are kept: more than a picture has columns of pixels.
MOST_DRAWN = 1000


@dataclass(frozen=True)
class PointMotion:
    """The motion of one point."""

    oscillator: Oscillator
    is_exact: bool  # whether its integrator is ``exact``
    #: Time, displacement and velocity. Two columns with the same time are the states before
    #: and after an impact. Of more than the periods to keep as many are kept, evenly spread,
    #: and a column of NaN stands for the periods between them. Shape (3, n).
    rows: np.ndarray
    depth: float  # largest x - clearance in all periods [length]
    periods: int  # number of forcing periods, with those left out
    start_phase: float  # omega t where the motion of the sweep began
    turns: int  # number of forcing periods of the sweep before time 0 of the rows

    @classmethod
    def of(
        cls,
        oscillator: Oscillator,
        spec: RunSpec,
        rows: np.ndarray,
        periods: int,
        most: int,
        start_phase: float,
        turns: int = 0,
    ) -> Self:
        """Return a motion over `periods`, given its rows; keep at most so many of these."""
        depth = float(rows[1].max()) - oscillator.clearance
        turn = np.floor((rows[0] - rows[0, 0]) * (oscillator.omega / (2.0 * np.pi)) + 1e-6)
        if not (np.diff(turn) >= 0.0).all() or not turn[-1] <= periods:  # another program's file
            beyond = f"beyond its {shown_count(periods, 'forcing period')}"
            raise Refused(f"a trajectory has times out of order or {beyond}: run the sweep again")
        chosen = (turn * most) % periods < most  # all, if they are no more
        left_out = ~(chosen | np.append(False, chosen[:-1]))  # a period ends with a row
        first_left_out = left_out & ~np.append(True, left_out[:-1])
        reduced = np.where(left_out, np.nan, rows)[:, ~left_out | first_left_out]
        is_exact = spec.integrator == "exact"
        return cls(oscillator, is_exact, reduced, depth, periods, start_phase, turns)

    @property
    def impacts(self) -> np.ndarray:
        """Time, displacement and velocity just before the impacts, shape (3, k)."""
        t, _, v = self.rows
        return self.rows[:, np.append((np.diff(t) == 0.0) & (v[:-1] > 0.0), False)]

    def flow(self, per_period: int) -> np.ndarray:
        """Return the rows; for the integrator ``exact``, with `per_period` samples in between."""
        if not self.is_exact:
            return self.rows
        from vibroimpact.trajectory import exact_samples  # with the compiler

        t, x, v = self.rows
        return np.stack(exact_samples(self.oscillator, t, x, v, per_period))


def periods_shown(m: int, most: int = MOST_PERIODS, unknown: int = 4) -> int:
    """Return how many forcing periods show a motion of period m (0: unknown): two repetitions."""
    return min(max(2 * m, 4), most) if m else unknown


def motion_of(point: OpenedSweep, periods: int | None, most: int = MOST_DRAWN) -> PointMotion:
    """Return the recorded motion of a point or, over some periods, the one after its record.

    Of a point without a recorded trajectory, the periods are as many as show its motion.
    """
    if periods is None and not all(name in point for name in TRAJECTORIES):
        (label,) = point.labels
        periods = periods_shown(label.m if label else 0)
    names = TRAJECTORIES if periods is None else ("poincare_x", "poincare_v")
    columns, start_phase = values_at_point(point, names), _start_phase(point)
    oscillator, spec = point.oscillator, replace(point.spec, transient=point.transients.item())
    if periods is None:
        return PointMotion.of(oscillator, spec, np.array(columns), spec.periods, most, start_phase)
    return continue_motion(oscillator, spec, columns, periods, start_phase, most)


def _start_phase(point: OpenedSweep) -> float:
    """Return omega t where the motion of a point began: at the start, or at a section if followed.

    A point of a followed sweep begins at the start only if it is the first of its chain. After a
    point that failed the next one does, too, but a point does not know its neighbours.
    """
    spec = point.spec
    if spec.followed is not None:
        values = point.config.sweep.grid.swept[spec.followed]
        first = values.min() if point.followed_directions[0] == "up" else values.max()
        if values[np.argmin(np.abs(values - float(point[spec.followed])))] != first:
            return spec.phase
    return float(point["phase"])


def continue_motion(
    oscillator: Oscillator,
    spec: RunSpec,
    states: Sequence[np.ndarray],
    periods: int,
    start_phase: float,
    most: int = MOST_DRAWN,
) -> PointMotion:
    """Compute the motion that follows the last of the recorded section states x and v, (2, n).

    Some impact rules let the mass pass the stop, and a motion cannot start beyond the stop. Then
    the last state that is not beyond it is used. Raises Refused if there is no such state, or if
    the motion cannot be computed.
    """
    from vibroimpact.trajectory import simulate  # with the compiler

    x, v = states
    allowed = np.flatnonzero(x <= oscillator.clearance)
    if not len(allowed):
        raise Refused("every recorded state of the section is beyond the stop at this point")
    last = int(allowed[-1])
    try:
        motion = simulate(
            oscillator,
            periods,
            spec.integrator,
            spec.impact,
            spec.steps_per_period,
            x0=float(x[last]),
            v0=float(v[last]),
            phase=spec.phase,
        )
    except ValueError as error:
        raise Refused(str(error)) from error
    if motion.status.failed:
        raise Refused(f"the motion cannot be computed at this point: {motion.status.meaning}")
    turns = spec.transient + last + 1 + (start_phase > spec.phase)  # passes the section after 2 pi
    rows = np.stack([motion.t, motion.x, motion.v])
    return PointMotion.of(oscillator, spec, rows, periods, most, start_phase, turns)
