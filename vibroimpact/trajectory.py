"""One oscillator, every step and every impact."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vibroimpact.oscillator import Oscillator
from vibroimpact.status import Status
from vibroimpact.step.integrators import exact
from vibroimpact.step.log import SECTION, trace
from vibroimpact.step.methods import stepping
from vibroimpact.step.stop import IMPACT, RELEASE, REST, time_to_release


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
    for name, number, least in (
        ("periods", periods, 1),
        ("steps_per_period", 1 if steps_per_period is None else steps_per_period, 1),
        ("transient", transient, 0),
    ):
        if isinstance(number, bool) or not isinstance(number, (int, np.integer)) or number < least:
            raise ValueError(f"{name} must be an integer >= {least}, not {number!r}")
    if not 0.0 <= phase < 2.0 * math.pi:
        raise ValueError(f"phase must be from 0 to below 2 pi, not {phase!r}")
    points = oscillator.at(x0, v0)
    steps = stepping(points, integrator, impact, steps_per_period, float(phase), at_section=True)
    log, status = trace(points, steps, int(periods), int(transient))
    kind, t, x, v = log.T.copy()
    hit, section = kind == IMPACT, kind == SECTION
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

    Between two rows at rest on the stop the mass stays there.

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
    omega, pt = oscillator.omega, oscillator.at(oscillator.clearance)[0]
    step = np.diff(t)
    # The margin keeps rounding from halving steps that are short enough.
    parts = np.ceil(step * (omega * per_period / (2.0 * math.pi)) - 1e-9).astype(np.int64)
    row = np.repeat(np.arange(len(step)), np.maximum(parts - 1, 0))
    first = np.searchsorted(row, np.arange(len(step)))
    s = step[row] * (1 + np.arange(len(row)) - first[row]) / parts[row]
    theta = omega * t[row]
    starts = zip(x[row], v[row], np.sin(theta), np.cos(theta), s, strict=True)
    state = np.array([exact(*start, pt) for start in starts]).reshape(-1, 2)
    on_stop = (x == oscillator.clearance) & (v == 0.0)
    resting = (on_stop[:-1] & on_stop[1:])[row]
    state[resting] = oscillator.clearance, 0.0
    columns = ((t, t[row] + s), (x, state[:, 0]), (v, state[:, 1]))
    t, x, v = (np.insert(rows, row + 1, samples) for rows, samples in columns)
    return t, x, v
