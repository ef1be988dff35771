"""The longest stable step: in closed form, from the map of a step, and from runs.

Without force and stop, eq. (1) has the single number zeta = h / p, and a step adds p T. The runs
use the kernel.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from vibroimpact import integrate
from vibroimpact.oscillator import POINT
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.stability import is_stable, spectral_radius

#: h / p of the table: none, light, half critical, critical, twice critical.
ZETAS = np.array([0.0, 0.1, 0.5, 1.0, 2.0])
#: A limit beyond this p T counts as none.
LONGEST = 10.0
#: The chart goes up to this p T and this h / p.
CHART = (4.0, 2.0)

#: Steps of a run, and of a quick one. Growth by less than ``SEEN`` / steps a step is not seen.
STEPS, STEPS_QUICK = 200_000, 20_000
SEEN = 1.5 * math.log(2.0)

_PER_PERIOD = 100
# A bracket of the limit is cut into so many parts, which fill the lanes of the kernel, so often.
_PARTS, _CUTS = 7, 9


class Limits(NamedTuple):
    """The greatest stable p T of one integrator, at ``ZETAS``; inf where there is none.

    Attributes
    ----------
    closed, radius, run : ndarray, shape (5,)
        From the table of integrators, from the spectral radius of the map, and from runs.
    """

    closed: np.ndarray
    radius: np.ndarray
    run: np.ndarray


class Chart(NamedTuple):
    """Spectral radii over p T (columns) and h / p (rows).

    Attributes
    ----------
    step, zeta : ndarray, shape (columns,) and (rows,)
    radius : dict of str to ndarray, shape (rows, columns)
        By integrator.
    """

    step: np.ndarray
    zeta: np.ndarray
    radius: dict[str, np.ndarray]


def limits(quick: bool = False) -> dict[str, Limits]:
    """Return the limits of every integrator, by name; `quick` shortens the runs."""
    steps = STEPS_QUICK if quick else STEPS
    return {
        name: Limits(
            closed=integrator.limit(ZETAS),
            radius=_first(partial(_unstable, name)),
            run=_first(partial(grows, name, zeta=ZETAS, steps=steps)),
        )
        for name, integrator in INTEGRATORS.items()
    }


def chart(quick: bool = False) -> Chart:
    """Return the spectral radius of every integrator; `quick` takes a coarser mesh."""
    columns, rows = (81, 41) if quick else (401, 201)
    step, zeta = np.linspace(0.0, CHART[0], columns), np.linspace(0.0, CHART[1], rows)
    radius = {name: spectral_radius(name, step, zeta[:, None]) for name in INTEGRATORS}
    return Chart(step, zeta, radius)


def grows(integrator: str, step: np.ndarray, zeta: np.ndarray, steps: int) -> np.ndarray:
    """Whether free motion grows in a run of the kernel.

    It does where its greatest section in the last third of the run is more than twice that in the
    first third, or no number any more.

    Parameters
    ----------
    integrator : str
    step, zeta : ndarray
        p T and h / p, of shapes that broadcast.
    steps : int
        Length of the run.

    Returns
    -------
    ndarray of bool
    """
    step, zeta = np.broadcast_arrays(step, zeta)
    points = np.zeros(step.size, dtype=POINT)
    points["h"], points["p"] = zeta.ravel(), 1.0
    points["omega"] = 2.0 * math.pi / (_PER_PERIOD * step.ravel())
    points["clearance"], points["x0"] = np.finfo(float).max, -1.0
    periods = steps // _PER_PERIOD
    out = integrate(
        points,
        integrator=integrator,
        impact="plain",
        steps_per_period=_PER_PERIOD,
        transient=0,
        periods=periods,
        impacts=0,
    )
    size = np.maximum(np.abs(out["poincare_x"]), np.abs(out["poincare_v"]))
    first, last = size[:, : periods // 3], size[:, -(periods // 3) :]
    return ~(last.max(axis=1) <= 2.0 * first.max(axis=1)).reshape(step.shape)


def _unstable(integrator: str, step: np.ndarray) -> np.ndarray:
    return ~is_stable(integrator, step, ZETAS)


def _first(unstable: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Return the least p T at which `unstable` holds, at each of ``ZETAS``; inf beyond LONGEST."""
    low, high = np.zeros_like(ZETAS), np.full_like(ZETAS, LONGEST)
    none = ~unstable(high)
    columns = np.arange(ZETAS.size)
    for _ in range(_CUTS):
        marks = np.linspace(low, high, _PARTS + 1)
        beyond = np.vstack([unstable(marks[1:-1]), np.ones_like(none)])
        k = beyond.argmax(axis=0)
        low, high = marks[k, columns], marks[k + 1, columns]
    return np.where(none, math.inf, high)
