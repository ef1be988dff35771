"""The regimes and classes of an opened sweep."""

from __future__ import annotations

import numpy as np
import xarray as xr

from sweeps.analysis.dataset import results_of
from sweeps.analysis.grouping import parameter_at_points
from vibroimpact.points.regimes import (
    OF_REGIMES,
    Label,
    Regime,
    labels_of,
    on_its_way,
    regimes_of,
)


def classify(dataset: xr.Dataset) -> np.ndarray:
    """Return the `Regime` at every point of a sweep with ``period``, in the shape of ``status``."""
    results = results_of(dataset, OF_REGIMES)
    omega = parameter_at_points(dataset, "omega").reshape(dataset["status"].shape)
    return regimes_of(results, omega, dataset.sizes["section"])


def approaching(dataset: xr.Dataset) -> np.ndarray:
    """Return the mask of the points whose motion is on its way to its orbit."""
    if "orbit_distance" not in dataset:
        return np.zeros(dataset["status"].shape, bool)
    (distance,) = results_of(dataset, ["orbit_distance"]).values()
    return on_its_way(classify(dataset), distance)


def classes_of(dataset: xr.Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return regime, m and q at every point, in the shape of ``status``; m = q = 0 if aperiodic."""
    regimes, results = classify(dataset), results_of(dataset, ("period", "period_impacts"))
    m, q = (np.where(regimes == Regime.PERIODIC, one, 0) for one in results.values())
    return regimes, m, q


def labels(line: xr.Dataset) -> list[Label | None]:
    """Return the class at every point of a line with ``period``; None if it is not known."""
    R = parameter_at_points(line, "R")
    return labels_of(classify(line), line["period"].values, line["period_impacts"].values, R)
