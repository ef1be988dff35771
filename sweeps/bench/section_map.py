"""The section map of a method, x(0) -> x(2 pi / omega), its Jacobian, flip and Lyapunov exponent.

A method is a map of its own: its flips and Lyapunov exponents are those of that map, not of the
motion that it approximates. Its Jacobian is taken by differences, all of them in one batch.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sweeps.bench.scenes import Method
from vibroimpact import Oscillator, integrate, one_impact_orbit
from vibroimpact.step.integrators import exact


class _Difference(NamedTuple):
    """A derivative by differences: sum of weights times values at the offsets."""

    offsets: np.ndarray
    weights: np.ndarray


# Fourth order for smooth maps; second order with small offsets for maps that are smooth only on
# short intervals, as beside a graze.
_SMOOTH = _Difference(
    1e-4 * np.array([-2.0, -1.0, 1.0, 2.0]), np.array([1.0, -8.0, 8.0, -1.0]) / 12e-4
)
_NARROW = _Difference(1e-6 * np.array([-1.0, 1.0]), np.array([-1.0, 1.0]) / 2e-6)

_LANES, _ZOOMS, _ITERATIONS = 33, 4, 12


def section_map(
    points: np.ndarray, method: Method, steps: int, threads: int | None = None
) -> np.ndarray:
    """Return the states, shape (n, 2), one forcing period after the points' starts at t = 0."""
    run = integrate(
        points,
        **method._asdict(),
        steps_per_period=steps,
        transient=0,
        periods=1,
        impacts=0,
        threads=threads,
    )
    return np.stack([run["poincare_x"][:, 0], run["poincare_v"][:, 0]], axis=1)


def jacobians(
    points: np.ndarray,
    method: Method,
    steps: int,
    difference: _Difference = _SMOOTH,
    threads: int | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the images (n, 2) of the points' starts, and the Jacobians (n, 2, 2) there."""
    offsets, weights = difference
    size = len(offsets)
    neighbours = np.repeat(points[:, None], 1 + 2 * size, axis=1)
    neighbours["x0"][:, 1 : 1 + size] += offsets
    neighbours["v0"][:, 1 + size :] += offsets
    # No motion starts beyond the stop.
    neighbours["x0"] = np.minimum(neighbours["x0"], neighbours["clearance"])
    images = section_map(neighbours.ravel(), method, steps, threads).reshape(*neighbours.shape, 2)
    along_x = np.einsum("k,nki->ni", weights, images[:, 1 : 1 + size])
    along_v = np.einsum("k,nki->ni", weights, images[:, 1 + size :])
    return images[:, 0], np.stack([along_x, along_v], axis=2)


def flip_value(
    oscillator: Oscillator,
    bracket: tuple[float, float],
    method: Method,
    steps: int,
    threads: int | None = None,
) -> float:
    """Return the omega at which the period-1 orbit of a method's section map flips.

    The fixed points on a grid of omega, by Newton's method on all at once, show where
    1 + trace + det of the Jacobian changes its sign; the grid is narrowed to that interval.

    Parameters
    ----------
    oscillator : Oscillator
        Near the flip: its one-impact orbit is the first guess, and of several changes of sign
        the nearest to its omega is taken.
    bracket : tuple of float
        The interval of omega that is searched.

    Returns
    -------
    float
        NaN where the sign does not change: the map has no flip.
    """
    low, high = bracket
    start = _section_state(oscillator)
    points = np.repeat(oscillator.at(*start), _LANES)
    omega = value = np.empty(0)
    left = 0
    for _ in range(_ZOOMS):
        omega = points["omega"] = np.linspace(low, high, _LANES)
        points["x0"], points["v0"] = start
        value = _flip_condition(points, method, steps, threads)
        changes = np.flatnonzero(value[:-1] * value[1:] <= 0.0)
        if not len(changes):
            return math.nan
        left = changes[np.argmin(np.abs(omega[changes] - oscillator.omega))]
        low, high = omega[left], omega[left + 1]
        start = points["x0"][left], points["v0"][left]
    rise = value[left + 1] - value[left]
    return float(low - value[left] * (high - low) / rise) if rise else float(low)


def _section_state(oscillator: Oscillator) -> tuple[float, float]:
    """Return the state of the one-impact orbit at omega t = 0 (mod 2 pi)."""
    orbit, point = one_impact_orbit(oscillator), oscillator.at(oscillator.clearance)[0]
    left = (2.0 * math.pi - orbit.phase) / oscillator.omega
    s, c = math.sin(orbit.phase), math.cos(orbit.phase)
    x, v = exact(oscillator.clearance, -oscillator.R * orbit.v, s, c, left, point)
    return x, v


def _flip_condition(
    points: np.ndarray, method: Method, steps: int, threads: int | None
) -> np.ndarray:
    """Move the points' starts to the fixed points; return 1 + trace + det there.

    NaN where Newton's method does not converge.
    """
    size = 1e-9 * (np.abs(points["x0"]) + np.abs(points["v0"]))
    for _ in range(_ITERATIONS):
        images, J = jacobians(points, method, steps, _SMOOTH, threads)
        residual = images - np.stack([points["x0"], points["v0"]], axis=1)
        if not (np.abs(residual).max(axis=1) > 1e-4 * size).any():
            break
        a, b = 1.0 - J[:, 0, 0], -J[:, 0, 1]
        c, d = -J[:, 1, 0], 1.0 - J[:, 1, 1]
        with np.errstate(all="ignore"):
            det = a * d - b * c
            dx = (d * residual[:, 0] - b * residual[:, 1]) / det
            dv = (a * residual[:, 1] - c * residual[:, 0]) / det
            # An orbit is not farther than that from its neighbour on the grid.
            points["x0"] = np.minimum(
                points["x0"] + np.clip(dx, -0.1, 0.1), points["clearance"] - _SMOOTH.offsets[-1]
            )
            points["v0"] += np.clip(dv, -0.1, 0.1)
    converged = np.abs(residual).max(axis=1) <= size
    condition = 1.0 + J[:, 0, 0] + J[:, 1, 1]
    condition += J[:, 0, 0] * J[:, 1, 1] - J[:, 0, 1] * J[:, 1, 0]
    return np.where(converged, condition, np.nan)


def largest_exponent(
    points: np.ndarray,
    method: Method,
    steps: int,
    transient: int,
    periods: int,
    threads: int | None = None,
) -> float:
    """Return the largest Lyapunov exponent per forcing period, from a method's own Jacobians.

    A tangent vector is carried through the Jacobians at the sections of every orbit, and its
    growth averaged over orbits and periods. The first tenth of them only turns it.

    Parameters
    ----------
    points : ndarray of dtype ``POINT``, shape (n,)
        Starts of the orbits.
    transient, periods : int
        Forcing periods left out, and those in which the growth is taken.

    Returns
    -------
    float
        NaN or -inf where an orbit failed or forgot its past.
    """
    run = integrate(
        points,
        **method._asdict(),
        steps_per_period=steps,
        transient=transient,
        periods=periods,
        impacts=0,
        threads=threads,
    )
    starts = np.repeat(points, periods)
    starts["x0"], starts["v0"] = run["poincare_x"].ravel(), run["poincare_v"].ravel()
    _, J = jacobians(starts, method, steps, _NARROW, threads)
    J = J.reshape(len(points), periods, 2, 2)
    tangent = np.tile([1.0, 0.0], (len(points), 1))
    growth = np.empty((periods, len(points)))
    with np.errstate(all="ignore"):
        for k in range(periods):
            tangent = np.einsum("nij,nj->ni", J[:, k], tangent)
            length = np.hypot(tangent[:, 0], tangent[:, 1])
            growth[k] = np.log(length)
            tangent /= length[:, None]
    return float(growth[periods // 10 :].mean())
