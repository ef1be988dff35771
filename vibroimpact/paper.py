"""`PaperRun`: the paper's procedure taken literally, eqs (1)-(10).

This file shares no code with the kernel, and shows what the kernel corrects. After an impact the
next step starts at t_0 + T_r, so the grid is no longer uniform. That step starts with the
acceleration of eq. (10), which is the acceleration before the impact; after the impact it is wrong
by 2h (1 + R) v. So the scheme is of first order if h > 0, and misses the fourth impact of the third
case at T = 2 pi/100. If x_0 = 0 after a rebound, eq. (7) gives T_r = 0: time stops advancing, and
the procedure stalls.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vibroimpact.inputs import FLAG, integer, refuse_other
from vibroimpact.oscillator import Oscillator

#: Most forcing periods, and most steps in each.
_MOST_PERIODS_AND_STEPS = 1_000_000


@dataclass(frozen=True)
class PaperRun:
    """A run of the paper's own scheme, from rest at x = x' = 0.

    Attributes
    ----------
    t, x, v : ndarray, shape (n,)
        Every step, and the state before and after every impact (two rows with the same t).
    impact_t, impact_v : ndarray, shape (m,)
        Time of each impact, and speed before it.
    stalled_at : float or None
        Time at which the procedure stopped advancing (T_r = 0), or None if it reached the end.

    Examples
    --------
    >>> run = paper_procedure(Oscillator(h=0.1, R=0.8, omega=2.3, f=1.0), periods=5)
    >>> len(run.impact_t), run.stalled_at
    (4, None)
    """

    t: np.ndarray
    x: np.ndarray
    v: np.ndarray
    impact_t: np.ndarray
    impact_v: np.ndarray
    stalled_at: float | None

    @property
    def max_penetration(self) -> float:
        """Largest displacement beyond the stop, at least 0."""
        return float(np.maximum(self.x.max(), 0.0))


def paper_procedure(
    oscillator: Oscillator, periods: int = 10, steps_per_period: int = 100, procedure: bool = True
) -> PaperRun:
    """Integrate eq. (1) with Newmark's method and the paper's impact rule.

    Parameters
    ----------
    oscillator : Oscillator
        Its clearance must be 0, as in the paper.
    periods : int
        Forcing periods to run, at most 1,000,000.
    steps_per_period : int
        T = 2 pi / (omega steps_per_period), at most 1,000,000; the paper has 100.
    procedure : bool
        Whether to take the reduced time step, eqs (6)-(10).

    Returns
    -------
    PaperRun
        Complete up to `periods`, or up to the stall.

    Raises
    ------
    TypeError, ValueError
        If an argument has the wrong type or is out of its range, or if the clearance is not 0.

    Examples
    --------
    >>> osc = Oscillator(h=0.1, R=0.8, omega=2.3, f=1.0)
    >>> with_procedure, without = paper_procedure(osc), paper_procedure(osc, procedure=False)
    >>> with_procedure.max_penetration < without.max_penetration
    True
    """
    refuse_other("oscillator", oscillator, Oscillator)
    periods = integer(1, _MOST_PERIODS_AND_STEPS).checked("periods", periods)
    steps_per_period = integer(1, _MOST_PERIODS_AND_STEPS).checked(
        "steps_per_period", steps_per_period
    )
    procedure = FLAG.checked("procedure", procedure)
    if oscillator.clearance != 0.0:
        raise ValueError(f"the paper's stop is at 0, not at {oscillator.clearance:g}")
    T = oscillator.forcing_period / steps_per_period
    end = periods * oscillator.forcing_period
    n = 0
    t, x, v = 0.0, 0.0, 0.0
    a = _acceleration(oscillator, t, x, v)
    rows, impacts = [(t, x, v)], []
    stalled_at = None
    while t < end - 1e-9 * T:  # terminates: after a reduced step x = 0, then a full step or a stall
        x_T, v_T, a_T = _newmark(oscillator, t, x, v, a, T)
        if procedure and x_T > 0.0:
            T_r = T * (0.0 - x) / (x_T - x)  # (6), (7)
            if T_r <= 0.0:
                stalled_at = t
                break
            v, a = v + (v_T - v) * T_r / T, a + (a_T - a) * T_r / T  # (9), (10)
            t, x = t + T_r, 0.0  # (8)
        else:
            x, v, a = x_T, v_T, a_T
            n += 1
            t = t + T if procedure else n * T
        rows.append((t, x, v))
        if x >= 0.0 and v > 0.0:  # (2)
            impacts.append((t, v))
            x, v = 0.0, -oscillator.R * v  # (3), (4), (5)
            if not procedure:
                a = _acceleration(oscillator, t, x, v)
            rows.append((t, x, v))
    times, displacements, velocities = np.array(rows).T
    impact_t, impact_v = np.array(impacts).reshape(-1, 2).T
    return PaperRun(times, displacements, velocities, impact_t, impact_v, stalled_at)


def _acceleration(osc: Oscillator, t: float, x: float, v: float) -> float:
    """Return x'' from eq. (1)."""
    return -2.0 * osc.h * v - osc.p * osc.p * x - osc.force * math.sin(osc.omega * t)


def _newmark(
    osc: Oscillator, t: float, x: float, v: float, a: float, T: float
) -> tuple[float, float, float]:
    """Take one step with constant average acceleration, from (x, v, a) to (x_T, v_T, a_T)."""
    # First x_T and v_T with a_T = 0, then a_T from eq. (1) at t + T, which is linear in a_T.
    quarter = T * T / 4.0
    x_0 = x + T * v + quarter * a
    v_0 = v + T / 2.0 * a
    a_T = _acceleration(osc, t + T, x_0, v_0) / (1.0 + osc.h * T + osc.p * osc.p * quarter)
    return x_0 + quarter * a_T, v_0 + T / 2.0 * a_T, a_T
