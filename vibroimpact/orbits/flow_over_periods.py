"""The exact flow of eq. (1) over whole forcing periods, to rounding.

The flow takes (x, v) to M (x, v) + G (sin theta, cos theta). For h < p and far from resonance it is
written in closed form: with A the complex steady response, G = (I - M) (A, i omega A). The angle
Om T is reduced exactly, so that the small coefficients near a multiple of the natural period have
all their digits. Elsewhere it is the map of ``integrators.exact``.
"""

from __future__ import annotations

import math
from fractions import Fraction

from vibroimpact.orbits.orbit import dynamic_stiffness
from vibroimpact.oscillator import Oscillator
from vibroimpact.step.integrators import INTEGRATORS, affine_map


def flow_over_periods(osc: Oscillator, n: int) -> tuple[list[float], float]:
    """Return the flow over `n` forcing periods.

    Returns
    -------
    flow : list of 8 floats
        ``[M00, M01, G00, G01, M10, M11, G10, G11]``.
    one_minus_xx : float
        1 - M00.
    """
    T = n * osc.forcing_period
    h, p, omega = osc.h, osc.p, osc.omega
    stiffness = dynamic_stiffness(osc)
    if h >= p or abs(stiffness) < 0.1 * (p * p + omega * omega):
        flow = list(affine_map(INTEGRATORS["exact"].code, T, osc.at(osc.clearance)[0]))
        return flow, _one_minus(flow[0], flow[1], osc, T)
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


def _one_minus(xx: float, xv: float, osc: Oscillator, T: float) -> float:
    """Return 1 - xx without the cancellation where T is nearly a multiple of the natural period.

    det M = exp(-2 h T), vv = xx - 2 h xv and vx = -p^2 xv make
    (xx - h xv)^2 = exp(-2 h T) - (p^2 - h^2) xv^2, whose difference from 1 is small with T and xv.
    """
    root = xx - osc.h * xv
    if root <= 0.0:
        return 1.0 - xx
    below_1 = -math.expm1(-2.0 * osc.h * T) + (osc.p**2 - osc.h**2) * xv**2
    return below_1 / (1.0 + root) - osc.h * xv
