"""One oscillator, every step and every impact: what the lanes of the kernel do, written down."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibroimpact.jit import is_set, jit
from vibroimpact.oscillator import Oscillator
from vibroimpact.status import Status
from vibroimpact.step.methods import checked_method
from vibroimpact.step.one_step import advance, from_state, prepare, to_state
from vibroimpact.step.phases import THETA, lead_in, one_period, sine_at_start
from vibroimpact.step.rules import EXACT, PLAIN
from vibroimpact.step.stop import (
    DISPLACEMENT,
    IMPACT,
    KIND,
    RELEASE,
    REST,
    SPEED,
    TIME,
    new_scratch,
    start,
    time_to_release,
)

# Kinds of row in the log, beside the kinds of event: a grid state, and the end of a period.
_STATE, _SECTION = 10, 11
_PENDING = int(Status.PENDING)


@dataclass(frozen=True)
class Trajectory:
    """The motion of one oscillator.

    Attributes
    ----------
    t, x, v : ndarray, shape (n,)
        Every step, and the state before and after every impact (two rows with the same t).
    impact_t, impact_v : ndarray, shape (m,)
        Time of, and speed before, each impact.
    rests : ndarray, shape (k, 2)
        Start and end of each rest on the stop. The end is that of the run where the mass still
        rests then, and inf where the force never releases it.
    section_x, section_v : ndarray, shape (periods,)
        State at the end of each forcing period.
    max_penetration : float
        Largest x - clearance among the rows, 0 if there is none.
    status : Status
        Rows after a failure are NaN.
    """

    t: np.ndarray
    x: np.ndarray
    v: np.ndarray
    impact_t: np.ndarray
    impact_v: np.ndarray
    rests: np.ndarray
    section_x: np.ndarray
    section_v: np.ndarray
    max_penetration: float
    status: Status


@jit
def _put(log, n, kind, t, x, v):
    """Write a row if it still fits; return the number of rows with it."""
    if n < log.shape[0]:
        log[n, 0], log[n, 1], log[n, 2], log[n, 3] = kind, t, x, v
    return n + 1


@jit
def _put_events(log, n, events, n_events, t, t_T, T, pt):
    """Write the events of one step that began at `t`: an impact as the states on its two sides."""
    for k in range(n_events):
        at = t_T if events[k, TIME] == T else t + events[k, TIME]
        kind, v = events[k, KIND], events[k, SPEED]
        n = _put(log, n, kind, at, events[k, DISPLACEMENT], v)
        if kind == IMPACT:
            n = _put(log, n, _STATE, at, pt.clearance, -pt.R * v)
    return n


@jit
def _put_start(log, t, pt, resting):
    """Write the rows at the start, at time `t`: the state, or both sides of an impact at once."""
    if pt.x0 >= pt.clearance and pt.v0 > 0.0:
        n = _put(log, 0, IMPACT, t, pt.x0, pt.v0)
        return _put(log, n, _STATE, t, pt.x0, -pt.R * pt.v0)
    return _put(log, 0, REST if resting else _STATE, t, pt.x0, pt.v0)


@jit
def _approach(method, steps, transient, pt, scratch, interrupt):
    """Run from the start to the start of the record: the state there, and the status."""
    lead, grid = steps
    x, v, resting = start(pt, sine_at_start(lead, grid))
    state, status = to_state(method[0], x, v, resting and method[0] != PLAIN, pt), 0
    for k in range(-1, transient):
        if is_set(interrupt):
            break
        phases = lead if k < 0 else grid
        prepared = prepare(method[1], phases, pt)
        for n in range(phases.size):
            state, _, outcome = advance(method, prepared, state, phases, n, pt, scratch)
            status = max(status, outcome)
        if k >= 0:
            x, v = from_state(method[0], state, pt)
            state = to_state(method[0], x, v, state[2], pt)
    return state, status


@jit
def _trace(pt, method, steps, transient, periods, every, log, interrupt):
    """Run one point as the kernel's lanes do, and log the recorded periods.

    Once `interrupt` is set the run ends within a forcing period, with the status ``PENDING``.

    Parameters
    ----------
    method : (int, int)
        The codes of rule and integrator.
    steps : (Phases, Phases)
        The steps before the first period, and those of a period.

    Returns
    -------
    rows : int
        Rows the log needs; those beyond its length are lost.
    status : int
    """
    scratch, (lead, grid) = new_scratch(), steps
    state, status = _approach(method, steps, transient, pt, scratch, interrupt)
    size, T = grid.size, grid.step / pt.omega
    prepared = prepare(method[1], grid, pt)
    t = (2.0 * math.pi * transient + grid.table[THETA, 0]) / pt.omega
    if transient == 0 and lead.size == 0:
        rows = _put_start(log, t, pt, state[2])
    else:
        x, v = from_state(method[0], state, pt)
        rows = _put(log, 0, REST if state[2] else _STATE, t, x, v)
    for k in range(transient, transient + periods):
        if is_set(interrupt):
            return 0, _PENDING
        for n in range(size):
            last = n + 1 == size
            t_T = (2.0 * math.pi * k + grid.table[THETA, n + 1]) / pt.omega
            state, n_events, outcome = advance(method, prepared, state, grid, n, pt, scratch)
            status = max(status, outcome)
            rows = _put_events(log, rows, scratch.events, n_events, t, t_T, T, pt)
            x, v = from_state(method[0], state, pt)
            if last:
                state = to_state(method[0], x, v, state[2], pt)
            if ((k - transient) * size + n + 1) % every == 0:
                in_log = 0 < rows <= log.shape[0]
                if in_log and log[rows - 1, 0] == _STATE and log[rows - 1, 1] == t_T:
                    rows -= 1  # an impact at the end of the step left this state already
                rows = _put(log, rows, _SECTION if last else _STATE, t_T, x, v)
            t = t_T
    return rows, status


def trace(
    points: np.ndarray,
    *,
    integrator: str,
    impact: str,
    steps_per_period: int | None,
    transient: int = 0,
    periods: int,
    phase: float = 0.0,
    at_section: bool = False,
    every: int = 1,
    interrupt: np.ndarray | None = None,
) -> tuple[np.ndarray, Status]:
    """Log the motion of one parameter point; arguments as for ``integrate``.

    Parameters
    ----------
    points : ndarray of dtype ``POINT``, shape (1,)
    every : int
        Keep every that many grid states; both sides of every impact are kept always.

    Returns
    -------
    log : ndarray, shape (rows, 4)
        Kind of row, t, x, v. NaN after a failure.
    status : Status
        ``PENDING`` with an empty log where `interrupt` was set.
    """
    if interrupt is None:
        interrupt = np.zeros(1, np.int64)
    rule, code, n_steps = checked_method(points, integrator, impact, steps_per_period)
    steps = lead_in(phase, n_steps, at_section), one_period(phase, n_steps)
    outcome = Status.CERTIFIED if rule == EXACT else Status.COMPUTED
    rows, log = periods * (n_steps // every + 8) + 1, np.empty((0, 4))
    while rows > len(log):  # ends: the second pass needs as many rows as the first
        log = np.empty((rows, 4))
        rows, status = _trace(
            points[0], (rule, code), steps, transient, periods, every, log, interrupt
        )
    log = log[:rows]
    if status == Status.PENDING:
        return log, Status.PENDING
    failed = ~np.isfinite(log[:, 2:]).all(axis=1)
    log[failed, 2:] = np.nan
    outcome = Status(max(outcome, status))
    if failed.any() and not outcome.failed:
        outcome = Status.NON_FINITE
    return log, outcome


def simulate(
    oscillator: Oscillator,
    periods: int = 20,
    integrator: str = "exact",
    impact: str = "exact",
    steps_per_period: int | None = None,
    x0: float = 0.0,
    v0: float = 0.0,
    phase: float = 0.0,
    transient: int = 0,
) -> Trajectory:
    """Follow one oscillator over `periods` forcing periods, after `transient` of them.

    The arithmetic is that of a lane of the sweep kernel, to the last bit.

    Parameters
    ----------
    oscillator : Oscillator
    periods : int
        Forcing periods, >= 1.
    integrator, impact : str
        Names in ``INTEGRATORS`` and ``IMPACT_RULES``.
    steps_per_period : int, optional
        Steps of length T = 2 pi / (omega steps_per_period), >= 1, stable or not; by default 100
        or as many as are stable, and for the impact rule ``exact`` as few as it allows.
    x0, v0 : float
        Start: displacement (<= clearance) [length] and velocity [length/time].
    phase : float
        omega t at the start, in [0, 2 pi) [rad]: the motion starts at t = phase / omega. With a
        state of a section and the phase of the section, it goes on from there.
    transient : int
        Forcing periods left out at the start, >= 0.

    Returns
    -------
    Trajectory

    Raises
    ------
    TypeError, ValueError
        If an argument is not of its kind or not in its valid range.
    """
    if not isinstance(oscillator, Oscillator):
        raise TypeError(f"oscillator must be an Oscillator, not {oscillator!r}")
    for name, number in (("periods", periods), ("steps_per_period", steps_per_period)):
        if number is None and name == "steps_per_period":
            continue
        if isinstance(number, bool) or not isinstance(number, (int, np.integer)) or number < 1:
            raise ValueError(f"{name} must be an integer >= 1, not {number!r}")
    if isinstance(transient, bool) or not isinstance(transient, (int, np.integer)) or transient < 0:
        raise ValueError(f"transient must be an integer >= 0, not {transient!r}")
    if not 0.0 <= phase < 2.0 * math.pi:
        raise ValueError(f"phase must be from 0 to below 2 pi, not {phase!r}")
    points = oscillator.at(x0, v0)
    log, status = trace(
        points,
        integrator=integrator,
        impact=impact,
        steps_per_period=steps_per_period,
        transient=int(transient),
        periods=int(periods),
        phase=float(phase),
        at_section=True,
    )
    kind, t, x, v = log.T.copy()
    hit, section = kind == IMPACT, kind == _SECTION
    depth = x[np.isfinite(x)] - oscillator.clearance
    return Trajectory(
        t=t,
        x=x,
        v=v,
        impact_t=t[hit],
        impact_v=v[hit],
        rests=_rests(kind, t, points),
        section_x=x[section],
        section_v=v[section],
        max_penetration=max(0.0, float(depth.max())),
        status=status,
    )


def _rests(kind: np.ndarray, t: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Pair the starts of rests with their releases."""
    begin, end = t[kind == REST], t[kind == RELEASE]
    if len(end) < len(begin):
        pt = points.view(np.recarray)[0]
        for_ever = time_to_release(pt.omega * t[-1], pt) == math.inf
        end = np.append(end, math.inf if for_ever else t[-1])
    return np.column_stack([begin, end])


def exact_samples(
    oscillator: Oscillator, t: np.ndarray, x: np.ndarray, v: np.ndarray, per_period: int = 200
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Insert states of the exact flow between the rows of a trajectory.

    The flow over a time s is expm(A s) on (x, v, sin omega t, cos omega t), with A the matrix of
    eq. (1) and of the force: it has no special case. Between two rows at rest on the stop the mass
    stays there.

    Parameters
    ----------
    oscillator : Oscillator
    t, x, v : ndarray, shape (n,)
        Rows of a `Trajectory` of the integrator ``exact``, with every event among them.
    per_period : int
        How many samples a forcing period has at least.

    Returns
    -------
    t, x, v : ndarray, shape (k,)
        The rows, unchanged, and the samples between them.
    """
    from scipy.linalg import expm  # takes half a second to import

    h, omega, f, p = (getattr(oscillator, name) for name in ("h", "omega", "f", "p"))
    step = np.diff(t)
    # The margin keeps rounding from halving steps that are short enough.
    parts = np.ceil(step * (omega * per_period / (2.0 * math.pi)) - 1e-9).astype(np.int64)
    row = np.repeat(np.arange(len(step)), np.maximum(parts - 1, 0))
    first = np.searchsorted(row, np.arange(len(step)))
    s = step[row] * (1 + np.arange(len(row)) - first[row]) / parts[row]
    A = np.array(
        [[0, 1, 0, 0], [-(p**2), -2 * h, -f, 0], [0, 0, 0, omega], [0, 0, -omega, 0]], float
    )
    start = np.stack([x[:-1], v[:-1], np.sin(omega * t[:-1]), np.cos(omega * t[:-1])], axis=1)
    state = np.einsum("kij,kj->ki", expm(A * s[:, None, None]), start[row])[:, :2]
    on_stop = (x == oscillator.clearance) & (v == 0.0)
    resting = (on_stop[:-1] & on_stop[1:])[row]
    state[resting] = oscillator.clearance, 0.0
    columns = ((t, t[row] + s), (x, state[:, 0]), (v, state[:, 1]))
    t, x, v = (np.insert(rows, row + 1, samples) for rows, samples in columns)
    return t, x, v


def trajectories(points: np.ndarray, **arguments: Any) -> dict[str, np.ndarray]:
    """Log the motion of many parameter points; arguments as for `trace`.

    Parameters
    ----------
    points : ndarray of dtype ``POINT``, shape (n,)

    Returns
    -------
    dict of str to ndarray
        ``trajectory_t``, ``trajectory_x``, ``trajectory_v`` : (n, samples), with NaN after the
        end of the shorter ones; of a point that was given up, nothing else.
    """
    logs = [trace(points[i : i + 1], **arguments)[0] for i in range(points.size)]
    out = np.full((3, len(logs), max(map(len, logs), default=0)), np.nan)
    for i, log in enumerate(logs):
        out[:, i, : len(log)] = log[:, 1:].T
    return dict(zip(("trajectory_t", "trajectory_x", "trajectory_v"), out, strict=True))
