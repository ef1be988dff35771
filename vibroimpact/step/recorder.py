"""Record the motion of one orbit step by step, to the same bits as in the lanes of the kernel."""

from __future__ import annotations

import math
import sys

import numpy as np

from vibroimpact.jit import inlined, is_set, jit
from vibroimpact.status import Status
from vibroimpact.step.contact import (
    DISPLACEMENT,
    IMPACT,
    KIND,
    REST,
    SPEED,
    TIME,
    new_scratch,
    start,
)
from vibroimpact.step.scheme import EXACT, PLAIN, THETA, Scheme, sine_at_start
from vibroimpact.step.stepper import (
    from_state,
    prepare,
    prepare_exact,
    take_exact_grid_step,
    take_grid_step,
    to_state,
)

# Kinds of row besides the kinds of event: a state on the grid, and the end of a period.
_STATE, SECTION = 10, 11
_PENDING = int(Status.PENDING)


@jit
def _put(log, n, kind, t, x, v):
    """Write a row if there is room; return the number of rows, written or not."""
    if n < log.shape[0]:
        log[n, 0], log[n, 1], log[n, 2], log[n, 3] = kind, t, x, v
    return n + 1


@jit
def _put_events(log, n, events, n_events, t, t_T, T, pt):
    """Write the events of a step that began at `t`; an impact gives a row before and one after."""
    for k in range(n_events):
        at = t_T if events[k, TIME] == T else t + events[k, TIME]
        kind = events[k, KIND]
        v = events[k, SPEED] if kind == IMPACT else 0.0
        n = _put(log, n, kind, at, events[k, DISPLACEMENT], v)
        if kind == IMPACT:
            n = _put(log, n, _STATE, at, pt.clearance, -pt.R * v)
    return n


@jit
def _put_start(log, t, pt, resting):
    """Write the rows at the start, at time `t`: the state, or both sides of an impact there."""
    if pt.x0 >= pt.clearance and pt.v0 > 0.0:
        n = _put(log, 0, IMPACT, t, pt.x0, pt.v0)
        return _put(log, n, _STATE, t, pt.x0, -pt.R * pt.v0)
    return _put(log, 0, REST if resting else _STATE, t, pt.x0, pt.v0)


@inlined
def _trace(pt, scheme, periods, transient, every, most_rows, log, interrupt, prepare, take):
    """Run one point as the kernel's lanes do, and log the recorded periods.

    `prepare` and `take` are the functions of the rule, so that those of the others are not
    compiled. Once `interrupt` is set the run ends within a forcing period. Once it has more rows
    than `most_rows` it ends within a step. Its status is then ``PENDING``. Returns the number of
    rows that the log needs (rows beyond its length are not written), and the status.
    """
    scratch, (method, lead, grid) = new_scratch(), scheme
    rule = method[0]
    x, v, resting = start(pt, sine_at_start(lead, grid))
    state, status = to_state(rule, x, v, resting and rule != PLAIN, pt), 0
    size, T = grid.size, grid.phase_step / pt.omega
    t = (2.0 * math.pi * transient + grid.table[THETA, 0]) / pt.omega
    rows = 0
    for k in range(-transient - 1, periods):
        if is_set(interrupt):
            return 0, _PENDING
        phases = lead if k < -transient else grid
        if k <= -transient:
            prepared = prepare(method, phases, pt)
        if k == 0 and transient == 0 and lead.size == 0:
            rows = _put_start(log, t, pt, state[2])
        elif k == 0:
            x, v = from_state(rule, state, pt)
            rows = _put(log, 0, REST if state[2] else _STATE, t, x, v)
        for n in range(phases.size):
            if rows > most_rows:
                return 0, _PENDING
            state, n_events, outcome = take(method, prepared, state, phases, n, pt, scratch)
            status = max(status, outcome)
            x, v = from_state(rule, state, pt)
            last = n + 1 == size
            if k >= -transient and last:
                state = to_state(rule, x, v, state[2], pt)
            if k < 0:
                continue
            t_T = (2.0 * math.pi * (transient + k) + grid.table[THETA, n + 1]) / pt.omega
            rows = _put_events(log, rows, scratch.events, n_events, t, t_T, T, pt)
            if (k * size + n + 1) % every == 0:
                in_log = 0 < rows <= log.shape[0]
                if in_log and log[rows - 1, 0] == _STATE and log[rows - 1, 1] == t_T:
                    rows -= 1  # replace the state after an impact at the end of the step
                rows = _put(log, rows, SECTION if last else _STATE, t_T, x, v)
            t = t_T
    return rows, status


@jit
def _trace_exact(pt, scheme, periods, transient, every, most_rows, log, interrupt):
    """Run one point with the rule ``exact``."""
    return _trace(
        pt, scheme, periods, transient, every, most_rows, log, interrupt,
        prepare_exact, take_exact_grid_step,
    )  # fmt: skip


@jit
def _trace_steps(pt, scheme, periods, transient, every, most_rows, log, interrupt):
    """Run one point with a rule of time stepping."""
    return _trace(
        pt, scheme, periods, transient, every, most_rows, log, interrupt, prepare, take_grid_step
    )


def trace(
    points: np.ndarray,
    scheme: Scheme,
    periods: int,
    transient: int = 0,
    every: int = 1,
    interrupt: np.ndarray | None = None,
    most_rows: int = sys.maxsize,
) -> tuple[np.ndarray, Status]:
    """Log the motion of one parameter point, an array of shape (1,); return the log and the status.

    The log has the shape (rows, 4): kind of row, t, x, v, with NaN after a failure. It holds every
    `every`-th state of the grid, and both sides of every impact. A run that ends early, because of
    `interrupt` as for ``run_points`` or because its log has more than `most_rows`, has an empty log
    and the status ``PENDING``.
    """
    if periods * (scheme.grid.size // every) > most_rows:
        return np.empty((0, 4)), Status.PENDING
    if interrupt is None:
        interrupt = np.zeros(1, np.int64)
    run, outcome = _trace_steps, Status.COMPUTED
    if scheme.method[0] == EXACT:
        run, outcome = _trace_exact, Status.CERTIFIED
    rows, log = periods * (scheme.grid.size // every + 8) + 1, np.empty((0, 4))
    while rows > len(log):  # terminates: the second pass needs as many rows as the first
        log = np.empty((rows, 4))
        rows, status = run(points[0], scheme, periods, transient, every, most_rows, log, interrupt)
    log = log[:rows]
    if status == Status.PENDING:
        return log, Status.PENDING
    failed = ~np.isfinite(log[:, 2:]).all(axis=1)
    log[failed, 2:] = np.nan
    outcome = Status(max(outcome, status))
    if failed.any() and not outcome.failed:
        outcome = Status.NON_FINITE
    return log, outcome


def trajectories(
    points: np.ndarray,
    scheme: Scheme,
    periods: int,
    transient: int = 0,
    every: int = 1,
    interrupt: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Log the motion of many parameter points; arguments as for `trace`.

    Returns ``trajectory_t``, ``trajectory_x`` and ``trajectory_v``, of shape (n, samples). Shorter
    motions end in NaN; an interrupted point has only NaN.
    """
    logs = [
        trace(points[i : i + 1], scheme, periods, transient, every, interrupt)[0]
        for i in range(points.size)
    ]
    out = np.full((3, len(logs), max(map(len, logs), default=0)), np.nan)
    for i, log in enumerate(logs):
        out[:, i, : len(log)] = log[:, 1:].T
    return dict(zip(("trajectory_t", "trajectory_x", "trajectory_v"), out, strict=True))
