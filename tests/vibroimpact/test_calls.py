"""Python calls the compiled code of orbits in one form; each further one would be compiled anew."""

from vibroimpact import Oscillator, bifurcation_curve, branch
from vibroimpact.orbits.branches import doubled_branch, grazing_branch
from vibroimpact.orbits.calls import _do
from vibroimpact.orbits.one_impact import one_impact_orbits
from vibroimpact.orbits.periodic import periodic_orbit

RANGE = "omega", 1.56, 4.16


def test_all_that_python_asks_of_orbits_is_compiled_once():
    osc = Oscillator(h=0.02, R=0.6, omega=2.6, f=1.0, clearance=0.3)
    orbit = next(orbit for orbit in one_impact_orbits(osc, 2) if orbit.exists)
    assert periodic_orbit(osc, *orbit.sections()[0], m=2).q == 1
    special = branch(orbit, *RANGE).special
    assert [point.kind for point in special] == ["graze", "fold", "flip", "graze"]
    for point in special:
        assert bifurcation_curve(point.orbit, point.kind, RANGE, ("R", 0.5, 0.9)).special
        follow = {"flip": doubled_branch, "graze": grazing_branch}.get(point.kind)
        if follow:
            assert follow(point.orbit, *RANGE).special
    assert len(_do.overloads) == 1
