"""The coordinates of the motion: what a diagram shows of a record, or of an exact orbit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from sweeps.store.variables import VARIABLES, Variable
from vibroimpact.orbits.orbit import PeriodicOrbit

#: The coordinates by name; the height is not in a file, but follows from x and the clearance.
COORDINATES: Mapping[str, Variable] = {
    "poincare_x": VARIABLES["poincare_x"],
    "poincare_v": VARIABLES["poincare_v"],
    "poincare_height": Variable("section", "length", "height above the stop", r"\sigma - x"),
    "impact_v": VARIABLES["impact_v"],
    "impact_phase": VARIABLES["impact_phase"],
}


def recorded_coordinate(dataset: xr.Dataset, coordinate: str) -> xr.DataArray:
    """Return a coordinate at the points of a sweep, as read from the file or computed from x."""
    if coordinate != "poincare_height":
        return dataset[coordinate]
    x = dataset["poincare_x"]
    return (dataset["clearance"] - x).transpose(*x.dims)


def orbit_coordinates(orbit: PeriodicOrbit, phase: float) -> dict[str, np.ndarray]:
    """Return the coordinates of an orbit by name, in time order, shapes (m,) and (q,).

    The phases of the impacts increase; `phase` is that of the section [rad].
    """
    x, v = orbit.sections(phase).T
    values = (x, v, orbit.oscillator.clearance - x, orbit.speeds, orbit.phases)
    return dict(zip(COORDINATES, values, strict=True))
