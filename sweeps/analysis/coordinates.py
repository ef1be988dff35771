"""The coordinates of the motion: what a diagram shows of a record, or of an exact orbit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from sweeps.store.variables import VARIABLES, Variable
from vibroimpact.orbits.periodic import PeriodicOrbit

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


def orbit_coordinate(orbit: PeriodicOrbit, coordinate: str, phase: float) -> np.ndarray:
    """Return a coordinate of an orbit, in time order.

    Parameters
    ----------
    orbit : PeriodicOrbit
    coordinate : str
        One of ``COORDINATES``.
    phase : float
        Of the section [rad].

    Returns
    -------
    ndarray, shape (m,) or (q,)
    """
    if coordinate == "impact_v":
        return orbit.speeds
    if coordinate == "impact_phase":
        return orbit.phases % (2.0 * np.pi)
    x, v = orbit.sections(phase).T
    if coordinate == "poincare_height":
        return orbit.oscillator.clearance - x
    return v if coordinate == "poincare_v" else x
