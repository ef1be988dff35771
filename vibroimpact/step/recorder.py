"""`TraceJob`: records the motions of points step by step, to the bits of the kernel."""

from __future__ import annotations

import math
import sys
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from vibroimpact.jit import ALL_THREADS, claim, compiled, is_set, jit, on_threads, specialised
from vibroimpact.oscillator import with_one_force
from vibroimpact.status import Status
from vibroimpact.step.contact import DISPLACEMENT, IMPACT, KIND, REST, SPEED, TIME, new_scratch
from vibroimpact.step.propagator import is_near, steady_of, turns_near
from vibroimpact.step.scheme import EXACT, THETA, Scheme
from vibroimpact.step.stepper import (
    first_section,
    from_state,
    prepare,
    prepare_exact,
    to_state,
    watch_exact_grid_step,
    watch_grid_step,
)
from vibroimpact.step.turning_points import extremes_of_x, widen_near

# Kinds of row besides the kinds of event: a state on the grid, and the end of a period.
_STATE, SECTION = 10, 11
#: The columns of a trajectory.
TRAJECTORY = "trajectory_t", "trajectory_x", "trajectory_v"
_PENDING = int(Status.PENDING)
_NO_LIMIT = sys.maxsize


@jit
def _put(log, n, kind, t, x, v):
    """Write a row if there is room; return the number of rows, written or not.

    Its columns have the shape (3, rows), or (4, rows) if the kind is logged, too. After a failure x
    and v are NaN.
    """
    if n < log.shape[1]:
        failed = not (math.isfinite(x) and math.isfinite(v))
        log[-3, n] = t
        log[-2, n], log[-1, n] = (math.nan, math.nan) if failed else (x, v)
        if log.shape[0] > 3:
            log[0, n] = kind
    return n + 1


@jit
def _put_events(log, n, events, n_events, t, t_T, T, pt):
    """Write the events of a step that began at `t`; an impact gives a row before and one after.

    Return the number of rows, and whether the last is the state after an impact at the end `t_T`.
    """
    at, at_end = t, False
    for k in range(n_events):
        # Rounded in different ways, no event may come before another, or after the step.
        at = t_T if events[k, TIME] == T else min(max(t + events[k, TIME], at), t_T)
        kind = events[k, KIND]
        v = events[k, SPEED] if kind == IMPACT else 0.0
        n = _put(log, n, kind, at, events[k, DISPLACEMENT], v)
        if kind == IMPACT:
            n = _put(log, n, _STATE, at, pt.clearance, -pt.R * v)
        at_end = kind == IMPACT and at == t_T
    return n, at_end


@specialised
def _put_first(log, t, pt, rule, state, first, led):
    """Write the rows at the section number `first`; `led` says whether steps have led to it."""
    x, v = from_state(rule, state, pt)
    if first == 0 and not led:
        x, v = pt.x0, pt.v0
        if x >= pt.clearance and v > 0.0:  # both sides of an impact at the start
            return _put(log, _put(log, 0, IMPACT, t, x, v), _STATE, t, x, -pt.R * v)
    return _put(log, 0, REST if state[2] else _STATE, t, x, v)


class TraceJob(NamedTuple):
    """The data that the threads share."""

    points: np.ndarray  #: Of dtype ``POINT``, shape (n,).
    scheme: Scheme
    periods: int
    first: np.ndarray  #: Number of the section at which the clock of each point begins.
    every: int  #: Of so many states of the grid one is logged.
    most_rows: int  #: A motion with more rows ends within a step.
    #: Receives the rows for which there is room: t, x, v, or kind, t, x, v. Shape (3, room) or
    #: (4, room), with the logs of the points one after the other.
    logs: np.ndarray
    #: Where the room of each point starts in `logs`, and its end, shape (n + 1,).
    starts: np.ndarray
    #: Receives the number of rows that a log needs, and the status, shape (n, 2). The status of a
    #: motion that ends early is ``PENDING``.
    outcomes: np.ndarray
    extremes: np.ndarray  #: Receives the least and the greatest displacement, shape (n, 2).
    claimed: np.ndarray  #: Number of points taken by the threads so far, shape (1,).
    interrupt: np.ndarray  #: Once it is set, the motions end within a forcing period. Shape (1,).


@specialised
def _trace(job, i, exactly):
    """Run a point as the kernel's lanes do, and log its motion; return its rows and its status."""
    pt, log = job.points[i], job.logs[:, job.starts[i] : job.starts[i + 1]]
    first, every, periods = job.first[i], job.every, job.periods
    scratch, (method, grid) = new_scratch(), job.scheme
    rule, led = method[0], pt.phase != grid.table[THETA, 0]
    state, status = first_section(method, grid, pt, scratch, first > 0, exactly)
    size, T = grid.size, grid.phase_step / pt.omega
    t = (2.0 * math.pi * first + grid.table[THETA, 0]) / pt.omega
    rows = _put_first(log, t, pt, rule, state, first, led)
    start, extremes, near = state, (state[0], state[0]), False
    if exactly:
        prepared, steady = prepare_exact(grid, pt, scratch), steady_of(pt, grid)
        forms = turns_near(prepared[0], steady, grid.phase_step)
    else:
        prepared = prepare(method, grid, pt)
    for k in range(periods):
        if is_set(job.interrupt):
            return 0, _PENDING
        if exactly:
            near = is_near(steady, state[0], state[1])
            if near:
                extremes = widen_near(steady, forms, state[0], state[1], extremes)
        for n in range(size):
            if rows > job.most_rows:
                return 0, _PENDING
            if exactly:
                state, n_events, outcome, wider = watch_exact_grid_step(
                    prepared, state, grid, n, pt, scratch, extremes
                )
            else:
                state, n_events, outcome, wider = watch_grid_step(
                    method, prepared, state, grid, n, pt, scratch, extremes
                )
            extremes = extremes if near else wider
            status = max(status, outcome)
            x, v = from_state(rule, state, pt)
            last = n + 1 == size
            if last:
                state = to_state(rule, x, v, state[2], pt)
            t_T = (2.0 * math.pi * (first + k) + grid.table[THETA, n + 1]) / pt.omega
            rows, at_end = _put_events(log, rows, scratch.events, n_events, t, t_T, T, pt)
            if (k * size + n + 1) % every == 0:
                if at_end:
                    rows -= 1  # replace the state after an impact at the end of the step
                rows = _put(log, rows, SECTION if last else _STATE, t_T, x, v)
            t = t_T
    first_x = from_state(rule, start, pt)[0] if led else pt.x0
    least, most = extremes_of_x(extremes, first_x, x, pt.clearance, exactly)
    job.extremes[i, 0], job.extremes[i, 1] = least, most
    return rows, status


@cache
def _loop_of(exactly: bool) -> Any:
    """Return the loop of a thread with the rule ``exact``, or with a rule of time stepping."""

    @jit
    def trace_points(job):
        i = claim(job.claimed)
        while i < job.points.size:  # terminates: the counter only rises
            rows, status = _trace(job, i, exactly)
            job.outcomes[i, 0], job.outcomes[i, 1] = rows, status
            i = claim(job.claimed)

    return trace_points


def _logged(
    points: np.ndarray,
    scheme: Scheme,
    excerpt: tuple[int, np.ndarray, int, int],
    threads: int,
    interrupt: np.ndarray | None,
    columns: int,
    events: np.ndarray | None = None,
) -> tuple[list[np.ndarray], TraceJob]:
    """Log motions; return their logs, of shape (columns, rows) each, and the job that logged them.

    An `excerpt` is periods, first section of each point, every and most rows of a job; `events` are
    as of `trajectories`.
    """
    n, run = points.size, _loop_of(scheme.method[0] == EXACT)
    interrupt = np.zeros(1, np.int64) if interrupt is None else interrupt
    periods, first, every, most = excerpt
    rows = np.full(n, 4 * periods) if events is None else np.ceil(events).astype(np.int64)
    rows = 2 * rows + periods * scheme.grid.size // every + 1
    room = np.zeros(n, np.int64)
    points = with_one_force(points)
    while (rows > room).any():  # terminates: the second pass needs as many rows as the first
        room = np.maximum(rows, room)
        starts = np.concatenate([[0], np.cumsum(room)])
        logs = np.empty((columns, starts[-1]))  # memory that is not written is not taken
        outcomes, claimed = np.zeros((n, 2), np.int64), np.zeros(1, np.int64)
        pairs = np.empty((n, 2))
        shares = logs, starts, outcomes, pairs, claimed, interrupt
        job = TraceJob(points, scheme, periods, first, every, most, *shares)
        on_threads(threads, interrupt, compiled(run, job), job)
        rows = job.outcomes[:, 0]
    return [job.logs[:, starts[i] : starts[i] + rows[i]] for i in range(n)], job


def trace(
    points: np.ndarray,
    scheme: Scheme,
    periods: int,
    first: int = 0,
    every: int = 1,
    interrupt: np.ndarray | None = None,
    most_rows: int = _NO_LIMIT,
    extremes: np.ndarray | None = None,
) -> tuple[np.ndarray, Status]:
    """Log the motion of one parameter point, an array of shape (1,); return the log and the status.

    The log has the shape (rows, 4): kind of row, t, x, v, with NaN after a failure. It holds every
    `every`-th state of the grid, and both sides of every impact. Its clock begins at the section
    number `first`. A run that ends early, because of `interrupt` as for ``run_points`` or because
    its log has more than `most_rows`, has an empty log and the status ``PENDING``. `extremes`, of
    shape (2,), receives the least and the greatest displacement.
    """
    if periods * (scheme.grid.size // every) > most_rows:
        return np.empty((0, 4)), Status.PENDING
    excerpt = (periods, np.array([first]), every, most_rows)
    (log,), job = _logged(points, scheme, excerpt, 1, interrupt, 4)
    log, status = log.T, job.outcomes[0, 1]
    if extremes is not None:
        extremes[:] = job.extremes[0]
    if status == Status.PENDING:
        return log, Status.PENDING
    done = Status.CERTIFIED if scheme.method[0] == EXACT else Status.COMPUTED
    outcome = Status(max(done, status))
    if np.isnan(log[:, 2]).any() and not outcome.failed:
        outcome = Status.NON_FINITE
    return log, outcome


def trajectories(
    points: np.ndarray,
    scheme: Scheme,
    periods: int,
    first: int | np.ndarray = 0,
    every: int = 1,
    threads: int | None = 1,
    interrupt: np.ndarray | None = None,
    events: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Log the motion of many parameter points, on all threads if `threads` is None.

    The other arguments are those of `trace`; `first` may have the shape (n,). If a motion has more
    events than `events` says, by default four in each period, a second pass is necessary. Returns
    ``trajectory_t``, ``trajectory_x`` and ``trajectory_v``, of shape (n,): of each motion an array
    of its own length, which is 0 for an interrupted point.
    """
    n = points.size
    excerpt = (periods, np.full(n, first), every, _NO_LIMIT)
    threads = min(ALL_THREADS if threads is None else threads, n)
    logs, _ = _logged(points, scheme, excerpt, threads, interrupt, 3, events)
    result = {name: np.empty(n, object) for name in TRAJECTORY}
    for i, log in enumerate(logs):
        for name, samples in zip(TRAJECTORY, log, strict=True):
            result[name][i] = samples
    return result
