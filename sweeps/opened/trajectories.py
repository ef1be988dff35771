"""The motion of one point in time: recorded, or computed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from sweeps.errors import Refused
from sweeps.opened.coordinates import recorded, refuse_unrecorded
from sweeps.opened.opened_sweep import OpenedSweep, Selection
from sweeps.store.variables import DIRECTION
from vibroimpact.oscillator import Oscillator
from vibroimpact.points.run_spec import RunSpec
from vibroimpact.trajectory import exact_samples, simulate

#: The variables of a recorded trajectory.
RECORDED = ("trajectory_t", "trajectory_x", "trajectory_v")
#: Most forcing periods of a motion that are kept: more than a picture has columns of pixels.
MOST_DRAWN = 1000


@dataclass(frozen=True)
class PointMotion:
    """The motion of one point."""

    oscillator: Oscillator
    is_exact: bool  # whether its integrator is ``exact``
    #: Time, displacement and velocity. Two columns with the same time are the states before
    #: and after an impact. Of more than the periods to keep as many are kept, evenly spread,
    #: and a column of NaN stands for the periods between them. Shape (3, n).
    rows: np.ndarray
    depth: float  # largest x - clearance in all periods [length]
    periods: int  # number of forcing periods, with those left out
    begun: float  # omega t where the motion of the sweep began
    turns: int  # number of forcing periods of the sweep before time 0 of the rows

    @classmethod
    def of(
        cls,
        oscillator: Oscillator,
        spec: RunSpec,
        rows: np.ndarray,
        periods: int,
        most: int,
        begun: float,
        turns: int = 0,
    ) -> Self:
        """Return a motion over `periods`, given its rows; keep at most so many of these."""
        depth = float(rows[1].max()) - oscillator.clearance
        turn = np.floor((rows[0] - rows[0, 0]) * (oscillator.omega / (2.0 * np.pi)) + 1e-6)
        chosen = (turn * most) % periods < most  # all, if they are no more
        left_out = ~(chosen | np.append(False, chosen[:-1]))  # a period ends with a row
        first_left_out = left_out & ~np.append(True, left_out[:-1])
        kept = np.where(left_out, np.nan, rows)[:, ~left_out | first_left_out]
        is_exact = spec.integrator == "exact"
        return cls(oscillator, is_exact, kept, depth, periods, begun, turns)

    @property
    def impacts(self) -> np.ndarray:
        """Time, displacement and velocity just before the impacts, shape (3, k)."""
        t, _, v = self.rows
        return self.rows[:, np.append((np.diff(t) == 0.0) & (v[:-1] > 0.0), False)]

    def flow(self, per_period: int) -> np.ndarray:
        """Return the rows; for the integrator ``exact``, with `per_period` samples in between."""
        if not self.is_exact:
            return self.rows
        t, x, v = self.rows
        return np.stack(exact_samples(self.oscillator, t, x, v, per_period))


def periods_shown(m: int) -> int:
    """Return how many forcing periods show a motion of period m (0: unknown): two repetitions."""
    return max(2 * m, 4)


def recorded_motion(
    sweep: OpenedSweep, at: Selection | None, most: int = MOST_DRAWN
) -> PointMotion:
    """Return at most so many periods of the trajectory of a point; refuse a point without one."""
    point, spec = sweep.cut(at), sweep.spec
    rows = np.stack([point[name].values for name in RECORDED])
    rows = rows[:, np.isfinite(rows).all(axis=0)]  # without the padding
    if not rows.size:
        refuse_unrecorded(point["status"].item(), RECORDED[0])
    return PointMotion.of(point.oscillator, spec, rows, spec.periods, most, _begun(point))


def _begun(point: OpenedSweep) -> float:
    """Return omega t where the motion of a point began: at the start, or at a section if followed.

    A point of a followed sweep begins at the start only if it is the first of its chain. After a
    point that failed the next one does, too, but a point does not know its neighbours.
    """
    spec = point.spec
    if spec.followed is not None:
        values = point.config.sweep.grid.swept[spec.followed]
        way = point[DIRECTION].item() if DIRECTION in point else spec.directions[0]
        first = values.min() if way == "up" else values.max()
        if values[np.argmin(np.abs(values - float(point[spec.followed])))] != first:
            return spec.phase
    return float(point["phase"])


def continued_motion(
    sweep: OpenedSweep, at: Selection | None, periods: int, most: int = MOST_DRAWN
) -> PointMotion:
    """Compute the motion that follows the last recorded state at the section of a point."""
    point, states = recorded(sweep, ("poincare_x", "poincare_v"), at)
    return continued(point.oscillator, sweep.spec, states, periods, _begun(point), most)


def continued(
    oscillator: Oscillator,
    spec: RunSpec,
    states: Sequence[np.ndarray],
    periods: int,
    begun: float,
    most: int = MOST_DRAWN,
) -> PointMotion:
    """Compute the motion that follows the last of the recorded section states x and v, (2, n).

    Some impact rules let the mass pass the stop, and a motion cannot start beyond the stop. Then
    the last state that is not beyond it is used. Raises Refused if there is no such state, or if
    the motion cannot be computed.
    """
    x, v = states
    allowed = np.flatnonzero(x <= oscillator.clearance)
    if not len(allowed):
        raise Refused("every recorded state of the section is beyond the stop at this point")
    last = int(allowed[-1])
    try:
        motion = simulate(
            oscillator,
            periods,
            spec.integrator,
            spec.impact,
            spec.steps_per_period,
            x0=float(x[last]),
            v0=float(v[last]),
            phase=spec.phase,
        )
    except ValueError as error:
        raise Refused(str(error)) from error
    if motion.status.failed:
        raise Refused(f"the motion cannot be computed at this point: {motion.status.meaning}")
    turns = spec.transient + last + 1
    turns += begun > spec.phase  # it passes the section after 2 pi
    rows = np.stack([motion.t, motion.x, motion.v])
    return PointMotion.of(oscillator, spec, rows, periods, most, begun, turns)
