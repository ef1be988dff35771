"""Scenes of the comparison, the errors of a run, and other solvers.

A scene is not a single point but 64 neighbours of it: this fills whole blocks of lanes, as in a
sweep, and impacts fall on different places within a step. A scene may also be 64 points of a sweep.
Errors are root mean squares over these points, against the rule ``exact``, and are dimensionless:
displacements, speeds and times are divided by V / omega, V and 2 pi / omega. V is the speed of the
fastest true impact of the point, or a speed of its section if it has no impact.

They are used as their users would use them. Neither of them knows rests, so a complete chatter
would never end for them.
"""

from __future__ import annotations

import importlib.util
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from sweeps.config.sweep import SweepConfig
from sweeps.errors import Refused
from sweeps.opened.motions import section_distance
from vibroimpact import Oscillator, Status, integrate
from vibroimpact.oscillator import with_one_force
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.scheme import IMPACT_RULES, default_steps

#: Number of points in a scene, neighbours of one point.
NEIGHBOURS = 64
#: Number of last impacts of a run that are kept, to find the counterparts of the true impacts.
_KEPT = 8

#: The kinds of errors of an orbit, as in the pictures.
ORBIT_ERRORS = ("section state", "impact time", "impact speed", "deepest penetration")


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
        kept: int = _KEPT,
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
            np.stack([of["poincare_x"][:n, -1], of["poincare_v"][:n, -1]], axis=1)
            for of in (run, truth)
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


#: Runs are repeated for at least this time, at least once.
_LEAST_SECONDS = 0.1

#: Last state (x, v) of a motion computed by a solver, and times and speeds of its impacts.
Motion = tuple[float, float, list[tuple[float, float]]]
#: (point, x, v, t, end) -> Motion: follows one oscillator from the state (x, v) at t.
Follow = Callable[[Any, float, float, float, float], Motion]


def _scipy(method: str, tolerance: float) -> Follow:
    """Return SciPy's `solve_ivp` with a terminal event, restarted after every impact."""
    from scipy.integrate import solve_ivp

    def follow(point: Any, x: float, v: float, t: float, end: float) -> Motion:
        h, R, omega, f, p, stop = (float(point[name]) for name in list(point.dtype.names)[:6])
        impacts = []

        def rates(t: float, y: np.ndarray) -> tuple[float, float]:
            return y[1], -2.0 * h * y[1] - p * p * y[0] - f * math.sin(omega * t)

        def stopped(t: float, y: np.ndarray) -> float:
            return y[0] - stop

        stopped.terminal, stopped.direction = True, 1.0  # type: ignore[attr-defined]
        options = {"rtol": tolerance, "atol": 1e-2 * tolerance, "events": stopped}
        while t < end:
            solution = solve_ivp(rates, (t, end), (x, v), method, **options)
            t, (x, v) = solution.t[-1], solution.y[:, -1]
            if solution.status == 1:
                impacts.append((t, v))
                # Start below the stop, so that the root at the launch is not found again.
                x, v = stop - 1e-13, -R * v
        return x, v, impacts

    return follow


def _heyoka(tolerance: float) -> Follow:
    """Return heyoka's adaptive Taylor integrator with an event whose callback is the impact."""
    import heyoka as hy

    x, v = hy.make_vars("x", "v")
    names = ("h", "omega", "f", "p", "clearance")
    h, omega, f, p, stop = (hy.par[i] for i in range(len(names)))
    impacts: list[tuple[float, float]] = []
    restitution = 1.0

    def impact(integrator: Any, _: int) -> bool:
        impacts.append((integrator.time, integrator.state[1]))
        integrator.state[:] = integrator.pars[4], -restitution * integrator.state[1]
        return True

    integrator = hy.taylor_adaptive(
        [(x, v), (v, -2.0 * h * v - p * p * x - f * hy.sin(omega * hy.time))],
        [0.0, 0.0],
        t_events=[hy.t_event(x - stop, callback=impact, direction=hy.event_direction.positive)],
        tol=tolerance,
        pars=[0.0] * len(names),
    )

    def follow(point: Any, x: float, v: float, t: float, end: float) -> Motion:
        nonlocal restitution
        restitution = float(point["R"])
        impacts.clear()
        integrator.pars[:] = [point[name] for name in names]
        integrator.reset_cooldowns()
        integrator.time = t
        integrator.state[:] = x, v
        integrator.propagate_until(end)
        return *integrator.state, impacts.copy()

    return follow


#: Solvers by name: the module they need, and what follows a motion for a relative tolerance.
PEERS: Mapping[str, tuple[str, Callable[[float], Follow]]] = {
    "SciPy RK45": ("scipy", partial(_scipy, "RK45")),
    "SciPy DOP853": ("scipy", partial(_scipy, "DOP853")),
    "heyoka": ("heyoka", _heyoka),
}


def installed(peer: str) -> bool:
    """Whether a solver can be run here."""
    return importlib.util.find_spec(PEERS[peer][0]) is not None


def run_peer(peer: str, scene: Scene, tolerance: float) -> tuple[dict[str, np.ndarray], float]:
    """Run the points of a scene from omega t = 2 pi to its section; return results and seconds.

    The results are those of `Scene.run`, with NaN as the deepest penetration. The seconds are per
    forcing period, the best of several runs, without the preparation.
    """
    points = with_one_force(scene.points)
    first = integrate(
        points, steps_per_period=2 * least_steps(EXACT_METHOD, points), transient=0, periods=1
    )
    begin = 2.0 * math.pi / points["omega"]
    end = (scene.phase + 2.0 * math.pi * scene.periods) / points["omega"]
    periods = scene.periods - 1 + scene.phase / (2.0 * math.pi)
    x, v = first["poincare_x"][:, 0], first["poincare_v"][:, 0]
    starts = list(zip(points, x, v, begin, end, strict=True))
    follow = PEERS[peer][1](tolerance)
    spent, best = 0.0, math.inf
    while spent < _LEAST_SECONDS:
        began = time.perf_counter()
        motions = [follow(*start) for start in starts]
        seconds = time.perf_counter() - began
        spent, best = spent + seconds, min(best, seconds)
    last = np.full((len(points), _KEPT, 2), np.nan)
    for row, (_, _, impacts) in zip(last, motions, strict=True):
        row[: len(impacts)] = np.reshape(impacts[-_KEPT:], (-1, 2))
    results = {
        "poincare_x": np.array([[x] for x, _, _ in motions]),
        "poincare_v": np.array([[v] for _, v, _ in motions]),
        "impact_phase": np.mod(points["omega"][:, None] * last[:, :, 0], 2.0 * math.pi),
        "impact_v": last[:, :, 1],
        "max_penetration": np.full(len(points), np.nan),
    }
    return results, best / (len(points) * periods)
