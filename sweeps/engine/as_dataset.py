"""Results in memory in the form of an opened file, so that all analyses can read them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from sweeps.config.sweep import SweepConfig
from sweeps.store import VARIABLES


def as_dataset(
    config: SweepConfig, axes: Mapping[str, np.ndarray], results: Mapping[str, np.ndarray]
) -> xr.Dataset:
    """Return results of a sweep as an opened file has them.

    Parameters
    ----------
    config : SweepConfig
    axes : mapping of str to ndarray
        The swept parameters and their values at these points, slowest first.
    results : mapping of str to ndarray
        The variables of the file, arrays of shape (points, ...), in C order over the axes.
    """
    shape = tuple(map(len, axes.values()))
    variables = {}
    for name, values in results.items():
        record = VARIABLES[name].record
        dimensions = (*axes, record) if record else tuple(axes)
        variables[name] = (dimensions, values.reshape((*shape, *values.shape[1:])))
    section = config.record.transient + 1 + np.arange(config.record.periods)
    attributes = {"name": config.name, "configuration": config.to_yaml()}
    return xr.Dataset(variables, {**config.grid.fixed, **axes, "section": section}, attributes)
