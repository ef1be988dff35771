import math
from dataclasses import replace

import numpy as np
import pytest

from vibroimpact.integrate import integrate
from vibroimpact.orbits.one_impact import one_impact_orbit
from vibroimpact.orbits.one_impact_branches import one_impact_branches, sections
from vibroimpact.oscillator import Oscillator

LIGHT = Oscillator(h=0.05, R=0.8, omega=2.0, f=1.0)
AHEAD = Oscillator(h=0.1, R=0.8, omega=1.0, f=1.0, clearance=1.0)


def ends(branches, stable):
    return [(p.values[0], p.values[-1]) for p in branches.pieces if p.stable == stable]


@pytest.mark.parametrize(
    ("h", "R", "n", "flips"),
    [
        (0.0, 0.8, 1, (1.260677, 2.653348)),
        (0.0, 0.8, 2, (3.353178, 4.641837)),
        (0.0, 0.8, 3, (5.359488, 6.639142)),
        (0.0, 0.5, 1, (1.195148, 2.658152)),
        (0.05, 0.8, 1, (1.22973534658679, 2.65888454668484)),
        (0.05, 0.8, 2, (3.33809052026845, 4.64512198413259)),
    ],
)
def test_a_branch_is_stable_between_its_known_flips(h, R, n, flips):
    values = np.linspace(0.8, 7.0, 100)
    found = one_impact_branches(replace(LIGHT, h=h, R=R), "omega", values, n)
    tolerance = 1e-13 if h else 1e-6
    located = [mark.value for mark in found.marks if mark.kind == "flip"]
    assert located[-2:] == pytest.approx(flips, abs=tolerance)
    assert ends(found, True)[-1] == tuple(located[-2:])
    # The unstable pieces end and begin where the stable one begins and ends: no gap at a flip.
    assert [high for _, high in ends(found, False)][-2] == located[-2]
    assert [low for low, _ in ends(found, False)][-1] == located[-1]
    if h == 0.0:  # every flip, also a further one at a lower frequency, is on the exact curve
        rate, k = np.array(located), math.pi * n / np.array(located)
        curve = np.cos(k) ** 2 * (rate**2 - ((1.0 - R) / (1.0 + R)) ** 2)
        np.testing.assert_allclose(curve, 1.0, rtol=1e-11)


def test_a_branch_ends_in_its_known_graze():
    values = np.linspace(0.9, 1.1, 30)
    found = one_impact_branches(LIGHT, "omega", values)
    (graze,) = [mark for mark in found.marks if mark.kind == "graze"]
    assert graze.value == pytest.approx(1.01658832780028, abs=1e-12)
    assert min(piece.values[0] for piece in found.pieces) == graze.value
    assert abs(graze.orbit.peak) < 1e-9


def test_a_branch_with_a_clearance_has_a_fold_and_ends_without_impact():
    """The two orbits meet in the fold; v = 0 where f / sqrt(D) = clearance, at omega = 1.4.

    (1 - omega^2)^2 + 0.04 omega^2 = 1 is omega^2 = 1.96.
    """
    found = one_impact_branches(AHEAD, "omega", np.linspace(1.2, 2.0, 40))
    (node,), (saddle,) = ends(found, True), ends(found, False)
    (fold,) = [mark.value for mark in found.marks if mark.kind == "fold"]
    (touch,) = [mark.value for mark in found.marks if mark.kind == "graze"]
    assert touch == pytest.approx(1.4, abs=1e-14)
    assert node == (1.2, fold) and saddle == (touch, fold)
    speeds = [p.orbits[-1].v for p in found.pieces]
    assert speeds[0] == pytest.approx(speeds[1], rel=1e-3)
    assert next(p for p in found.pieces if not p.stable).orbits[0].v < 1e-3


def test_the_values_decide_nothing_but_where_the_branch_is_sampled():
    coarse, fine = (
        one_impact_branches(LIGHT, "omega", np.linspace(1.0, 3.0, num)) for num in (20, 57)
    )
    for one, other in zip(coarse.marks, fine.marks, strict=True):
        assert one.kind == other.kind
        assert one.value == pytest.approx(other.value, rel=1e-13)


def test_without_an_orbit_there_is_no_branch():
    found = one_impact_branches(LIGHT, "omega", np.linspace(2.4, 3.5, 10), 4)
    assert found.pieces == () and found.marks == ()


@pytest.mark.parametrize("n", [1, 2])
@pytest.mark.parametrize("phase", [0.0, 1.0, 5.0])
def test_sections_are_those_that_the_kernel_computes(n, phase):
    osc = replace(LIGHT, omega={1: 2.3, 2: 4.1}[n])
    orbit = one_impact_orbit(osc, n)
    assert orbit.stable
    expected = sections(osc, orbit, phase)
    run = integrate(osc.at(), transient=600, periods=2 * n, phase=phase)
    found = np.column_stack([run["poincare_x"][0], run["poincare_v"][0]])
    shifts = [np.abs(np.roll(found, k, axis=0)[:n] - expected).max() for k in range(n)]
    assert min(shifts) < 1e-12


def test_a_section_at_the_impact_is_the_state_after_it():
    orbit = one_impact_orbit(LIGHT)
    ((x, v),) = sections(LIGHT, orbit, orbit.phase)
    assert (x, v) == (0.0, -LIGHT.R * orbit.v)
    ((x, v),) = sections(LIGHT, orbit, (orbit.phase - 1e-9) % (2 * math.pi))
    assert x == pytest.approx(0.0, abs=1e-8) and v == pytest.approx(orbit.v, abs=1e-8)
