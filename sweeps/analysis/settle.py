"""Follow motions that go to no known attractor until they do.

The class of a motion is that of its destination (`vibroimpact.destination`). A motion without a
class is followed further, unless it rests twice. Each extension makes the motion four times as
long, continuing from the last section with the method of the file.

**Rest.** A rest erases the past, so all motions of a parameter point that have rested have the same
future. A motion that rests twice is periodic. But if a motion that has rested is chaotic later, the
time between two rests is longer than a record, and it is a matter of chance whether a record shows
rest or chaos. In this case rest and chaos are the same attractor.

**Chaos** may be a long transient. A chaotic motion is followed further once, and then for as long
as some of the chaotic motions of its parameter point settle. If some settled in the last extension,
the others are undecided.

Some motions never settle, for example without damping. Therefore all motions together are followed
for at most ``MOST_FOLLOWED`` forcing periods.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from sweeps.analysis.grouping import GridIndex
from sweeps.analysis.regimes import UNSETTLED, Regime, classify, regimes_of
from sweeps.analysis.selection import config_of
from sweeps.config.sweep import SweepConfig
from vibroimpact import integrate
from vibroimpact.destination.repetition import LONGEST_PERIOD, TOLERANCE
from vibroimpact.points.destinations import classified

#: How often a motion is followed further, each time four times as long.
EXTENSIONS = 4
#: Most forcing periods over which Lyapunov exponents are computed; weak chaos needs many to show.
_LONG = 1024
#: Forcing periods of the last record of a motion followed further: twice the longest repetition.
_RECORD = 2 * LONGEST_PERIOD
#: Most forcing periods for which all motions together are followed.
MOST_FOLLOWED = 300_000_000
#: Number of points that are followed in one call.
_PART = 4_000


def follow(
    config: SweepConfig, points: np.ndarray, periods: int, **options: Any
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Follow motions from their states at the section, with the method of a sweep.

    `options` are arguments of `vibroimpact.integrate`. Returns its results and the states at the
    sections, shape (n, periods, 2).
    """
    method = config.method.arguments
    record = {"transient": 0, "phase": config.record.phase, "impacts": 0} | options
    results = integrate(points, **method, periods=periods, at_section=True, **record)
    return results, np.stack([results["poincare_x"], results["poincare_v"]], axis=2)


class Outcomes:
    """The regimes and classes of the motions of a file, from their records or from longer runs."""

    def __init__(self, dataset: xr.Dataset, points: GridIndex) -> None:
        self._points, self._config = points, config_of(dataset)
        self._exact = self._config.method.impact == "exact"
        #: The `Regime` at each point, shape (n,).
        self.regime = classify(dataset).ravel()
        names = "period", "period_impacts", "rest_fraction", "chatters"
        m, q, share, chatters = (dataset[name].values.ravel() for name in names)
        periodic = self.regime == Regime.PERIODIC
        #: Forcing periods and impacts per repetition of a periodic motion, otherwise 0.
        self.m, self.q = np.where(periodic, m, 0), np.where(periodic, q, 0)
        shown = dataset["orbit_distance"].values.ravel() <= TOLERANCE
        shown &= self.m <= dataset.sizes["section"]
        #: m where the record itself repeats, otherwise 0.
        self.repetition = np.where(shown, self.m, 0)
        #: Whether the record does not show the attractor, so that the motion was followed further
        #: or its orbit found.
        self.followed = periodic & ~shown
        #: The section states of the orbits of all other periodic motions, by point, shape (m, 2).
        self.cycles: dict[int, np.ndarray] = {}
        orbit = [dataset[f"orbit_{name}"].values.ravel() for name in "xv"]
        self._add_cycles(np.flatnonzero(self.followed), np.stack(orbit, axis=1)[self.followed])
        first = int(dataset["section"].values[0]) if "section" in dataset.coords else 1
        self._length = first - 1 + dataset.sizes["section"]
        self._rests = _rests(share, np.maximum(chatters, share > 0.0))

    def _add_cycles(self, at: np.ndarray, states: np.ndarray) -> None:
        """Add the cycles of periodic motions, given a section state of each orbit, shape (k, 2)."""
        for m in np.unique(self.m[at]).tolist():
            rows = np.flatnonzero(self.m[at] == m)
            cycles = states[rows, None]
            if m > 1:
                points = self._points.at_states(at[rows], *states[rows].T)
                cycles = np.concatenate([cycles, follow(self._config, points, m - 1)[1]], axis=1)
            self.cycles |= dict(zip(at[rows].tolist(), cycles, strict=True))

    def follow_on(self, last: np.ndarray, extensions: int) -> None:
        """Follow the motions that have not settled from their `last` states, shape (n, 2).

        Each of at most `extensions` extensions makes them four times as long.
        """
        self._last = last.copy()
        left, chaos_ends = MOST_FOLLOWED, np.zeros(self._points.count, bool)
        before = np.zeros(self.regime.size, bool)
        for extension in range(1, extensions + 1):
            length = (4**extension - 4 ** (extension - 1)) * self._length
            chaotic = self._chaotic()
            once = (self.regime == Regime.REST) & (self._rests == 1)
            open_chaos = chaotic & (chaos_ends[self._points.parameter] | ~before)
            at = np.flatnonzero(np.isin(self.regime, UNSETTLED) | once | open_chaos)
            left -= length * at.size
            if not at.size or left < 0:
                break
            for part in np.array_split(at, -(-at.size // _PART)):
                self._follow(part, length)
            settled = ~self._chaotic() & ~np.isin(self.regime, UNSETTLED)
            chaos_ends, before = self._at_points(chaotic & settled), chaotic
        if extensions:
            self._conclude(chaos_ends)

    def _at_points(self, which: np.ndarray) -> np.ndarray:
        """Return the mask of the parameter points that have some of the motions in `which`."""
        return np.bincount(self._points.parameter[which], minlength=self._points.count) > 0

    def _chaotic(self) -> np.ndarray:
        """Return the mask of motions that are chaotic, or that rest where a rest leads to chaos."""
        chaotic = self.regime == Regime.CHAOTIC
        leads_to_chaos = self._at_points(chaotic & (self._rests > 0))
        return chaotic | ((self.regime == Regime.REST) & leads_to_chaos[self._points.parameter])

    def _conclude(self, chaos_ends: np.ndarray) -> None:
        """Assign the same regime to all chaotic motions of a parameter point."""
        parameter, chaotic = self._points.parameter, self._chaotic()
        rests_again = self._at_points(chaotic & (self._rests > 1))[parameter]
        self.regime[chaotic] = np.where(rests_again[chaotic], Regime.REST, Regime.CHAOTIC)
        self.regime[chaotic & chaos_ends[parameter]] = Regime.UNDECIDED

    def _record(
        self, at: np.ndarray, periods: int, lyapunov: bool = False
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Follow motions as `follow` does, keep their last states, and count their rests."""
        points = self._points.at_states(at, *self._last[at].T)
        results, sections = follow(self._config, points, periods, lyapunov=lyapunov)
        last = sections[:, -1]
        # A failed motion keeps its old state, so that the next record fails again.
        self._last[at] = np.where(np.isfinite(last), last, self._last[at])
        self._rests[at] += _rests(results["rest_fraction"], results["chatters"])
        return results, sections

    def _follow(self, at: np.ndarray, length: int) -> None:
        """Follow motions over `length` periods and a last record, and store their regimes."""
        for done in range(0, length - _LONG, _LONG):
            self._record(at, min(length - _LONG - done, _LONG))
        grown = min(length, _LONG)
        growth, _ = self._record(at, grown, lyapunov=self._exact)
        results, _ = self._record(at, _RECORD)
        share = np.maximum(growth["rest_fraction"], results["rest_fraction"])
        points = self._points.oscillators[self._points.parameter[at]]
        results = classified(self._config.sweep.spec, points, results, None, None)
        regime = regimes_of(growth | results | {"rest_fraction": share}, points["omega"], grown)
        periodic = regime == Regime.PERIODIC
        self.followed[at] = True
        self.regime[at] = regime
        self.m[at] = np.where(periodic, results["period"], 0)
        self.q[at] = np.where(periodic, results["period_impacts"], 0)
        orbit = np.stack([results["orbit_x"], results["orbit_v"]], axis=1)
        self._add_cycles(at[periodic], orbit[periodic])


def _rests(share: np.ndarray, chatters: np.ndarray) -> np.ndarray:
    """Count the rests in records; a rest that lasts counts as two, since nothing can follow it."""
    return np.where(share > 0.999, 2, chatters)


def orbit_speeds(
    config: SweepConfig, points: np.ndarray, m: np.ndarray, q: np.ndarray
) -> list[np.ndarray]:
    """Compute the speeds before the impacts of periodic motions, with the method of a file.

    The motions start from the states of `points` at the section, and have m periods and q impacts
    per repetition. The q speeds of each motion are returned in increasing order.
    """
    speeds = []
    for i in range(len(points)):
        results, _ = follow(config, points[i : i + 1], int(m[i]), impacts=int(q[i]))
        kept = results["impact_v"][0]
        speeds.append(np.sort(kept[np.isfinite(kept)]))
    return speeds
