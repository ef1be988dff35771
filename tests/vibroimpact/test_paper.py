"""The paper's procedure taken literally: its equations, and the rule without it.

How large the failures of time stepping are, the tests of the bench `stability` measure.
"""

import math

import numpy as np
import pytest

from tests.helpers import naive
from vibroimpact import Oscillator, paper_procedure, simulate


@pytest.mark.parametrize(
    ("h", "R", "omega", "n", "stalls"),
    [
        (0.5, 1.0, 1.0, 100, False),
        (0.0, 0.5, 1.0, 100, False),
        (0.1, 0.6, 2.2, 100, False),
        (2.0, 0.7, 1.3, 100, False),
        (0.5, 0.95, 0.4, 10, True),  # on a coarse step, though no mass ever rests
    ],
)
def test_the_procedure_is_equations_6_to_10(h, R, omega, n, stalls):
    """Every impact equals the slow implementation, which solves Newmark as linear equations."""
    run = paper_procedure(Oscillator(h=h, R=R, omega=omega, f=1.0), 4, n)
    impacts, stalled = naive.literal(naive.oscillator(h, R, omega), 4, n)
    assert (run.stalled_at is not None) == (stalled is not None) == stalls
    assert not stalls or run.stalled_at == pytest.approx(stalled, rel=1e-9)
    assert len(impacts) >= (2 if stalls else 3)
    np.testing.assert_allclose(run.impact_t, impacts[:, 0], rtol=1e-10)
    np.testing.assert_allclose(run.impact_v, impacts[:, 1], rtol=1e-9)


@pytest.mark.parametrize(("h", "R"), [(0.5, 1.0), (0.0, 0.5), (0.5, 0.5)])
def test_without_the_procedure_it_is_the_plain_rule(h, R):
    osc = Oscillator(h=h, R=R, omega=1.0, f=1.0)
    run = paper_procedure(osc, 5, 100, procedure=False)
    tr = simulate(osc, 5, "newmark", "plain", 100)
    np.testing.assert_allclose(run.impact_t, tr.impact_t, rtol=1e-12)
    np.testing.assert_allclose(run.impact_v, tr.impact_v, atol=1e-11)
    assert run.max_penetration == pytest.approx(tr.max_penetration, rel=1e-9)


@pytest.mark.parametrize("procedure", [True, False])
def test_both_sides_of_an_impact_are_recorded(procedure):
    """Two rows with the same time; the second on the stop with the velocity turned."""
    osc = Oscillator(h=0.0, R=0.5, omega=1.0, f=1.0)
    run = paper_procedure(osc, 5, 100, procedure=procedure)
    assert (np.diff(run.t) >= 0.0).all()
    before = np.flatnonzero(np.diff(run.t) == 0.0)
    np.testing.assert_array_equal(run.t[before], run.impact_t)
    np.testing.assert_array_equal(run.v[before], run.impact_v)
    np.testing.assert_array_equal(run.v[before + 1], -0.5 * run.impact_v)
    np.testing.assert_array_equal(run.x[before + 1], 0.0)
    assert run.t[-1] >= 5 * 2 * math.pi - 1e-9


def test_a_stop_elsewhere_is_refused():
    """The paper has its stop at 0."""
    with pytest.raises(ValueError, match=r"not at 0\.5"):
        paper_procedure(Oscillator(h=0.1, R=0.5, omega=1.0, f=1.0, clearance=0.5))
