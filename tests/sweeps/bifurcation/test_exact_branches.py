"""Branches of a sweep, sets of branches, and their points for a picture: against closed forms."""

import re
from collections import Counter
from dataclasses import replace
from operator import attrgetter

import numpy as np
import pandas as pd
import pytest

import sweeps
from sweeps import bifurcations, branches
from sweeps.bifurcation.branch_set import BranchSet, with_short_chords
from sweeps.errors import Refused
from sweeps.opened.export import branch_table, write_csv
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting import bifurcation, plot
from sweeps.plotting.exact_lines import branch_pieces
from sweeps.plotting.page import Page
from tests.helpers import naive, oscillators
from tests.helpers.equal_points import legend_texts
from tests.helpers.sweep_files import run_in, swept
from vibroimpact.orbits.branches import branch
from vibroimpact.orbits.one_impact import one_impact_orbit
from vibroimpact.orbits.periodic import periodic_orbit
from vibroimpact.oscillator import Oscillator
from vibroimpact.trajectory import simulate

pytestmark = pytest.mark.slow

CONFIG = """
name: beside the exact orbits
oscillator: {h: 0.05, R: [0.5, 0.8], omega: {start: 2.4, stop: 3.5, num: 45}, f: 1.0}
method: {integrator: exact, impact: exact}
record: {transient: 300, periods: 40, phase: 1.0, impacts: 20}
"""
FILES = {"later": CONFIG.replace("[0.5, 0.8]", "0.8").replace("phase: 1.0", "phase: 1.3")}
FLIPS = {1: 2.65888454668484, 2: 3.33809052026845}


@pytest.fixture(scope="module")
def found(dataset):
    """Return the first branches at R = 0.8."""
    return branches(dataset, at={"R": 0.8}, most=16)


@pytest.fixture(scope="module")
def later(loaded):
    """Return branches whose impact passes the section within the range, and their file."""
    return branches(loaded["later"], classes=[(1, 1), (2, 2)], most=8), loaded["later"]


def test_any_parameter_of_the_oscillator_can_be_the_axis():
    one = branches(swept(CONFIG, "oscillator.R=[0.6, 0.7, 0.8]", "oscillator.omega=2.5"), "R")
    assert one["R"].size > 3
    for R, v in zip(one["R"].values, one["impact_v"].values[:, 0], strict=True):
        expected = one_impact_orbit(Oscillator(h=0.05, R=R, omega=2.5, f=1.0)).v
        assert v == pytest.approx(expected, abs=1e-13)


def curves(figure, dashed):
    """Return the points of the exact branches in a diagram."""
    lines = [line for line in figure.axes[0].lines if line.get_zorder() == 4]
    chosen = [line for line in lines if (line.get_linestyle() == "--") == dashed]
    return np.concatenate([line.get_xydata() for line in chosen])


def test_the_diagram_shows_them_solid_where_stable(dataset, found):
    figure = bifurcation(dataset, at={"R": 0.8}, coordinate="impact_phase", exact=found)
    x = curves(figure, dashed=False)[:, 0]
    assert x.min() == 2.4 and x.max() == 3.5
    x = curves(figure, dashed=True)[:, 0]
    assert x.min() == pytest.approx(FLIPS[1], abs=1e-12)
    marks = {line.get_label(): line for line in figure.axes[0].lines if line.get_marker() == "o"}
    for flip in FLIPS.values():
        assert np.abs(marks["flip"].get_xdata() - flip).min() < 1e-12
    assert {"exact orbits, stable", "exact orbits, unstable"} <= {*legend_texts(figure)}


def test_the_limits_take_the_branches_in_and_the_legend_names_what_is_seen(dataset, found):
    """Where the points alone would leave the unstable branch out; and of a part of the axis."""
    plain = bifurcation(dataset, at={"R": 0.5}, coordinate="impact_v").axes[0]
    half = branches(dataset, "omega", {"R": 0.5}, classes=[(1, 1)], most=4)
    with_all = bifurcation(dataset, at={"R": 0.5}, coordinate="impact_v", exact=half)
    low, high = with_all.axes[0].get_ylim()
    y = np.concatenate([curves(with_all, dashed)[:, 1] for dashed in (False, True)])
    assert low <= y.min() and y.max() <= high
    assert low <= plain.get_ylim()[0] and plain.get_ylim()[1] <= high

    def named(**limits):
        page = Page(**limits)
        figure = bifurcation(dataset, at={"R": 0.8}, exact=found, page=page)
        return [text for text in legend_texts(figure) if not text.startswith("on its way")]

    assert {"exact orbits, stable", "exact orbits, unstable", "flip"} <= {*named()}
    assert named(xlim=(2.4, 2.6)) == ["exact orbits, stable"]
    oscillator = Oscillator(0.05, 0.8, 3.45, 1.0)
    orbit = one_impact_orbit(oscillator)
    ((x, _),) = naive.after_impact(oscillator, 1, orbit.v, orbit.phase, 1.0)
    assert named(xlim=(3.4, 3.5), ylim=(x - 0.02, x + 0.02)) == ["exact orbits, unstable"]


def test_a_line_breaks_where_the_phase_begins_anew(later):
    found, dataset = later
    figure = bifurcation(dataset, coordinate="poincare_v", exact=found)
    drawn = [line for line in figure.axes[0].lines if line.get_zorder() == 4]
    assert drawn
    for line in drawn:
        assert np.abs(np.diff(line.get_ydata(), axis=0)).max() < 0.5


def test_a_sweep_without_any_impact_has_the_free_oscillation_as_its_branch():
    """Its amplitude is that of the steady response; no impact is compared with it."""
    dataset = swept(CONFIG, "oscillator.R=0.5", "oscillator.clearance=2.0", "oscillator.h=0.3")
    assert not dataset["impacts_per_period"].any()
    found = branches(dataset, "omega")
    assert (found["m"] == 1).all() and (found["q"] == 0).all()
    omega = found["omega"].values
    x = (-np.exp(1j) / (1.0 - omega**2 + 0.6j * omega)).imag  # at the phase 1
    np.testing.assert_allclose(found["poincare_x"].values[:, 0], x, atol=1e-14)
    moduli = np.broadcast_to(np.exp(-0.6 * np.pi / omega)[:, None], (omega.size, 2))
    np.testing.assert_allclose(np.abs(found["multipliers"].values), moduli, rtol=1e-13)
    kinds = found["kind"].values
    assert found["stable"].values[kinds == ""].all()
    assert kinds[kinds != ""].tolist() == ["edge", "edge"]


def classes_of(found):
    """Return m and q of each branch."""
    first = np.unique(found["branch"].values, return_index=True)[1]
    return list(zip(found["m"].values[first], found["q"].values[first], strict=True))


def test_motions_of_the_file_are_followed_first_and_what_is_left_out_is_named(dataset):
    cut = OpenedSweep(dataset).cut({"R": 0.8}, free=["omega"]).data.load()
    m, q = cut["period"].values, cut["period_impacts"].values
    known = (m > 0) & (cut["rest_fraction"].values == 0.0)
    points = Counter(zip(m[known].tolist(), q[known].tolist(), strict=True))
    (first, _), (second, _), *others = points.most_common()
    found = branches(dataset, "omega", {"R": 0.8}, most=2)
    assert classes_of(found) == [first, second]
    said = next(line for line in found.attrs["summary"].split("\n") if "beyond the first 2" in line)
    for (periods, impacts), count in others:
        if periods <= 8:
            assert f"{periods}/{impacts} ({count} point" in said
    assert re.search(r"not followed: .*beyond the first 2 \(\d+\)", found.attrs["summary"])
    chosen = branches(dataset, "omega", {"R": 0.8}, classes=[(2, 2), (1, 1), (3, 5)], most=4)
    assert {*classes_of(chosen)} == {(1, 1), (2, 2)}
    assert "no orbit of 3/5 is found" in chosen.attrs["summary"]


def test_the_line_is_exact_between_its_points(later):
    """Its orbit in closed form is on it, also where the impact passes the section."""
    omegas = np.linspace(2.4, FLIPS[1], 500)[:-1]
    states = []
    for omega in omegas:
        oscillator = Oscillator(h=0.05, R=0.8, omega=omega, f=1.0)
        orbit = one_impact_orbit(oscillator)
        states += [*naive.after_impact(oscillator, 1, orbit.v, orbit.phase, 1.3)]
    for coordinate, exact in zip(("poincare_x", "poincare_v"), np.transpose(states), strict=True):
        lines = [p for p in branch_pieces(later[0], coordinate) if p.y.shape[1:] == (1,)]
        drawn = [
            np.interp(omegas, line.x, line.y[:, 0], left=np.nan, right=np.nan) for line in lines
        ]
        off = np.nanmin(np.abs(np.array(drawn) - exact), axis=0, initial=np.inf)
        off[np.isinf(off)] = 0.0
        extent = float(np.ptp(np.concatenate([line.y for line in lines])))
        assert 0.0 < max(off) < 2e-4 * extent
        assert sum(off == 0.0) < 3  # the gap at a jump is not wider


def test_the_branches_are_a_dataset_and_a_table(found, tmp_path):
    assert found.sizes["impact"] == found["q"].max()
    one = found.isel(point=(found["branch"].values == 0) & (found["kind"].values == ""))
    first = one.isel(impact=0)
    columns = (first[name].values for name in ("omega", "impact_v", "impact_phase", "stable"))
    for omega, v, phase, stable in zip(*columns, strict=True):
        closed = one_impact_orbit(Oscillator(h=0.05, R=0.8, omega=omega, f=1.0))
        assert v == pytest.approx(closed.v, abs=1e-13)
        assert np.cos(phase - closed.phase) == pytest.approx(1.0)
        assert stable == closed.stable or abs(omega - FLIPS[1]) < 1e-12
    flips = found.where(found["kind"] == "flip", drop=True)["omega"].values
    for flip in FLIPS.values():
        assert np.abs(flips - flip).min() < 1e-13
    for coordinate, record in (("poincare_v", "section"), ("impact_v", "impact")):
        path = tmp_path / f"{record}.csv"
        write_csv(path, [branch_table(found, coordinate)])
        rows = pd.read_csv(path)
        assert len(rows) == np.isfinite(found[coordinate]).sum()
        on_one = rows[(rows["branch"] == 0) & rows["kind"].isna()]
        assert on_one[record].eq(1).all()
        assert on_one["omega"].tolist() == one["omega"].values.tolist()
        assert on_one[coordinate].tolist() == one[coordinate].values[:, 0].tolist()
        if record == "impact":
            assert rows["impact_phase"].between(0.0, 2.0 * np.pi, inclusive="left").all()
            assert (found["impact_phase"] > 2.0 * np.pi).any()  # of a second period
        for row in on_one[::5].itertuples():
            closed = one_impact_orbit(Oscillator(h=0.05, R=0.8, omega=row.omega, f=1.0))
            multiplier = row.multiplier_1_real + 1j * row.multiplier_1_imag
            assert np.abs(closed.multipliers - multiplier).min() < 1e-9
        double = rows[(rows["m"] == 2) & (rows["q"] == 2)]
        assert double[record].tolist()[:4] == [1, 2, 1, 2]
        kinds = rows[rows["kind"].notna() & (rows[record] == 1)]["kind"]
        assert {"", *kinds} == {*found["kind"].values}


def test_the_last_rows_of_a_branch_are_as_stable_as_their_multipliers_say(found):
    """At an edge and at a graze, too; only at a flip and a fold, where one is +-1, are they not."""
    kinds, values = found["kind"].values, found["omega"].values
    # Where a branch of twice the period begins, one is 1 to rounding.
    stable = (np.abs(found["multipliers"].values) < 1.0 - 1e-12).all(axis=1)
    bifurcates = np.isin(kinds, ["flip", "fold"])
    special = found.isel(point=bifurcates)
    where = {*zip(special["branch"].values.tolist(), special["omega"].values.tolist(), strict=True)}
    places = zip(found["branch"].values.tolist(), values.tolist(), strict=True)
    beside = np.array([place in where for place in places])
    assert found["stable"].values.tolist() == (stable & ~beside).tolist()
    ends = np.isin(kinds, ["edge", "graze"])
    assert stable[ends].any() and not stable[ends].all()


def test_what_has_no_exact_orbit_is_refused(dataset, found):
    starts = swept(CONFIG, "start.x0=[-1.0, -0.5]", "oscillator.omega=2.5")
    with pytest.raises(Refused, match="the exact orbits do not depend on x0"):
        branches(starts, "x0")
    with pytest.raises(Refused, match="do not depend on x0; draw the map without"):
        sweeps.curves(starts, ["R", "x0"])
    with pytest.raises(Refused, match="the exact branches are over omega, not R"):
        plot(dataset, "a.png", axes=["R"], exact=found)


def test_chosen_classes_have_all_branches_that_are_found_without_a_choice(dataset, found):
    """Also those that begin at bifurcations of other classes."""

    def bifurcations(dataset, mq):
        own = np.array([each == mq for each in classes_of(dataset)])
        assert own.any()
        special = own[dataset["branch"].values] & (dataset["kind"].values != "")
        return {*dataset["omega"].values[special].tolist()}

    classes = [(2, 3), (4, 3)]
    chosen = branches(dataset, at={"R": 0.8}, classes=classes)
    assert {*classes_of(chosen)} == {*classes}
    for mq in classes:
        assert bifurcations(found, mq) <= bifurcations(chosen, mq)
    assert "no orbit" not in chosen.attrs["summary"]


def test_the_work_reports_its_share_up_to_its_end_and_can_be_ended(tmp_path):
    """The shares never fall; an exception at any of them ends the work."""
    scene = "oscillator: {h: 0.1, R: 0.8, omega: {start: 2.6, stop: 2.8, num: 30}, f: 1.0}\n"
    path = run_in(tmp_path, scene + "record: {transient: 200, periods: 16}\n")
    shares = []
    found = branches(path, "omega", None, shares.append)
    assert shares == sorted(shares) and shares[0] == 0.0 and 0.8 < shares[-1] < 1.0
    assert len(set(shares)) >= 2 * len(np.unique(found["branch"])) - 1

    class EndedError(Exception):
        pass

    def end(share):
        if share > 0.5:
            raise EndedError

    with pytest.raises(EndedError):
        branches(path, "omega", None, end)
    with pytest.raises(EndedError):
        bifurcations(path, "omega", None, end)


def test_orbits_between_a_fold_and_a_flip_of_one_step_are_stable():
    """The window is 1e-6 wide; points added for a picture have their own stability."""
    osc = Oscillator(h=0.565873495924132, R=0.5, omega=4.5, f=1.0, clearance=-0.5)
    inside = periodic_orbit(osc, -0.502280357078872, -0.03054864829772489, 4)
    assert (inside.m, inside.q) == (4, 11) and inside.stable
    start = branch(inside, "h", 0.005, 0.6).orbit(5)
    found = with_short_chords(
        branch(start, "h", 0.005, 0.6), 0.005, 0.6, attrgetter("speeds"), 1e-4
    )
    largest = np.array([abs(found.orbit(i).multipliers[0]) for i in range(len(found.values))])
    clear = np.abs(largest - 1.0) > 1e-6
    assert found.stable[clear].any()
    np.testing.assert_array_equal(found.stable[clear], largest[clear] < 1.0)


def test_ordinates_that_are_rounding_only_end_the_search_for_a_picture():
    """A branch over a range so narrow that the drawn ordinates are noise."""
    osc = Oscillator(h=0.1, R=0.8, omega=2.5, f=1.0)
    noise = np.random.default_rng(1)
    start = branch(one_impact_orbit(osc), "omega", 2.45, 2.55)
    drawn = (lambda orbits: 0.03 * noise.integers(2, size=(len(orbits.phases), 1))), 0.02
    found = with_short_chords(start, 2.45, 2.55, *drawn)
    assert len(start.values) < len(found.values) < 2000


def test_a_branch_between_whose_points_no_orbit_is_found_stays_as_it_is():
    """Its points are far apart, as on both sides of a gap: halfway Newton's method fails."""
    osc = Oscillator(h=0.1, R=0.8, omega=2.5, f=1.0)
    whole = branch(one_impact_orbit(osc), "omega", 2.45, 2.55)
    ends = {name: getattr(whole, name)[[0, -1]] for name in ("values", "stable", "speeds")}
    apart = replace(whole, phases=np.array([[1.0], [60.0]]), **ends)
    found = with_short_chords(apart, 2.45, 2.55, lambda orbits: orbits.sections(0.0)[:, 0], 1e-4)
    assert found.values.tolist() == apart.values.tolist()


def test_a_tree_joins_all_motions_of_the_hysteresis_scene():
    """Two folds, two grazes of the free oscillation, and what lies between them: from one seed."""
    osc = Oscillator(h=0.05, R=0.8, omega=1.5, f=1.0, clearance=1.5)
    tree = BranchSet("omega", 0.4, 1.9, phase=0.0)
    assert tree.add(periodic_orbit(osc, 0.0, 0.0))
    tree.grow()
    classes = {(one.m, one.q) for one in tree.branches}
    assert {(1, 0), (1, 1), (1, 2), (2, 3)} <= classes
    special = [point for one in tree.branches for point in one.special]
    folds = sorted(point.value for point in special if point.kind == "fold")
    expected = [
        oscillators.bifurcation(osc, "fold", "omega", *ends) for ends in ((0.5, 0.56), (1.5, 1.8))
    ]
    assert [folds[0], folds[-1]] == pytest.approx(expected, abs=1e-11)
    for one in tree.branches:
        assert tree.holds(one.orbit(len(one.values) // 2))


def test_a_tree_has_no_branch_twice_and_every_stable_orbit_attracts():
    osc = Oscillator(h=0.05, R=0.8, omega=2.5, f=1.0)
    tree = BranchSet("omega", 2.4, 3.5, phase=0.0, most_periods=8)
    assert tree.add(one_impact_orbit(osc))
    tree.grow()
    assert sum((one.m, one.q) == (1, 1) for one in tree.branches) == 1
    classes = {(one.m, one.q) for one in tree.branches}
    assert {(1, 1), (2, 2), (2, 1), (4, 4), (4, 2), (4, 3)} <= classes
    for one in tree.branches:
        for i in np.flatnonzero(one.stable)[1:-1:7].tolist():
            orbit = one.orbit(i)
            (x, v), *_ = orbit.sections()
            run = simulate(orbit.oscillator, 20 * one.m, x0=min(x + 1e-9, 0.0), v0=v)
            assert run.section_x[-1] == pytest.approx(x, abs=2e-8)
    assert tree.given_up["of more than 8 periods"] > 0
