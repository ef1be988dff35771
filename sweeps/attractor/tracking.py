"""Continues motions beyond records until they `settle`; links attractors along an axis.

**Settling.** The class of a motion is that of its destination (`vibroimpact.destination`). A motion
without a class is continued, unless it rests twice, with the method of the file.

**Rest.** A rest erases the past, so all motions of a parameter point that have rested have the same
future. A motion that rests twice is periodic. But if a motion that has rested is chaotic later, the
time between two rests is longer than a record, and it is a matter of chance whether a record shows
rest or chaos. In this case rest and chaos are the same attractor.

**Chaos** may be a long transient. A chaotic motion is continued once, and then for as long as some
of the chaotic motions of its parameter point get a class. If some did in the last extension, the
others are unknown.

Some motions never get a class, for example without damping. Therefore all motions together are
continued for at most ``MOST_CONTINUED`` forcing periods; of many, each is continued less at first.

**Numbers along the axes.** Two attractors at neighbouring values of an axis get the same number if
each is the nearest to the other and their distance is at most ``MAX_DISTANCE``. An attractor keeps
its number through a flip: an orbit of m periods may continue as a nearby orbit of 2 m or m / 2
periods, as the branches of a diagram do. It loses its number in a jump, for example at the end of a
window.

If a step moves the section by more, motions are seeded on each of the two attractors, with the
parameters of the other. They get the same number if each seed leads to the other attractor, and
their classes are the same, or m/q and 2 m/2 q.

These links form chains along the longest axis, also over gaps of at most ``MAX_GAP`` of the axis,
because at a few values no start may reach the attractor, or settle on it. Along the other axes
chains are joined, those with the longest border first, but never two chains that coexist at some
point. Around a cusp, where one attractor leads to another, the number therefore changes along some
line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from sweeps.opened.motions import ORBIT_TOLERANCE, Cycles, cycles_of, distances, motions_from
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
#: Last forcing periods of a motion, which show its class: twice the longest repetition.
_CLASS_PERIODS = 2 * LONGEST_PERIOD
#: Most forcing periods for which all motions together are continued.
MOST_CONTINUED = 300_000_000
#: Number of points that are continued in one call.
_POINTS_AT_ONCE = 4_000


def settle(
    motions: np.ndarray, sweep: OpenedSweep, parameter: np.ndarray, extensions: int
) -> tuple[np.ndarray, int]:
    """Continue motions that go to no known attractor, and write the regimes and orbits they reach.

    Motions of `motions`, of dtype ``MOTION``, shape (n,), that are not periodic get their last
    states as starts. `parameter` is the parameter point of each. Returns the mask of those that
    were continued, and how many extensions ``MOST_CONTINUED`` left out.
    """
    regime, continued, left_out = motions["regime"], np.zeros(len(motions), bool), 0
    without = (regime != Regime.PERIODIC) & (regime > Regime.FAILED)
    if not without.any():
        return continued, left_out
    state = _last_states(motions["point"], sweep)
    motions["point"][without] = state[without]
    share, chatters = (sweep[name].values.ravel() for name in ("rest_fraction", "chatters"))
    rests = _rests_of(share, np.maximum(chatters, share > 0.0))
    chaotic = _chaotic(regime, rests, parameter)
    going = np.flatnonzero((regime == Regime.UNKNOWN) | _rested_once(regime, rests) | chaotic)
    length = int(sweep.transients.ravel()[going].max(initial=0)) + sweep.sizes["section"]
    longest = (MOST_CONTINUED // max(going.size, 1) - _CLASS_PERIODS) // 3
    length, planned, chaos_ends = max(min(length, longest), 1), 0, np.zeros_like(continued)
    for i in range(extensions):
        periods = 3 * length * 4**i + _CLASS_PERIODS
        planned += periods * going.size
        if not going.size or planned > MOST_CONTINUED:
            left_out = extensions - i if going.size else 0
            break
        continued[going] = True
        motions[going], state[going], rested = _continue(sweep.spec, state[going], periods)
        rests[going] += rested
        before, chaotic = chaotic, _chaotic(regime, rests, parameter)
        unknown = regime == Regime.UNKNOWN
        chaos_ends = _at_point_of(before & ~chaotic & ~unknown, parameter)
        on = unknown | _rested_once(regime, rests) | (chaotic & (chaos_ends | ~before))
        going = going[on[going]]
    aperiodic = continued & (regime != Regime.PERIODIC)
    motions["point"][aperiodic] = state[aperiodic]
    # All chaotic motions of a parameter point are on one attractor.
    rests_again = _at_point_of(chaotic & (rests > 1), parameter)
    if continued.any():
        regime[chaotic] = np.where(rests_again, Regime.REST, Regime.CHAOTIC)[chaotic]
        regime[chaotic & chaos_ends] = Regime.UNKNOWN
        motions["m"][chaotic] = 0
    return continued, left_out


def _last_states(points: np.ndarray, sweep: OpenedSweep) -> np.ndarray:
    """Return the points of motions with their last states in the records as starts."""
    last = points.copy()
    for name in "xv":
        last[f"{name}0"] = sweep[f"poincare_{name}"].isel(section=-1).values.ravel()
    return last


def _continue(
    spec: RunSpec, points: np.ndarray, periods: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Continue motions, and return where they go, their last states, and how often they rested.

    A motion that failed in any part has failed: its last state is a start, from which the next part
    begins anew.
    """
    chunks = []
    count, first = divmod(periods - _CLASS_PERIODS, _LYAPUNOV_PERIODS)
    lengths = [first] * (first > 0) + [_LYAPUNOV_PERIODS] * count  # the longest last
    for state in np.array_split(points, -(-points.size // _POINTS_AT_ONCE)):
        rests, worst = np.zeros(state.size, np.int64), np.full(state.size, Status.COMPUTED, np.int8)
        for length in lengths:
            bare = replace(spec.stage(0, length, 0, spec.impact == "exact"), period=False)
            before = compute_points(bare, state, None)
            rests += _rests_of(before["rest_fraction"], before["chatters"])
            worst = worst_of(worst, before["status"])
            put_last(state, before, spec.phase)
        record = compute_points(spec.stage(0, _CLASS_PERIODS, 0, False), state, None)
        rests += _rests_of(record["rest_fraction"], record["chatters"])
        share = np.maximum(before["rest_fraction"], record["rest_fraction"])
        of_both = {"rest_fraction": share, "status": np.maximum(worst, record["status"])}
        motions = motions_from(bare, state, before | record | of_both)
        put_last(state, record, spec.phase)
        chunks.append((motions, state, rests))
    motions, state, rests = map(np.concatenate, zip(*chunks, strict=True))
    return motions, state, rests


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


#: Attractors farther apart than this, relative to their greatest coordinate, are different.
MAX_DISTANCE = 0.2
#: Longest gap that is bridged, as a share of an axis.
MAX_GAP = 1 / 32
#: Most attractors of a parameter point that are tracked: all pairs of two points are compared.
MOST_TRACKED = 50
#: Forcing periods for which a seed moves before its record.
_SEED_PERIODS = 500

#: Tells which pairs of attractors, given by two arrays of indices, are linked.
Links = Callable[[np.ndarray, np.ndarray], np.ndarray]


def joined_by(count: int, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the number of the group of each of `count` things; each ``a[i], b[i]`` are in one."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = a.astype(np.int32), b.astype(np.int32)  # SciPy 1.11 needs int32
    graph = coo_array((np.ones(len(a)), pairs), (count, count))
    numbers: np.ndarray = connected_components(graph, directed=False)[1]
    return numbers


def track(shape: tuple[int, ...], point: np.ndarray, near: Links, seeded: Links) -> np.ndarray:
    """Return a number from 0 for each attractor, the same for those that continue each other.

    `shape` is the shape of the grid of parameter points, and `point` the index of that of each
    attractor, increasing. `seeded` is asked where `near` finds no link along the longest axis.
    """
    longest = int(np.argmax(shape))
    gap = max(1, int(MAX_GAP * shape[longest]))
    over = [(1, near), (1, seeded), *((step, near) for step in range(2, gap + 1))]
    a, b = _along(shape, point, longest, over)
    chain = joined_by(len(point), a, b)
    others = (axis for axis in range(len(shape)) if axis != longest)
    borders = [chain[_along(shape, point, axis, [(1, near)])] for axis in others]
    return _joined_chains(chain, point, np.concatenate(borders, axis=1)) if borders else chain


def _along(
    shape: tuple[int, ...], point: np.ndarray, axis: int, links: Sequence[tuple[int, Links]]
) -> np.ndarray:
    """Return the pairs linked along an axis, shape (2, n); an attractor has at most one per side.

    The `links` are tried one after the other, each between values that are some steps apart.
    """
    stride = int(np.prod(shape[axis + 1 :], dtype=np.int64))
    at = point // stride % shape[axis]
    free = np.tile(np.bincount(point)[point] <= MOST_TRACKED, (2, 1))  # without a link on a side
    of_steps = [np.empty((2, 0), np.int64)]
    for step, linked in links:
        a, b = np.flatnonzero(free[0] & (at < shape[axis] - step)), np.flatnonzero(free[1])
        first, last = (
            np.searchsorted(point[b], point[a] + step * stride, side) for side in ("left", "right")
        )
        row = np.repeat(np.arange(len(a)), last - first)
        column = np.arange(len(row)) + (last - np.cumsum(last - first))[row]
        pairs = np.stack([a[row], b[column]])
        pairs = pairs[:, linked(*pairs)]
        free[[[0], [1]], pairs] = False
        of_steps.append(pairs)
    return np.concatenate(of_steps, axis=1)


def mutually_nearest(cycles: Cycles, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the mask of the pairs in which each is the nearest to the other, and near enough."""
    apart = distances(cycles, a, b)
    mutual = apart <= MAX_DISTANCE
    for first, second in ((a, b), (b, a)):
        order = np.lexsort((second, apart, first))
        mutual[order[1:]] &= np.diff(first[order]) > 0
    return mutual


def lead_to_each_other(
    spec: RunSpec, motions: np.ndarray, a: np.ndarray, b: np.ndarray
) -> np.ndarray:
    """Return the mask of the pairs of motions in which a seed from each leads to the other."""
    m, q, mask = motions["m"], motions["q"], np.zeros(len(a), bool)
    spec = spec.stage(_SEED_PERIODS, _CLASS_PERIODS, 0, False)
    at = np.flatnonzero(np.isin(m[b] / m[a], (0.5, 1.0, 2.0)) & (q[b] * m[a] == q[a] * m[b]))
    for first, second in ((a, b), (b, a)):
        if not len(at):
            break
        from_, to = motions[first[at]], motions[second[at]]
        seeds = to["point"].copy()
        seeds["x0"] = np.minimum(from_["point"]["x0"], seeds["clearance"])
        seeds["v0"] = from_["point"]["v0"]
        final = motions_from(spec, seeds, compute_points(spec, seeds, None))
        is_same = (final["m"] == to["m"]) & (final["q"] == to["q"])
        at, final, to = at[is_same], final[is_same], to[is_same]
        pairs = np.arange(2 * len(at)).reshape(2, -1)
        cycles = cycles_of(spec, np.concatenate([final, to]))
        at = at[distances(cycles, *pairs) <= ORBIT_TOLERANCE]
    mask[at] = True
    return mask


def _joined_chains(chain: np.ndarray, point: np.ndarray, borders: np.ndarray) -> np.ndarray:
    """Join chains that have `borders`, shape (2, n), unless they share a parameter point."""
    from scipy.cluster.hierarchy import DisjointSet

    points = [set[int]() for _ in range(chain.max() + 1)]
    for number, at in zip(chain.tolist(), point.tolist(), strict=True):
        points[number].add(at)
    joined = DisjointSet(range(len(points)))
    pairs, lengths = np.unique(borders, axis=1, return_counts=True)
    for pair in pairs[:, np.argsort(-lengths, kind="stable")].T.tolist():
        a, b = (joined[number] for number in pair)
        if a != b and points[a].isdisjoint(points[b]):
            joined.merge(a, b)
            points[joined[a]] = points[a] | points[b]
    names = [joined[number] for number in range(len(points))]
    return np.unique(names, return_inverse=True)[1][chain]
