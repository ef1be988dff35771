"""Other solvers on the scenes of the comparison: SciPy and heyoka.

They are used as their users would use them. Neither of them knows rests, so a complete chatter
would never end for them.
"""

from __future__ import annotations

import importlib.util
import math
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from vibroimpact import integrate
from vibroimpact.oscillator import with_one_force
from vibroimpact.step.scheme import default_steps

#: Number of last impacts of a run that are kept, to find the counterparts of the true impacts.
IMPACTS_KEPT = 8
#: Runs are repeated for at least this time, at least once.
_LEAST_SECONDS = 0.1

#: Last state (x, v) of a motion computed by a solver, and times and speeds of its impacts.
SolverMotion = tuple[float, float, list[tuple[float, float]]]
#: (point, x, v, t, end) -> SolverMotion: follows one oscillator from the state (x, v) at t.
Follow = Callable[[Any, float, float, float, float], SolverMotion]


def _scipy(method: str, tolerance: float) -> Follow:
    """Return SciPy's `solve_ivp` with a terminal event, restarted after every impact."""
    from scipy.integrate import solve_ivp

    def follow(point: Any, x: float, v: float, t: float, end: float) -> SolverMotion:
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

    def follow(point: Any, x: float, v: float, t: float, end: float) -> SolverMotion:
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


def run_peer(
    peer: str, points: np.ndarray, periods: int, phase: float, tolerance: float
) -> tuple[dict[str, np.ndarray], float]:
    """Run points from omega t = 2 pi to the section at `phase` after so many forcing periods.

    Returns results as of `integrate`, with NaN as the deepest penetration, and the seconds per
    forcing period: the best of several runs, without the preparation.
    """
    points = with_one_force(points)
    steps = 2 * default_steps(points, "exact")
    first = integrate(points, steps_per_period=steps, transient=0, periods=1)
    begin = 2.0 * math.pi / points["omega"]
    end = (phase + 2.0 * math.pi * periods) / points["omega"]
    x, v = first["poincare_x"][:, 0], first["poincare_v"][:, 0]
    starts = list(zip(points, x, v, begin, end, strict=True))
    follow = PEERS[peer][1](tolerance)
    spent, best = 0.0, math.inf
    while spent < _LEAST_SECONDS:
        began = time.perf_counter()
        motions = [follow(*start) for start in starts]
        seconds = time.perf_counter() - began
        spent, best = spent + seconds, min(best, seconds)
    last = np.full((len(points), IMPACTS_KEPT, 2), np.nan)
    for row, (_, _, impacts) in zip(last, motions, strict=True):
        row[: len(impacts)] = np.reshape(impacts[-IMPACTS_KEPT:], (-1, 2))
    results = {
        "poincare_x": np.array([[x] for x, _, _ in motions]),
        "poincare_v": np.array([[v] for _, v, _ in motions]),
        "impact_phase": np.mod(points["omega"][:, None] * last[:, :, 0], 2.0 * math.pi),
        "impact_v": last[:, :, 1],
        "max_penetration": np.full(len(points), np.nan),
    }
    return results, best / (len(points) * (periods - 1 + phase / (2.0 * math.pi)))
