"""Follow motions whose record does not show their attractor, until it is known.

A motion is followed on if it has not settled in its record: it neither repeats nor rests nor is
chaotic. So is a motion that rests once in its record, since it rests again only if it is periodic.
So is chaos beside other attractors, since it may be a long transient. Each extension makes the
motion four times as long, from the last section on and with the method of the file. A motion that
still has not settled is given the stable orbit that it goes to (`sweeps.analysis.nearby_orbit`), if
there is such an orbit.

Chaos beside other attractors is followed on for as long as some of these motions leave chaos.
Motions that never settle, as without damping, would take forever: all motions together are followed
for at most ``MOST_PERIODS`` forcing periods.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, fields

import numpy as np
import xarray as xr

from sweeps.analysis.grouping import PointNumbers, parameter_at_points
from sweeps.analysis.motion import Motion, classify, kinds
from sweeps.analysis.nearby_orbit import goes_to, nearby_orbit
from sweeps.analysis.selection import Setting
from vibroimpact import integrate
from vibroimpact.orbits.period_class import LONGEST_PERIOD, period_class
from vibroimpact.oscillator import POINT, Oscillator

#: How often a motion is followed on, four times as long each time.
EXTENSIONS = 4
#: Forcing periods that are recorded of a motion followed on: twice the longest repetition.
_RECORD = 2 * LONGEST_PERIOD
#: The most forcing periods that all motions together are followed for.
MOST_PERIODS = 300_000_000
#: After this many motions of a parameter point lead to no orbit, no more are tried.
_MOST_FAILURES = 5
#: Motions of which a longer run may show another kind.
_OPEN = (Motion.UNDECIDED, Motion.NEUTRAL, Motion.CHAOTIC)
#: Points that are followed in one call.
_PART = 20_000


@dataclass(frozen=True)
class Outcomes:
    """What the motions of a file are in the long run.

    Attributes
    ----------
    motion, period, impacts : ndarray of int, shape (n,)
        The `Motion` at each point, and m and q of a periodic motion, otherwise 0.
    followed : ndarray of bool, shape (n,)
        Whether the motion was followed on: then these values come from the longer run, not from
        its record.
    cycles : dict of int to ndarray, shape (m, 2)
        The section states of the periodic motions that were followed on, by point.
    """

    motion: np.ndarray
    period: np.ndarray
    impacts: np.ndarray
    followed: np.ndarray
    cycles: dict[int, np.ndarray]


def outcomes(dataset: xr.Dataset, points: PointNumbers, extensions: int = EXTENSIONS) -> Outcomes:
    """Find what the motions of a sweep are in the long run.

    Parameters
    ----------
    dataset : Dataset
        An opened sweep, or a cut through one, with ``period`` and the section.
    points : PointNumbers
        The points of `dataset`.
    extensions : int
        How often a motion that has not settled is followed four times as long; with 0 the
        records alone decide.
    """
    motion = classify(dataset).ravel()
    periodic = motion == Motion.PERIODIC
    period, impacts = (
        np.where(periodic, dataset[name].values.ravel(), 0) for name in ("period", "period_impacts")
    )
    result = Outcomes(motion, period, impacts, np.zeros(motion.size, bool), {})
    at = np.flatnonzero(np.isin(motion, _OPEN))
    if "chatters" in dataset:
        once = (motion == Motion.REST) & (dataset["chatters"].values.ravel() == 1)
        at = np.union1d(at, np.flatnonzero(once))
    if extensions and at.size:
        _Extension(dataset, points, result).run(at, extensions)
    return result


class _Extension:
    """Follows motions on, and stores the result."""

    def __init__(self, dataset: xr.Dataset, points: PointNumbers, result: Outcomes) -> None:
        self._points, self._outcomes = points, result
        self._setting = Setting.of(dataset)
        self._exact = self._setting.method["impact"] == "exact"
        first = int(dataset["section"].values[0]) if "section" in dataset.coords else 1
        self._length = first - 1 + dataset.sizes["section"]
        last = [
            dataset[name].isel(section=-1).values.ravel() for name in ("poincare_x", "poincare_v")
        ]
        self._states = _at_states(dataset, slice(None), *last)
        self._orbits: dict[int, list[tuple[int, int, np.ndarray]]] = {}

    def run(self, at: np.ndarray, extensions: int) -> None:
        """Follow the motions at points on, as often as `extensions` says."""
        motion, left = self._outcomes.motion, MOST_PERIODS
        ended = np.ones(self._points.count, bool)
        for extension in range(1, extensions + 1):
            length = (4**extension - 4 ** (extension - 1)) * self._length
            at = at[self._worthwhile(at, ended)]
            left -= length * at.size
            if not at.size or left < 0:
                return
            before = motion[at]
            for part in np.array_split(at, -(-at.size // _PART)):
                self._follow(part, max(0, length - _RECORD))
            transient_chaos = at[(before == Motion.CHAOTIC) & (motion[at] != before)]
            ended[:] = False
            ended[self._points.parameter[transient_chaos]] = True
            at = at[np.isin(motion[at], _OPEN)]

    def _worthwhile(self, at: np.ndarray, ended: np.ndarray) -> np.ndarray:
        """Return which motions to follow: chaos only beside settled motions and if some `ended`."""
        motion, parameter = self._outcomes.motion, self._points.parameter
        settled = np.isin(motion, (Motion.PERIODIC, Motion.REST))
        beside = np.bincount(parameter[settled], minlength=self._points.count) > 0
        chaotic = motion[at] == Motion.CHAOTIC
        return ~chaotic | (beside & ended)[parameter[at]]

    def _follow(self, at: np.ndarray, transient: int) -> None:
        """Follow motions over the transient and a record, and store what the record shows."""
        setting = self._setting
        results = integrate(
            self._states[at],
            **setting.scheme,
            transient=transient,
            periods=_RECORD,
            phase=setting.phase,
            at_section=True,
            impacts=0,
            lyapunov=self._exact,
        )
        x, v = results["poincare_x"], results["poincare_v"]
        period, impacts = period_class(x, v, results["impacts_per_period"])
        results |= {"period": period}
        motion = kinds(results, self._states["omega"][at], _RECORD)
        self._outcomes.followed[at] = True
        self._outcomes.motion[at] = motion
        self._outcomes.period[at] = np.where(motion == Motion.PERIODIC, period, 0)
        self._outcomes.impacts[at] = np.where(motion == Motion.PERIODIC, impacts, 0)
        self._states["x0"][at], self._states["v0"][at] = x[:, -1], v[:, -1]
        failures: Counter[int] = Counter()
        for i, record in zip(at.tolist(), np.stack([x, v], axis=2), strict=True):
            if self._outcomes.motion[i] == Motion.PERIODIC:
                self._outcomes.cycles[i] = record[-self._outcomes.period[i] :].copy()
            elif self._exact and self._outcomes.motion[i] in (Motion.UNDECIDED, Motion.NEUTRAL):
                self._store_orbit(i, record, failures)

    def _store_orbit(self, i: int, record: np.ndarray, failures: Counter[int]) -> None:
        """Store the stable orbit that a motion goes to, if there is one."""
        parameter = int(self._points.parameter[i])
        orbits = self._orbits.setdefault(parameter, [])
        class_and_cycle = next((orbit for orbit in orbits if goes_to(record, orbit[2])), None)
        if class_and_cycle is None:
            if failures[parameter] >= _MOST_FAILURES:
                return
            state = self._states[i]
            values = {field.name: float(state[field.name]) for field in fields(Oscillator)}
            orbit = nearby_orbit(Oscillator(**values), record, self._setting.phase)
            if orbit is None:
                failures[parameter] += 1
                return
            class_and_cycle = orbit.m, orbit.q, orbit.sections(self._setting.phase)
            orbits.append(class_and_cycle)
        self._outcomes.motion[i] = Motion.PERIODIC
        m, q, cycle = class_and_cycle
        self._outcomes.period[i], self._outcomes.impacts[i] = m, q
        self._outcomes.cycles[i] = cycle


def orbit_speeds(
    dataset: xr.Dataset, at: np.ndarray, states: np.ndarray, m: np.ndarray, q: np.ndarray
) -> list[np.ndarray]:
    """Compute the speeds before the impacts of periodic motions, with the method of the file.

    Parameters
    ----------
    dataset : Dataset
        An opened sweep.
    at : ndarray of int, shape (n,)
        The points of the motions, counted in C order over the file.
    states : ndarray, shape (n, 2)
        x and v at a section of each motion [length, length/time].
    m, q : ndarray of int, shape (n,)
        Forcing periods and impacts per repetition; q speeds are returned per motion, increasing.
    """
    setting = Setting.of(dataset)
    points = _at_states(dataset, at, *states.T)
    speeds = []
    for i in range(len(at)):
        results = integrate(
            points[i : i + 1],
            **setting.scheme,
            transient=0,
            periods=int(m[i]),
            phase=setting.phase,
            at_section=True,
            impacts=int(q[i]),
        )
        kept = results["impact_v"][0]
        speeds.append(np.sort(kept[np.isfinite(kept)]))
    return speeds


def _at_states(
    dataset: xr.Dataset, at: np.ndarray | slice, x: np.ndarray, v: np.ndarray
) -> np.ndarray:
    """Return the parameters of points of a file, with states at the section to start from."""
    points = np.empty(x.size, POINT)
    for name in (field.name for field in fields(Oscillator)):
        points[name] = parameter_at_points(dataset, name)[at]
    points["x0"], points["v0"] = x, v
    return points
