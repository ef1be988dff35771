"""Insert refined points into stored results along one axis."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sweeps.store.reader import SweepFile


def merged(
    sweep: SweepFile, values: np.ndarray, points: Mapping[float, Mapping[str, np.ndarray]]
) -> dict[str, np.ndarray]:
    """Return the results at values of the axis: of the points, and for the others of the file.

    Parameters
    ----------
    sweep : SweepFile
        A file along one axis, whose values increase.
    values : ndarray, shape (n,)
        In increasing order, each of the file or of `points`.
    points : mapping of float to mapping
        By the value of the axis, the results of one point.

    Returns
    -------
    dict of str to ndarray
        Arrays of shape (n, ...).
    """
    (old,) = sweep.layout.axes.values()
    at = np.minimum(np.searchsorted(old, values), len(old) - 1)
    stored = sweep.read((slice(int(at[0]), int(at[-1]) + 1),))
    results = {name: array[at - at[0]] for name, array in stored.items()}
    for i in np.flatnonzero(np.isin(values, list(points))):
        for name, array in results.items():
            array[i] = points[float(values[i])][name]
    return results
