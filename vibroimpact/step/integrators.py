"""`Parameters`; a step function for each integrator of eq. (1); its map and spectral radius.

Eq. (1) is linear, so a step of any of these integrators is an affine map,

    (x, v) -> M (x, v) + G (sin theta, cos theta),    theta = omega t at the start of the step,

with 2x2 matrices M and G that are constant for a parameter point and step length. Each integrator
is written once, as a scalar step; its map follows by applying the step to the unit vectors.
A new integrator is one step function here and one line in ``INTEGRATORS`` of ``scheme.py``.

**Stability of free motion**, from the map M. Without force and stop, eq. (1) has one parameter,
zeta = h / p; a step adds p T. The table ``INTEGRATORS`` has the limits in closed form.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vibroimpact.jit import fma, inlined, jit, specialised
from vibroimpact.step.elementary import sin_cos, sine_after
from vibroimpact.step.scheme import INTEGRATORS


class Parameters(NamedTuple):
    """The parameters of eq. (1), named as in a parameter point."""

    h: float
    R: float
    omega: float
    f: float
    p: float
    clearance: float


@specialised
def acceleration(x, v, s, pt):
    """Return x'' from eq. (1), at a phase with the sine `s`."""
    return -2.0 * pt.h * v - pt.p * pt.p * x - pt.f * s


@specialised
def euler(x, v, s, c, T, pt):
    """Euler's explicit method, order 1.

    Euler (1768), Institutionum calculi integralis I, ch. VII. Without damping it gains energy at
    every step, however short.
    Stable where |1 + lambda T| <= 1: p T = 2 zeta up to critical damping.
    """
    return x + T * v, v + T * acceleration(x, v, s, pt)


@specialised
def semi_implicit_euler(x, v, s, c, T, pt):
    """Symplectic Euler: the new velocity moves the displacement, order 1.

    Hairer, Lubich & Wanner (2006), Geometric Numerical Integration, eq. (I.1.9); the damping is
    taken at the start of the step. At the limit 1 + trace + det = 0, with det = 1 - 2h T and
    trace = 1 + det - p^2 T^2.
    """
    v_T = v + T * acceleration(x, v, s, pt)
    return x + T * v_T, v_T


@specialised
def verlet(x, v, s, c, T, pt):
    """The central difference method, order 2.

    Verlet (1967), Phys. Rev. 159, 98-103; Newmark's method with beta = 0, gamma = 1/2. The
    acceleration at the end of the step is linear in the new velocity and solved for it. At the
    limit 1 + trace + det = 0, with det = (1 - h T) / (1 + h T), trace = (2 - p^2 T^2) / (1 + h T).
    """
    s_T = sine_after(s, c, pt.omega * T)
    v_half = v + 0.5 * T * acceleration(x, v, s, pt)
    x_T = x + T * v_half
    return x_T, (v_half - 0.5 * T * (pt.p * pt.p * x_T + pt.f * s_T)) / (1.0 + pt.h * T)


@specialised
def newmark(x, v, s, c, T, pt):
    """Newmark's constant average acceleration (beta = 1/4, gamma = 1/2), order 2.

    Newmark (1959), J. Eng. Mech. Div. ASCE 85(3), 67-94. The equation of motion at the end
    of the step is linear in the new acceleration and solved for it.
    """
    s_T = sine_after(s, c, pt.omega * T)
    a = acceleration(x, v, s, pt)
    v_half = v + 0.5 * T * a
    x_half = x + T * v + 0.25 * T * T * a
    a_T = -pt.f * s_T - 2.0 * pt.h * v_half - pt.p * pt.p * x_half
    a_T /= 1.0 + pt.h * T + 0.25 * pt.p * pt.p * T * T
    return x_half + 0.25 * T * T * a_T, v_half + 0.5 * T * a_T


@specialised
def rk4(x, v, s, c, T, pt):
    """The classical Runge-Kutta method, order 4.

    Kutta (1901), Z. Math. Phys. 46, 435-453.
    """
    half = 0.5 * T
    s_half, s_T = sine_after(s, c, pt.omega * half), sine_after(s, c, pt.omega * T)
    a1 = acceleration(x, v, s, pt)
    v2 = v + half * a1
    a2 = acceleration(x + half * v, v2, s_half, pt)
    v3 = v + half * a2
    a3 = acceleration(x + half * v2, v3, s_half, pt)
    v4 = v + T * a3
    a4 = acceleration(x + T * v3, v4, s_T, pt)
    return x + T / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4), v + T / 6.0 * (
        a1 + 2.0 * a2 + 2.0 * a3 + a4
    )


@jit
def _taylor(x, v, s, c, T, pt):
    """Sum the Taylor series of eq. (1) over a short step: the matrix exponential, to rounding.

    Differentiating eq. (1) k times: x(k+2) = -2h x(k+1) - p^2 x(k) - f (sin theta)(k). There is no
    division by p^2 - omega^2 or p^2 - h^2, so resonance and critical damping are not special.
    """
    x_T, v_T = 0.0, 0.0
    weight = 1.0
    for k in range(1, _TERMS):
        x_T += x * weight
        v_T += v * weight
        a = acceleration(x, v, s, pt)
        x, v = v, a
        s, c = pt.omega * c, -pt.omega * s
        weight *= T / k
    return x_T, v_T


# With (2h + p + omega) T <= 1 the first neglected term is below 1 / 19! = 8e-18.
_TERMS = 20


@jit
def closed_form(x, v, s, c, T, pt):
    """The flow of eq. (1) itself: M = exp(A T), G from the augmented system (x, v, sin, cos).

    A Taylor step short enough to converge to rounding is doubled as often as needed:
    M(2T) = M M,  G(2T) = M G + G Rot(omega T). This is scaling and squaring, as in Higham (2005),
    SIAM J. Matrix Anal. 26, 1179-1193. It is valid for h < p, h = p, h > p, and omega = p, h = 0.
    Each doubling doubles the relative error: after 53 doublings no digit is right, and the result
    is NaN.
    """
    scale = (2.0 * pt.h + pt.p + pt.omega) * T
    if not scale < 2.0**53:
        return math.nan, math.nan
    doublings = 0
    while scale > 1.0:  # terminates after at most 53 halvings
        scale *= 0.5
        doublings += 1
    if doublings == 0:
        return _taylor(x, v, s, c, T, pt)
    tau = math.ldexp(T, -doublings)
    xx, vx = _taylor(1.0, 0.0, 0.0, 0.0, tau, pt)
    xv, vv = _taylor(0.0, 1.0, 0.0, 0.0, tau, pt)
    xs, vs = _taylor(0.0, 0.0, 1.0, 0.0, tau, pt)
    xc, vc = _taylor(0.0, 0.0, 0.0, 1.0, tau, pt)
    for _ in range(doublings):
        sin, cos = sin_cos(pt.omega * tau)
        xs, vs, xc, vc = (
            xx * xs + xv * vs + xs * cos - xc * sin,
            vx * xs + vv * vs + vs * cos - vc * sin,
            xx * xc + xv * vc + xs * sin + xc * cos,
            vx * xc + vv * vc + vs * sin + vc * cos,
        )
        xx, xv, vx, vv = (
            xx * xx + xv * vx,
            xx * xv + xv * vv,
            vx * xx + vv * vx,
            vx * xv + vv * vv,
        )
        tau *= 2.0
    return xx * x + xv * v + xs * s + xc * c, vx * x + vv * v + vs * s + vc * c


def _choice(code: int, chosen: Callable, otherwise: Callable) -> Callable:
    """Return a step function: `chosen` for the integrator with this code, else `otherwise`."""

    @inlined
    def chosen_or_next(integrator, x, v, s, c, T, pt):
        if integrator == code:
            return chosen(x, v, s, c, T, pt)
        return otherwise(integrator, x, v, s, c, T, pt)

    return chosen_or_next


@specialised
def _no_step(integrator, x, v, s, c, T, pt):
    return math.nan, math.nan


_chosen_step = _no_step
for _row in INTEGRATORS.values():
    _chosen_step = _choice(_row.code, _row.step, _chosen_step)


@jit
def integrator_step(integrator, x, v, s, c, T, pt):
    """Return (x_T, v_T) after one step of the integrator with that code in ``INTEGRATORS``."""
    return _chosen_step(integrator, x, v, s, c, T, pt)


@jit
def affine_map(integrator, T, pt):
    """Return the map of one step: factors of (x, v, sin, cos) for x_T, then those for v_T."""
    xx, vx = integrator_step(integrator, 1.0, 0.0, 0.0, 0.0, T, pt)
    xv, vv = integrator_step(integrator, 0.0, 1.0, 0.0, 0.0, T, pt)
    xs, vs = integrator_step(integrator, 0.0, 0.0, 1.0, 0.0, T, pt)
    xc, vc = integrator_step(integrator, 0.0, 0.0, 0.0, 1.0, T, pt)
    return xx, xv, xs, xc, vx, vv, vs, vc


@specialised
def apply_map(row, x, v, s, c):
    """Apply a row of the map to (x, v, sin, cos), with the same roundings in lanes and alone."""
    xx, xv, xs, xc = row
    return fma(xx, x, fma(xv, v, fma(xs, s, xc * c)))


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
    square root of rounding.
    """
    M = free_map(integrator, step, zeta)
    mean = 0.5 * (M[..., 0, 0] + M[..., 1, 1])
    apart = 0.25 * (M[..., 0, 0] - M[..., 1, 1]) ** 2 + M[..., 0, 1] * M[..., 1, 0]
    root = np.sqrt(np.abs(apart))
    return np.where(apart < 0.0, np.hypot(mean, root), np.abs(mean) + root)
