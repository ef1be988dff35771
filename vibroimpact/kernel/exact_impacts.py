"""Exact impacts in columns: the stages of ``meet_stop`` on the rows of many flights.

A column is a flight: what happens in a lane from the start of a step, or from a rebound in it, to
the next impact or to the end of the step. At first the columns hold the lanes that may have met the
stop in this step. A flight that ends with an impact from which the mass returns within the step
begins the next one, in one of the first columns, until no flight is left. Flights that this does
not settle are followed alone, by ``exact_step``, to the end of the step.

LLVM vectorises the loop of each stage. All stages in one loop would be a long chain of operations,
each of which waits for the previous one. The chain of a single stage is so short that a processor
computes several vectors at the same time.
"""

from __future__ import annotations

import math

from vibroimpact.jit import inlined, jit, select, transpose, widest_vectors
from vibroimpact.kernel.workspace import (
    COEFFICIENTS,
    COLUMN_ROW,
    COLUMNS,
    LANES,
    ROW,
    TANGENT,
    VECTOR,
    Rows,
    W,
    Y,
    put_tangent,
    tangent_in,
)
from vibroimpact.step.chatter import may_rest
from vibroimpact.step.impact import (
    FREE,
    ONLY,
    Flight,
    FreeEnd,
    Guess,
    all_terms,
    approach,
    end_flight,
    expand_near,
    guess,
    guess_return,
    launch_after,
    own_end,
    rebound,
)
from vibroimpact.step.propagator import Coefficients, remainder_bound
from vibroimpact.step.turning_points import (
    approach_turn,
    bounds,
    guess_turn,
    is_settled,
    late_from,
    part_of,
    turn_at,
)
from vibroimpact.step.variational import fly_tangent, tangent_after_impact

_rows = Rows(COLUMN_ROW)
COLUMN_COEFFICIENTS = _rows.take(5)  #: The coefficients of (P).
_FACTORS = _rows.take(3)  # of the remainder bound
# The flight: its state at the start, sine and cosine of the phase there, and this phase since the
# start of the step.
Y_0, W_0, S_0, C_0, BEGIN = (_rows.take() for _ in range(5))
#: Sine and cosine at the end of the step, for turning points.
S_T, C_T = _rows.take(), _rows.take()
# The state at the end of the step, without and with the impact.
Y_T, W_T = _rows.take(), _rows.take()
Y_1, W_1 = _rows.take(), _rows.take()
BOUND = _rows.take()  #: The remainder bound of the step.
# The tangent vector at the start of the flight, after its impact, and at the end of the step.
TANGENT_0, _TANGENT_I, TANGENT_1 = _rows.take(2), _rows.take(2), _rows.take(2)
# The phase of the impact since the start of the step, its speed, and what is proved of it.
AT, W_I, PROVED = _rows.take(), _rows.take(), _rows.take()
FLOOR = _rows.take()  #: A lower bound of y in the flight, and in the last one if it is known.
EXTREME = _rows.take()  #: Where a flight turns, or else its end; NaN if this is not found.
# Handed from one stage to the next: the guess, the length of the flight and the time left after it,
# the value of the series with its derivatives, and the series.
_LATE, _T, _NONE = _rows.take(), _rows.take(), _rows.take()
_LENGTH, _R = _rows.take(), _rows.take()
_VALUES = _rows.take(3)
_SERIES_ROWS = _rows.take(17)
#: Numbers in the rows of the columns together.
EXACT_COLUMNS = _rows.size


@inlined
def coefficients_in(rows, e, distance):
    """Return the ``Coefficients`` whose numbers begin at `e`, `distance` apart."""
    return Coefficients(
        rows[e], rows[e + distance], rows[e + 2 * distance], rows[e + 3 * distance],
        rows[e + 4 * distance],
    )  # fmt: skip


@inlined
def flight_in(c, j):
    """Return the ``Flight`` of column `j`."""
    return Flight(c[Y_0 + j], c[W_0 + j], c[S_0 + j], c[C_0 + j], c[BEGIN + j])


@inlined
def _guess_in(c, j):
    """Return the ``Guess`` of column `j`."""
    return Guess(c[_LATE + j], c[_T + j], c[_NONE + j])


@inlined
def free_end_in(c, j):
    """Return the ``FreeEnd`` of column `j`."""
    return FreeEnd(c[Y_T + j], c[W_T + j], c[BOUND + j])


@inlined
def _series_in(c, j):
    """Return the series of column `j`."""
    k, d = _SERIES_ROWS + j, COLUMN_ROW
    return (
        c[k], c[k + d], c[k + 2 * d], c[k + 3 * d], c[k + 4 * d], c[k + 5 * d], c[k + 6 * d],
        c[k + 7 * d], c[k + 8 * d], c[k + 9 * d], c[k + 10 * d], c[k + 11 * d], c[k + 12 * d],
        c[k + 13 * d], c[k + 14 * d], c[k + 15 * d], c[k + 16 * d],
    )  # fmt: skip


@inlined
def _put_series(c, j, terms):
    """Set the series of column `j`."""
    k, d = _SERIES_ROWS + j, COLUMN_ROW
    (
        c[k], c[k + d], c[k + 2 * d], c[k + 3 * d], c[k + 4 * d], c[k + 5 * d], c[k + 6 * d],
        c[k + 7 * d], c[k + 8 * d], c[k + 9 * d], c[k + 10 * d], c[k + 11 * d], c[k + 12 * d],
        c[k + 13 * d], c[k + 14 * d], c[k + 15 * d], c[k + 16 * d],
    ) = terms  # fmt: skip


@jit
def follow_flights(c, vectors, waves, phase_step, launched):
    """Follow the flights of `vectors` vectors as ``meet_stop`` does, stage by stage.

    `waves` holds sine and cosine of the phase at the start of the step, and at its end; `launched`
    says whether the flights begin with rebounds, or with the step.
    """
    widest_vectors()
    count = VECTOR * vectors  # shows LLVM that no column is left over
    wave, end_wave = waves
    if launched:
        for j in range(count):
            eq = coefficients_in(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW)
            c[_LATE + j], c[_T + j], c[_NONE + j] = guess_return(eq, flight_in(c, j), phase_step)
    else:
        for j in range(count):
            c[S_0 + j], c[C_0 + j], c[BEGIN + j] = wave[0], wave[1], 0.0
            f, flight = _FACTORS + j, flight_in(c, j)
            factors = c[f], c[f + COLUMN_ROW], c[f + 2 * COLUMN_ROW]
            c[BOUND + j] = remainder_bound(factors, flight.y, flight.w)
            c[_LATE + j], c[_T + j], c[_NONE + j] = guess(flight, free_end_in(c, j), phase_step)
    for j in range(count):
        eq = coefficients_in(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW)
        free = free_end_in(c, j)
        _put_series(c, j, expand_near(eq, flight_in(c, j), free, end_wave, c[_LATE + j]))
    if launched:
        for j in range(count):
            k, free = _series_in(c, j), free_end_in(c, j)
            c[Y_T + j], c[W_T + j], _ = own_end(k, flight_in(c, j), free, c[_LATE + j], phase_step)
    for j in range(count):
        c[_T + j] = approach(_series_in(c, j), _guess_in(c, j), phase_step)
    for j in range(count):
        v = _VALUES + j
        c[v], c[v + COLUMN_ROW], c[v + 2 * COLUMN_ROW] = all_terms(_series_in(c, j), c[_T + j])
    for j in range(count):
        v = _VALUES + j
        c[_LENGTH + j], c[_R + j], c[W_I + j], c[PROVED + j] = end_flight(
            flight_in(c, j), free_end_in(c, j), _guess_in(c, j), _series_in(c, j),
            (c[v], c[v + COLUMN_ROW], c[v + 2 * COLUMN_ROW]), phase_step,
        )  # fmt: skip
    for j in range(count):
        eq = coefficients_in(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW)
        c[AT + j] = c[BEGIN + j] + c[_LENGTH + j]
        c[Y_1 + j], c[W_1 + j], c[PROVED + j] = rebound(
            eq, free_end_in(c, j), c[_R + j], c[W_I + j], c[PROVED + j], phase_step
        )


@jit
def carry_columns(c, vectors, wave):
    """Carry the tangent vectors of the columns of `vectors` vectors through their flights."""
    widest_vectors()
    for j in range(VECTOR * vectors):
        eq = coefficients_in(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW)
        before, met = tangent_in(c, TANGENT_0 + j, COLUMN_ROW), c[PROVED + j] < FREE
        flight = c[_LENGTH + j], c[AT + j], c[W_I + j]
        after = tangent_after_impact(eq, before, flight, wave)
        put_tangent(c, _TANGENT_I + j, COLUMN_ROW, after)
        # Without an impact the flight itself goes on to the end of the step.
        left = select(met, c[_R + j], c[_R + j] + c[_LENGTH + j])
        last = select(met, after[0], before[0]), select(met, after[1], before[1])
        put_tangent(c, TANGENT_1 + j, COLUMN_ROW, fly_tangent(eq, last, left))


@jit
def bound_flights(c, vectors, phase_step):
    """Find the FLOOR of the columns of `vectors` vectors."""
    widest_vectors()
    for j in range(VECTOR * vectors):
        R, met = c[COLUMN_COEFFICIENTS + 4 * COLUMN_ROW + j], c[PROVED + j] < FREE
        r, w_i = c[_R + j], c[W_I + j]
        u = select(met, c[_LENGTH + j], c[_LENGTH + j] + r)
        y_1, w_1 = select(met, 0.0, c[Y_T + j]), select(met, w_i, c[W_T + j])
        part = part_of(c[BOUND + j], u, phase_step)
        floor, _ = bounds(c[Y_0 + j], c[W_0 + j], y_1, w_1, u, part)
        part = part_of(c[BOUND + j], r, phase_step)
        after, _ = bounds(0.0, -R * w_i, c[Y_1 + j], c[W_1 + j], r, part)
        c[FLOOR + j] = select(c[PROVED + j] == ONLY, min(floor, after), floor)


@jit
def find_turns(c, vectors, phase_step):
    """Find the turning points of `vectors` vectors of whole steps, as ``widen_by_flight`` does."""
    widest_vectors()
    count = VECTOR * vectors
    for j in range(count):
        y, w = c[Y_0 + j], c[W_0 + j]
        n, turns, sure = guess_turn(y, w, c[Y_T + j], c[W_T + j], phase_step, c[BOUND + j])
        c[_NONE + j] = select(sure, select(turns, 0.0, 1.0), math.nan)
        late = late_from(n * phase_step, phase_step, phase_step)
        c[_LATE + j], c[_T + j] = late, n * phase_step - late * phase_step
    for j in range(count):
        eq = coefficients_in(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW)
        flight, free, end_wave = flight_in(c, j), free_end_in(c, j), (c[S_T + j], c[C_T + j])
        _put_series(c, j, expand_near(eq, flight, free, end_wave, c[_LATE + j]))
    for j in range(count):
        c[_T + j], c[_VALUES + j] = approach_turn(_series_in(c, j), c[_T + j], phase_step)
    for j in range(count):
        y, change = turn_at(_series_in(c, j), c[_T + j], c[_VALUES + j])
        found = is_settled(c[_T + j] + c[_LATE + j] * phase_step, change, phase_step)
        y = select(c[_NONE + j] == 0.0, select(found, y, math.nan), c[Y_T + j])
        c[EXTREME + j] = y + 0.0 * c[_NONE + j]


@jit
def fill_columns(workspace, met, lo, count, n, carrying):
    """Copy `count` lanes of a list from index `lo` on to the columns: their flights in step `n`."""
    lanes, c = workspace.lanes, workspace.columns
    old_row, new_row = (n & 1) * ROW, (~n & 1) * ROW
    for vector in range((count + VECTOR - 1) // VECTOR):
        j = VECTOR * vector & (COLUMNS - 1)  # the mask shows LLVM that it is not negative
        transpose(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW, lanes, COEFFICIENTS, met, lo + j)
    for j in range(count):
        i = met[lo + j] & (LANES - 1)
        c[Y_0 + j], c[W_0 + j] = lanes[Y + old_row + i], lanes[W + old_row + i]
        c[Y_T + j], c[W_T + j] = lanes[Y + new_row + i], lanes[W + new_row + i]
        if carrying is not None and carrying:
            tangent = tangent_in(lanes, TANGENT + old_row + i, 2 * ROW)
            put_tangent(c, TANGENT_0 + j, COLUMN_ROW, tangent)


@jit
def begin_next_flight(c, j, k, wave):
    """Begin in column `k` the flight after the impact of column `j`; `k` is not after `j`."""
    for q in range(5):
        a = COLUMN_COEFFICIENTS + q * COLUMN_ROW
        c[a + k] = c[a + j]
    eq = coefficients_in(c, COLUMN_COEFFICIENTS + k, COLUMN_ROW)
    launch = launch_after(eq, wave, c[AT + j], c[W_I + j])
    c[Y_0 + k], c[W_0 + k], c[S_0 + k], c[C_0 + k], c[BEGIN + k] = launch
    c[Y_T + k], c[W_T + k], c[BOUND + k] = c[Y_1 + j], c[W_1 + j], c[BOUND + j]
    put_tangent(c, TANGENT_0 + k, COLUMN_ROW, tangent_in(c, _TANGENT_I + j, COLUMN_ROW))
    return may_rest(eq, launch)
