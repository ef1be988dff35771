"""Sine and cosine for compiled code: both at once, without branches, the same on every machine."""

from __future__ import annotations

import math

import numpy as np

from vibroimpact.jit import fma, inlined, jit

# pi / 2 in double precision, and its rounding error.
_QUARTER, _QUARTER_REST = 1.5707963267948966, 6.123233995736766e-17


@jit
def sin_cos(angle):
    """Return sine and cosine of an angle of at most a few thousand radians, to rounding.

    The angle is reduced to [-pi/4, pi/4] with fused operations (Cody & Waite 1980); then the
    minimax polynomials of fdlibm apply (Sun Microsystems 1993, ``k_sin.c`` and ``k_cos.c``).
    """
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


@inlined
def sine_after(s, c, angle):
    """Return the sine of the phase `angle` after the phase with sine `s` and cosine `c`."""
    sin, cos = sin_cos(angle)
    return s * cos + c * sin
