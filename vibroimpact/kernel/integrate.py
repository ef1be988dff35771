"""`integrate`: arrays of points in, named results out; `Length`, what is recorded; `Effort`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from vibroimpact.inputs import FLAG, integer
from vibroimpact.jit import ALL_THREADS
from vibroimpact.kernel.record import SUMS, Record, loses_digits, named_results
from vibroimpact.kernel.threads import KernelJob, find_on_threads, lanes_per_thread, run_on_threads
from vibroimpact.oscillator import refuse_invalid, with_one_force
from vibroimpact.status import Status
from vibroimpact.step.contact import with_near_stop
from vibroimpact.step.scheme import EXACT, MOST_PERIODS, MOST_RECORDED, THETA, Scheme, scheme_of


class Length(NamedTuple):
    """How long a run is, and how much of it is kept."""

    transient: int  #: Periods left out.
    periods: int  #: Periods recorded.
    impacts: int  #: How many of the last impacts to keep.


def integrate(
    points: np.ndarray,
    *,
    integrator: str = "exact",
    impact: str = "exact",
    steps_per_period: int | None = None,
    transient: int = 1000,
    periods: int = 100,
    phase: float = 0.0,
    at_section: bool = False,
    impacts: int = 64,
    lyapunov: bool = False,
    extremes: bool = False,
    threads: int | None = None,
) -> dict[str, np.ndarray]:
    """Run every parameter point from its start and record its attractor.

    The record covers `periods` forcing periods. Before them, `transient` forcing periods are left
    out, counted from the first passage of the phase `phase`. An impact at the very start of the
    record does not belong to it.

    Parameters
    ----------
    points : ndarray of dtype ``POINT``, shape (n,)
        Valid parameter points; ``Oscillator.at`` makes one.
    integrator, impact : str
        Keys of `vibroimpact.INTEGRATORS` and `vibroimpact.IMPACT_RULES`.
    steps_per_period : int, optional
        Steps of length T = 2 pi / (omega steps_per_period), from 1 to 1,000,000, stable or not. The
        default is that of `simulate`, the largest for all points.
    transient : int
        Forcing periods left out, at most 1,000,000,000.
    periods : int
        Forcing periods recorded, at most 1,000,000.
    phase : float
        omega t mod 2 pi of the stroboscopic section, in [0, 2 pi) [rad]. It is always a point of
        the grid of steps.
    at_section : bool
        Whether every point starts at the phase `phase`, instead of its own. A run that starts at
        the last section of another run continues it.
    impacts : int
        How many of the last impacts to keep, at most 1,000,000.
    lyapunov : bool
        Whether to compute the Lyapunov exponents; with the rule ``exact`` only.
    extremes : bool
        Whether to compute the least and the greatest displacement.
    threads : int, optional
        Threads to use; all by default. The results do not depend on it.

    Returns
    -------
    dict of str to ndarray
        ``poincare_x``, ``poincare_v`` : (n, periods), state at the end of each recorded period.
        ``impact_phase``, ``impact_v`` : (n, impacts), omega t mod 2 pi [rad] of the last impacts
        and the speed before them, in time order; NaN where there were fewer.

        All others cover the recorded periods and have the shape (n,): ``impacts_per_period``;
        ``slowest_impact`` and ``fastest_impact``, speeds before the impact, NaN without an impact;
        ``impulse`` on the stop, (1 + R) sum v, and ``energy_lost`` at impacts, (1 - R^2) / 2
        sum v^2, both per forcing period and unit of mass, including impacts of a chatter that are
        summed instead of followed; ``max_penetration``; ``rest_fraction``; ``chatters``, the number
        of complete ones; ``near_grazes``; ``status``. The rule ``plain`` has no rests; only
        ``exact`` looks for near grazes. If ``status`` is a failure, the numbers are NaN and the
        counts 0. With ``exact`` it is ``CERTIFIED``, or ``COMPUTED`` where the stop is so far from
        the rest position that x keeps fewer than 8 digits of the motion at the sections, or where
        the motion is below 1e-300 or omega^2 overflows.

        With `lyapunov` also ``lyapunov`` : (n, 2), per unit time, the larger first. Both are -inf
        after a rest, which erases the past; the second is -inf after an impact with R = 0, because
        the motion after it depends only on its phase.

        With `extremes` also ``x_min`` and ``x_max`` : (n,), the least and the greatest x of the
        recorded periods, with their beginning. With the rule ``exact`` the turning points between
        the steps are right to rounding, and x_max is the clearance after an impact or a rest. With
        time stepping they are those of the cubic Hermite interpolant between two states of the
        method, and x_max exceeds the clearance by ``max_penetration``: states beyond the stop
        count, but not an interpolant between them.

    Raises
    ------
    TypeError
        If `points` is not an array of dtype ``POINT``.
    ValueError
        If a point is not valid; the message names its row and parameter. If a start is beyond the
        stop, except at a section with the rule ``plain``, which lets the mass pass the stop. If any
        other argument is out of range, the integrator or impact rule is unknown, the rule ``exact``
        comes with another integrator, or it has too few steps per period.
    MemoryError
        If the memory is too small for the results.

    Examples
    --------
    >>> from vibroimpact import Oscillator
    >>> points = Oscillator(h=0.1, R=0.8, omega=2.3, f=1.0).at().repeat(3)
    >>> points["omega"] = [2.3, 2.5, 2.7]
    >>> integrate(points, periods=2)["poincare_x"].round(4)
    array([[-0.5534, -0.5534],
           [-0.3891, -0.3891],
           [-0.1716, -0.4215]])
    """
    at_section = FLAG.checked("at_section", at_section)
    lyapunov = FLAG.checked("lyapunov", lyapunov)
    extremes = FLAG.checked("extremes", extremes)
    length = Length(
        integer(0, MOST_PERIODS).checked("transient", transient),
        integer(1, MOST_RECORDED).checked("periods", periods),
        integer(0, MOST_RECORDED).checked("impacts", impacts),
    )
    if threads is not None:
        threads = integer(1, MOST_RECORDED).checked("threads", threads)
    refuse_invalid(points, beyond_stop=at_section and impact == "plain")
    scheme = scheme_of(points, integrator, impact, steps_per_period, phase)
    points = with_near_stop(points, impact)
    if at_section:
        points["phase"] = scheme.grid.table[THETA, 0]
    if lyapunov and scheme.method[0] != EXACT:
        raise ValueError(f"lyapunov needs the impact rule 'exact', not {impact!r}")
    interrupt = np.zeros(1, np.int64)
    results = run_points(points, scheme, length, lyapunov, threads, interrupt, extremes=extremes)
    del results["begun"]
    return results


def run_points(
    points: np.ndarray,
    scheme: Scheme,
    length: Length,
    lyapunov: bool,
    threads: int | None,
    interrupt: np.ndarray,
    classes: bool = False,
    extremes: bool = False,
) -> dict[str, np.ndarray]:
    """Do what ``integrate`` does, for valid arguments of which the scheme is known.

    There is also ``begun``, (n, 2), the state where the record begins after a transient, and with
    `classes` ``destination``, of dtype ``DESTINATION``. Once another thread sets `interrupt`, an
    array of one int64, the run ends within a forcing period. Points that are not complete then have
    NaN and the status ``PENDING``.
    """
    points = with_one_force(points)
    threads = ALL_THREADS if threads is None else threads
    record = _record(points, scheme, length, lyapunov, threads, interrupt, extremes)
    more = {}
    if classes:
        of_record = record.sections, record.sums
        more["destination"] = find_on_threads(points, scheme, *of_record, threads, interrupt)
    results = named_results(points, record)
    if scheme.method[0] == EXACT:
        lost = loses_digits(points, results["poincare_x"], results["rest_fraction"])
        results["status"][lost & (results["status"] == Status.CERTIFIED)] = Status.COMPUTED
    if not lyapunov:
        del results["lyapunov"]
    return results | more


def _record(
    points: np.ndarray,
    scheme: Scheme,
    length: Length,
    lyapunov: bool,
    threads: int,
    interrupt: np.ndarray,
    extremes: bool,
) -> Record:
    """Run points with one force; return their record."""
    (transient, periods, impacts), n = length, points.size
    sums = np.zeros(n, dtype=SUMS)
    sums["slowest_impact"], sums["status"] = np.inf, Status.PENDING
    begun = np.full((n, 2), np.nan)
    x_extremes = np.full((n, 2 if extremes else 0), np.nan)
    record = Record(np.empty((n, periods, 2)), np.empty((n, impacts, 2)), begun, sums, x_extremes)
    lanes, claimed = lanes_per_thread(n, threads), np.zeros(1, np.int64)
    job = KernelJob(points, scheme, transient, periods, lyapunov, lanes, record, claimed, interrupt)
    run_on_threads(threads, job)
    return record


class Effort(NamedTuple):
    """What a run computed, with its transient; what it copied does not count."""

    periods: int
    impacts: float  #: As many in every period as in those that were recorded.
    alone: int  #: Steps that left the vector, with the rule ``exact``.


def effort(points: np.ndarray, scheme: Scheme, length: Length, lyapunov: bool = False) -> Effort:
    """Run valid points on one thread, and count what the run computed."""
    points, interrupt = with_one_force(points), np.zeros(1, np.int64)
    sums = _record(points, scheme, length, lyapunov, 1, interrupt, False).sums
    all_periods = length.transient + length.periods
    computed = all_periods - sums["skipped"]
    impacts = (sums["impacts"] * computed).sum() / length.periods
    return Effort(int(computed.sum()), float(impacts), int(sums["alone"].sum()))


def find_destinations(
    points: np.ndarray, scheme: Scheme, results: Mapping[str, np.ndarray], threads: int | None
) -> np.ndarray:
    """Find where motions go, given the results of a run; returns dtype ``DESTINATION``, (n,)."""
    n, periods = results["poincare_x"].shape
    sums, status = np.zeros(n, SUMS), results["status"]
    # A motion that grows without bound goes nowhere.
    sums["status"] = np.where(status == Status.UNBOUNDED, Status.UNRESOLVED, status)
    sums["impacts"] = np.rint(np.nan_to_num(results["impacts_per_period"]) * periods)
    sums["chatters"], sums["rested"] = results["chatters"], results["rest_fraction"]
    sections = np.stack([results["poincare_x"], results["poincare_v"]], axis=2)
    threads = ALL_THREADS if threads is None else threads
    points, interrupt = with_one_force(points), np.zeros(1, np.int64)
    return find_on_threads(points, scheme, sections, sums, threads, interrupt)
