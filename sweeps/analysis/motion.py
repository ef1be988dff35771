"""The kind of motion at each point of a sweep: periodic, with rest, chaotic, or not known.

The kind of a point is what its record shows. The first of these that holds decides:

1. not computed, failed, or unbounded: by ``status``;
2. with rest: the mass rested on the stop during the record, after a complete chatter or, with
   R = 0, after an impact. Such a motion may be periodic, but its number of impacts depends on where
   a chatter is cut off;
3. periodic: the record repeats (`vibroimpact.points.period_class.period_class`);
4. by the larger Lyapunov exponent, where it is recorded. Over the time t of a record of k forcing
   periods, tangent vectors grow by exp(lambda_1 t). On a torus they grow linearly at the most, so
   that more than k-fold growth is chaos. From 1/k to k is neutral: a quasi-periodic motion, or a
   periodic one too close to its bifurcation to have settled. Less is a motion that settles and has
   not repeated yet, which is undecided;
5. undecided.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum

import numpy as np
import xarray as xr

from vibroimpact.status import Status


class Motion(IntEnum):
    """The kind of motion at one parameter point."""

    PENDING = 0
    FAILED = 1
    UNBOUNDED = 2
    REST = 3
    PERIODIC = 4
    CHAOTIC = 5
    NEUTRAL = 6
    UNDECIDED = 7


def has_result(status: np.ndarray) -> np.ndarray:
    """Return which points were computed and did not fail."""
    return ~np.isin(status, [outcome for outcome in Status if outcome.failed])


def classify(dataset: xr.Dataset) -> np.ndarray:
    """Return the kind of motion at every point.

    Parameters
    ----------
    dataset : Dataset
        An opened sweep, or a cut through one, with ``period``; ``lyapunov`` is used where there.

    Returns
    -------
    ndarray of int
        A `Motion` per point, in the shape of ``status``.
    """
    axes = dataset["status"].dims
    names = ("status", "rest_fraction", "period", "lyapunov")
    results = {
        name: dataset[name].transpose(*axes, ...).values for name in names if name in dataset
    }
    whole = xr.zeros_like(dataset["status"], float) + dataset["omega"]
    return kinds(results, whole.transpose(*axes).values, dataset.sizes["section"])


def kinds(results: Mapping[str, np.ndarray], omega: np.ndarray, periods: int) -> np.ndarray:
    """Return the kind of motion that results show.

    Parameters
    ----------
    results : mapping of str to ndarray
        ``status``, ``rest_fraction``, ``period`` of shape (...), and ``lyapunov`` of shape
        (..., 2) where it was computed.
    omega : ndarray, shape (...)
    periods : int
        Forcing periods of the record.

    Returns
    -------
    ndarray of int, shape (...)
        A `Motion` each.
    """
    status = results["status"]
    rules = [
        (status == Status.PENDING, Motion.PENDING),
        (~has_result(status), Motion.FAILED),
        (status == Status.UNBOUNDED, Motion.UNBOUNDED),
        (results["rest_fraction"] > 0.0, Motion.REST),
        (results["period"] > 0, Motion.PERIODIC),
    ]
    if "lyapunov" in results:
        limit = np.log(periods)
        growth = results["lyapunov"][..., 0] * (periods * 2.0 * np.pi / omega)
        rules += [(growth > limit, Motion.CHAOTIC), (growth >= -limit, Motion.NEUTRAL)]
    return np.select(
        [condition for condition, _ in rules],
        [int(motion) for _, motion in rules],
        int(Motion.UNDECIDED),
    )


def frequent_periods(period: np.ndarray, impacts: np.ndarray, count: int) -> list[tuple[int, int]]:
    """Return the most frequent (forcing periods, impacts) per repetition, in increasing order.

    Parameters
    ----------
    period, impacts : ndarray of int, shape (n,)
        Of the periodic points.
    count : int
        How many at the most.

    Returns
    -------
    list of tuple of int
    """
    pairs, numbers = np.unique(np.stack([period, impacts], axis=1), axis=0, return_counts=True)
    frequent = pairs[np.argsort(-numbers, kind="stable")[:count]]
    return sorted((int(m), int(q)) for m, q in frequent)
