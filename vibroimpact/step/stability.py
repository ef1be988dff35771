"""Stability of free motion, from an integrator's map M.

Without force and stop, eq. (1) has one parameter, zeta = h / p; a step adds p T. The table
``INTEGRATORS`` has the limits in closed form.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vibroimpact.jit import jit
from vibroimpact.step.integrators import INTEGRATORS, Parameters, affine_map

# Tolerance of Jury's conditions, for maps that are marginal at every step: the rounding of the
# terms of a step, the greatest of which is of the order of p^2 T^2.
_JURY_TOLERANCE = 1e-14


def free_map(integrator: str, step: ArrayLike, zeta: ArrayLike) -> np.ndarray:
    """Return the matrix M of a step of free motion, (x, v / p) -> (x_T, v_T / p): (..., 2, 2).

    `step` is p T and `zeta` is h / p; their shapes must broadcast.
    """
    step, zeta = np.broadcast_arrays(np.asarray(step, float), np.asarray(zeta, float))
    maps = np.empty((step.size, 2, 2))
    _fill_maps(maps, INTEGRATORS[integrator].code, step.ravel(), zeta.ravel())
    return maps.reshape(*step.shape, 2, 2)


@jit
def _fill_maps(maps: np.ndarray, integrator: int, steps: np.ndarray, zeta: np.ndarray) -> None:
    """Fill `maps` with the matrices M of steps of free motion."""
    for i in range(steps.size):
        pt = Parameters(h=zeta[i], R=1.0, omega=1.0, f=0.0, p=1.0, clearance=0.0)
        xx, xv, _, _, vx, vv, _, _ = affine_map(integrator, steps[i], pt)
        maps[i, 0, 0], maps[i, 0, 1], maps[i, 1, 0], maps[i, 1, 1] = xx, xv, vx, vv


def spectral_radius(integrator: str, step: ArrayLike, zeta: ArrayLike) -> np.ndarray:
    """Return the greatest modulus of the eigenvalues of M: the growth of free motion per step.

    Arguments as for `free_map`. Where both eigenvalues coincide, the result is accurate only to the
    square root of rounding; use `is_stable` to decide whether it exceeds 1.
    """
    M = free_map(integrator, step, zeta)
    mean = 0.5 * (M[..., 0, 0] + M[..., 1, 1])
    apart = 0.25 * (M[..., 0, 0] - M[..., 1, 1]) ** 2 + M[..., 0, 1] * M[..., 1, 0]
    root = np.sqrt(np.abs(apart))
    return np.where(apart < 0.0, np.hypot(mean, root), np.abs(mean) + root)


def is_stable(integrator: str, step: ArrayLike, zeta: ArrayLike) -> np.ndarray:
    """Whether no eigenvalue of M exceeds 1 in modulus, to rounding; arguments as for `free_map`.

    By the conditions of Jury (1962), Proc. IRE 50, 1493-1500, for a polynomial of degree 2:
    |det M| <= 1 and |trace M| <= 1 + det M.
    """
    M = free_map(integrator, step, zeta)
    trace = M[..., 0, 0] + M[..., 1, 1]
    det = M[..., 0, 0] * M[..., 1, 1] - M[..., 0, 1] * M[..., 1, 0]
    allowance = _JURY_TOLERANCE * (1.0 + np.asarray(step, float) ** 2)
    return (np.abs(det) <= 1.0 + allowance) & (np.abs(trace) <= 1.0 + det + allowance)
