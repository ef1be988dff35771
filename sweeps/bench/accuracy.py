"""Accuracy against speed, measured: `Scene`; error and cost of every `Method`.

A scene is not a single point but 64 neighbours of it: this fills whole blocks of lanes, as in a
sweep, and impacts fall on different places within a step. A scene may also be 64 points of a sweep.
Errors are root mean squares over these points, against the rule ``exact``, and are dimensionless:
displacements, speeds and times are divided by V / omega, V and 2 pi / omega. V is the speed of the
fastest true impact of the point, or a speed of its section if it has no impact.

All methods run interleaved, each round over all of them, so that a drift of the machine affects all
of them alike; the best time of the rounds counts. A rung n of the ladder stands for numbers of
steps from n to 1.1 n, a different number in every round, so that impacts fall on different places
within a step. Errors are root mean squares over the rounds.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from sweeps.bench.peers import IMPACTS_KEPT, PEERS, installed, run_peer
from sweeps.config.sweep import SweepConfig
from sweeps.errors import Refused
from sweeps.opened.motions import section_distance
from vibroimpact import Oscillator, Status, integrate
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.scheme import IMPACT_RULES, default_steps

#: Number of points in a scene, neighbours of one point.
NEIGHBOURS = 64
#: Least steps of a timed run, all points together; with fewer, mainly the call would be timed.
_LEAST_WORK = 1_500_000

#: The kinds of errors of an orbit, as in the pictures.
ORBIT_ERRORS = ("section state", "impact time", "impact speed", "deepest penetration")
STATE, PENETRATION = ORBIT_ERRORS[0], ORBIT_ERRORS[-1]
#: What stands for the impact rule of a peer.
EVENTS = "events"
#: The columns of the table of measurements; below, the types of those that may have no value.
MEASURED_COLUMNS = [
    "scene", "error_kind", "integrator", "impact", "steps_per_period", "tolerance", "error",
    "seconds_per_period",
]  # fmt: skip
_TYPES = {"steps_per_period": "Int64", "tolerance": float, "error": float}


class Method(NamedTuple):
    """An integrator and an impact rule, by their names."""

    integrator: str
    impact: str


EXACT_METHOD = Method("exact", "exact")
METHODS = tuple(
    Method(integrator, rule)
    for rule in IMPACT_RULES
    for integrator in INTEGRATORS
    if rule != EXACT_METHOD.impact or integrator == EXACT_METHOD.integrator
)


@dataclass(frozen=True, eq=False)
class Scene:
    """A motion on which methods are compared."""

    name: str
    points: np.ndarray  # dtype ``POINT``
    periods: int  # forcing periods from the start to the section
    phase: float = 0.0  # omega t of the section; no impact is near it
    impacts: int = 0  # number of the last true impacts that are compared
    recorded: int = 1  # forcing periods before the section that contain these impacts
    at_section: bool = False  # whether the points start at a section instead of at t = 0
    timed: int | None = None  # forcing periods of a timed run, if those to the section are too few

    def run(
        self,
        method: Method,
        steps: int,
        threads: int | None = None,
        copies: int = 1,
        kept: int = IMPACTS_KEPT,
        periods: int | None = None,
    ) -> dict[str, np.ndarray]:
        """Run all points, `copies` times over, with one method; results as of `integrate`."""
        return integrate(
            np.tile(self.points, copies),
            **method._asdict(),
            steps_per_period=steps,
            transient=(periods or self.periods) - self.recorded,
            periods=self.recorded,
            phase=self.phase,
            at_section=self.at_section,
            impacts=kept,
            threads=threads,
        )

    def truth(self) -> dict[str, np.ndarray]:
        """Run all points with exact impacts, on their own steps; results as of `integrate`."""
        return self.run(EXACT_METHOD, 2 * least_steps(EXACT_METHOD, self.points), kept=self.impacts)

    def errors(
        self, truth: Mapping[str, np.ndarray], run: Mapping[str, np.ndarray]
    ) -> dict[str, float]:
        """Return the RMS errors of a run by kind, with keys in ``ORBIT_ERRORS``.

        States are compared directly or through an impact. Every true impact is compared with the
        impact found at the nearest phase. If none was found, it counts as half a period late and as
        without speed. The section of a failed run has the error NaN. Errors of impacts are left out
        if there are no true impacts. Rows of further copies in the run are ignored.
        """
        n = len(self.points)
        R, omega, clearance = (self.points[name] for name in ("R", "omega", "clearance"))
        end, true_end = (
            np.stack([each["poincare_x"][:n, -1], each["poincare_v"][:n, -1]], axis=1)
            for each in (run, truth)
        )
        V = truth["fastest_impact"]
        V = np.where(V > 0.0, V, np.hypot(omega * true_end[:, 0], true_end[:, 1]))
        V = np.where(V > 0.0, V, 1.0)  # the point never moves
        units = np.stack([V / omega, V], axis=1)
        phase, v = truth["impact_phase"], truth["impact_v"]
        real = np.isfinite(phase)
        delay = run["impact_phase"][:n, None, :] - phase[:, :, None]
        delay = np.abs((delay + math.pi) % (2.0 * math.pi) - math.pi)
        delay = np.where(np.isnan(delay), math.pi, delay)
        nearest = delay.argmin(axis=2)
        found_v = np.nan_to_num(np.take_along_axis(run["impact_v"][:n], nearest, axis=1))
        with np.errstate(all="ignore"):
            values = (
                section_distance(end, true_end, clearance, R, units),
                delay.min(axis=2)[real] / (2.0 * math.pi),
                ((found_v - v) / V[:, None])[real],
                omega * run["max_penetration"][:n] / V,
            )
            return {
                kind: float(np.sqrt(np.mean(np.square(value))))
                for kind, value in zip(ORBIT_ERRORS, values, strict=True)
                if value.size
            }


def least_steps(method: Method, points: np.ndarray) -> int:
    """Return the fewest steps per forcing period that a method needs at these points."""
    return default_steps(points, "exact") if method.impact == EXACT_METHOD.impact else 1


_OFFSETS = np.linspace(-0.005, 0.005, NEIGHBOURS)
# The speed of an impact grows with the root of the distance from its graze; so most are small.
_GRAZE_OFFSETS = np.geomspace(1e-8, 1e-3, NEIGHBOURS // 2)
#: The omega at which the first flight from rest touches the stop (h = 0.1).
_GRAZE = 3.03833647460949767


def _scene(
    name: str, h: float, R: float, omega: float, offsets: np.ndarray = _OFFSETS, **options: Any
) -> Scene:
    """Return a scene whose points start at rest, with omega (1 + offset)."""
    points = Oscillator(h=h, R=R, omega=omega, f=1.0).at().repeat(offsets.size)
    points["omega"] *= 1.0 + offsets
    return Scene(name, points, **options)


#: Motions without rests and grazes, on which methods show their orders.
REGULAR = (
    _scene("conservative impacts", 0.5, 1.0, 1.0, periods=20, phase=math.pi, impacts=2),
    _scene("conservative motion", 0.0, 0.5, 1.0, periods=20, phase=math.pi, impacts=2),
    _scene("fully dissipative", 0.5, 0.5, 1.0, periods=20, phase=math.pi, impacts=4),
    _scene("one impact", 0.05, 0.7, 2.3, periods=40, impacts=1),
    _scene("high frequency", 0.1, 0.8, 10.0, periods=60, phase=math.pi, impacts=1, recorded=5),
)
# The section is after three impacts of a chatter that is complete at 4.78.
CHATTER_SCENE = _scene("chatter and rest", 0.05, 0.6, 0.4, periods=5, phase=4.4, impacts=3)
# The section is between the second impact, at 5.2 at the latest, and the third.
GRAZING = _scene(
    "near grazing", 0.1, 0.8, _GRAZE, np.concatenate([-_GRAZE_OFFSETS[::-1], _GRAZE_OFFSETS]),
    periods=1, phase=5.67, impacts=2,
)  # fmt: skip
SCENES = (*REGULAR, CHATTER_SCENE, GRAZING)


def of_sweep(config: SweepConfig) -> Scene:
    """Return points spread over a sweep, each from the state at the end of its record.

    They are followed for one forcing period: over a longer time the errors of chaotic motions would
    say nothing. Each point is computed from its own start. Raises Refused if no point can be
    computed with exact impacts.
    """
    points, spec = config.sweep.grid.spread(NEIGHBOURS), config.sweep.spec
    transient = spec.transient + spec.periods - 1
    try:
        last = integrate(points, transient=transient, periods=1, phase=spec.phase, impacts=0)
    except ValueError as error:
        raise Refused(str(error)) from error
    good = np.array([not Status(status).failed for status in last["status"]])
    if not good.any():
        raise Refused(f"{config.name} has no point that exact impacts can be found for")
    points["x0"], points["v0"] = last["poincare_x"][:, 0], last["poincare_v"][:, 0]
    return Scene(
        f"sweep {config.name}", points[good], 1, spec.phase, impacts=4, at_section=True, timed=20
    )


@dataclass(frozen=True)
class Plan:
    """How much is measured."""

    #: Steps per forcing period.
    ladder: tuple[int, ...] = (12, 25, 50, 100, 200, 400, 800, 1600, 3200)
    rounds: int = 4
    tolerances: tuple[float, ...] = (1e-3, 1e-6, 1e-9, 1e-12)  # relative tolerances of the peers
    thinning: int = 16  # only every such point of a scene is given to the peers
    scenes: tuple[Scene, ...] = SCENES
    methods: tuple[Method, ...] = METHODS
    peers: tuple[str, ...] = tuple(PEERS)


FULL = Plan()
QUICK = Plan(ladder=(25, 100, 400, 1600), rounds=2, tolerances=(1e-3, 1e-9), thinning=32)


def plan_for_sweep(config: SweepConfig, plan: Plan) -> Plan:
    """Return a plan for a sweep: without peers, and also with the fewest steps of exact impacts."""
    scene = of_sweep(config)
    ladder = {*plan.ladder, least_steps(EXACT_METHOD, scene.points)}
    return replace(plan, scenes=(scene,), ladder=tuple(sorted(ladder)), peers=())


def measure_methods(
    plan: Plan,
    threads: int | None = None,
    report: Callable[[float], object] = lambda share: None,
) -> pd.DataFrame:
    """Measure the errors and the cost of every method, a row for each error.

    The columns are ``scene``; ``error_kind``, as in `Scene.errors`; ``integrator`` and ``impact``,
    for a peer its name and ``events``; ``steps_per_period``, missing if the solver chooses them;
    ``tolerance``, only for a peer; ``error``, dimensionless, NaN or inf if the method failed; and
    ``seconds_per_period``, per forcing period. `threads` are those of the kernel; peers use one.
    `report` is given the share that is done.
    """
    runs = list(_runs(plan))
    rows: list[tuple] = []
    failed: set[tuple] = set()
    truths = {scene.name: scene.truth() for scene in plan.scenes}
    for done, (turn, scene, method, rung, tolerance) in enumerate(runs, 1):
        run = scene, method, rung
        if tolerance is not None:
            thinned = replace(scene, points=scene.points[:: plan.thinning])
            results, seconds = run_peer(
                method.integrator, thinned.points, scene.periods, scene.phase, tolerance
            )
            errors = thinned.errors(thinned.truth(), results)
            del errors[PENETRATION]  # the state between the steps of a peer is not compared
        elif rung is not None and run not in failed:  # a failed run might never end
            # The golden ratio spreads the rounds evenly.
            more = round(max(plan.rounds, 0.1 * rung) * (0.618034 * turn % 1.0))
            results, seconds = _timed(scene, method, rung + more, threads)
            errors = scene.errors(truths[scene.name], results)
            failed |= set() if np.isfinite([*errors.values()]).all() else {run}
        else:
            errors = {}
        rows += [
            (scene.name, kind, *method, rung, tolerance, error, seconds)
            for kind, error in errors.items()
        ]
        report(done / len(runs))
    rounds = pd.DataFrame(rows, columns=MEASURED_COLUMNS).astype(_TYPES)
    same = rounds.groupby(MEASURED_COLUMNS[:-2], sort=False, dropna=False)
    return same.agg({"error": _root_mean_square, "seconds_per_period": "min"}).reset_index()


def _root_mean_square(values: pd.Series) -> float:
    return float(np.sqrt(np.mean(values.to_numpy() ** 2)))  # NaN if a value is NaN


def _runs(plan: Plan) -> Iterator[tuple[int, Scene, Method, int | None, float | None]]:
    """Yield the round, scene, method, and rung or tolerance of every run, all methods in turn."""
    for turn in range(plan.rounds):
        for scene in plan.scenes:
            for rung in plan.ladder:
                for method in plan.methods:
                    if rung >= least_steps(method, scene.points):
                        yield turn, scene, method, rung, None
    for scene in plan.scenes:
        if scene is not CHATTER_SCENE and scene.impacts:
            for name in filter(installed, plan.peers):
                for tolerance in plan.tolerances:
                    yield 0, scene, Method(name, EVENTS), None, tolerance


def _timed(
    scene: Scene, method: Method, steps: int, threads: int | None
) -> tuple[dict[str, np.ndarray], float]:
    """Return the results of a method on a scene, and its seconds per forcing period."""
    periods = scene.timed or scene.periods
    copies = math.ceil(_LEAST_WORK / (len(scene.points) * periods * steps))
    began = time.perf_counter()
    results = scene.run(method, steps, threads, copies, periods=periods)
    seconds = (time.perf_counter() - began) / (len(scene.points) * copies * periods)
    if periods != scene.periods:
        results = scene.run(method, steps, threads)
    return results, seconds
