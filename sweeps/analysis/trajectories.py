"""The motion of one point of a sweep in time: as recorded, or computed from its last section."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from sweeps.analysis.selection import Selection, config_of, oscillator_of, recorded
from sweeps.errors import Refused
from vibroimpact.oscillator import Oscillator
from vibroimpact.trajectory import exact_samples, simulate

#: The variables of a recorded trajectory.
RECORDED = ("trajectory_t", "trajectory_x", "trajectory_v")


@dataclass(frozen=True)
class PointMotion:
    """The motion of one point.

    Attributes
    ----------
    point : Dataset
        The point of the sweep.
    oscillator : Oscillator
        Its oscillator.
    rows : ndarray, shape (3, n)
        Time, displacement and velocity, without NaN. Two columns with the same time are the states
        before and after an impact.
    turns : int
        Number of forcing periods of the sweep before time 0 of the rows.
    """

    point: xr.Dataset
    oscillator: Oscillator
    rows: np.ndarray
    turns: int = 0

    @property
    def impacts(self) -> np.ndarray:
        """Time, displacement and velocity just before the impacts, shape (3, k)."""
        t, _, v = self.rows
        return self.rows[:, np.append((np.diff(t) == 0.0) & (v[:-1] > 0.0), False)]

    def flow(self, per_period: int) -> np.ndarray:
        """Return the rows; for the integrator ``exact``, with `per_period` samples in between."""
        if config_of(self.point).method.integrator != "exact":
            return self.rows
        t, x, v = self.rows
        return np.stack(exact_samples(self.oscillator, t, x, v, per_period))


def recorded_motion(dataset: xr.Dataset, at: Selection | None) -> PointMotion:
    """Return the recorded trajectory of a point; refuse a point without one."""
    point, rows = recorded(dataset, RECORDED, at)
    return PointMotion(point, oscillator_of(point), np.stack(rows))


def continued_motion(dataset: xr.Dataset, at: Selection | None, periods: int) -> PointMotion:
    """Compute the motion that follows the last recorded state at the section of a point.

    Some impact rules let the mass pass the stop, and a motion cannot start beyond the stop. Then
    the last state that is not beyond it is used. Raises Refused if there is no such state, or if
    the motion cannot be computed.
    """
    point, (x, v) = recorded(dataset, ("poincare_x", "poincare_v"), at)
    config = config_of(dataset)
    oscillator = oscillator_of(point)
    allowed = np.flatnonzero(x <= oscillator.clearance)
    if not len(allowed):
        raise Refused("every recorded state of the section is beyond the stop at this point")
    last = int(allowed[-1])
    try:
        motion = simulate(
            oscillator,
            periods,
            **config.integration,
            x0=float(x[last]),
            v0=float(v[last]),
            phase=config.record.phase,
        )
    except ValueError as error:
        raise Refused(str(error)) from error
    if motion.status.failed:
        raise Refused(f"the motion cannot be computed at this point: {motion.status.meaning}")
    turns = config.record.transient + last + 1
    return PointMotion(point, oscillator, np.stack([motion.t, motion.x, motion.v]), turns)
