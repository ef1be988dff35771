"""Refinement: bifurcations bracketed by a coarse sweep, and the file of such a sweep."""

import math
from pathlib import Path

import naive
import numpy as np
import pytest
import xarray as xr
from scipy.optimize import brentq

from commands import accepted, refused
from sweep_files import load, run_in
from sweeps import bifurcations, load_config, open_sweep, run_sweep
from sweeps.analysis.regimes import cascades, changes, labels
from sweeps.engine.compute import compute
from sweeps.engine.refine import Classifier, Refinement
from sweeps.grid import Grid
from sweeps.store import sweep_writer
from vibroimpact.orbits.one_impact import one_impact_orbit
from vibroimpact.oscillator import Oscillator, mesh
from vibroimpact.status import Evidence
from vibroimpact.trajectory import simulate
from written_files import WIDTHS, results, schema

CONFIG = """\
name: around a flip
oscillator: {h: 0.0, R: 0.8, omega: {start: 2.6, stop: 2.7, num: 21}, f: 1.0}
record: {transient: 300, periods: 100, impacts: 8, diagnostics: [period, lyapunov]}
refine: {axis: omega, levels: 17}
"""


def refined(folder, *overrides, text=CONFIG, name="out.h5", **options):
    return run_in(folder, text, *overrides, name=name, **options)


def found(path):
    with open_sweep(path) as dataset:
        return list(changes(dataset["omega"].values, labels(dataset.load())))


def flip(n, low, high, R=0.8):
    """Return where cos^2(pi n / omega) (omega^2 - ((1 - R) / (1 + R))^2) = 1 (h = 0, p = 1)."""
    loss = ((1.0 - R) / (1.0 + R)) ** 2
    return brentq(
        lambda w: math.cos(math.pi * n / w) ** 2 * (w * w - loss) - 1.0, low, high, xtol=1e-15
    )


@pytest.fixture(scope="module")
def around(tmp_path_factory):
    """Return the file of a sweep that is refined around a flip."""
    return refined(tmp_path_factory.mktemp("around"))


@pytest.fixture(scope="module")
def cascade(tmp_path_factory):
    """Return the file of a sweep that is refined around a cascade of flips."""
    config = load_config(Path(__file__).parents[2] / "configs/feigenbaum.yaml")
    return run_sweep(config, tmp_path_factory.mktemp("cascade") / "out.h5")


def on_section(osc):
    """Return the state of the orbit with one impact per period at the phase 0."""
    orbit = one_impact_orbit(osc)
    return naive.after_impact(osc, 1, orbit.v, orbit.phase, 0.0)


@pytest.mark.slow
def test_a_flip_is_bracketed_to_the_last_level(around):
    """The grid's interval is 0.005; no run of these lengths settles within 1e-3 of the flip."""
    below, first = found(around)[:2]
    assert (str(below.before), str(below.after)) == ("6/6", "1/1")  # the zero start reaches it
    assert (str(first.before), str(first.after), first.kind) == ("1/1", "2/2", "flip")
    assert first.low < flip(1, 2.6, 2.7) < first.high
    assert first.high - first.low == pytest.approx(0.005 / 2**17, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("axis", "changes", "width"),
    [
        ([2.652, 2.657], ["refine.levels=40"], 4e-9),
        ([2.64, 2.66], ["refine.levels=22", "record.phase=2.0"], 1e-8),
    ],
)
def test_a_bracket_holds_the_flip_however_narrow_and_at_any_phase(tmp_path, axis, changes, width):
    """1e-9 from it no multiplier is inside the unit circle by more than rounding."""
    path = refined(tmp_path, f"oscillator.omega={axis}", *changes)
    (first,) = found(path)
    assert first.low - 1e-14 < flip(1, 2.6, 2.7) < first.high + 1e-14
    assert first.high - first.low < width


@pytest.mark.slow
def test_a_point_of_the_grid_that_has_not_left_an_unstable_orbit_has_no_class(tmp_path):
    """The start is the unstable orbit just beyond the flip: its record repeats after one period."""
    omega = flip(1, 2.6, 2.7) + 1e-7
    osc = Oscillator(h=0.0, R=0.8, omega=omega, f=1.0)
    ((x0, v0),) = on_section(osc).tolist()
    common = (f"oscillator.omega=[{omega}, 2.66]", f"start={{x0: {x0}, v0: {v0}}}")
    plain = refined(tmp_path, *common, "refine=null", name="plain.h5")
    path = refined(tmp_path, *common, "refine.levels=1")
    with open_sweep(plain) as grid, open_sweep(path) as dataset:
        assert grid["period"].values.tolist() == dataset["period"].values.tolist() == [0, 2]
        assert np.ptp(grid["poincare_x"].values[0]) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(
    ("direction", "axis"),
    [("up", [1.2, 1.4, 1.6, 1.8]), ("down", [*np.linspace(1.27, 1.4, 27).tolist(), 1.6, 1.8])],
)
def test_new_points_start_from_the_neighbour_before_them(tmp_path, direction, axis):
    """Down, the free motion ends where its amplitude is the clearance; up, the one with impacts.

    Between, both exist: 1.2861 and 1.6504. Down, the grid's last step, of 0.005, may kick the free
    motion out of its basin before the graze: the bracket is then that of the kick.
    """
    h, clearance = 0.05, 1.5
    path = refined(
        tmp_path,
        f"oscillator={{h: {h}, R: 0.8, clearance: {clearance}, f: 1.0, omega: {axis}}}",
        f"follow={{axis: omega, direction: {direction}}}",
        "refine.levels=10",
    )
    graze = brentq(lambda w: clearance**2 * ((1 - w * w) ** 2 + (2 * h * w) ** 2) - 1.0, 1.1, 1.5)
    (end,) = [one for one in found(path) if (one.before.q > 0) != (one.after.q > 0)]
    exact, kick = {"up": (1.6504, 1e-4), "down": (graze, 0.005)}[direction]
    assert end.low - kick < exact < end.high + 1e-4
    assert end.high - end.low < 1e-3


BESIDE_ANOTHER = (
    "oscillator={h: 0.01, R: 0.9, clearance: 0.3, f: 1.0, omega: [0.6918947, 0.7008220]}",
    "record={transient: 50, periods: 20, diagnostics: [period, lyapunov]}",
)


@pytest.mark.slow
def test_a_motion_that_passes_a_coexisting_orbit_is_not_taken_for_it(tmp_path):
    """If a new point is called periodic, a long run from the same start ends on that motion."""
    path = refined(tmp_path, *BESIDE_ANOTHER, "refine.levels=3")
    with open_sweep(path) as dataset:
        periodic = dataset.isel(omega=np.flatnonzero(dataset["period"] > 0))
        assert periodic.sizes["omega"] < dataset.sizes["omega"]
        for omega in periodic["omega"].values.tolist():
            osc = Oscillator(h=0.01, R=0.9, omega=omega, f=1.0, clearance=0.3)
            ends = simulate(osc, 3000).section_x[-1]
            x = periodic["poincare_x"].sel(omega=omega).values
            assert np.abs(x - ends).min() < 1e-6


def test_without_a_transient_motions_are_followed_longer_too():
    config = load(CONFIG, "record.transient=0")
    (point,) = Classifier(config).compute(np.array([2.64]))
    assert str(point.label) == "1/1"


@pytest.mark.slow
def test_no_point_is_put_beside_one_of_the_grid(tmp_path):
    """If the class is unknown between two values, their middle is on the grid."""
    axis = "{start: 0.6740400525929372, stop: 0.830268176902766, num: 36}"
    path = refined(tmp_path, *BESIDE_ANOTHER, f"oscillator.omega={axis}", "refine.levels=1")
    plain = refined(
        tmp_path, *BESIDE_ANOTHER, f"oscillator.omega={axis}", "refine=null", name="plain.h5"
    )
    with open_sweep(path) as dataset, open_sweep(plain) as grid:
        omega = dataset["omega"].values
        assert np.isin(grid["omega"], omega).all()
        assert np.diff(omega).min() > 1e-3
        unknown = dataset.isel(omega=[label is None for label in labels(dataset.load())])
        for point in unknown["omega"].values[np.isin(unknown["omega"], grid["omega"])]:
            assert np.array_equal(
                unknown["poincare_x"].sel(omega=point), grid["poincare_x"].sel(omega=point)
            )


def test_where_the_stop_has_moved_past_the_neighbour_a_new_point_starts_on_it():
    """Like the points of the grid, see test_follow.py; chaos does not forget its start."""
    text = CONFIG.replace("{start: 2.6, stop: 2.7, num: 21}", "2.8")
    config = load(text, "refine.axis=clearance", "oscillator.clearance=[0.0, 0.1]")
    starts = np.array([[0.04, -1.0], [0.0, -1.0], [-0.01, -1.0]])
    beyond, on, below = Classifier(config).compute(np.zeros(3), starts)
    assert str(beyond.label) == "chaos"
    assert beyond.results["poincare_x"].tobytes() == on.results["poincare_x"].tobytes()
    assert beyond.results["poincare_x"][0] != below.results["poincare_x"][0]


def test_a_point_that_starts_at_the_section_is_not_scaled():
    """One f represents the others only for starts at rest."""
    text = CONFIG.replace("f: 1.0", "f: [1.0, 3.0]").replace(
        "{start: 2.6, stop: 2.7, num: 21}", "2.8"
    )
    config = load(text, "refine=null", "record.transient=0")
    points = mesh({"f": np.array([3.0])}, config.sweep.grid.fixed)
    points["x0"], points["v0"] = -0.5, 1.0
    results = compute(config.sweep.spec, points, None, at_section=True)
    run = simulate(Oscillator(h=0.0, R=0.8, omega=2.8, f=3.0), 100, x0=-0.5, v0=1.0)
    assert results["poincare_x"][0].tobytes() == run.section_x.tobytes()


def test_what_shooting_finds_is_told_where_the_record_is_too_short_to_show_it():
    """The start is the unstable orbit of one period, just beyond its flip."""
    omega = flip(1, 2.6, 2.7) + 1e-7
    osc = Oscillator(h=0.0, R=0.8, omega=omega, f=1.0)
    config = load(CONFIG, "record.periods=3", "record.diagnostics=[period]")
    start = on_section(osc)
    (point,) = Classifier(config).compute(np.array([omega]), start)
    assert str(point.label) == "2/2"
    assert (point.results["period"], point.results["period_impacts"]) == (2, 2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("n", "axis", "direction", "near"),
    [
        (2, "{start: 3.33, stop: 3.73, num: 21}", "down", (3.3, 3.4)),
        (3, "{start: 6.5, stop: 6.66, num: 9}", "up", (6.6, 6.7)),
    ],
)
def test_the_edges_of_the_windows_are_found_from_a_followed_sweep(
    tmp_path, n, axis, direction, near
):
    """The zero start leads to another motion near the lower edges."""
    path = refined(
        tmp_path,
        f"oscillator.omega={axis}",
        f"follow={{axis: omega, direction: {direction}}}",
        "refine.levels=12",
    )
    edges = [one for one in found(path) if "/1" in f"{one.before} {one.after}"]
    (edge,) = [
        one for one in edges if one.kind == "flip" and f"{n}/1" in (str(one.before), str(one.after))
    ]
    assert edge.low < flip(n, *near) < edge.high
    assert edge.high - edge.low < 1e-5


@pytest.mark.slow
def test_further_flips_of_a_cascade(cascade):
    """Their distances shrink by ratios that approach Feigenbaum's 4.669."""
    (run,) = cascades(found(cascade))
    assert [str(one.before) for one in run][:3] == ["1/1", "2/2", "4/4"]
    assert all(one.high - one.low < 1e-6 for one in run[:3])
    # Where the least multiplier of the orbits is -1, far enough from it to be told otherwise.
    for one, exact in zip(run, (flip(1, 2.6, 2.7), 2.71598725144, 2.72911791816), strict=False):
        assert one.low < exact < one.high
    first, second, third = (0.5 * (change.low + change.high) for change in run[:3])
    assert 4.4 < (second - first) / (third - second) < 5.2


@pytest.mark.slow
def test_the_border_of_two_basins_is_bracketed_to_rounding(tmp_path):
    """At the border of two basins every motion goes to one of the two attractors."""
    path = refined(tmp_path, "oscillator.omega=[2.69, 2.695]", "refine.levels=52")
    first = found(path)[0]
    assert first.low < first.high < first.low + 1e-11


@pytest.mark.slow
def test_what_happens_at_a_graze_is_resolved(tmp_path):
    """The one-impact orbit touches the stop again at 1.11292970401963, and is none below.

    From one impact to two in a period it is not a single step, but all within 2e-4 of the graze: on
    the grid of 0.025 there is one interval.
    """
    path = refined(
        tmp_path,
        "oscillator={h: 0.1, R: 0.5, omega: {start: 1.0, stop: 1.2, num: 9}, f: 1.0}",
        "refine.levels=16",
    )
    graze = 1.11292970401963
    first, *_, last = found(path)
    assert (str(first.before), str(last.after)) == ("1/2", "1/1")
    assert graze - 2e-4 < first.low < graze < last.high < graze + 2e-4
    with open_sweep(path) as dataset:
        alone = (dataset["period"] == 1) & (dataset["period_impacts"] == 1)
        assert dataset["omega"].values[alone.values].min() > graze


def test_of_too_many_changes_the_lowest_are_followed_and_the_others_counted(tmp_path, monkeypatch):
    monkeypatch.setattr("sweeps.engine.refine.MOST_INTERVALS", 1)
    config = load(CONFIG, "oscillator.omega={start: 2.6, stop: 2.8, num: 21}", "refine.levels=3")
    with open_sweep(
        refined(tmp_path, "oscillator.omega={start: 2.6, stop: 2.8, num: 21}", "refine=null")
    ) as grid:
        refinement = Refinement(config, grid)
        assert refinement.left_out > 0
        assert list(refinement) == [1, 2, 3]
    assert len(refinement.intervals) == 1
    assert 2.6 <= refinement.intervals[0][0].value < 2.605  # 6/6 becomes 1/1


# Refused requests


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["refine.axis=omga"], "refine.axis = omga is unknown (did you mean omega?)"),
        (["refine.axis=R"], "R must be the only swept axis, but these are swept: omega"),
        (["oscillator.R=[0.7, 0.8]"], "these are swept: R, omega"),
        (["oscillator.omega=2.0"], "these are swept: none"),
        (["oscillator.omega=[2.0]"], "two or more values of it, in increasing order"),
        (["oscillator.omega=[2.1, 2.0]"], "two or more values of it, in increasing order"),
        (["refine.levels=0"], "refine.levels = 0 is not allowed; expected: how often"),
        (["refine.levels=53"], "an integer from 1 to 52"),
        (["refine.around=everything"], "refine.around = everything is not allowed"),
        (["refine.lvls=3"], "unknown key refine.lvls (did you mean levels?)"),
        (["refine={axis: omega}"], "refine.levels is missing"),
        (["record.diagnostics=[lyapunov]"], "record.diagnostics: [period]"),
        (["record.trajectory={every: 5}"], "cannot be recorded with refine"),
        (["method={integrator: rk4, impact: cubic}"], "the impact rule exact, not cubic"),
        (["follow={axis: omega, direction: both}"], "expected: up or down, or no refine"),
    ],
)
def test_what_cannot_be_refined_is_refused(overrides, said):
    options = [part for override in overrides for part in ("--set", override)]
    assert said in refused("run", "sweep.yaml", *options, "--dry-run")


# The file


@pytest.mark.slow
def test_the_grid_keeps_its_data_and_the_new_points_are_told(around, tmp_path):
    plain = refined(tmp_path, "refine=null")
    with open_sweep(around) as dataset, open_sweep(plain) as grid:
        omega = dataset["omega"].values
        assert (np.diff(omega) > 0.0).all() and np.isin(grid["omega"], omega).all()
        assert dataset.attrs["points_added"] == len(omega) - 21
        beside = {one.low for one in found(around)} | {one.high for one in found(around)}
        kept = [w for w in grid["omega"].values if w not in beside]
        for name in grid.data_vars:
            same = dataset[name].sel(omega=kept).values
            assert np.array_equal(same, grid[name].sel(omega=kept).values, equal_nan=True)
    with xr.open_dataset(around, engine="h5netcdf") as dataset:
        assert dataset["poincare_x"].dims == ("omega", "section")
        assert (dataset["status"] == 1).all()


def test_a_new_point_records_the_attractor(around):
    """1e-8 from the flip a transient would have to be 1e8 periods long."""
    first = found(around)[1]
    with open_sweep(around) as dataset:
        for value, m in ((first.low, 1), (first.high, 2)):
            point = dataset.sel(omega=value)
            x = point["poincare_x"].values
            assert point["period"] == m
            assert np.abs(x[m:] - x[:-m]).max() < 1e-10


@pytest.mark.slow
def test_resume_ends_with_the_same_data(around, tmp_path, monkeypatch):
    """Also if the run was interrupted between the grid and its refinement."""

    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr("sweeps.engine.refine.Refinement", interrupted)
        refined(tmp_path)
    with open_sweep(tmp_path / "out.h5") as dataset:
        assert dataset.sizes["omega"] == 21 and (dataset["status"] != -1).all()
    for _ in range(2):  # the second run has nothing to do
        path = refined(tmp_path, resume=True, threads=1)
        with open_sweep(path) as again, open_sweep(around) as first:
            assert again.drop_attrs().identical(first.drop_attrs())
            for name in first.variables:
                assert again[name].values.tobytes() == first[name].values.tobytes()


def test_points_before_and_behind_all_others_are_added_too(tmp_path):
    """By the writer, in a sweep of several blocks; one replaces a point of the grid."""
    grid = Grid({"omega": np.linspace(1.0, 2.0, 5)}, {})
    widths = {**WIDTHS, "sample": 0}
    plan = schema(grid, block_size=2, widths=widths)
    added = {
        value: {
            name: array[0] for name, array in results((slice(i, i + 1),), widths=widths).items()
        }
        for i, value in enumerate([0.5, 1.1, 1.3, 1.45, 1.5, 3.0, 2.5], 100)
    }
    points = dict(added)
    with sweep_writer(tmp_path / "out.h5", plan) as store:
        for block in store.pending():
            given = results(block, widths=widths)
            store.write(block, given)
            for i, value in enumerate(grid.axes["omega"][block].tolist()):
                points.setdefault(value, {name: array[i] for name, array in given.items()})
        store.finish(added, compressed=True)
    with open_sweep(tmp_path / "out.h5") as dataset:
        assert dataset.attrs["points_added"] == 6
        assert dataset["omega"].values.tolist() == sorted(points)
        for name in dataset.data_vars:
            expected = [points[value][name] for value in sorted(points)]
            np.testing.assert_array_equal(dataset[name].values, expected)


# Messages


@pytest.mark.slow
def test_every_class_of_a_refined_file_has_its_orbit(cascade):
    """Also beside a flip, where no motion was shown to reach the orbit that was recorded."""
    with open_sweep(cascade) as dataset:
        known = dataset["period"].values > 0
        assert (dataset["class_evidence"].values[known] > Evidence.UNREACHED).all()
        x, v = dataset["orbit_x"].values[known], dataset["orbit_v"].values[known]
        assert np.isfinite([x, v]).all() and (dataset["orbit_distance"].values[known] < 1e-2).all()
        flips = bifurcations(dataset)["value"].dropna()
    exact = flip(1, 2.6, 2.7), 2.71598725144, 2.72911791816
    np.testing.assert_allclose(flips, exact, rtol=1e-11)


@pytest.mark.slow
def test_info_lists_the_brackets(cascade):
    lines = accepted("info", cascade, "--bifurcations").splitlines()
    assert lines[0].split() == ["omega", "kind", "classes", "between"]
    value, *classes = lines[1].split()[:5]
    assert classes == ["flip", "1/1", "->", "2/2"]
    assert float(value) == pytest.approx(flip(1, 2.6, 2.7), rel=1e-11)
    (ratios,) = (line for line in lines if line.startswith("cascade: omega = 2.653347"))
    assert "ratios of the distances 4." in ratios


def test_the_plan_says_that_points_are_added():
    plan = accepted("run", "sweep.yaml", "-o", "out.h5", "--dry-run")
    assert "where the class of the motion changes, halved 17 times" in plan
