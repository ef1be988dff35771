"""The coordinates that a sweep records at sections and impacts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

import numpy as np
import xarray as xr

from sweeps.errors import Refused
from sweeps.grid import Grid, block_points
from sweeps.opened.opened_sweep import OpenedSweep, Selection
from sweeps.store.variables import VARIABLES, Variable
from sweeps.text import listed
from vibroimpact.status import Status

if TYPE_CHECKING:
    from vibroimpact.orbits.orbit import Orbits

#: Number of section states read at a time.
_STATES_READ = 500_000

_Values = TypeVar("_Values", xr.DataArray, np.ndarray)


def recorded(
    sweep: OpenedSweep, names: tuple[str, ...], at: Selection | None
) -> tuple[OpenedSweep, list[np.ndarray]]:
    """Read variables at one point, without padding; refuse a point that has no values."""
    missing = [name for name in names if name not in sweep]
    if missing:
        raise Refused(f"the file has no {listed(missing)}: record it and run the sweep again")
    point = sweep.cut(at)
    columns = np.array([point[name].values for name in names])
    columns = columns[:, np.isfinite(columns).all(axis=0)]
    if not columns.size:
        refuse_unrecorded(point["status"].item(), names[0])
    return point, list(columns)


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


def recorded_coordinate(record: Mapping[Any, _Values], coordinate: str) -> _Values:
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
    """Return a coordinate at points given in C order, shape (k, record), reading in parts."""
    width = sweep.sizes[COORDINATES[name].dimension]
    result = np.empty((len(at), width))
    for part, cut in in_parts(sweep.data, _STATES_READ // width):
        wanted = np.flatnonzero((at >= cut.start) & (at < cut.stop))
        if len(wanted):
            values = recorded_coordinate(part, name).values.reshape(-1, width)
            result[wanted] = values[at[wanted] - cut.start]
    return result


def in_parts(dataset: xr.Dataset, size: int) -> Iterator[tuple[xr.Dataset, slice]]:
    """Yield parts of at most `size` points (at least 1), each with its slice of all in C order."""
    sizes, stop = dataset["status"].sizes, 0
    grid = Grid({str(name): np.empty(length) for name, length in sizes.items()}, {})
    for block in grid.blocks(max(1, size)):
        start, stop = stop, stop + block_points(block)
        yield dataset.isel(dict(zip(sizes, block, strict=True))), slice(start, stop)
