"""Motions without a known attractor, run on until they reach one.

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

from dataclasses import replace

import numpy as np

from sweeps.opened.motions import motions_from
from sweeps.opened.opened_sweep import OpenedSweep
from vibroimpact.destination.repetition import LONGEST_PERIOD
from vibroimpact.points.computation import compute_points
from vibroimpact.points.regimes import Regime
from vibroimpact.points.stages import RunSpec, put_last, worst_of
from vibroimpact.status import Status

#: How often a motion is continued, each time until it is four times as long.
EXTENSIONS = 4
#: Most forcing periods over which Lyapunov exponents are computed; weak chaos needs many to show.
_LYAPUNOV_PERIODS = 1024
#: Last forcing periods of an extension, which show the class: twice the longest repetition.
_CLASS_PERIODS = 2 * LONGEST_PERIOD
#: Most forcing periods for which all motions together are continued.
MOST_CONTINUED = 300_000_000
#: Number of points that are continued in one call.
_POINTS_AT_ONCE = 4_000


def settle(
    motions: np.ndarray, sweep: OpenedSweep, parameter: np.ndarray, extensions: int
) -> np.ndarray:
    """Continue motions that go to no known attractor, and write the regimes and orbits they reach.

    Motions of `motions`, of dtype ``MOTION``, shape (n,), that are not periodic get their last
    states as starts. `parameter` is the parameter point of each. Returns the mask of those that
    were continued.
    """
    regime, continued = motions["regime"], np.zeros(len(motions), bool)
    without = (regime != Regime.PERIODIC) & (regime > Regime.FAILED)
    if not without.any():
        return continued
    state = _last_states(motions["point"], sweep)
    motions["point"][without] = state[without]
    share, chatters = (sweep[name].values.ravel() for name in ("rest_fraction", "chatters"))
    rests = _rests_of(share, np.maximum(chatters, share > 0.0))
    chaotic = _chaotic(regime, rests, parameter)
    going = np.flatnonzero((regime == Regime.UNKNOWN) | _rested_once(regime, rests) | chaotic)
    first = int(sweep["section"].values[0]) if "section" in sweep else 1
    length = first - 1 + sweep.sizes["section"]
    done, planned, spec = 0, 3 * length * going.size, sweep.spec
    chaos_ends = np.zeros_like(continued)
    for i in range(extensions):
        if not going.size or planned > MOST_CONTINUED:
            break
        continued[going] = True
        periods = 3 * length * 4**i + _CLASS_PERIODS
        motions[going], state[going], rested = _extended(spec, state[going], periods)
        rests[going] += rested
        before, chaotic = chaotic, _chaotic(regime, rests, parameter)
        unknown = regime == Regime.UNKNOWN
        chaos_ends = _at_point_of(before & ~chaotic & ~unknown, parameter)
        on = unknown | _rested_once(regime, rests) | (chaotic & (chaos_ends | ~before))
        going, done = going[on[going]], done + periods
        planned += 3 * (length + done) * going.size
    aperiodic = continued & (regime != Regime.PERIODIC)
    motions["point"][aperiodic] = state[aperiodic]
    # All chaotic motions of a parameter point are on one attractor.
    rests_again = _at_point_of(chaotic & (rests > 1), parameter)
    if continued.any():
        regime[chaotic] = np.where(rests_again, Regime.REST, Regime.CHAOTIC)[chaotic]
        regime[chaotic & chaos_ends] = Regime.UNKNOWN
        motions["m"][chaotic] = 0
    return continued


def _last_states(points: np.ndarray, sweep: OpenedSweep) -> np.ndarray:
    """Return the points of motions with their last states in the records as starts."""
    last = points.copy()
    for name in "xv":
        last[f"{name}0"] = sweep[f"poincare_{name}"].isel(section=-1).values.ravel()
    return last


def _extended(
    spec: RunSpec, points: np.ndarray, periods: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Continue motions, and return where they go, their last states, and how often they rested.

    A motion that failed in any part has failed: its last state is a start, from which the next part
    begins anew.
    """
    parts = []
    for state in np.array_split(points, -(-points.size // _POINTS_AT_ONCE)):
        rests, worst = np.zeros(state.size, np.int64), np.full(state.size, Status.COMPUTED, np.int8)
        for length in _lengths(periods - _CLASS_PERIODS):
            bare = replace(spec.part(0, length, 0, spec.impact == "exact"), period=False)
            before = compute_points(bare, state, None)
            rests += _rests_of(before["rest_fraction"], before["chatters"])
            worst = worst_of(worst, before["status"])
            put_last(state, before, spec.phase)
        record = compute_points(spec.part(0, _CLASS_PERIODS, 0, False), state, None)
        rests += _rests_of(record["rest_fraction"], record["chatters"])
        share = np.maximum(before["rest_fraction"], record["rest_fraction"])
        whole = {"rest_fraction": share, "status": np.maximum(worst, record["status"])}
        reached = motions_from(bare, state, before | record | whole)
        put_last(state, record, spec.phase)
        parts.append((reached, state, rests))
    reached, state, rests = map(np.concatenate, zip(*parts, strict=True))
    return reached, state, rests


def _lengths(periods: int) -> list[int]:
    """Divide periods into records of at most ``_LYAPUNOV_PERIODS``, the longest last."""
    count, first = divmod(periods, _LYAPUNOV_PERIODS)
    return [first] * (first > 0) + [_LYAPUNOV_PERIODS] * count


def _at_point_of(which: np.ndarray, parameter: np.ndarray) -> np.ndarray:
    """Return the mask of the motions at whose parameter points there are motions in `which`."""
    return np.isin(parameter, parameter[which])


def _chaotic(regime: np.ndarray, rests: np.ndarray, parameter: np.ndarray) -> np.ndarray:
    """Return the mask of motions that are chaotic, or that rest where a rest leads to chaos."""
    chaotic = regime == Regime.CHAOTIC
    return chaotic | ((regime == Regime.REST) & _at_point_of(chaotic & (rests > 0), parameter))


def _rested_once(regime: np.ndarray, rests: np.ndarray) -> np.ndarray:
    """Return the mask of the motions of which it is not known whether they rest again."""
    mask: np.ndarray = (regime == Regime.REST) & (rests == 1)
    return mask


def _rests_of(share: np.ndarray, chatters: np.ndarray) -> np.ndarray:
    """Count the rests in records; a rest that lasts counts as two, since nothing can follow it."""
    return np.where(share > 0.999, 2, chatters)
