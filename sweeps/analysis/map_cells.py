"""The cells of a map from which its exact curves are sought.

These are the changes between periodic classes, and the middles of the large regions of a class.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vibroimpact.points.regimes import Regime

#: Most steps from one side of a change to the other: a share of the axis, but at least a few cells.
WIDEST_GAP, FEW = 0.05, 3.0
#: Least share of the map that a large region covers.
LARGE = 0.01


def changes(classes: np.ndarray, regimes: np.ndarray) -> np.ndarray:
    """Return the two cells of every change along a row or a column, shape (changes, 2, 2).

    `classes` are m and q of each cell, 0 if it is not periodic. The cells between the two have no
    class, or are chaotic: a known rest or a motion without bound ends the search.
    """
    known = np.argwhere(np.isin(regimes, [Regime.PERIODIC, Regime.REST, Regime.UNBOUNDED]))
    found = [np.empty((0, 2, 2), int)]
    for axis in (0, 1):
        widest = max(FEW, WIDEST_GAP * regimes.shape[axis])
        cells = known[np.lexsort((known[:, axis], known[:, 1 - axis]))]
        pairs = np.stack([cells[:-1], cells[1:]], axis=1)
        steps = pairs[:, 1] - pairs[:, 0]
        before, after = classes[*pairs[:, 0].T], classes[*pairs[:, 1].T]
        is_change = (before != after).any(axis=1) & (before[:, 0] > 0) & (after[:, 0] > 0)
        found.append(pairs[is_change & (steps[:, 1 - axis] == 0) & (steps[:, axis] <= widest)])
    return np.concatenate(found)


def steps_between(changes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the middles of all steps from cell to cell of changes, and whose steps they are."""
    first, last = changes.transpose(1, 0, 2)
    counts = (last - first).max(axis=1)
    owners = np.repeat(np.arange(len(changes)), counts)
    before = np.arange(len(owners)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (before + 0.5) / counts[owners]
    return owners, first[owners] + share[:, None] * (last - first)[owners]


def middles_of_regions(classes: np.ndarray) -> Iterator[tuple[np.ndarray, int]]:
    """Yield the middle of every large region of a class where it is widest, for each axis.

    If all regions of a class are small but cover much of the map together, the largest counts.
    """
    from scipy.ndimage import label

    flat = classes.reshape(-1, 2)
    names, counts = np.unique(flat[flat[:, 0] > 0], axis=0, return_counts=True)
    for name in names[counts >= LARGE * len(flat)]:
        regions, _ = label((classes == name).all(axis=2))
        sizes = np.bincount(regions.ravel())[1:]
        for number in np.flatnonzero(sizes >= min(LARGE * len(flat), sizes.max())) + 1:
            inside = regions == number
            for axis in (0, 1):
                widest = int(np.argmax(inside.sum(axis=axis)))
                within = np.flatnonzero(inside.take(widest, axis=1 - axis))
                middle = int(within[len(within) // 2])
                yield np.array([middle, widest] if axis == 0 else [widest, middle]), axis
