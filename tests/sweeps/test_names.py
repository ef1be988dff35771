"""The names of the packages that other programs use."""

import inspect

import numpy as np
import pytest

import sweeps
import vibroimpact

PHYSICS = (
    "POINT OrbitError Oscillator PeriodicOrbit Status bifurcation_curve branch integrate "
    "one_impact_orbit periodic_orbit simulate __version__"
)
ENGINE = (
    "ConfigError Failed Refused StoreError attractors branches curves explore integrity knocks "
    "load_config open_sweep run_sweep __version__"
)


@pytest.mark.parametrize(("package", "names"), [(vibroimpact, PHYSICS), (sweeps, ENGINE)])
def test_every_name_is_there_and_documented(package, names):
    for name in names.split():
        assert name in package.__all__ or name == "__version__"
        one = getattr(package, name)
        assert not inspect.isroutine(one) or "Returns\n" in one.__doc__


def test_points_are_a_structured_array():
    points = np.zeros(2, vibroimpact.POINT)
    points["omega"] = points["p"] = 1.0
    assert vibroimpact.integrate(points, transient=0, periods=3)["poincare_x"].shape == (2, 3)
