"""The coordinates that a sweep records at sections and impacts, and which of them are missing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NoReturn

import numpy as np
import xarray as xr

from sweeps.analysis.cuts import Selection, select
from sweeps.analysis.dataset import config_of
from sweeps.errors import Refused
from sweeps.store.variables import VARIABLES, Variable
from sweeps.text import listed
from vibroimpact.status import Status

if TYPE_CHECKING:
    from vibroimpact.orbits.orbit import PeriodicOrbit


def recorded(
    dataset: xr.Dataset, names: tuple[str, ...], at: Selection | None
) -> tuple[xr.Dataset, list[np.ndarray]]:
    """Read variables at one point, without padding; refuse a point that has no values."""
    missing = [name for name in names if name not in dataset]
    if missing:
        raise Refused(f"the file has no {listed(missing)}: record it and run the sweep again")
    point = select(dataset, at)
    columns = np.array([point[name].values for name in names])
    columns = columns[:, np.isfinite(columns).all(axis=0)]
    if not columns.size:
        refuse_unrecorded(point, names[0])
    return point, list(columns)


def refuse_unrecorded(point: xr.Dataset, name: str) -> NoReturn:
    """Refuse a point that has no value of a variable, and say why."""
    status = Status(int(point["status"]))
    reason = status.meaning if status.failed else f"no {name} was recorded"
    raise Refused(f"there is nothing to draw at this point: {reason}")


#: The coordinates by name. The height is not in a file, but computed from x and the clearance.
COORDINATES: Mapping[str, Variable] = {
    "poincare_x": VARIABLES["poincare_x"],
    "poincare_v": VARIABLES["poincare_v"],
    "poincare_height": Variable("section", "length", "height above the stop", r"\sigma - x"),
    "impact_v": VARIABLES["impact_v"],
    "impact_phase": VARIABLES["impact_phase"],
}


def recorded_coordinate(dataset: xr.Dataset, coordinate: str) -> xr.DataArray:
    """Return a coordinate at the points of a sweep, read from the file or computed from x."""
    if coordinate != "poincare_height":
        return dataset[coordinate]
    x = dataset["poincare_x"]
    return (dataset["clearance"] - x).transpose(*x.dims)


def impacts_met(dataset: xr.Dataset) -> np.ndarray:
    """Return the number of impacts during the record of every point, in the shape of ``status``."""
    per_period = dataset["impacts_per_period"].transpose(*dataset["status"].dims).values
    return np.rint(np.nan_to_num(per_period) * config_of(dataset).record.periods).astype(int)


def impacts_left_out(dataset: xr.Dataset) -> str:
    """Say how many impacts of the record were kept at most; empty if all were."""
    kept, most = dataset.sizes["impact"], int(impacts_met(dataset).max(initial=0))
    several = "up to " if dataset["status"].size > 1 else ""
    return f"last {kept:,} of {several}{most:,} impacts" if most > kept else ""


def shows_part(dataset: xr.Dataset) -> np.ndarray:
    """Return the mask of the points of which the kept impacts are less than a repetition.

    Where no class is known, the impacts of a forcing period count.
    """
    repetition = dataset["impacts_per_period"]
    if "period" in dataset:
        repetition = dataset["period_impacts"].where(dataset["period"] > 0, repetition)
    kept = dataset.sizes["impact"]
    longer: np.ndarray = repetition.transpose(*dataset["status"].dims).values > kept
    return longer & (impacts_met(dataset) > kept)


def orbit_coordinates(orbit: PeriodicOrbit, phase: float) -> dict[str, np.ndarray]:
    """Return the coordinates of an orbit by name, in time order, shapes (m,) and (q,).

    The phases of the impacts increase. `phase` is the phase of the section [rad].
    """
    x, v = orbit.sections(phase).T
    values = (x, v, orbit.oscillator.clearance - x, orbit.speeds, orbit.phases)
    return dict(zip(COORDINATES, values, strict=True))
