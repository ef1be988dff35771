"""One-impact orbits in closed form.

An orbit with one impact in n forcing periods, T = 2 pi n / omega, leaves the stop at the phase
theta = omega t0 with the speed R v and returns with the speed v at the same phase. With the exact
flow of eq. (1) over T (M from the state, G from the force)

    (sigma, v) = M (sigma, -R v) + G (sin theta, cos theta),    sigma the clearance,

these are two equations that are linear in (v, sin theta, cos theta). They describe a line, whose
intersections with the cylinder sin^2 + cos^2 = 1 are sought. The direction d of the line is the
cross product of the normals of the two equations. There is no division by p^2 - omega^2 or
sin(Om T), so h = p, h > p, h = 0 with omega = p, and h = 0 with omega = 2p are not special. An
intersection is an orbit if v > 0. At clearance 0 the line passes through the origin, and there is
one such intersection. Otherwise there may be two or none; the two meet in a fold where the line
touches the cylinder.

Multipliers. Let F- = (v, a-) and F+ = (-R v, a+) be the rates before and after the impact, and
D = diag(1, -R) the impact rule. The saltation matrix is D + (F+ - D F-) (1, 0) / v, where

    a- = -2 h v - p^2 sigma - f sin theta,    a+ = 2 h R v - p^2 sigma - f sin theta.

In a+ + R a- the damping cancels: (1 + R) a, with a = -f sin theta - p^2 sigma, remains, so

    P = S M,    S = [[-R, 0], [(1 + R) a / v, -R]],    det P = R^2 exp(-2 h T),
    trace P = -R (M00 + M11) + (1 + R) (a / v) M01.

The multipliers are the eigenvalues of P. At a flip (period doubling) 1 + trace + det = 0, at a fold
1 - trace + det = 0. The latter sum is (omega / v) (d_s sin theta + d_c cos theta), so it has
opposite signs at the two ends of the chord of the line. Along d the speed increases:
d_v = det G >= 0, as G = (I - M) X with X the steady response and
det X = omega f^2 / ((p^2 - omega^2)^2 + 4 h^2 omega^2). Hence, for every clearance, the sum is
positive on the faster orbit and negative on the slower one, which is a saddle. At clearance 0 there
is no fold.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from vibroimpact.inputs import integer, refuse_other, shown_count
from vibroimpact.orbits.flights import MOST_ORBIT_STEPS
from vibroimpact.orbits.orbit import PeriodicOrbit, free_amplitude
from vibroimpact.orbits.periodic import OrbitError, refuse_long
from vibroimpact.oscillator import Oscillator, with_one_force
from vibroimpact.step.integrators import INTEGRATORS, affine_map

_EPS = float(np.finfo(float).eps)


def _rounding(osc: Oscillator, n: int) -> float:
    """Return the relative error of the flow over the flight."""
    return 4.0 * _EPS * (4.0 + (2.0 * osc.h + osc.p + osc.omega) * n * osc.forcing_period)


def _flow(osc: Oscillator, n: int) -> tuple[list[float], float]:
    """Return [M00, M01, G00, G01, M10, M11, G10, G11] over `n` forcing periods, and 1 - M00.

    For h < p and far from resonance the flow is written in closed form: with A the complex steady
    response, G = (I - M) (A, i omega A). The angle Om T is reduced exactly, so that coefficients
    that are small near a multiple of the natural period keep all their digits. Otherwise it is the
    map of ``integrators.closed_form``.
    """
    T = n * osc.forcing_period
    h, p, omega = osc.h, osc.p, osc.omega
    a = free_amplitude(osc)
    if h >= p or osc.force < 0.1 * (p * p + omega * omega) * abs(a):  # or near resonance
        points = with_one_force(osc.at(osc.clearance))
        flow = list(affine_map(INTEGRATORS["exact"].code, T, points[0]))
        return flow, _one_minus_xx(flow[0], flow[1], osc, T)
    rate = math.sqrt((p - h) * (p + h))
    turns = round(n * rate / omega)
    angle = 2.0 * math.pi * float(n * Fraction(rate) - turns * Fraction(omega)) / omega
    decay = math.exp(-h * T)
    xv = decay * math.sin(angle) / rate
    middle = 2.0 * decay * math.sin(0.5 * angle) ** 2 - math.expm1(-h * T)
    one_minus_xx, one_minus_vv, vx = middle - h * xv, middle + h * xv, -p * p * xv
    sine, cosine = complex(a.real, -omega * a.imag), complex(a.imag, omega * a.real)
    xs, xc = (one_minus_xx * y.real - xv * y.imag for y in (sine, cosine))
    vs, vc = (one_minus_vv * y.imag - vx * y.real for y in (sine, cosine))
    return [1.0 - one_minus_xx, xv, xs, xc, vx, 1.0 - one_minus_vv, vs, vc], one_minus_xx


def _one_minus_xx(xx: float, xv: float, osc: Oscillator, T: float) -> float:
    """Return 1 - xx without cancellation where T is nearly a multiple of the natural period.

    From det M = exp(-2 h T), vv = xx - 2 h xv and vx = -p^2 xv follows
    (xx - h xv)^2 = exp(-2 h T) - (p^2 - h^2) xv^2. The difference of this from 1 is small where T
    and xv are small.
    """
    root = xx - osc.h * xv
    if root <= 0.0:
        return 1.0 - xx
    below_1 = -math.expm1(-2.0 * osc.h * T) + (osc.p**2 - osc.h**2) * xv**2
    return below_1 / (1.0 + root) - osc.h * xv


def _solve(osc: Oscillator, n: int) -> list[np.ndarray]:
    """Return each (v, sin, cos) where the line cuts the cylinder, the smaller v first."""
    T = n * osc.forcing_period
    (_, xv, xs, xc, vx, vv, vs, vc), one_minus_xx = _flow(osc, n)
    R, sigma = osc.R, osc.clearance
    first, second = np.array([-R * xv, xs, xc]), np.array([-1.0 - R * vv, vs, vc])
    line = np.cross(first, second)
    # Size of the terms in the last two components of the line, before they cancel.
    terms = (1.0 + R) * math.hypot(xs, xc) + R * min(T, 1.0 / osc.p) * math.hypot(vs, vc)
    across = math.hypot(line[1], line[2])
    if not across > _rounding(osc, n) * terms:  # the line is parallel to the cylinder
        return []
    offset = line / across
    radial = np.array([0.0, offset[1], offset[2]])
    # Cramer's rule for the point of the line nearest to the axis of the cylinder.
    middle = sigma * one_minus_xx * np.cross(second, radial) - sigma * vx * np.cross(radial, first)
    middle /= across
    discriminant = 1.0 - middle[1] ** 2 - middle[2] ** 2
    if not discriminant >= 0.0:
        return []
    root = math.sqrt(discriminant)
    return [middle + sign * offset for sign in ((-root, root) if root else (root,))]


def one_impact_orbits(osc: Oscillator, n: int = 1) -> tuple[PeriodicOrbit, ...]:
    """Return all orbits with one impact in `n` forcing periods, the slower first.

    All solutions of the impact conditions with v > 0 are returned, even if their flight passes the
    stop (`exists` is then False). A family of orbits whose speed is not determined, for example
    without a force, is left out.

    Parameters
    ----------
    osc : Oscillator
    n : int
        Forcing periods per impact, >= 1.

    Returns
    -------
    tuple of PeriodicOrbit
        Zero to two orbits with m = n and q = 1; at most one at clearance 0.

    Raises
    ------
    OrbitError
        If the flight is too long to be solved for, as in `periodic_orbit`.
    TypeError
        If `osc` is not an Oscillator.
    ValueError
        If `n` is not an integer from 1 to 32,768, or if the numbers overflow or underflow.

    Notes
    -----
    For clearance 0 and h = 0 the speed is given, with k = pi n p / omega, by
    v^2 {[(1 + R) cot(k) / (2 p)]^2 + [(1 - R) / (2 omega)]^2} = f^2 / (p^2 - omega^2)^2.

    Examples
    --------
    >>> orbits = one_impact_orbits(Oscillator(h=0.1, R=0.8, omega=2.3, f=1.0))
    >>> [(orbit.speeds.round(6).tolist(), orbit.exists) for orbit in orbits]
    [([1.09758], True)]
    """
    refuse_other("osc", osc, Oscillator)
    n = integer(1, MOST_ORBIT_STEPS).checked("n", n)
    refuse_long(osc, n, 1)
    try:
        with np.errstate(divide="raise", over="raise", invalid="raise"):
            solutions = _solve(osc, n)
    except ArithmeticError:
        raise ValueError(f"the numbers of the orbit are too large or too small: {osc}") from None
    slowest = _rounding(osc, n) * (osc.force / osc.omega + osc.p * abs(osc.clearance))
    turn = 2.0 * math.pi  # the first remainder is 2 pi for a tiny negative phase
    return tuple(
        PeriodicOrbit(osc, n, np.array([math.atan2(s, c) % turn % turn]), np.array([v]))
        for v, s, c in solutions
        if v > slowest
    )


def one_impact_orbit(osc: Oscillator, n: int = 1) -> PeriodicOrbit:
    """Return the orbit with one impact in `n` forcing periods; if there are two, the faster.

    The slower of two is a saddle and never stable; `one_impact_orbits` returns it, too.

    Parameters
    ----------
    osc : Oscillator
    n : int
        Forcing periods per impact, >= 1.

    Returns
    -------
    PeriodicOrbit
        With m = n and q = 1. If its flight passes the stop, `exists` and `stable` are False.

    Raises
    ------
    OrbitError
        If the impact conditions have no solution with v > 0.
    OrbitError, TypeError, ValueError
        As by `one_impact_orbits`.

    Examples
    --------
    >>> from vibroimpact import Oscillator, branch, one_impact_orbit
    >>> orbit = one_impact_orbit(Oscillator(h=0.05, R=0.8, omega=2.6, f=1.0))
    >>> print(f"{orbit.v:.6f} {orbit.exists} {orbit.stable}")
    0.500672 True True
    >>> [(point.kind, round(point.value, 6)) for point in branch(orbit, "omega", 2.4, 2.8).special]
    [('edge', 2.4), ('flip', 2.658885), ('edge', 2.8)]
    """
    orbits = one_impact_orbits(osc, n)
    if not orbits:
        raise OrbitError(
            f"the impact conditions have no solution with one impact in "
            f"{shown_count(n, 'forcing period')}"
        )
    return orbits[-1]
