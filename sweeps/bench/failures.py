"""Where the methods fail: a scene for each failure, a figure measured in a run, and its limit.

The method ``to the letter`` is the paper's procedure unchanged, ``vibroimpact.paper``. It starts
from rest at the stop, so figures that need another start are not measured for it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sweeps.bench.scenes import Method
from vibroimpact import Oscillator, PaperRun, Trajectory, integrate, paper_procedure, simulate

LETTER = Method("newmark", "to the letter")
#: Without ``exact`` under the rules of time stepping, which fails here as ``rk4`` does.
METHODS: Sequence[Method] = (
    LETTER,
    Method("euler", "plain"),
    Method("euler", "reduced-step"),
    Method("semi-implicit-euler", "plain"),
    Method("semi-implicit-euler", "reduced-step"),
    Method("verlet", "plain"),
    Method("verlet", "reduced-step"),
    Method("newmark", "plain"),
    Method("newmark", "reduced-step"),
    Method("newmark", "cubic"),
    Method("rk4", "plain"),
    Method("rk4", "reduced-step"),
    Method("rk4", "cubic"),
    Method("exact", "exact"),
)

#: Steps per period, where not said otherwise; the rule ``exact`` takes its own.
STEPS = 100

#: The chatter of a slow force, which ends at 12.41264; the mass then rests for 8.53.
CHATTER = Oscillator(h=0.0, R=0.3, omega=0.3, f=1.0)
#: Long chatters that never end: nothing rests.
ENDLESS = (Oscillator(h=0.5, R=0.8, omega=0.6, f=1.0), Oscillator(h=0.5, R=0.95, omega=0.4, f=1.0))
#: The paper's fully dissipative case: four impacts per period, the slowest at the speed 0.0365.
PAPER = Oscillator(h=0.5, R=0.5, omega=1.0, f=1.0)
PAPER_IMPACTS, PAPER_SLOWEST = 80, 0.036454221377120
#: The first flight touches the stop at this time, at the speed 0.0039.
GRAZE, GRAZE_TIME = Oscillator(h=0.1, R=0.8, omega=3.0383, f=1.0), 2.8308
#: Free motion that loses nothing.
FREE = Oscillator(h=0.0, R=1.0, omega=101.37 / 100.0, f=0.0)
#: Two attractors: 1 impact in 1 period, and 3 impacts in 2 periods.
COEXISTING = Oscillator(h=0.02, R=0.8, omega=1.3, f=1.0)
#: At four steps per period p T = pi here, beyond every limit but that of an unlimited integrator.
COARSE, COARSE_STEPS = Oscillator(h=0.0, R=0.8, omega=0.5, f=1.0), 4


@dataclass(frozen=True)
class Failure:
    """One kind of failure.

    Attributes
    ----------
    name : str
        Of the figure.
    scene : str
        What is run, and what the figure is.
    measure : callable
        The figure of a method; nan where it cannot be measured.
    fails : callable
        Whether a figure is a failure.
    digits : str
        Format of the figure.
    """

    name: str
    scene: str
    measure: Callable[[Method], float]
    fails: Callable[[float], bool]
    digits: str


def follow(
    method: Method, oscillator: Oscillator, periods: int, steps: int = STEPS
) -> Trajectory | PaperRun:
    """Run an oscillator from rest at the stop."""
    if method == LETTER:
        return paper_procedure(oscillator, periods, steps)
    return simulate(oscillator, periods, *method, _steps(method, steps))


def _steps(method: Method, steps: int) -> int | None:
    return None if method.impact == "exact" else steps


def stall(method: Method) -> float:
    """Time at which time stops advancing; inf where it does not."""
    run = follow(method, CHATTER, 2)
    if isinstance(run, PaperRun):
        return math.inf if run.stalled_at is None else run.stalled_at
    return run.t[-1] if run.status.failed else math.inf


def impacts_at_rest(method: Method) -> float:
    """Impacts while the true mass rests."""
    run, true = follow(method, CHATTER, 1), follow(Method("exact", "exact"), CHATTER, 1)
    assert isinstance(true, Trajectory)
    if isinstance(run, PaperRun) and run.stalled_at is not None:
        return math.nan
    begin, end = true.rests[0]
    return float(np.count_nonzero((run.impact_t > begin + 1e-6) & (run.impact_t < end - 1e-6)))


def spurious_rests(method: Method) -> float:
    """Rests in 20 periods of each motion that never rests."""
    if method == LETTER:
        return math.nan
    runs = [simulate(osc, 20, *method, _steps(method, STEPS)) for osc in ENDLESS]
    return float(sum(len(run.rests) for run in runs))


def penetration(method: Method) -> float:
    """Greatest depth, over the speed of the fastest impact times T."""
    run = follow(method, PAPER, 20)
    return run.max_penetration * PAPER.omega * STEPS / (2.0 * math.pi * run.impact_v.max())


def smallest_touch(method: Method) -> float:
    """Least depth of a touch that is seen, over |a| T^2 / 8, its top in the middle of a step.

    The free flight x = cos t, started 2.5 steps before its top. Below 0, impacts are seen where
    there is no touch.
    """
    if method == LETTER:
        return math.nan
    T = 2.0 * math.pi / STEPS
    x0, v0 = math.cos(2.5 * T), math.sin(2.5 * T)
    missed, seen = -40.0, 40.0
    for _ in range(50):
        depth = 0.5 * (missed + seen)
        stop = 1.0 - depth * T * T / 8.0
        osc = Oscillator(h=0.0, R=0.8, omega=1.0, f=0.0, clearance=max(stop, x0))
        impacts = simulate(osc, 1, *method, _steps(method, STEPS), x0, v0).impact_t
        missed, seen = (missed, depth) if (impacts < 5.0 * T).any() else (depth, seen)
    return round(seen, 9) + 0.0


def first_graze(method: Method) -> float:
    """Time of the first impact."""
    return follow(method, GRAZE, 3).impact_t[0]


def energy(method: Method) -> float:
    """Share of the energy after 100 impacts of free motion from x = -1."""
    if method == LETTER:
        return math.nan
    run = simulate(FREE, 60, *method, _steps(method, STEPS), x0=-1.0)
    return run.impact_v[99] ** 2


def impacts(method: Method) -> float:
    """Impacts in 20 periods."""
    return float(len(follow(method, PAPER, 20).impact_t))


def slowest_impact(method: Method) -> float:
    """Speed of the slowest impact in the last 10 of 20 periods."""
    run = follow(method, PAPER, 20)
    return run.impact_v[run.impact_t > 10 * PAPER.forcing_period].min()


def wrong_attractor(method: Method) -> float:
    """Of 64 starts, how many end on another attractor than that of the true motion."""
    if method == LETTER:
        return math.nan
    starts = [(x, v) for x in np.linspace(-3.0, 0.0, 8) for v in np.linspace(-2.0, 2.0, 8)]
    points = np.concatenate([COEXISTING.at(*start) for start in starts])
    ends = [
        integrate(
            points,
            integrator=run_method.integrator,
            impact=run_method.impact,
            steps_per_period=_steps(run_method, STEPS),
            transient=1500,
            periods=60,
        )["impacts_per_period"]
        for run_method in (method, Method("exact", "exact"))
    ]
    return float(np.count_nonzero(~(np.abs(ends[0] - ends[1]) < 0.1)))


def greatest_speed(method: Method) -> float:
    """Greatest speed in 400 periods; inf where it overflows."""
    if method == LETTER:
        return math.nan
    run = simulate(COARSE, 400, *method, _steps(method, COARSE_STEPS))
    return math.inf if run.status.failed else float(np.abs(run.v).max())


FAILURES: Sequence[Failure] = (
    Failure(
        "stalls at",
        "chatter, h = 0, R = 0.3, omega = 0.3: time at which time stops advancing",
        stall,
        lambda t: t < math.inf,
        ".2f",
    ),
    Failure(
        "at rest",
        "the same: impacts while the mass in truth rests",
        impacts_at_rest,
        lambda count: count > 0,
        ".0f",
    ),
    Failure(
        "false rests",
        "h = 0.5, R = 0.8, omega = 0.6 and h = 0.5, R = 0.95, omega = 0.4: rests in 20 periods "
        "each, where nothing rests",
        spurious_rests,
        lambda count: count > 0,
        ".0f",
    ),
    Failure(
        "depth",
        "fully dissipative case of the paper: deepest penetration, over the speed of the fastest "
        "impact times T",
        penetration,
        lambda depth: depth > 1e-12,
        ".2f",
    ),
    Failure(
        "touch from",
        "a touch that begins and ends within a step: least depth that is seen, over |a| T^2 / 8; "
        "below 0, an impact is seen where there is no touch",
        smallest_touch,
        lambda depth: abs(depth) > 1e-6,
        ".2f",
    ),
    Failure(
        "graze at",
        "h = 0.1, R = 0.8, omega = 3.0383: time of the first impact, a touch at t = 2.8308",
        first_graze,
        lambda t: abs(t - GRAZE_TIME) > 2.0 * math.pi / (GRAZE.omega * STEPS),
        ".4f",
    ),
    Failure(
        "energy",
        "f = 0, h = 0, R = 1, T = 2 pi / 101.37: share of the energy after 100 impacts",
        energy,
        lambda share: abs(share - 1.0) > 0.005,
        ".3g",
    ),
    Failure(
        "impacts",
        "fully dissipative case of the paper: impacts in 20 periods, of which there are 80",
        impacts,
        lambda count: count != PAPER_IMPACTS,
        ".0f",
    ),
    Failure(
        "slowest",
        "the same: speed of the slowest impact, which is 0.0365",
        slowest_impact,
        lambda speed: abs(speed - PAPER_SLOWEST) > 0.05 * PAPER_SLOWEST,
        ".4f",
    ),
    Failure(
        "astray",
        "h = 0.02, R = 0.8, omega = 1.3, two attractors: of 64 starts, those that end on the other",
        wrong_attractor,
        lambda count: count > 0,
        ".0f",
    ),
    Failure(
        "p T = pi",
        "h = 0, R = 0.8, omega = 0.5 at 4 steps per period: greatest speed in 400 periods, which "
        "is 1.62; inf: overflow",
        greatest_speed,
        lambda speed: speed > 1.5 * 1.62,
        ".3g",
    ),
)


def measure(methods: Sequence[Method] = METHODS) -> Mapping[tuple[Method, str], float]:
    """Return every figure, by method and name of the failure."""
    return {
        (method, failure.name): failure.measure(method)
        for method in methods
        for failure in FAILURES
    }
