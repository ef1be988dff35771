"""The curves over a map, against the closed form, and the shares that they explain."""

import math
import re

import numpy as np
import pytest
import xarray as xr

from sweeps import curves, load_config
from sweeps.bifurcation import exact_curves
from sweeps.bifurcation.exact_curves import middles_of_regions
from sweeps.errors import Refused
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting import Page, parameter_map
from tests.helpers.commands import accepted, refused
from tests.helpers.equal_points import legend_texts
from tests.helpers.sweep_files import run_in, swept
from vibroimpact.orbits.branches import Branch, SpecialPoint
from vibroimpact.orbits.continuation import MOST_POINTS
from vibroimpact.orbits.one_impact import one_impact_orbits
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.orbits.periodic import OrbitError
from vibroimpact.oscillator import Oscillator

pytestmark = pytest.mark.slow

CONFIG = """
name: the flip of one impact per period
oscillator:
  {h: 0.0, R: {start: 0.5, stop: 0.9, num: 12}, omega: {start: 2.6, stop: 2.72, num: 30}, f: 1.0}
follow: {axis: omega, direction: up}
record: {transient: 300, periods: 16, diagnostics: [period]}
"""


def assert_on_closed_form(omega, R, tolerance):
    curve = np.cos(math.pi / omega) ** 2 * (omega**2 - ((1.0 - R) / (1.0 + R)) ** 2)
    assert np.abs(curve - 1.0).max() < tolerance


@pytest.fixture(scope="module")
def found(path):
    """Return all curves of the map."""
    return curves(path)


def test_the_flips_of_the_map_are_on_the_closed_form(path, found):
    assert found.attrs["changes"] > 5
    assert found.attrs["explained"] == found.attrs["changes"]
    flips = found.where((found["kind"] == "flip") & (found["m"] == 1), drop=True)
    own = flips.where(flips["curve"] == flips["curve"][0], drop=True)
    assert_on_closed_form(own["omega"].values, own["R"].values, 1e-12)
    assert {*own["special"].values} == {"", "edge"}
    panel = parameter_map(path, exact=found).axes[0]
    assert {"1/1", "2/2"} <= {text.get_text() for text in panel.texts}


def test_cells_without_a_class_between_two_motions_do_not_hide_their_flip(dataset, monkeypatch):
    """As beside a flip, where motions settle slowly."""
    monkeypatch.setattr(exact_curves, "middles_of_regions", lambda _: iter(()))
    period = dataset["period"].copy()
    for axis in ("omega", "R"):
        moved = dataset["period"].shift({axis: 1}, fill_value=0)
        period = period.where((dataset["period"] == moved) | (moved == 0), 0)
    assert 0 < (period == 0).sum() < 0.2 * period.size
    found = curves(dataset.assign(period=period))
    assert found.attrs["changes"] == found.attrs["explained"] > 5
    flips = (found["kind"] == "flip") & (found["m"] == 1) & (found["q"] == 1)
    assert len({*found["curve"].values[flips]}) == 1


def test_chosen_classes_have_all_their_curves(path, found):
    chosen = curves(path, classes=[(2, 2), (5, 1)])
    own = (found["m"] == 2) & (found["q"] == 2)
    assert 0 < own.sum() < own.size
    for name in ("kind", "special", "omega"):
        assert chosen[name].values.tolist() == found[name].values[own].tolist()
    assert 0 < chosen.attrs["changes"] < found.attrs["changes"]
    lines = chosen.attrs["summary"].split("\n")
    assert lines[1] == "no curve of 5/1 is found"
    assert " changes from or to 2/2, 5/1 (" in lines[2]


def test_only_the_curves_that_are_asked_for_are_followed(path, found, monkeypatch):
    """And the changes beside other curves have that as their reason."""
    followed, follow = [], exact_curves.bifurcation_curve

    def counted(orbit, kind, *ranges):
        curve = follow(orbit, kind, *ranges)
        followed.append((curve.kind, curve.m, curve.q))
        return curve

    def begun(search, cell, axis):
        begins.append(tuple(search._classes[*cell].tolist()))
        return borders(search, cell, axis)

    begins, borders = [], exact_curves.CurveSearch._borders
    monkeypatch.setattr(exact_curves, "bifurcation_curve", counted)
    monkeypatch.setattr(exact_curves.CurveSearch, "_borders", begun)
    asked = curves(path, classes=[(2, 2)], kinds=["flip"])
    assert begins and {*begins} <= {(2, 2), (4, 4)}
    of_curves = found.isel(point=np.unique(found["curve"].values, return_index=True)[1])
    every = of_curves[["kind", "m", "q"]].to_dataframe()[["kind", "m", "q"]].values.tolist()
    assert ["flip", 1, 1] in every
    assert set(followed) == {("flip", 2, 2)} and len(followed) == every.count(["flip", 2, 2])
    assert 0 < asked.attrs["explained"] < asked.attrs["changes"]
    assert "the curve there is of a class or kind that was not asked for" in asked.attrs["summary"]


def test_a_motion_ends_at_the_fold_of_its_orbit_not_at_the_graze_beyond(tmp_path):
    """The unstable orbit beyond the fold grazes at a value before it, between it and the motion.

    On the fold two orbits in closed form begin; from rest, motions reach 1/1 up to the graze only.
    """
    oscillator = "{h: 0.05, R: 0.7, clearance: 0.5, omega: {start: 1.18, stop: 1.22, num: 4}, "
    force = "f: {start: 0.05, stop: 0.5, num: 12}}"
    record = "record={transient: 200, periods: 8, diagnostics: [period]}"
    found = curves(run_in(tmp_path, f"oscillator: {oscillator}{force}", record), kinds=["fold"])
    assert set(found["kind"].values) == {"fold"} and set(found["m"].values) == {1}
    for omega, f in zip(found["omega"].values, found["f"].values, strict=True):
        at = {"h": 0.05, "R": 0.7, "omega": omega, "clearance": 0.5}
        shares = 1.0 - 1e-9, 1.0 + 1e-9
        sides = [one_impact_orbits(Oscillator(f=f * share, **at)) for share in shares]
        assert [len(orbits) for orbits in sides] == [0, 2]


def test_every_large_region_of_a_class_has_a_start():
    classes = np.zeros((40, 40, 2), int)
    classes[2:10, 5:9] = classes[20:30, 20:38] = 1, 1
    classes[35, 35] = 1, 1
    found = [(*cell.tolist(), axis) for cell, axis in middles_of_regions(classes)]
    assert found == [(6, 5, 0), (2, 7, 1), (25, 20, 0), (20, 29, 1)]


MAP = """
oscillator: {h: 0.02, R: 0.9, clearance: 1.0, f: {start: 0.345, stop: 0.385, num: 16},
             omega: {start: 0.782, stop: 0.80, num: 16}}
record: {transient: 600, periods: 32, diagnostics: [period, lyapunov]}
"""


def test_every_change_has_a_curve_or_a_reason(tmp_path):
    """Beside the fold of 2/1, where free motion and 2/2 coexist."""
    found = curves(run_in(tmp_path, MAP))
    changes, explained = found.attrs["changes"], found.attrs["explained"]
    assert 0 < explained < changes
    summary = found.attrs["summary"]
    counts = dict(reversed(pair) for pair in re.findall(r"^  (\d+): (.*) \(.*\)$", summary, re.M))
    assert sum(map(int, counts.values())) == changes - explained
    decides = "both motions are stable on both sides, and the start decides"
    assert int(counts[decides]) > 10
    assert f"{counts[decides]}: {decides} (1/0 and 2/2" in summary
    grazes = (found["kind"] == "graze") & (found["m"] == 1) & (found["q"] == 1)
    own = found["curve"].values == found["curve"].values[grazes][0]
    omega, f = found["omega"].values[own], found["f"].values[own]
    assert np.abs(f - np.hypot(1.0 - omega**2, 0.04 * omega)).max() < 1e-13


def test_a_border_that_cannot_be_followed_is_a_reason(path, monkeypatch):
    def refuse(*_):
        raise OrbitError("the flip does not go on")

    monkeypatch.setattr(exact_curves, "bifurcation_curve", refuse)
    found = curves(path)
    assert found.sizes["point"] == found.attrs["explained"] == 0 < found.attrs["changes"]
    assert "the flip does not go on" in found.attrs["summary"]


RIG = {"mass": 2, "stiffness": 8, "damping": 1, "force": 1, "gap": 0, "R": 0.5, "frequency": 1}
OF_RIG = {"configuration": load_config({"rig": RIG}).to_yaml()}
MODEL = {"h": 0.02, "R": 0.9, "omega": 2, "f": 1}
OF_MODEL = {"configuration": load_config({"oscillator": MODEL}).to_yaml()}


@pytest.mark.parametrize(
    ("attributes", "axis", "place"),
    [(OF_MODEL, "omega", "omega = 2"), (OF_RIG, "frequency", "frequency = 0.31831")],
)
def test_a_curve_that_is_lost_says_where_and_why(attributes, axis, place):
    cut = xr.Dataset(coords={"R": [0.2], "omega": (axis, [1.0])}, attrs=attributes)
    cut = OpenedSweep(cut, in_rig=attributes is OF_RIG)
    osc = Oscillator(h=0.02, R=0.9, omega=2.0, f=1.0)
    slowest = "the slowest impact has 2e-01 of the speed of the fastest"
    for points, speeds_there, reason in (
        (MOST_POINTS, [4.0, 1.0], f"not at its end after 2,000 points; {slowest}"),
        (
            9,
            [0.0, 5.0],
            "Newton's method fails or takes too long",
        ),  # a single impact does not graze
    ):
        orbit = PeriodicOrbit(osc, 1, np.array([1.0, 2.0]), np.array(speeds_there))
        values = np.full((points, 2), 0.5)
        end = SpecialPoint("lost", np.array([0.25, 2.0]), orbit)
        speeds = np.ones((points, 2))
        rows = values, speeds[:, 0] < 0.0, speeds, speeds
        curve = Branch("flip", ("R", "omega"), 1, 2, *rows, [end], orbit.oscillator)
        (_, _, line) = exact_curves.curves_summary(cut, [curve], (), 0, 0, {}).split("\n")
        assert line == f"a curve of flips of 1/2 is lost at R = 0.25, {place}: {reason}"


def strong_lines(figure):
    return [line for line in figure.axes[0].lines if line.get_path_effects()]


def test_curves_that_bound_a_motion_of_the_map_stand_out(dataset, monkeypatch):
    """The flip of 1/1 between 1/1 and 2/2, on its closed form; elsewhere it is thin."""
    own = curves(dataset, classes=[(1, 1)])
    figure = parameter_map(dataset, exact=own)
    (line,) = strong_lines(figure)
    omega, R = line.get_data()
    assert np.ptp(R) > 0.35
    assert_on_closed_form(omega, R, 1e-4)
    elsewhere = dataset.copy()
    elsewhere["period"] = 0 * dataset["period"] + 3  # another motion all over the map
    thin = parameter_map(elsewhere, exact=own)
    upright = parameter_map(dataset, axes=["R", "omega"], exact=own)
    assert (strong_lines(upright)[0].get_data()[::-1] == np.array([omega, R])).all()
    middle = len(omega) // 2
    for share in (1e-2, 1e-4):  # of the axes: less than the distance of two points
        away = [share * np.ptp(z) for z in (omega, R)]
        ends = [(z[middle] - d, z[middle] + d) for z, d in zip((omega, R), away, strict=True)]
        page = Page(xlim=ends[0], ylim=ends[1])
        (part,) = strong_lines(parameter_map(dataset, exact=own, page=page))
        assert (part.get_data() == np.array([omega, R])).all()
    assert not strong_lines(thin) and thin.axes[0].lines
    assert "1 further curve" in legend_texts(thin)
    monkeypatch.setattr("sweeps.plotting.exact_lines._CURVES_IN_FULL", 0)
    assert len(strong_lines(parameter_map(dataset, exact=own))) == 1
    left_out = parameter_map(elsewhere, exact=own)
    assert not left_out.axes[0].lines and "1 further curve not shown" in legend_texts(left_out)
    beside = Page(xlim=(float(dataset["omega"][0]), omega.min() - 0.01 * np.ptp(omega)))
    assert not any(
        "curve" in t for t in legend_texts(parameter_map(elsewhere, exact=own, page=beside))
    )


def test_a_curve_that_bounds_a_motion_on_a_part_is_drawn_whole(dataset, monkeypatch, unpainted):
    """Where starts lead to another orbit, the rest of the curve is thin, also among many curves."""
    monkeypatch.setattr("sweeps.plotting.exact_lines._CURVES_IN_FULL", 0)
    found = curves(dataset, classes=[(1, 1)])
    half = dataset.copy()
    half["period"] = dataset["period"].where(dataset["R"] < 0.7, 3)
    figure = parameter_map(half, exact=found)
    (strong,) = strong_lines(figure)
    (thin,) = (line for line in figure.axes[0].lines if line not in strong_lines(figure))
    for line in (strong, thin):
        assert_on_closed_form(*line.get_data(), 1e-4)
    assert 0.65 < strong.get_ydata().max() < 0.8
    assert {strong.get_ydata().min(), thin.get_ydata().max()} == {0.5, 0.9}
    assert np.isclose(thin.get_ydata().min(), strong.get_ydata().max(), atol=0.02)


def test_the_kinds_of_the_curves_can_be_chosen(unpainted):
    oscillator = "h: 0.05, f: 1.0, R: [0.7, 0.75, 0.8], clearance: 1.5, "
    oscillator += "omega: {start: 1.2, stop: 1.8, num: 9}"
    dataset = swept(f"oscillator: {{{oscillator}}}\nrecord: {{transient: 300, periods: 16}}\n")
    assert "graze" in curves(dataset)["kind"].values
    chosen = curves(dataset, kinds=["graze"])
    assert {*chosen["kind"].values.tolist()} == {"graze"}
    with pytest.raises(Refused, match=r"kind 'flp' .did you mean flip.*choose from"):
        curves(dataset, kinds=["flp"])
    drawn = accepted("plot", "swept.h5", "--exact", "--kinds", "graze", "--dpi", "60")
    assert "of grazes" in drawn and "of folds" not in drawn
    told = refused("plot", "swept.h5", "--kind", "bifurcation", "--exact", "--kinds", "graze")
    assert "--kinds chooses curves over a map, and a diagram shows branches" in told


def test_a_change_with_a_reason_and_a_curve_counts_once_in_the_share_of_the_work():
    """A curve found later may explain a change that already had a reason."""
    search = object.__new__(exact_curves.CurveSearch)
    search.explained = np.array([True, True, False, False])
    search.counted = np.array([True, True, True, False])
    assert search._share({0: "lost", 3: "of other classes"}) == pytest.approx(2 / 3)
    assert search._share({0: "lost", 2: "lost"}) == 1.0
    assert search._share(()) == pytest.approx(2 / 3)
