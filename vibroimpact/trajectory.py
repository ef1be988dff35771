"""`simulate`, a `Trajectory`: every step and impact of one oscillator, samples between."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vibroimpact.inputs import integer, refuse_other
from vibroimpact.kernel.integrate import Length, run_points
from vibroimpact.kernel.record import loses_digits
from vibroimpact.oscillator import Oscillator, with_one_force
from vibroimpact.status import Status
from vibroimpact.step.contact import (
    IMPACT,
    RELEASE,
    RELEASE_MARGIN,
    REST,
    impulse_and_loss,
    time_to_release,
    with_near_stop,
)
from vibroimpact.step.integrators import closed_form
from vibroimpact.step.recorder import SECTION, trace
from vibroimpact.step.scheme import MOST_PERIODS, MOST_RECORDED, scheme_of

#: Most rows of a trajectory; a longer one is refused.
MOST_ROWS = 10_000_000


@dataclass(frozen=True)
class Trajectory:
    """The motion of one oscillator.

    Attributes
    ----------
    t, x, v : ndarray, shape (n,)
        Every step, and the state before and after every impact (two rows with the same t).
    impact_t, impact_v : ndarray, shape (m,)
        Time of each impact, and speed before it.
    rests : ndarray, shape (k, 2)
        Start and end of each rest on the stop. A rest that lasts to the end of the run ends there,
        or at inf if the force never releases the mass.
    section_x, section_v : ndarray, shape (periods,)
        State at the end of each forcing period.
    max_penetration : float
        Largest x - clearance among the rows, at least 0.
    x_min, x_max : float
        Least and greatest x over the whole length, also where the mass turns between two rows; NaN
        after a failure. See `integrate`.
    status : Status
        The outcome. After a failure the rows are NaN. If only the impulse or the energy lost at the
        impacts overflows, the status is ``NON_FINITE``, as for `integrate`, and the rows are valid.

    Examples
    --------
    >>> from vibroimpact import Oscillator
    >>> tr = simulate(Oscillator(h=0.1, R=0.8, omega=2.3, f=1.0), periods=50)
    >>> len(tr.impact_t), tr.rests.shape, tr.max_penetration
    (49, (0, 2), 0.0)
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
    x_min: float
    x_max: float
    status: Status

    def __repr__(self) -> str:
        """Return the numbers of periods, rows, impacts and rests, and the outcome, on one line."""
        lengths = {
            "periods": self.section_x,
            "rows": self.t,
            "impacts": self.impact_t,
            "rests": self.rests,
        }
        counts = ", ".join(f"{len(values):,} {name}" for name, values in lengths.items())
        return f"Trajectory({counts}, {self.status.name})"


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
    """Follow one oscillator over `periods` forcing periods, after a transient.

    The arithmetic is that of a lane of the sweep kernel, to the last bit.

    Parameters
    ----------
    oscillator : Oscillator
    periods : int
        Forcing periods, from 1 to 1,000,000.
    integrator, impact : str
        Keys of `vibroimpact.INTEGRATORS` and `vibroimpact.IMPACT_RULES`.
    steps_per_period : int, optional
        Steps of length T = 2 pi / (omega steps_per_period), from 1 to 1,000,000, stable or
        not. The default is 100, or more if stability needs them; for the impact rule ``exact`` it
        is the least number that the rule allows.
    x0, v0 : float
        Start: displacement (<= clearance) [length] and velocity [length/time].
    phase : float
        omega t at the start, in [0, 2 pi) [rad]: the motion starts at t = phase / omega. Given a
        state at a section and the phase of that section, the motion continues from there.
    transient : int
        Forcing periods left out at the start, from 0 to 1,000,000,000.

    Returns
    -------
    Trajectory

    Raises
    ------
    TypeError, ValueError
        If an argument has the wrong type or is out of its valid range, or if the trajectory has
        more than 10,000,000 rows.

    Examples
    --------
    >>> from vibroimpact import Oscillator
    >>> tr = simulate(Oscillator(h=0.1, R=0.8, omega=2.3, f=1.0), periods=50)
    >>> tr.status.name, tr.impact_v[-1:].round(6)
    ('CERTIFIED', array([1.09758]))
    """
    refuse_other("oscillator", oscillator, Oscillator)
    periods = integer(1, MOST_RECORDED).checked("periods", periods)
    transient = integer(0, MOST_PERIODS).checked("transient", transient)
    points, interrupt = oscillator.at(x0, v0), np.zeros(1, np.int64)
    scheme = scheme_of(points, integrator, impact, steps_per_period, phase)
    points = with_near_stop(points, impact)
    points["phase"] = phase
    before = Status.PENDING
    if transient > 0:
        run = run_points(points, scheme, Length(transient, 1, 0), False, 1, interrupt)
        points["x0"], points["v0"] = run["begun"].T
        before = Status(run["status"][0])
    extremes = np.empty(2)
    log, status = trace(points, scheme, periods, transient, 1, interrupt, MOST_ROWS, extremes)
    if status is Status.PENDING:
        raise ValueError(
            f"the trajectory has more than {MOST_ROWS:,} rows; expected: fewer periods"
        )
    status = max(status, before)
    kind, t, x, v = log.T.copy()
    hit, section = kind == IMPACT, kind == SECTION
    speeds = v[1:][hit[1:]]  # an impact at the start belongs to no step
    with np.errstate(over="ignore"):
        sums = np.sum(speeds), np.sum(speeds * speeds)
    if not status.failed and np.isinf(impulse_and_loss(points["R"], *sums)).any():
        status = Status.NON_FINITE
    rests = _rests(kind, t, points)
    if status is Status.CERTIFIED:
        rested = (np.minimum(rests[:, 1], t[-1]) - rests[:, 0]).sum() / (t[-1] - t[0])
        if loses_digits(points, x[section][None], rested)[0]:
            status = Status.COMPUTED
    if status.failed:
        extremes[:] = math.nan
    depth = x[np.isfinite(x)] - oscillator.clearance
    return Trajectory(
        t=t,
        x=x,
        v=v,
        impact_t=t[hit],
        impact_v=v[hit],
        rests=rests,
        section_x=x[section],
        section_v=v[section],
        max_penetration=float(depth.max(initial=0.0)),
        x_min=float(extremes[0]),
        x_max=float(extremes[1]),
        status=status,
    )


def _rests(kind: np.ndarray, t: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the start and end of each rest that is longer than rounding, from its rows."""
    begin, end = t[kind == REST], t[kind == RELEASE]
    if len(end) < len(begin):
        pt = points.view(np.recarray)[0]
        for_ever = time_to_release(pt.omega * t[-1], pt) == math.inf
        end = np.append(end, math.inf if for_ever else t[-1])
    return np.column_stack([begin, end])[points["omega"] * (end - begin) > RELEASE_MARGIN]


def exact_samples(
    oscillator: Oscillator, t: np.ndarray, x: np.ndarray, v: np.ndarray, per_period: int = 200
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Insert states of the exact flow between the rows of a trajectory of the integrator ``exact``.

    The rows must include every event; they are not changed. Each forcing period gets at least
    `per_period` states, and none are inserted beside a row of NaN. Between two rows at rest on the
    stop, the mass stays there.
    """
    omega, pt = oscillator.omega, with_one_force(oscillator.at(oscillator.clearance))[0]
    step = np.diff(t)
    # The margin prevents rounding from halving steps that are already short enough.
    parts = np.ceil(step * omega * (per_period / (2.0 * math.pi)) - 1e-9)
    parts = np.nan_to_num(parts).astype(np.int64)  # NaN beside rows that are left out
    row = np.repeat(np.arange(len(step)), np.maximum(parts - 1, 0))
    first = np.searchsorted(row, np.arange(len(step)))
    s = step[row] * (1 + np.arange(len(row)) - first[row]) / parts[row]
    theta = omega * t[row]
    starts = zip(x[row], v[row], np.sin(theta), np.cos(theta), s, strict=True)
    state = np.array([closed_form(*start, pt) for start in starts]).reshape(-1, 2)
    on_stop = (x == oscillator.clearance) & (v == 0.0)
    resting = (on_stop[:-1] & on_stop[1:])[row]
    state[resting] = oscillator.clearance, 0.0
    columns = ((t, t[row] + s), (x, state[:, 0]), (v, state[:, 1]))
    t, x, v = (np.insert(rows, row + 1, samples) for rows, samples in columns)
    return t, x, v
