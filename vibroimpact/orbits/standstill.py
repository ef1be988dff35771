"""Curves of flips and folds on which all impacts lose their speed at once.

Without damping any natural vibration closes the orbit where omega is a fraction of p. A curve that
leads there ends in an orbit that touches the stop without speed. The equations of its orbits are
singular there: the end is extrapolated from points beside it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibroimpact.orbits.calls import linearised
from vibroimpact.orbits.family import OrbitFamily, units_along
from vibroimpact.orbits.halves import interpolated
from vibroimpact.orbits.unknowns import speeds

#: Where all impacts are slower than this, the end is extrapolated. Points
#: slower than the second are less accurate than the end.
_SLOW, _SLOWEST = 0.05, 0.005
#: It is extrapolated from points at which the impacts have these shares of their speed.
_SHARES = (0.85, 0.7, 0.55, 0.4, 0.3, 0.2)
#: There the speeds, and the residuals of the flights, are rounding below this.
_STANDS = 1e-6


def standstill(family: OrbitFamily, points: Sequence[np.ndarray]) -> tuple[int, np.ndarray] | None:
    """Return how many points of a lost curve to keep, and where its impacts have no speed.

    None if it does not lead there.
    """
    here = units_along(family.oscillator(points[-1]), [])
    unit = here.out_of("length/time", 1.0) / family.units.out_of("length/time", 1.0)
    fastest = [float(speeds(X, family.q).max()) / unit for X in points]
    if family.kind not in ("flip", "fold") or family.q == 1 or not fastest[-1] < _SLOW:
        return None
    first = max((i + 1 for i, v in enumerate(fastest) if v >= _SLOW), default=0)
    end = _extrapolated(family, points[first])
    if end is None or not np.abs(speeds(end, family.q)).max() < _STANDS:
        return None
    speeds(end, family.q)[:] = 0.0
    missed = float(np.abs(linearised(family.system, end)[0]).max())
    if not missed < _STANDS or family.inadmissible(end)[0] is not None:
        return None
    if not family.oscillator(end).force > _STANDS * family.osc.force:  # with it they vanish
        return None
    return first + max(1, sum(v > _SLOWEST for v in fastest[first:])), end


def _extrapolated(family: OrbitFamily, X: np.ndarray) -> np.ndarray | None:
    """Return the point of a curve beside X where the mean speed is zero, or None."""
    plane, along = np.zeros(X.size), family.tangent(X)
    speeds(plane, family.q)[:] = 1.0
    sizes, points = [float(speeds(X, family.q).mean())], [X]
    slope = float(speeds(along, family.q).mean())
    for share in _SHARES:
        size = share * sizes[0]
        if len(points) == 1:
            guess = X + (size - sizes[0]) / slope * along
        else:
            guess = interpolated(np.array(sizes), np.array(points), size)
        Y = family.corrected(guess, plane[None, :])
        if Y is None:
            return None
        sizes.append(float(speeds(Y, family.q).mean()))
        points.append(Y)
    return interpolated(np.array(sizes), np.array(points), 0.0)
