"""`Workspace`, the memory of a thread: points in lanes, impacts in columns of named rows, lists.

A lane is one parameter point. Lanes lie side by side and so fill SIMD vectors.
The steps per period are an integer, so one table of omega t_n mod 2 pi serves every lane, even if
omega is swept, and the loops contain no trigonometry.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import inlined, jit, lowest_bit, not_negative, specialised, widest_vectors
from vibroimpact.kernel.record import Record
from vibroimpact.step.contact import Scratch, time_to_release
from vibroimpact.step.propagator import Propagator

#: Most lanes, a power of 2; and impacts corrected at a time.
LANES, COLUMNS = 128, 32
#: Numbers in a vector of 512 bits.
VECTOR = 8
#: Distances between rows. Powers of two would put all rows into few sets of the cache.
ROW, COLUMN_ROW = LANES + 24, COLUMNS + VECTOR
#: Most steps per period for which the forcing of each step is kept; more do not fit into the cache.
KEPT = 64
#: Numbers of a lane from COEFFICIENTS on: one cache line.
COEFFICIENTS_SIZE = 8


class Rows:
    """The places of rows in a flat array, for which the compiler knows their distances."""

    def __init__(self, distance: int) -> None:
        self._distance, self.size = distance, 0

    def take(self, rows: int = 1) -> int:
        """Return where the next rows begin; place + i is that of lane or column i."""
        place, self.size = self.size, self.size + rows * self._distance
        return place


_rows = Rows(ROW)
# The state (x, v), which is (y, w) with exact impacts, and the tangent vector. Each number has two
# rows: one for the start of even steps, one for odd steps. Time stepping uses the first.
POSITION = _rows.take(2)
VELOCITY = _rows.take(2)
TANGENT = _rows.take(4)
#: Not negative for a lane to be listed: in a step, if it may have met its stop, is at rest or may
#: widen its extremes; at a section, if it has come back to its mark, is due, or is near its free
#: oscillation.
GUARD = _rows.take()
LEVEL = _rows.take()  #: The stop that time stepping watches, or AT_REST.
WAKE = _rows.take()  #: The phase before which a resting lane is not released, or AWAKE.
CLEARANCE = _rows.take()
OMEGA = _rows.take()
# For exact impacts.
PROPAGATOR = _rows.take(7)
FORCING = _rows.take(6)
SLEPT = _rows.take()  #: Steps at rest.
# For time stepping; all but the map with the rule ``plain``.
MAP = _rows.take(8)  #: The affine map of a step.
RESTITUTION = _rows.take()
GREATEST = _rows.take()  #: The greatest displacement.
SPEEDS = _rows.take(4)  #: Those of the impacts in a stride.
#: The period of the record in which the lane is, below 0 in its transient.
PERIOD = _rows.take()
DUE = _rows.take()  #: The period before which nothing happens but a return of the motion.
# The state of the mark, and its period.
MARK_X = _rows.take()
MARK_V = _rows.take()
MARK_LEVEL = _rows.take()
MARK_PERIOD = _rows.take()
# For the extremes.
LEAST, MOST = _rows.take(), _rows.take()  #: The extremes of the motion, see ``turning_points.py``.
THIRD = _rows.take()  #: A third of the step T.
#: Positive if the steps of this period may widen the extremes, -1 if nothing ever will.
WATCHED = _rows.take()
STEADY = _rows.take(7)  #: The ``Steady`` of the point.
FORMS = _rows.take(4)  #: Its ``turns_near``; the first is 0 until they are needed.
BOUND_BY_X = _rows.take()  #: The factor of 1 in the remainder bound by x.
#: The coefficients of (P) and the factors of the remainder bound, not in rows: the eight numbers of
#: one lane are contiguous.
COEFFICIENTS = _rows.size
#: The rows of the state with exact impacts, in the units of ``propagator.py``.
Y, W = POSITION, VELOCITY
#: Numbers in the rows of the lanes together.
LANES_SIZE = COEFFICIENTS + COEFFICIENTS_SIZE * LANES

#: The LEVEL of a lane at rest: below every displacement, so time stepping lists the lane each time.
#: The WAKE of a lane that is not at rest.
AT_REST, AWAKE = -math.inf, -math.inf


class Workspace(NamedTuple):
    """The memory of a thread."""

    lanes: np.ndarray  #: The rows of the lanes.
    met: np.ndarray  #: The list of lanes whose GUARD is not negative.
    columns: np.ndarray  #: The rows of the columns, each a copy of a listed lane.
    #: The lanes of steps that may turn, whose turning points are found together, and their number.
    turning: np.ndarray
    turns: np.ndarray  #: The rows of columns for these steps.
    #: With exact impacts, what each step adds to y and w of each lane: shape (KEPT, 2, ROW).
    added: np.ndarray
    scratch: Scratch
    rows: np.ndarray  #: The row of the point of each lane, in the points and in the record.
    points: np.ndarray  #: The points of the lanes.
    sums: np.ndarray  #: Their sums so far, of dtype ``SUMS``.
    sums_at_mark: np.ndarray  #: Their sums at their marks.


class Batch(NamedTuple):
    """The lanes of a thread that have a point, which are the first ones."""

    workspace: Workspace
    record: Record
    size: int


@inlined
def whole_vectors(size):
    """Return the number of lanes of whole vectors that hold `size` lanes."""
    return min(LANES, (size + VECTOR - 1) & -VECTOR)  # numba 0.61 vectorises no loop without min


@specialised
def propagator_in(lanes, i):
    """Return the ``Propagator`` of lane `i`."""
    f = PROPAGATOR + i
    return Propagator(
        lanes[f], lanes[f + ROW], lanes[f + 2 * ROW], lanes[f + 3 * ROW], lanes[f + 4 * ROW],
        lanes[f + 5 * ROW], lanes[f + 6 * ROW],
    )  # fmt: skip


@inlined
def tangent_in(rows, a, distance):
    """Return the tangent vector whose numbers begin at `a`, `distance` apart."""
    return rows[a], rows[a + distance]


@inlined
def put_tangent(rows, a, distance, tangent):
    """Set a tangent vector; arguments as for ``tangent_in``."""
    rows[a], rows[a + distance] = tangent


@inlined
def set_rest(lanes, i, resting, theta, pt):
    """Note whether lane `i` is at rest at the phase `theta`, and until when."""
    lanes[LEVEL + i] = AT_REST if resting else pt.clearance
    lanes[WAKE + i] = theta + pt.omega * time_to_release(theta, pt) if resting else AWAKE


@inlined
def sleeps_until(lanes, i, theta):
    """Whether lane `i` rests until after the phase `theta`, rounding excluded."""
    return theta < lanes[WAKE + i] - 1e-9


@jit
def any_exceeds(lanes, row, limit, size):
    """Whether the number in `row` of any of the first lanes exceeds a limit."""
    widest_vectors()
    exceeds = False
    for i in range(min(size, LANES)):  # to the end: so LLVM vectorises it
        exceeds |= lanes[row + i] > limit
    return exceeds


@jit
def list_lanes(lanes, met, size):
    """List those of the first `size` lanes whose GUARD is not negative; return their number."""
    listed = 0
    for first in range(0, size, 64):
        bits = not_negative(lanes, GUARD + first)
        if first + 64 > size:
            bits &= (1 << (size - first)) - 1
        while bits != 0:  # terminates: one bit less each time
            met[listed] = first + lowest_bit(bits)
            bits &= bits - 1
            listed += 1
    return listed
