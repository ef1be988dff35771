"""General solvers with events, for comparison: SciPy, and heyoka with the extra ``peers``.

They are used as their users would use them. Neither of them knows rests, so a complete chatter
would never end for them.
"""

from __future__ import annotations

import importlib.util
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sweeps.bench.method_scenes import EXACT_METHOD, Scene, least_steps
from vibroimpact import integrate
from vibroimpact.oscillator import with_one_force

#: Runs are repeated for at least this time, at least once.
_LEAST_SECONDS = 0.1


class SolverFlight(NamedTuple):
    """A motion computed by a solver: its last state, and times and speeds of its impacts."""

    x: float
    v: float
    impact_t: list[float]
    impact_v: list[float]


#: (point, x, v, t, end) -> Flight: follows one oscillator from the state (x, v) at t.
Follow = Callable[[Any, float, float, float, float], SolverFlight]


def solve_ivp(method: str, tolerance: float) -> Follow:
    """Return SciPy's `solve_ivp` with a terminal event, restarted after every impact."""
    from scipy.integrate import solve_ivp

    def follow(point: Any, x: float, v: float, t: float, end: float) -> SolverFlight:
        h, R, omega, f, p, stop = (float(point[name]) for name in list(point.dtype.names)[:6])
        impact_t: list[float] = []
        impact_v: list[float] = []

        def rates(t: float, y: np.ndarray) -> tuple[float, float]:
            return y[1], -2.0 * h * y[1] - p * p * y[0] - f * math.sin(omega * t)

        def stopped(t: float, y: np.ndarray) -> float:
            return y[0] - stop

        stopped.terminal, stopped.direction = True, 1.0  # type: ignore[attr-defined]
        while t < end:
            solution = solve_ivp(
                rates,
                (t, end),
                (x, v),
                method=method,
                rtol=tolerance,
                atol=1e-2 * tolerance,
                events=stopped,
            )
            t, (x, v) = solution.t[-1], solution.y[:, -1]
            if solution.status == 1:
                impact_t.append(t)
                impact_v.append(v)
                # Start below the stop, so that the root at the launch is not found again.
                x, v = stop - 1e-13, -R * v
        return SolverFlight(x, v, impact_t, impact_v)

    return follow


def heyoka(tolerance: float) -> Follow:
    """Return heyoka's adaptive Taylor integrator with an event whose callback is the impact."""
    import heyoka as hy

    x, v = hy.make_vars("x", "v")
    h, omega, f, p, stop = (hy.par[i] for i in range(5))
    impacts: list[tuple[float, float]] = []
    restitution = 1.0

    def impact(integrator: Any, _: int) -> bool:
        impacts.append((integrator.time, integrator.state[1]))
        integrator.state[:] = integrator.pars[4], -restitution * integrator.state[1]
        return True

    event = hy.t_event(x - stop, callback=impact, direction=hy.event_direction.positive)
    integrator = hy.taylor_adaptive(
        [(x, v), (v, -2.0 * h * v - p * p * x - f * hy.sin(omega * hy.time))],
        [0.0, 0.0],
        t_events=[event],
        tol=tolerance,
        pars=[0.0] * 5,
    )

    def follow(point: Any, x: float, v: float, t: float, end: float) -> SolverFlight:
        nonlocal restitution
        restitution = float(point["R"])
        impacts.clear()
        integrator.pars[:] = [point[name] for name in ("h", "omega", "f", "p", "clearance")]
        integrator.reset_cooldowns()
        integrator.time = t
        integrator.state[:] = x, v
        integrator.propagate_until(end)
        x, v = integrator.state
        return SolverFlight(x, v, [time for time, _ in impacts], [speed for _, speed in impacts])

    return follow


@dataclass(frozen=True)
class Peer:
    """A solver for comparison."""

    name: str
    #: Returns, for a relative tolerance, the function that follows a motion.
    prepare: Callable[[float], Follow]
    module: str  # the module that must be installed

    @property
    def installed(self) -> bool:
        """Whether the solver can be run here."""
        return importlib.util.find_spec(self.module) is not None

    def run(self, scene: Scene, tolerance: float) -> tuple[dict[str, np.ndarray], float]:
        """Run the points of a scene from omega t = 2 pi to its section; return results and seconds.

        The results are those of `Scene.run`, without the deepest penetration. The seconds are per
        forcing period, the best of several runs, without the preparation.
        """
        points = with_one_force(scene.points)
        first = integrate(
            points,
            steps_per_period=2 * least_steps(EXACT_METHOD, points),
            transient=0,
            periods=1,
        )
        begin = 2.0 * math.pi / points["omega"]
        end = (scene.phase + 2.0 * math.pi * scene.periods) / points["omega"]
        periods = scene.periods - 1 + scene.phase / (2.0 * math.pi)
        x, v = first["poincare_x"][:, 0], first["poincare_v"][:, 0]
        arguments = list(zip(points, x, v, begin, end, strict=True))
        follow = self.prepare(tolerance)
        spent, best = 0.0, math.inf
        flights: list[SolverFlight] = []
        while spent < _LEAST_SECONDS:
            began = time.perf_counter()
            flights = [follow(*start) for start in arguments]
            seconds = time.perf_counter() - began
            spent, best = spent + seconds, min(best, seconds)
        return _as_results(points, flights), best / (len(points) * periods)


def _as_results(points: np.ndarray, flights: list[SolverFlight]) -> dict[str, np.ndarray]:
    """Name the results as `vibroimpact.integrate` does, with the last eight impacts."""
    last = np.full((len(points), 8, 2), np.nan)
    for row, omega, flight in zip(last, points["omega"], flights, strict=True):
        n = min(len(flight.impact_t), len(row))
        if n:
            row[:n, 0] = np.mod(omega * np.array(flight.impact_t[-n:]), 2.0 * math.pi)
            row[:n, 1] = flight.impact_v[-n:]
    return {
        "poincare_x": np.array([[flight.x] for flight in flights]),
        "poincare_v": np.array([[flight.v] for flight in flights]),
        "impact_phase": last[:, :, 0],
        "impact_v": last[:, :, 1],
        "max_penetration": np.full(len(points), np.nan),
    }


#: The solvers by name.
PEERS: Mapping[str, Peer] = {
    peer.name: peer
    for peer in (
        Peer("SciPy RK45", lambda tolerance: solve_ivp("RK45", tolerance), "scipy"),
        Peer("SciPy DOP853", lambda tolerance: solve_ivp("DOP853", tolerance), "scipy"),
        Peer("heyoka", heyoka, "heyoka"),
    )
}
