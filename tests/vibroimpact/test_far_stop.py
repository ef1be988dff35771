"""A stop so far from the rest position that x has few digits for the motion near it."""

import numpy as np
import pytest

from tests.vibroimpact.test_free_motions import found_of
from vibroimpact import Oscillator, Status, integrate, one_impact_orbits, simulate
from vibroimpact.points.regimes import is_chaotic
from vibroimpact.status import Evidence


def balls(p, R, gamma):
    """Return balls on a table with accelerations `gamma`, in units of gravity."""
    stop = -1.0 / p**2
    points = (
        Oscillator(h=0.0, R=R, omega=1.0, f=1.0, p=p, clearance=stop).at(stop).repeat(len(gamma))
    )
    points["f"], points["x0"] = gamma, stop - np.linspace(0.5, 3.0, len(gamma))
    return points


def test_chaos_that_rounding_makes_periodic_has_no_class():
    """At p = 1e-7, x is a multiple of 1/64 at the sections, and chaos comes back to the same."""
    gamma, periods = np.linspace(2.0, 20.0, 300), 512
    points = np.concatenate([balls(1e-7, R, gamma) for R in (0.4, 0.6, 0.65)])
    long = integrate(points, transient=500, periods=periods, lyapunov=True, impacts=0)
    chaotic = is_chaotic(long["lyapunov"], points["omega"], periods)  # some come to rest later
    last = integrate(points, transient=2000, periods=100, impacts=0)
    states = np.stack([last["poincare_x"], last["poincare_v"]], axis=2)
    came_back = (states[:, -65:-1] == states[:, -1:]).all(axis=2).any(axis=1)
    assert (chaotic & came_back & (last["chatters"] == 0)).sum() > 2
    out, _ = found_of(points, 2000, 100)
    chaotic &= out["rest_fraction"] == 0.0
    assert not out["period"][chaotic].any()
    assert (out["class_evidence"][chaotic] <= Evidence.UNSTABLE).all()
    assert (out["status"][chaotic] == Status.COMPUTED).all()


@pytest.mark.parametrize(("p", "status"), [(1e-3, 1), (1e-4, 1), (1e-5, 0), (1e-7, 0)])
def test_orbits_keep_their_class(p, status):
    """The ball jumps once a period, from beside its stable orbit on and from the unstable one."""
    osc = Oscillator(h=0.0, R=0.5, omega=1.0, f=1.3, p=p, clearance=-1.0 / p**2)
    unstable, stable = one_impact_orbits(osc)
    assert stable.stable and not unstable.stable
    x, v = stable.sections(0.0)[0]
    out, _ = found_of(osc.at(x - 0.1, v), 2000, 100)
    assert (out["period"], out["period_impacts"], out["status"]) == (1, 1, status)
    assert simulate(osc, 5, x0=x - 0.1, v0=v).status == status
    out, _ = found_of(osc.at(*unstable.sections(0.0)[0]), 0, 2)
    assert (out["period"], out["period_impacts"]) != (1, 1)
