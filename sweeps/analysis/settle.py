"""Continue motions that go to no known attractor until they do.

The class of a motion is that of its destination (`vibroimpact.destination`). A motion without a
class is continued, unless it rests twice, with the method of the file.

**Rest.** A rest erases the past, so all motions of a parameter point that have rested have the same
future. A motion that rests twice is periodic. But if a motion that has rested is chaotic later, the
time between two rests is longer than a record, and it is a matter of chance whether a record shows
rest or chaos. In this case rest and chaos are the same attractor.

**Chaos** may be a long transient. A chaotic motion is continued once, and then for as long as some
of the chaotic motions of its parameter point get a class. If some did in the last extension, the
others are unknown.

Some motions never get a class, for example without damping. Therefore all motions together are
continued for at most ``MOST_CONTINUED`` forcing periods.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import xarray as xr

from sweeps.analysis.dataset import config_of
from sweeps.analysis.grouping import GridIndex
from sweeps.analysis.motions import put_classes
from vibroimpact.destination.repetition import LONGEST_PERIOD
from vibroimpact.points.compute import compute_points
from vibroimpact.points.regimes import Regime, regimes_of
from vibroimpact.points.run_spec import RunSpec
from vibroimpact.points.stages import Results, in_stages, put_last

#: How often a motion is continued, each time until it is four times as long.
EXTENSIONS = 4
#: Most forcing periods over which Lyapunov exponents are computed; weak chaos needs many to show.
_LONG = 1024
#: Last forcing periods of an extension, which show the class: twice the longest repetition.
_RECORD = 2 * LONGEST_PERIOD
#: Most forcing periods for which all motions together are continued.
MOST_CONTINUED = 300_000_000
#: Number of points that are continued in one call.
_PART = 4_000


def settle(
    motions: np.ndarray, dataset: xr.Dataset, index: GridIndex, extensions: int
) -> np.ndarray:
    """Continue motions that go to no known attractor, and write the regimes and orbits they reach.

    `motions`, of dtype ``MOTION``, shape (n,), have their last states as starts. Returns the mask
    of those that were continued.
    """
    share, chatters = (dataset[name].values.ravel() for name in ("rest_fraction", "chatters"))
    regime, rests = motions["regime"], _rests_of(share, np.maximum(chatters, share > 0.0))
    chaotic = _chaotic(regime, rests, index)
    at = np.flatnonzero(
        (regime == Regime.UNKNOWN) | (regime == Regime.REST) & (rests == 1) | chaotic
    )
    continued = np.isin(np.arange(regime.size), at)
    first = int(dataset["section"].values[0]) if "section" in dataset.coords else 1
    length = first - 1 + dataset.sizes["section"]
    planned = 3 * length * at.size
    if not extensions or not at.size or planned > MOST_CONTINUED:
        return continued & False
    chaos_ends = np.zeros(regime.size, bool)

    def goes_on(rows: np.ndarray, done: int, results: Results) -> np.ndarray:
        nonlocal chaotic, chaos_ends, planned
        here, before = at[rows], chaotic
        rests[here] += results["rests"]
        reached = motions[here]
        put_classes(reached, results["regime"], results)
        motions[here] = reached
        chaotic = _chaotic(regime, rests, index)
        unknown = regime == Regime.UNKNOWN
        chaos_ends = _at_point_of(before & ~chaotic & ~unknown, index)
        once = (regime == Regime.REST) & (rests == 1)
        on = (unknown | once | (chaotic & (chaos_ends | ~before)))[here]
        planned += 3 * (length + done) * int(on.sum())
        return on & (planned <= MOST_CONTINUED)

    stops = [length * (4**i - 1) + _RECORD * i for i in range(1, extensions + 1)]
    run = _run_of(config_of(dataset).sweep.spec)
    last, _ = in_stages(motions["point"][at], stops, run, goes_on)
    aperiodic = motions["m"][at] == 0
    motions["point"][at[aperiodic]] = last[aperiodic]
    # All chaotic motions of a parameter point are on one attractor.
    rests_again = _at_point_of(chaotic & (rests > 1), index)
    regime[chaotic] = np.where(rests_again, Regime.REST, Regime.CHAOTIC)[chaotic]
    regime[chaotic & chaos_ends] = Regime.UNKNOWN
    return continued


def _run_of(spec: RunSpec) -> Callable[[np.ndarray, int, bool], Results]:
    """Return the function that continues motions over an extension, and finds their regimes."""
    exact, bare = spec.impact == "exact", replace(spec, period=False)

    def extension(points: np.ndarray, periods: int) -> Results:
        """Continue motions, and find their regimes; ``rests`` counts all their rests."""
        rests, state = np.zeros(points.size, np.int64), points.copy()
        for length in _lengths(periods - _RECORD):
            before = compute_points(bare.part(0, length, 0, exact), state, None, at_section=True)
            rests += _rests_of(before["rest_fraction"], before["chatters"])
            put_last(state, before)
        found = compute_points(spec.part(0, _RECORD, 0, False), state, None, at_section=True)
        rests += _rests_of(found["rest_fraction"], found["chatters"])
        share = np.maximum(before["rest_fraction"], found["rest_fraction"])
        shown = before | found | {"rest_fraction": share}
        ends = {name: values[:, -1:] for name, values in found.items() if values.ndim > 1}
        return found | ends | {"regime": regimes_of(shown, points["omega"], length), "rests": rests}

    def run(points: np.ndarray, periods: int, _: bool) -> Results:
        parts = np.array_split(points, -(-points.size // _PART))
        results = [extension(part, periods) for part in parts]
        return {name: np.concatenate([part[name] for part in results]) for name in results[0]}

    return run


def _lengths(periods: int) -> list[int]:
    """Divide periods into records of at most ``_LONG``, the longest last."""
    count, first = divmod(periods, _LONG)
    return [first] * (first > 0) + [_LONG] * count


def _at_point_of(which: np.ndarray, index: GridIndex) -> np.ndarray:
    """Return the mask of the motions at whose parameter points there are motions in `which`."""
    return (np.bincount(index.parameter[which], minlength=index.count) > 0)[index.parameter]


def _chaotic(regime: np.ndarray, rests: np.ndarray, index: GridIndex) -> np.ndarray:
    """Return the mask of motions that are chaotic, or that rest where a rest leads to chaos."""
    chaotic = regime == Regime.CHAOTIC
    return chaotic | ((regime == Regime.REST) & _at_point_of(chaotic & (rests > 0), index))


def _rests_of(share: np.ndarray, chatters: np.ndarray) -> np.ndarray:
    """Count the rests in records; a rest that lasts counts as two, since nothing can follow it."""
    return np.where(share > 0.999, 2, chatters)
