"""Exact impacts side by side: the stages of ``single_impact``, each for many columns at once.

A column is a copy of a lane that may have met the stop. LLVM vectorises the loop of each stage.
All stages in one loop would be a long chain of operations, each of which waits for the previous
one. The chain of a single stage is so short that a processor computes several vectors at the same
time.
"""

from __future__ import annotations

from vibroimpact.jit import inlined, jit, transpose, widest_vectors
from vibroimpact.kernel.workspace import (
    COEFFICIENTS,
    COLUMN_ROW,
    COLUMNS,
    LANES,
    ROW,
    TANGENTS,
    VECTOR,
    Rows,
    W,
    Y,
    pair_in,
    put_pair,
)
from vibroimpact.step.impact import (
    ONLY,
    FreeEnd,
    Guess,
    Waves,
    all_terms,
    approach,
    expand_near,
    first_impact,
    guess,
    rebound,
)
from vibroimpact.step.propagator import Coefficients, remainder_bound
from vibroimpact.step.scheme import COS, SIN
from vibroimpact.step.variational import tangents_through_impact

_rows = Rows(COLUMN_ROW)
COLUMN_COEFFICIENTS = _rows.take(5)  #: The coefficients of (P).
_FACTORS = _rows.take(3)  # of the remainder bound
# The states at the start of the step, and at its end without and with the impact.
Y_0, W_0 = _rows.take(), _rows.take()
Y_T, W_T = _rows.take(), _rows.take()
Y_1, W_1 = _rows.take(), _rows.take()
BOUND = _rows.take()  #: The remainder bound of the step.
PAIR = _rows.take(4)  #: The tangent vectors.
# The phase of the impact since the start of the step, its speed, and what is proved of it.
U, W_I, PROVED = _rows.take(), _rows.take(), _rows.take()
# Handed from one stage to the next: the guess, the time left after the impact, the value of the
# series with its derivatives, and the series.
_LATE, _T = _rows.take(), _rows.take()
_R = _rows.take()
_VALUES = _rows.take(3)
_SERIES = _rows.take(17)
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
def _free_end_in(c, j):
    """Return the ``FreeEnd`` of column `j`."""
    return FreeEnd(c[Y_T + j], c[W_T + j], c[BOUND + j])


@inlined
def _series_in(c, j):
    """Return the series of column `j`."""
    k, d = _SERIES + j, COLUMN_ROW
    return (
        c[k], c[k + d], c[k + 2 * d], c[k + 3 * d], c[k + 4 * d], c[k + 5 * d], c[k + 6 * d],
        c[k + 7 * d], c[k + 8 * d], c[k + 9 * d], c[k + 10 * d], c[k + 11 * d], c[k + 12 * d],
        c[k + 13 * d], c[k + 14 * d], c[k + 15 * d], c[k + 16 * d],
    )  # fmt: skip


@inlined
def _put_series(c, j, terms):
    """Set the series of column `j`."""
    k, d = _SERIES + j, COLUMN_ROW
    (
        c[k], c[k + d], c[k + 2 * d], c[k + 3 * d], c[k + 4 * d], c[k + 5 * d], c[k + 6 * d],
        c[k + 7 * d], c[k + 8 * d], c[k + 9 * d], c[k + 10 * d], c[k + 11 * d], c[k + 12 * d],
        c[k + 13 * d], c[k + 14 * d], c[k + 15 * d], c[k + 16 * d],
    ) = terms  # fmt: skip


@jit
def correct_columns(c, vectors, waves, phase_step):
    """Correct the columns of `vectors` vectors as ``single_impact`` does, stage by stage."""
    widest_vectors()
    count = VECTOR * vectors  # shows LLVM that no column is left over
    for j in range(count):
        f, start = _FACTORS + j, (c[Y_0 + j], c[W_0 + j])
        factors = c[f], c[f + COLUMN_ROW], c[f + 2 * COLUMN_ROW]
        c[BOUND + j] = remainder_bound(factors, start[0], start[1])
        c[_LATE + j], c[_T + j] = guess(start, _free_end_in(c, j), phase_step)
    for j in range(count):
        eq = coefficients_in(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW)
        start, free = (c[Y_0 + j], c[W_0 + j]), _free_end_in(c, j)
        _put_series(c, j, expand_near(eq, start, free, waves, c[_LATE + j]))
    for j in range(count):
        c[_T + j] = approach(_series_in(c, j), c[_T + j], phase_step)
    for j in range(count):
        v = _VALUES + j
        c[v], c[v + COLUMN_ROW], c[v + 2 * COLUMN_ROW] = all_terms(_series_in(c, j), c[_T + j])
    for j in range(count):
        v, start, guessed = _VALUES + j, (c[Y_0 + j], c[W_0 + j]), Guess(c[_LATE + j], c[_T + j])
        c[U + j], c[_R + j], c[W_I + j], c[PROVED + j] = first_impact(
            start, _free_end_in(c, j), guessed, _series_in(c, j),
            (c[v], c[v + COLUMN_ROW], c[v + 2 * COLUMN_ROW]), phase_step,
        )  # fmt: skip
    for j in range(count):
        eq = coefficients_in(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW)
        c[Y_1 + j], c[W_1 + j], c[PROVED + j] = rebound(
            eq, _free_end_in(c, j), c[_R + j], c[W_I + j], c[PROVED + j], phase_step
        )


@jit
def carry_columns(c, vectors, wave, phase_step):
    """Carry the tangent vectors of the columns of `vectors` vectors through their impacts."""
    widest_vectors()
    for j in range(VECTOR * vectors):
        eq, pair = (
            coefficients_in(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW),
            pair_in(c, PAIR + j, COLUMN_ROW),
        )
        pair = tangents_through_impact(eq, pair, c[U + j], c[W_I + j], wave, phase_step)
        put_pair(c, PAIR + j, COLUMN_ROW, pair)


@jit
def correct_exact_lanes(workspace, lo, count, grid, n, carrying):
    """Correct step `n` of `count` listed lanes, from index `lo` on, in columns."""
    lanes, met, c = workspace.lanes, workspace.met, workspace.columns
    table, old_row, new_row = grid.table, (n & 1) * ROW, (~n & 1) * ROW
    wave, vectors = (table[SIN, n], table[COS, n]), (count + VECTOR - 1) // VECTOR
    for vector in range(vectors):
        j = VECTOR * vector & (COLUMNS - 1)  # the mask shows LLVM that it is not negative
        transpose(c, COLUMN_COEFFICIENTS + j, COLUMN_ROW, lanes, COEFFICIENTS, met, lo + j)
    for j in range(count):
        i = met[lo + j] & (LANES - 1)
        c[Y_0 + j], c[W_0 + j] = lanes[Y + old_row + i], lanes[W + old_row + i]
        c[Y_T + j], c[W_T + j] = lanes[Y + new_row + i], lanes[W + new_row + i]
        if carrying:
            put_pair(c, PAIR + j, COLUMN_ROW, pair_in(lanes, TANGENTS + old_row + i, 2 * ROW))
    waves = Waves(wave[0], wave[1], table[SIN, n + 1], table[COS, n + 1])
    correct_columns(c, vectors, waves, grid.phase_step)
    if carrying:
        carry_columns(c, vectors, wave, grid.phase_step)
    for j in range(count):
        i = met[lo + j] & (LANES - 1)
        lanes[Y + new_row + i], lanes[W + new_row + i] = c[Y_1 + j], c[W_1 + j]
        if carrying and c[PROVED + j] == ONLY:  # those of a lane at rest must stay finite
            pair = pair_in(c, PAIR + j, COLUMN_ROW)
            put_pair(lanes, TANGENTS + new_row + i, 2 * ROW, pair)
