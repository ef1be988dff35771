"""One-impact orbits: their speed, phase, Floquet multipliers and existence.

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
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from vibroimpact.orbits.flights import highest_turn, values_of
from vibroimpact.orbits.orbit import determinant, dynamic_stiffness, multipliers_of
from vibroimpact.oscillator import Oscillator, checked_integer, refuse_other
from vibroimpact.step.contact import pressing
from vibroimpact.step.integrators import INTEGRATORS, affine_map

_EPS = float(np.finfo(float).eps)
#: Most forcing periods between two impacts; more are refused.
MOST_FLIGHT_PERIODS = 100_000
# Longest flight, in radians of all its rates together. A longer one would take seconds to search
# for a touch.
_LONGEST_FLIGHT = 2e6


@dataclass(frozen=True)
class OneImpactOrbit:
    """A periodic orbit with one impact in `n` forcing periods; all NaN if there is none.

    Attributes
    ----------
    n : int
        Forcing periods per impact.
    v : float
        Speed before the impact [length/time].
    phase : float
        omega t of the impact, in [0, 2 pi).
    trace, determinant : float
        Of the monodromy matrix.
    peak : float
        Largest local maximum of x - clearance strictly between the impacts [length]; -inf if there
        is none. Zero is a graze.
    """

    n: int
    v: float = math.nan
    phase: float = math.nan
    trace: float = math.nan
    determinant: float = math.nan
    peak: float = math.nan

    @property
    def multipliers(self) -> np.ndarray:
        """Both Floquet multipliers, complex, the larger first."""
        return multipliers_of(self.trace, self.determinant)

    @property
    def exists(self) -> bool:
        """Whether x < clearance strictly between the impacts."""
        return self.peak < 0.0

    @property
    def stable(self) -> bool:
        """Whether the orbit exists and both multipliers are inside the unit circle."""
        return self.exists and bool(np.all(np.abs(self.multipliers) < 1.0))


def _radians(osc: Oscillator, n: int) -> float:
    """Return the length of the flight in radians, (2h + p + omega) t."""
    return (2.0 * osc.h + osc.p + osc.omega) * n * osc.forcing_period


def _rounding(osc: Oscillator, n: int) -> float:
    """Return the relative error of the flow over the flight."""
    return 4.0 * _EPS * (4.0 + _radians(osc, n))


def _flow(osc: Oscillator, n: int) -> tuple[list[float], float]:
    """Return [M00, M01, G00, G01, M10, M11, G10, G11] over `n` forcing periods, and 1 - M00.

    For h < p and far from resonance the flow is written in closed form: with A the complex steady
    response, G = (I - M) (A, i omega A). The angle Om T is reduced exactly, so that coefficients
    that are small near a multiple of the natural period keep all their digits. Otherwise it is the
    map of ``integrators.exact``.
    """
    T = n * osc.forcing_period
    h, p, omega = osc.h, osc.p, osc.omega
    stiffness = dynamic_stiffness(osc)
    if h >= p or abs(stiffness) < 0.1 * (p * p + omega * omega):
        flow = list(affine_map(INTEGRATORS["exact"].code, T, osc.at(osc.clearance)[0]))
        return flow, _one_minus_xx(flow[0], flow[1], osc, T)
    rate = math.sqrt((p - h) * (p + h))
    turns = round(n * rate / omega)
    angle = 2.0 * math.pi * float(n * Fraction(rate) - turns * Fraction(omega)) / omega
    decay = math.exp(-h * T)
    xv = decay * math.sin(angle) / rate
    middle = 2.0 * decay * math.sin(0.5 * angle) ** 2 - math.expm1(-h * T)
    one_minus_xx, one_minus_vv, vx = middle - h * xv, middle + h * xv, -p * p * xv
    a = -osc.f / stiffness
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


def _solve(osc: Oscillator, n: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return the map of the flight, and each (v, sin, cos) where the line cuts the cylinder."""
    T = n * osc.forcing_period
    (xx, xv, xs, xc, vx, vv, vs, vc), one_minus_xx = _flow(osc, n)
    R, sigma = osc.R, osc.clearance
    first, second = np.array([-R * xv, xs, xc]), np.array([-1.0 - R * vv, vs, vc])
    line = np.cross(first, second)
    # Size of the terms in the last two components of the line, before they cancel.
    terms = (1.0 + R) * math.hypot(xs, xc) + R * min(T, 1.0 / osc.p) * math.hypot(vs, vc)
    across = math.hypot(line[1], line[2])
    flow = np.array([[xx, xv], [vx, vv]])
    if not across > _rounding(osc, n) * terms:  # the line is parallel to the cylinder
        return flow, []
    reach = line / across
    radial = np.array([0.0, reach[1], reach[2]])
    # Cramer's rule for the point of the line nearest to the axis of the cylinder.
    middle = sigma * one_minus_xx * np.cross(second, radial) - sigma * vx * np.cross(radial, first)
    middle /= across
    discriminant = 1.0 - middle[1] ** 2 - middle[2] ** 2
    if not discriminant >= 0.0:
        return flow, []
    root = math.sqrt(discriminant)
    return flow, [middle + sign * reach for sign in ((-root, root) if root else (root,))]


def one_impact_orbits(osc: Oscillator, n: int = 1) -> tuple[OneImpactOrbit, ...]:
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
    tuple of OneImpactOrbit
        Zero to two orbits; at most one at clearance 0.

    Raises
    ------
    TypeError
        If `osc` is not an Oscillator.
    ValueError
        If `n` is not an integer from 1 to ``MOST_FLIGHT_PERIODS``; if the flight is too long,
        because omega is far below h or p; or if its numbers overflow or underflow.

    Notes
    -----
    For clearance 0 and h = 0 the speed is given, with k = pi n p / omega, by
    v^2 {[(1 + R) cot(k) / (2 p)]^2 + [(1 - R) / (2 omega)]^2} = f^2 / (p^2 - omega^2)^2.
    """
    refuse_other("osc", osc, Oscillator)
    n = checked_integer("n", n, 1, MOST_FLIGHT_PERIODS)
    if not _radians(osc, n) <= _LONGEST_FLIGHT:
        raise ValueError(
            f"the flight between two impacts would be searched over more than "
            f"{_LONGEST_FLIGHT:g} radians of (2h + p + omega) t; omega is too small against h and p"
        )
    try:
        with np.errstate(divide="raise", over="raise", invalid="raise"):
            flow, solutions = _solve(osc, n)
    except ArithmeticError:
        raise ValueError(f"the numbers of the orbit are too large or too small: {osc}") from None
    slowest = _rounding(osc, n) * (osc.f / osc.omega + osc.p * abs(osc.clearance))
    return tuple(
        _orbit(osc, n, flow, *solution.tolist()) for solution in solutions if solution[0] > slowest
    )


def _orbit(
    osc: Oscillator, n: int, flow: np.ndarray, v: float, s: float, c: float
) -> OneImpactOrbit:
    """Return the orbit with this speed, sin theta and cos theta."""
    phase = math.atan2(s, c) % (2.0 * math.pi)
    phase = 0.0 if phase == 2.0 * math.pi else phase
    kick = (1.0 + osc.R) * pressing(math.sin(phase), osc.at(osc.clearance)[0]) / v
    return OneImpactOrbit(
        n=n,
        v=v,
        phase=phase,
        trace=float(kick * flow[0, 1] - osc.R * (flow[0, 0] + flow[1, 1])),
        determinant=determinant(osc.h, osc.R, osc.omega, n, 1),
        peak=highest_turn(values_of(osc), phase, v, n * osc.forcing_period),
    )


def one_impact_orbit(osc: Oscillator, n: int = 1) -> OneImpactOrbit:
    """Return the orbit with one impact in `n` forcing periods; if there are two, the faster.

    The slower of two is a saddle and never stable; `one_impact_orbits` returns it, too.

    Parameters
    ----------
    osc : Oscillator
    n : int
        Forcing periods per impact, >= 1.

    Returns
    -------
    OneImpactOrbit
        If the impact conditions have no solution with v > 0, all its numbers are NaN, and `exists`
        and `stable` are False.

    Raises
    ------
    TypeError
        If `osc` is not an Oscillator.
    ValueError
        If `n` is not an integer from 1 to ``MOST_FLIGHT_PERIODS``; if the flight is too long,
        because omega is far below h or p; or if its numbers overflow or underflow.
    """
    return max(one_impact_orbits(osc, n), key=lambda o: o.v, default=OneImpactOrbit(int(n)))
