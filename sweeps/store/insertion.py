"""Insert refined points into stored results along one axis."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sweeps.store.reader import SweepFile


def merged(
    sweep: SweepFile,
    axis: str,
    values: np.ndarray,
    points: Mapping[float, Mapping[str, np.ndarray]],
) -> dict[str, np.ndarray]:
    """Return the results at values of the axis: of the points, and for the others of the file.

    Parameters
    ----------
    sweep : SweepFile
        A file along `axis` alone, whose values increase.
    axis : str
    values : ndarray, shape (n,)
        In increasing order, each of the file or of `points`.
    points : mapping of float to mapping
        By the value of the axis, the results of one point.

    Returns
    -------
    dict of str to ndarray
        Arrays of shape (n, ...).
    """
    is_new = np.isin(values, list(points))
    old = sweep.layout.axes[axis]
    left, right = np.searchsorted(old, values[[0, -1]])
    stored = sweep.read((slice(int(left), int(right) + 1),))
    kept = np.isin(old[left : right + 1], values[~is_new])
    results = {}
    for name, array in stored.items():
        results[name] = np.empty((len(values), *array.shape[1:]), array.dtype)
        results[name][~is_new] = array[kept]
        for i in np.flatnonzero(is_new):
            results[name][i] = points[float(values[i])][name]
    return results
