"""Sine, arc sine, logarithm: the same bits on every machine.

Those of the C library differ in the last bit from one processor and system to the next. Here the
polynomials are those of fdlibm (Sun Microsystems 1993).
"""

from __future__ import annotations

import math

import numpy as np

from vibroimpact.jit import fma, inlined, jit, select

# pi / 2 in double precision, and its rounding error.
_QUARTER, _QUARTER_REST = 1.5707963267948966, 6.123233995736766e-17
# ln 2 in two parts, of which the first has so few digits that its multiples are exact.
_LN_2, _LN_2_REST = 6.93147180369123816490e-01, 1.90821492927058770002e-10


@inlined
def larger(a, b):
    """Return max(a, b), which numba compiles anew wherever it is used."""
    return select(b > a, b, a)


@inlined
def smaller(a, b):
    """Return min(a, b), likewise."""
    return select(b < a, b, a)


@jit
def sin_cos(angle):
    """Return sine and cosine of an angle of at most a few thousand radians, to rounding."""
    # To [-pi/4, pi/4] (Cody & Waite 1980), for the polynomials of ``k_sin.c`` and ``k_cos.c``.
    quarters = np.floor(fma(angle, 2.0 / math.pi, 0.5))
    r = fma(-quarters, _QUARTER_REST, fma(-quarters, _QUARTER, angle))
    z = r * r
    w = z * z
    # Three short chains of fused operations have less latency than one long one.
    p = fma(z, 1.58969099521155010221e-10, -2.50507602534068634195e-08)
    p = fma(w, p, fma(z, 2.75573137070700676789e-06, -1.98412698298579493134e-04))
    p = fma(w, p, fma(z, 8.33333333332248946124e-03, -1.66666666666666324348e-01))
    sine = fma(z * r, p, r)
    q = fma(z, -1.13596475577881948265e-11, 2.08757232129817482790e-09)
    q = fma(w, q, fma(z, -2.75573143513906633035e-07, 2.48015872894767294178e-05))
    q = fma(w, q, fma(z, -1.38888888888741095749e-03, 4.16666666666666019037e-02))
    top = fma(-0.5, z, 1.0)
    cosine = top + fma(w, q, fma(-0.5, z, 1.0 - top))
    half = 0.5 * quarters
    odd = half != np.floor(half)
    s, c = (cosine, sine) if odd else (sine, cosine)
    half -= 2.0 * np.floor(0.5 * half)  # now 0, 0.5, 1 or 1.5
    return -s if half >= 1.0 else s, -c if (half == 0.5) | (half == 1.0) else c


@jit
def fill_waves(phases, sines, cosines):
    """Fill arrays with the sines and cosines of phases."""
    for n in range(phases.size):
        sines[n], cosines[n] = sin_cos(phases[n])


@inlined
def sine_after(s, c, angle):
    """Return the sine of the phase `angle` after the phase with sine `s` and cosine `c`."""
    sin, cos = sin_cos(angle)
    return s * cos + c * sin


@jit
def asin(x):
    """Return the arc sine, to rounding; NaN beyond 1. As ``e_asin.c``."""
    far = abs(x) > 0.5
    z = 0.5 * (1.0 - abs(x)) if far else x * x
    p = fma(z, 3.47933107596021167570e-05, 7.91534994289814532176e-04)
    p = fma(z, fma(z, p, -4.00555345006794114027e-02), 2.01212532134862925881e-01)
    p = z * fma(z, fma(z, p, -3.25565818622400915405e-01), 1.66666666666666657415e-01)
    q = fma(z, 7.70381505559019352791e-02, -6.88283971605453293030e-01)
    q = fma(z, fma(z, fma(z, q, 2.02094576023350569471e00), -2.40339491173441421878e00), 1.0)
    if not far:
        return fma(x, p / q, x)
    # asin x = pi / 2 - 2 asin sqrt z; the rounding error of the root counts.
    root = math.sqrt(z)
    rest = fma(-root, root, z) / (2.0 * root) if root > 0.0 else 0.0
    angle = _QUARTER - 2.0 * root - fma(2.0, fma(root, p / q, rest), -_QUARTER_REST)
    return math.copysign(angle, x)


@jit
def log(x):
    """Return the natural logarithm, to rounding; -inf at 0, NaN below. As ``e_log.c``."""
    if not 0.0 < x < math.inf:
        return x if x > 0.0 else -math.inf if x == 0.0 else math.nan
    m, k = math.frexp(x)
    if m < math.sqrt(0.5):
        m, k = 2.0 * m, k - 1
    f = m - 1.0
    s = f / (2.0 + f)
    z = s * s
    r = fma(z, 1.479819860511658591e-01, 1.531383769920937332e-01)
    r = fma(z, fma(z, r, 1.818357216161805012e-01), 2.222219843214978396e-01)
    r = z * fma(z, fma(z, fma(z, r, 2.857142874366239149e-01), 3.999999999940941908e-01),
                6.666666666666735130e-01)  # fmt: skip
    half = 0.5 * f * f
    return k * _LN_2 - ((half - fma(s, half + r, k * _LN_2_REST)) - f)


@jit
def hypot(x, y):
    """Return the length of a vector, to rounding; it is scaled if its square would overflow."""
    greatest = larger(abs(x), abs(y))
    if not greatest > 0.0:
        return greatest
    scale = 1.0 if 1e-140 < greatest < 1e140 else greatest
    x, y = x / scale, y / scale
    return scale * math.sqrt(fma(x, x, y * y))
