"""The explanation of a change of class: the bifurcation on the branch of the orbit on a side."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sweeps.analysis.exact_branches import PeriodicPoints
from sweeps.analysis.grouping import STARTS
from sweeps.analysis.regimes import Change, Label, Regime
from sweeps.config.rig import model_name
from vibroimpact.orbits.branches import branch

#: The class of points that have none.
NO_LABEL = Label(Regime.UNDECIDED)
#: Kinds in the list for the special points of a branch: a penetration begins with a graze.
_KINDS = {"flip": "flip", "fold": "fold", "graze": "graze", "penetration": "graze", "rest": "rest"}


class _End(NamedTuple):
    """The first special point on a branch; without a stable orbit to follow, no kind."""

    kind: str = ""
    value: float = np.nan
    orbit: str = ""  # class of the orbit that bifurcates

    @property
    def is_exact(self) -> bool:
        """Whether this is a bifurcation with a known value."""
        return self.kind in _KINDS

    @property
    def explained(self) -> tuple[str, float, str]:
        """The kind in the list, the value and the orbit."""
        return (_KINDS[self.kind], self.value, self.orbit) if self.is_exact else _UNKNOWN


#: A change without an explanation.
_UNKNOWN = "unknown", np.nan, ""


def explain(
    motions: PeriodicPoints, axis: str, values: np.ndarray, change: Change, down: bool
) -> list[tuple[Change, str, float, str]]:
    """Return a change with its kind, the exact value (NaN if not known) and the orbit.

    If points of unknown class lie between, and no bifurcation leads from one class to the other,
    the change from the first class to an unknown one and that to the last class are returned.
    """
    if axis in STARTS:
        return [(change, "basin", np.nan, "")]
    i, j = np.searchsorted(values, [change.low, change.high]).tolist()
    left, right = _end(motions, axis, i, j), _end(motions, axis, j, i)
    first, second = (right, left) if down else (left, right)
    if first.kind == "edge":
        return [(change, "basin", np.nan, "")]
    if change.kind in ("rest", "chaos", "unbounded"):
        return [(change, "basin" if second.kind == "edge" else change.kind, np.nan, "")]
    exact = [end for end in (first, second) if end.is_exact]
    if not exact:
        return [(change, change.kind, np.nan, "")]
    if not change.between or _is_joined(change, first, second):
        return [(change, *exact[0].explained)]
    return [
        (_open(values, change, left.value, after=True), *left.explained),
        (_open(values, change, right.value, after=False), *right.explained),
    ]


def _is_joined(change: Change, first: _End, second: _End) -> bool:
    """Whether the same bifurcation ends the first motion and leads to the second one."""
    if first.is_exact and second.is_exact:
        return bool(abs(first.value - second.value) <= 1e-9 * max(1.0, abs(first.value)))
    return second.kind == "edge" or change.kind == "flip"


def _open(values: np.ndarray, change: Change, value: float, *, after: bool) -> Change:
    """Return the change between a class and the points of unknown class `after` or before it.

    It ends at the first of these points that lies beyond the exact value, if this is known.
    """
    inside = values[(values > change.low) & (values < change.high)]
    if after:
        beyond = inside[inside > value] if np.isfinite(value) else inside
        end = float(beyond[0] if beyond.size else inside[-1])
        return replace(change, high=end, after=NO_LABEL, between=int((inside < end).sum()))
    beyond = inside[inside < value] if np.isfinite(value) else inside
    end = float(beyond[-1] if beyond.size else inside[0])
    return replace(change, low=end, before=NO_LABEL, between=int((inside > end).sum()))


def _end(motions: PeriodicPoints, axis: str, i: int, j: int) -> _End:
    """Follow the branch of the orbit at point i towards point j; return the first special point."""
    if motions.m[i]:
        name = model_name(axis)
        start, end = motions.points[name][[i, j]].tolist()
        with suppress(ValueError):  # no orbit is found, or it cannot be followed
            orbit = motions.orbit(i)
            if (orbit.m, orbit.q) == (motions.m[i], motions.q[i]) and orbit.stable:
                special = branch(orbit, name, *sorted((start, end))).special
                # The branch starts at an end of the range, so it continues in one direction only.
                for point in special[1:] if start < end else special[-2::-1]:
                    of = point.orbit if point.kind == "flip" else orbit
                    return _End(point.kind, point.value, f"{of.m}/{of.q}")
    return _End()
