"""Impacts mended side by side: the stages of ``single_impact``, each for many columns at once.

A column is a copy of a lane that may have met the stop. LLVM makes a loop over vectors of each
stage. All stages in one loop would be a long chain of operations, each of which waits for the one
before it; the chain of a single stage is so short that a processor computes several vectors at the
same time.
"""

from __future__ import annotations

from vibroimpact.jit import jit, widest_vectors
from vibroimpact.lanes.workspace import aligned
from vibroimpact.step.flow import Equation
from vibroimpact.step.single_impact import (
    all_terms,
    approach,
    expand_near,
    first_impact,
    guess,
    rebound,
)
from vibroimpact.step.tangents import tangents_through_impact

#: Columns that are mended at a time, and those in one vector.
COLUMNS, VECTOR = 64, 8
#: The distance of rows; not a power of two, which would put them all into few sets of the cache.
ROW = COLUMNS + VECTOR

# Where the rows of the columns begin; row + j belongs to column j. They hold the equation, the
# states at both ends of the step, its E, the tangent vectors, the impact, and what is proved of it.
EQUATION = 0
Y_0, W_0, Y_T, W_T, E, PAIR = range(5 * ROW, 11 * ROW, ROW)
U, W_I, PROVED = range(PAIR + 4 * ROW, PAIR + 7 * ROW, ROW)
# What one stage hands to the next: the guess, the series, its value and derivatives, and the time
# left after the impact.
_LATE, _T, _R, _VALUES = range(PROVED + ROW, PROVED + 5 * ROW, ROW)
_SERIES = _VALUES + 3 * ROW
_SIZE = _SERIES + 17 * ROW


@jit
def new_columns():
    """Return memory for ``COLUMNS`` columns."""
    return aligned(_SIZE)


@jit(inline=True)
def equation_in(w, e, distance):
    """Return the ``Equation`` whose numbers begin at `e`, and are so far apart."""
    return Equation(
        w[e], w[e + distance], w[e + 2 * distance], w[e + 3 * distance], w[e + 4 * distance]
    )


@jit(inline=True)
def pair_in(w, a, distance):
    """Return two tangent vectors, whose numbers begin at `a` and are so far apart."""
    return w[a], w[a + distance], w[a + 2 * distance], w[a + 3 * distance]


@jit(inline=True)
def put_pair(w, a, distance, pair):
    """Set two tangent vectors, as ``pair_in``."""
    w[a], w[a + distance], w[a + 2 * distance], w[a + 3 * distance] = pair


@jit(inline=True)
def _series_in(c, j):
    """Return the series of column `j`."""
    k = _SERIES + j
    return (
        c[k], c[k + ROW], c[k + 2 * ROW], c[k + 3 * ROW], c[k + 4 * ROW], c[k + 5 * ROW],
        c[k + 6 * ROW], c[k + 7 * ROW], c[k + 8 * ROW], c[k + 9 * ROW], c[k + 10 * ROW],
        c[k + 11 * ROW], c[k + 12 * ROW], c[k + 13 * ROW], c[k + 14 * ROW], c[k + 15 * ROW],
        c[k + 16 * ROW],
    )  # fmt: skip


@jit(inline=True)
def _put_series(c, j, terms):
    """Set the series of column `j`."""
    k = _SERIES + j
    (
        c[k], c[k + ROW], c[k + 2 * ROW], c[k + 3 * ROW], c[k + 4 * ROW], c[k + 5 * ROW],
        c[k + 6 * ROW], c[k + 7 * ROW], c[k + 8 * ROW], c[k + 9 * ROW], c[k + 10 * ROW],
        c[k + 11 * ROW], c[k + 12 * ROW], c[k + 13 * ROW], c[k + 14 * ROW], c[k + 15 * ROW],
        c[k + 16 * ROW],
    ) = terms  # fmt: skip


@jit(refcounts=False)
def mend_columns(c, vectors, waves, step):
    """Mend the columns of so many vectors; as ``single_impact``, stage by stage."""
    widest_vectors()
    count = VECTOR * vectors  # in this form LLVM sees that nothing is left over
    for j in range(count):
        start, end = (c[Y_0 + j], c[W_0 + j]), (c[Y_T + j], c[W_T + j])
        c[_LATE + j], c[_T + j] = guess(start, end, step)
    for j in range(count):
        start, end = (c[Y_0 + j], c[W_0 + j]), (c[Y_T + j], c[W_T + j])
        eq = equation_in(c, EQUATION + j, ROW)
        _put_series(c, j, expand_near(eq, start, end, waves, c[_LATE + j]))
    for j in range(count):
        c[_T + j] = approach(_series_in(c, j), c[_T + j], step)
    for j in range(count):
        v = _VALUES + j
        c[v], c[v + ROW], c[v + 2 * ROW] = all_terms(_series_in(c, j), c[_T + j])
    for j in range(count):
        v, start, guessed = _VALUES + j, (c[Y_0 + j], c[W_0 + j]), (c[_LATE + j], c[_T + j])
        c[U + j], c[_R + j], c[W_I + j], c[PROVED + j] = first_impact(
            start, c[Y_T + j], c[E + j], guessed, _series_in(c, j),
            (c[v], c[v + ROW], c[v + 2 * ROW]), step,
        )  # fmt: skip
    for j in range(count):
        eq, free = equation_in(c, EQUATION + j, ROW), (c[Y_T + j], c[W_T + j], c[E + j])
        c[Y_T + j], c[W_T + j], c[PROVED + j] = rebound(
            eq, free, c[_R + j], c[W_I + j], c[PROVED + j], step
        )


@jit(refcounts=False)
def carry_columns(c, vectors, wave, step):
    """Carry the tangent vectors of the columns of so many vectors through their impacts."""
    widest_vectors()
    for j in range(VECTOR * vectors):
        eq, pair = equation_in(c, EQUATION + j, ROW), pair_in(c, PAIR + j, ROW)
        pair = tangents_through_impact(eq, pair, c[U + j], c[W_I + j], wave, step)
        put_pair(c, PAIR + j, ROW, pair)
