import numpy as np
import pytest
import xarray as xr

from sweeps import bifurcations
from sweeps.bifurcation.bifurcation_report import cascades
from sweeps.bifurcation.bifurcation_table import Change, changes_of_class
from sweeps.opened.motions import run_on
from sweeps.opened.opened_sweep import OpenedSweep
from tests.helpers import naive
from tests.helpers.commands import accepted
from tests.helpers.sweep_files import swept
from vibroimpact import integrate
from vibroimpact.points.regimes import Label, Regime, is_chaotic, labels_of
from vibroimpact.status import Evidence, Status

PERIODS = 100
OMEGA = 2.0
DURATION = PERIODS * 2 * np.pi / OMEGA


def given_points(status, period, rest=0.0, growth=None):
    """Return points along R with this growth of tangent vectors over the record."""
    n = len(np.atleast_1d(status))
    evidence = np.where(np.asarray(period) > 0, Evidence.REPEATS, Evidence.NONE)
    fill = {"status": status, "period": period, "class_evidence": evidence, "rest_fraction": rest}
    values = {name: ("R", np.broadcast_to(value, n)) for name, value in fill.items()}
    values["poincare_x"] = (("R", "section"), np.zeros((n, PERIODS)))
    if growth is not None:
        exponents = np.stack([np.asarray(growth) / DURATION, np.full(n, -5.0)], axis=1)
        values["lyapunov"] = (("R", "exponent"), exponents)
    oscillator = "oscillator: {h: 0, R: 1, omega: 2, f: 1}\n"
    attributes = {"configuration": f"{oscillator}record: {{periods: {PERIODS}}}"}
    return xr.Dataset(values, {"R": np.linspace(0, 1, n), "omega": OMEGA}, attributes)


def test_the_status_decides_first():
    """Even if the remaining numbers suggest another regime."""
    dataset = given_points(list(Status), period=1, rest=0.5)
    expected = [Regime.PENDING, *3 * [Regime.REST], Regime.UNBOUNDED, *2 * [Regime.FAILED]]
    assert OpenedSweep(dataset).regimes.tolist() == expected


def test_a_repetition_decides_before_the_exponent():
    sweep = OpenedSweep(given_points([1, 1], [3, 0], growth=[50.0, 50.0]))
    assert sweep.regimes.tolist() == [Regime.PERIODIC, Regime.CHAOTIC]


def test_the_exponent_decides_by_the_growth_that_a_torus_allows():
    """Linear growth over the record is the factor 100."""
    growth = [-np.inf, np.log(0.0099), np.log(0.0101), 0.0, np.log(99.0), np.log(101.0)]
    motion = [Regime.UNKNOWN] * 5 + [Regime.CHAOTIC]
    dataset = given_points(np.ones(6), 0, growth=growth)
    for kept in (dataset, dataset.isel(section=slice(-8, None))):
        assert OpenedSweep(kept).regimes.tolist() == motion
    assert [bool(is_chaotic(np.ones(2), np.ones(1), periods)) for periods in (31, 32)] == [0, 1]


@pytest.mark.parametrize("periods", [1, 3, 10])
def test_a_short_record_shows_no_chaos(periods):
    """Tangent vectors of stable motions on their way grow as fast in so few periods."""
    scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": {"start": 2.6, "stop": 2.9, "num": 61}}}
    scene["record"] = {"transient": 30, "periods": periods, "diagnostics": ["period", "lyapunov"]}
    scene["oscillator"]["f"] = 1.0
    assert Regime.CHAOTIC not in OpenedSweep(swept(scene)).regimes
    said = "; Lyapunov exponents of 32 or more periods tell which are chaotic"
    assert accepted("info", "swept.h5", "--bifurcations").count(said) == 1
    assert accepted("info", "swept.h5").count(said) == 1


def test_without_an_exponent_nothing_is_said_of_what_does_not_repeat():
    assert OpenedSweep(given_points([1, 0, 2], 0)).regimes.tolist() == [Regime.UNKNOWN] * 3


def test_the_shape_is_that_of_the_grid_in_any_order():
    omega = np.array([1.0, 2.0, 4.0])
    one = given_points([1, 1], 0, growth=[0.0, 0.0]).drop_vars("lyapunov")
    both = one.drop_vars("omega").expand_dims(omega=omega).transpose("R", "omega", ...)
    # The same exponent is a growth that falls with omega: 2 pi k / omega of time.
    rate = np.full((2, 3, 2), 1.5 * np.log(PERIODS) / DURATION)
    both["lyapunov"] = (("R", "omega", "exponent"), rate)
    expected = [Regime.CHAOTIC, Regime.CHAOTIC, Regime.UNKNOWN]
    assert OpenedSweep(both).regimes.tolist() == [expected, expected]
    turned = both.transpose("omega", "R", ...)
    assert OpenedSweep(turned).regimes.tolist() == np.transpose([expected, expected]).tolist()


#: A preload, with which rests repeat after 1, 3 and 6 periods.
PRELOADED = {"h": 0.0, "R": 0.5, "omega": [0.5, 3.9, 4.5], "f": 1.0, "clearance": -0.2}


def slow_period(omega):
    """Return after how many periods a slow solver, by many small steps, is where it was."""
    osc = naive.oscillator(0.0, 0.5, omega, clearance=-0.2)
    states, _ = naive.plain(osc, naive.rk4_step, 22, 400, x=-0.2)
    sections = states[399::400][8:]
    return next(m for m in range(1, 8) if np.abs(sections[m:] - sections[:-m]).max() < 1e-12)


@pytest.mark.slow
def test_the_state_of_a_motion_is_that_of_its_orbit_at_the_section():
    """Not at the phase of the start: from there, other attractors are linked along an axis.

    From there `run_on` continues it, whatever the phase of its point.
    """
    start = "start: {x0: -1.5, phase: 0}\nrecord: {transient: 400, periods: 32, phase: 4}\n"
    oscillator = "oscillator: {h: 0.05, R: 0.8, omega: [2.4, 2.6], f: 1.0}\n"
    sweep = OpenedSweep(swept(oscillator + start))
    motions = sweep.motions
    sections = integrate(motions["point"], transient=1, periods=4, phase=4.0)["poincare_x"]
    assert motions["m"].tolist() == motions["q"].tolist() == [1, 1]
    np.testing.assert_allclose(sections[:, 1], motions["point"]["x0"], rtol=1e-9)
    motions["point"]["phase"] = 0.0
    sections, _ = run_on(sweep.spec, motions["point"], 2)
    np.testing.assert_allclose(sections[:, 1, 0], motions["point"]["x0"], rtol=1e-9)


def test_a_rest_is_named_after_its_periods():
    """The motions start on the stop."""
    assert [slow_period(omega) for omega in PRELOADED["omega"]] == [1, 3, 6]
    expected = ["rest, 1 period", "rest, 3 periods", "rest, 6 periods"]
    record = {"transient": 100, "periods": 40}
    scene = {"oscillator": PRELOADED, "start": {"x0": -0.2}, "record": record}
    exact = swept(scene)
    assert [*map(str, OpenedSweep(exact).labels)] == expected
    listed = bifurcations(exact)[["before", "after"]].values.tolist()
    assert [expected[:2], expected[1:]] == listed
    steps = swept({**scene, "method": {"integrator": "rk4", "impact": "cubic"}})
    assert [*map(str, OpenedSweep(steps).labels)] == expected


@pytest.mark.parametrize("impact", ["cubic", "reduced-step"])
def test_a_rest_before_the_motion_repeats_is_not_in_its_name(impact):
    """The mass starts on the stop, which presses until the force releases it, and never rests."""
    dataset = swept({
        "oscillator": {"h": 0.1, "R": 0.6, "omega": [1.6, 2.0, 2.4], "f": 1.0, "clearance": -0.2},
        "start": {"x0": -0.2},
        "method": {"integrator": "rk4", "impact": impact},
        "record": {"transient": 0, "periods": 200},
    })  # fmt: skip
    assert (dataset["rest_fraction"] > 0.0).all()
    assert (dataset["class_evidence"] == Evidence.RELEASED).all()
    assert [*map(str, OpenedSweep(dataset).labels)] == ["1/1"] * 3


@pytest.mark.parametrize(("R", "name"), [([0.0, 0.5], "rest, 3 periods"), ([0.0], "rest 3/2")])
def test_no_change_of_class_is_seen_where_rests_no_longer_have_a_number_of_impacts(R, name):
    """Only with R = 0 is that number known."""
    of_each = np.full(len(R), 3), np.full(len(R), 2), np.array(R)
    labels = labels_of(np.full(len(R), Regime.REST), *of_each)
    assert {*map(str, labels)} == {name}


ONE, TWO, FOUR, EIGHT = (Label(Regime.PERIODIC, m, m) for m in (1, 2, 4, 8))
REST, CHAOS = Label(Regime.REST), Label(Regime.CHAOTIC)


def test_points_of_no_known_class_are_passed_over():
    given = [ONE, None, None, ONE, None, TWO, CHAOS]
    changes = [Change(3.0, 5.0, ONE, TWO, between=1), Change(5.0, 6.0, TWO, CHAOS)]
    assert list(changes_of_class(np.arange(7.0), given)) == changes


@pytest.mark.parametrize(
    ("before", "after", "kind"),
    [
        (ONE, TWO, "flip"),
        (FOUR, TWO, "flip"),
        (Label(Regime.PERIODIC, 2, 3), Label(Regime.PERIODIC, 2, 4), "unknown"),
        (ONE, FOUR, "unknown"),
        (Label(Regime.PERIODIC, 2, 3), Label(Regime.PERIODIC, 4, 7), "unknown"),
        (ONE, REST, "rest"),
        (CHAOS, REST, "rest"),
        (CHAOS, TWO, "chaotic"),
        (Label(Regime.REST, 2, 2), Label(Regime.REST, 2, 1), "unknown"),
        (Label(Regime.REST, 1, 1), Label(Regime.REST, 2, 2), "unknown"),
        (Label(Regime.REST, 1, 1), ONE, "rest"),
    ],
)
def test_kinds_of_change(before, after, kind):
    assert Change(0.0, 1.0, before, after).kind == kind


def test_cascades_run_both_ways_and_break_where_a_flip_is_missing():
    up = [(1.0, ONE, TWO), (2.0, TWO, FOUR), (2.5, FOUR, EIGHT)]
    down = [(4.0, EIGHT, FOUR), (5.0, FOUR, TWO), (7.0, TWO, ONE)]
    assert list(cascades(up)) == [[1.0, 2.0, 2.5]]
    assert list(cascades(down)) == [[7.0, 5.0, 4.0]]
    chaos = [(3.0, EIGHT, CHAOS), (3.5, CHAOS, EIGHT)]
    assert list(cascades([*up, *chaos, *down])) == [[1.0, 2.0, 2.5], [7.0, 5.0, 4.0]]
    assert list(cascades([up[0], up[2]])) == []
