"""The paper's literal procedure: what it does, where it stalls, and the order it loses."""

import math

import naive
import numpy as np
import pytest

from vibroimpact import Oscillator, paper_procedure, simulate

CASES = {"paper_A": (0.5, 1.0), "paper_B": (0.0, 0.5), "paper_C": (0.5, 0.5)}


def paper_case(name):
    """The oscillator of one of the paper's three cases."""
    h, R = CASES[name]
    return Oscillator(h=h, R=R, omega=1.0, f=1.0)


@pytest.mark.parametrize(
    ("h", "R", "omega"), [(0.5, 1.0, 1.0), (0.0, 0.5, 1.0), (0.1, 0.6, 2.2), (2.0, 0.7, 1.3)]
)
def test_the_procedure_is_equations_6_to_10(h, R, omega):
    """Every impact is that of the slow implementation, which solves Newmark as linear equations."""
    run = paper_procedure(Oscillator(h=h, R=R, omega=omega, f=1.0), 4, 100)
    impacts, stalled = naive.literal(naive.oscillator(h, R, omega), 4, 100)
    assert run.stalled_at is stalled is None
    assert len(impacts) >= 3
    np.testing.assert_allclose(run.impact_t, impacts[:, 0], rtol=1e-10)
    np.testing.assert_allclose(run.impact_v, impacts[:, 1], rtol=1e-9)


@pytest.mark.parametrize("name", CASES)
def test_without_the_procedure_it_is_the_plain_rule(name):
    """The same orbit as `simulate` and as the slow implementation, step by step."""
    run = paper_procedure(paper_case(name), 5, 100, procedure=False)
    tr = simulate(paper_case(name), 5, "newmark", "plain", 100)
    _, impacts = naive.plain(naive.oscillator(*CASES[name], 1.0), naive.newmark_step, 5, 100)
    for ours in (tr, run):
        np.testing.assert_allclose(ours.impact_t, impacts[:, 0], rtol=1e-12)
        np.testing.assert_allclose(ours.impact_v, impacts[:, 1], atol=1e-11)
    assert run.max_penetration == pytest.approx(tr.max_penetration, rel=1e-9)


@pytest.mark.parametrize("name", CASES)
def test_the_procedure_suppresses_the_penetration(name):
    """The paper's claim: displacements beyond the stop with the plain step, none with it."""
    without = paper_procedure(paper_case(name), 10, 100, procedure=False)
    assert 0.01 < without.max_penetration < without.impact_v.max() * 2 * math.pi / 100
    assert without.x.max() == without.max_penetration
    assert paper_procedure(paper_case(name), 10, 100).max_penetration == 0.0


@pytest.mark.parametrize("procedure", [True, False])
def test_both_sides_of_an_impact_are_recorded(procedure):
    """Two rows with the same time; the second on the stop with the velocity turned."""
    run = paper_procedure(paper_case("paper_B"), 5, 100, procedure=procedure)
    assert (np.diff(run.t) >= 0.0).all()
    before = np.flatnonzero(np.diff(run.t) == 0.0)
    np.testing.assert_array_equal(run.t[before], run.impact_t)
    np.testing.assert_array_equal(run.v[before], run.impact_v)
    np.testing.assert_array_equal(run.v[before + 1], -0.5 * run.impact_v)
    np.testing.assert_array_equal(run.x[before + 1], 0.0)
    assert run.t[-1] >= 5 * 2 * math.pi - 1e-9


@pytest.mark.parametrize(("n", "at"), [(100, 12.11), (10_000, 12.4103)])
def test_the_procedure_stalls_before_the_accumulation(truth, n, at):
    """T_r = 0 for ever, at known times, never past the accumulation of the chatter."""
    orbit = truth["stick_R03_w03"]
    run = paper_procedure(orbit.oscillator, 2, n)
    assert run.stalled_at == pytest.approx(at, abs=0.006 if n == 100 else 6e-5)
    assert run.t[-1] == run.stalled_at


def test_the_procedure_never_passes_the_accumulation(truth):
    """At no step count; and the kernel, on the same oscillator, always does."""
    orbit = truth["stick_R03_w03"]
    for n in (10, 20, 37, 50, 100, 200, 400, 1000, 3000):
        stalled = paper_procedure(orbit.oscillator, 2, n).stalled_at
        assert stalled is not None
        assert stalled < orbit.rests[0, 0]
        assert simulate(orbit.oscillator, 2, "newmark", "reduced-step", n).section_x.shape == (2,)


def test_a_stall_where_nothing_rests():
    """h = 0.5, R = 0.95, omega = 0.4: on a coarse step time stops though no mass ever rests."""
    osc = Oscillator(h=0.5, R=0.95, omega=0.4, f=1.0)
    stalled = paper_procedure(osc, 3, 10).stalled_at
    _, expected = naive.literal(naive.oscillator(0.5, 0.95, 0.4), 3, 10)
    assert stalled == pytest.approx(expected, rel=1e-9)


def order_of_the_first_impacts(impacts_of, orbit, count=6):
    """Fitted order of the first impacts' times and speeds, RMS over spread step counts."""
    steps = (100, 200, 400, 800)
    errors = []
    for n in steps:
        squares = []
        for m in np.round(n * np.linspace(1.0, 1.6, 8)).astype(int):
            impacts = impacts_of(int(m))[:count]
            squares.append((impacts[:, 0] - orbit.impact_t[:count]) ** 2)
            squares.append((impacts[:, 1] - orbit.impact_v[:count]) ** 2)
        errors.append(np.sqrt(np.mean(squares)))
    return -np.polyfit(np.log(steps), np.log(errors), 1)[0]


@pytest.mark.parametrize(("name", "order"), [("paper_A", 1), ("paper_B", 2)])
def test_carrying_the_acceleration_over_the_impact_costs_an_order_where_h_acts(truth, name, order):
    """Eq. (10) is the acceleration before the impact; 2 h v jumps there, and only h = 0 is spared.

    With eq. (1) asked again after the impact the slow implementation is of second order in both.
    """
    osc = paper_case(name)
    slow = naive.oscillator(*CASES[name], 1.0)

    def literal(n):
        run = paper_procedure(osc, 3, n)
        return np.column_stack([run.impact_t, run.impact_v])

    def asked_again(n):
        return naive.literal(slow, 3, n, carry=False)[0]

    assert order_of_the_first_impacts(literal, truth[name]) == pytest.approx(order, abs=0.25)
    assert order_of_the_first_impacts(asked_again, truth[name]) == pytest.approx(2, abs=0.25)


def test_a_stop_elsewhere_is_refused():
    """The paper has its stop at 0."""
    with pytest.raises(ValueError, match=r"not at 0\.5"):
        paper_procedure(Oscillator(h=0.1, R=0.5, omega=1.0, f=1.0, clearance=0.5))
