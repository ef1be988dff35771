"""Diagrams, sections and trajectories: what is drawn, against the arrays of the file."""

import numpy as np
import pytest
from matplotlib.collections import QuadMesh

from sweeps import ConfigError
from sweeps.opened import coordinates
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting import Page, bifurcation, diagram, impacts, pixels, section, trajectory
from sweeps.plotting.contents import select_line
from sweeps.plotting.labels import log_spaced
from sweeps.store.variables import VARIABLES
from tests.helpers.written_files import FIXED, OMEGA, SAMPLES, R, picture_results
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status


def drawn(panel, marker="o"):
    """Return the points of every line drawn with this marker, sorted."""
    found = [line.get_xydata() for line in panel.lines if line.get_marker() == marker]
    return sorted(map(tuple, np.concatenate(found))) if found else []


def plain(text):
    """Return a text with plain spaces in place of non-breaking ones."""
    return text.replace("\N{NO-BREAK SPACE}", " ").replace("\t", " ").replace("~", r"\ ")


def pairs(x, y):
    x, y = np.broadcast_arrays(x, y)
    keep = np.isfinite(y)
    return sorted(zip(x[keep], y[keep], strict=True))


@pytest.mark.parametrize("coordinate", ["poincare_x", "poincare_v", "impact_v", "impact_phase"])
def test_a_bifurcation_shows_every_value_over_its_axis(random_sweep, coordinate):
    dataset = random_sweep({"R": R, "omega": OMEGA})
    figure = bifurcation(dataset, coordinate=coordinate, at={"R": 0.79})
    panel = figure.axes[0]
    assert drawn(panel) == pairs(OMEGA[:, None], dataset[coordinate].values[1])
    assert panel.get_xlabel() == r"forcing frequency $\omega$"
    assert VARIABLES[coordinate].meaning in panel.get_ylabel()
    assert f"${VARIABLES[coordinate].symbol}$" in plain(panel.get_ylabel())
    assert panel.get_xscale() == "linear"
    assert not figure.legends


def test_the_height_is_measured_from_the_stop_of_each_point(random_sweep, monkeypatch):
    """Drawn as points, and read in parts as for a density; the second axis is clearance."""
    clearance = np.array([-0.5, 0.25, 2.0])
    dataset = random_sweep({"omega": OMEGA, "clearance": clearance}, fixed=FIXED | {"x0": -1.0})
    height = clearance[:, None] - dataset["poincare_x"].values[1]
    cut = {"at": {"omega": OMEGA[1]}, "axes": ["clearance"], "coordinate": "poincare_height"}
    panel = bifurcation(dataset, **cut).axes[0]
    assert drawn(panel) == pairs(clearance[:, None], height)
    assert plain(panel.get_ylabel()) == r"height above the stop $\sigma - x$"
    monkeypatch.setattr(coordinates, "_VALUES_READ", 10)
    line, *_ = select_line(OpenedSweep(dataset), **cut)
    parts = pixels.computed_chunks(line, "poincare_height")
    np.testing.assert_array_equal(np.concatenate([values for _, values in parts]), height)


def test_a_bifurcation_takes_the_longest_axis_and_the_first_value_of_others(random_sweep):
    dataset = random_sweep({"omega": OMEGA, "R": R})
    values = dataset["poincare_x"].values
    assert drawn(bifurcation(dataset).axes[0]) == pairs(OMEGA[:, None], values[:, 0])
    figure = bifurcation(dataset, axes=["R"])
    assert drawn(figure.axes[0]) == pairs(R[:, None], values[0])
    assert figure.axes[0].get_xlabel() == "coefficient of restitution $R$"


@pytest.mark.slow
def test_the_title_names_what_is_fixed_and_how_it_was_computed(random_sweep):
    dataset = random_sweep({"R": R, "omega": OMEGA}, name="a $ sweep")
    title = bifurcation(dataset, at={"R": 0.79}).get_suptitle()
    assert title.startswith("a \\$ sweep\n")
    assert "$R=0.8$" in title  # the value of the grid, not 0.79
    assert "$h=0.1$" in title
    assert r"$\sigma=0.25$" in title
    assert "omega" not in title
    assert "phase 0.5 rad, transient 1,000, record 7 periods" in plain(title)
    assert "newmark" in title  # whose rule and steps `test_legend_room.py` tests
    point = section(dataset, at={"omega": 1.5}).get_suptitle()
    shown = {name for name, about in PARAMETERS.items() if f"${about.symbol}=" in point}
    assert shown == {"h", "R", "omega", "f", "clearance"}  # p, x0 and v0 are at their defaults
    assert r"$\omega=1.5$" in point


@pytest.mark.slow
def test_a_title_leaves_out_defaults_and_breaks_between_words(random_sweep, with_layout):
    fixed = {"h": 0.05, "R": 0.8, "f": 1.0, "p": 1.0, "clearance": 0.0, "x0": 0.0, "v0": 0.0}
    dataset = random_sweep({"omega": OMEGA}, fixed=fixed)
    figure = bifurcation(dataset, page=Page(width=3.4))
    _, rest = figure.get_suptitle().split("\n", 1)
    assert rest.replace("\n", " ").startswith("$h=0.05$, $R=0.8$, $f=1$, phase")
    for a, force in ((0.0, "$f=0$, phase"), (0.5, "$a=0.5$, phase")):  # no force but that of a base
        shaken = random_sweep({"omega": OMEGA}, fixed={**fixed, "f": 0.0, "a": a})
        title = bifurcation(shaken).get_suptitle().replace("\n", " ")
        assert force in title and ("$f=0$" in title) == (a == 0.0)
    (text,) = figure.texts
    assert text.get_window_extent().width <= figure.bbox.width
    wide = bifurcation(dataset).texts[0].get_window_extent()
    assert text.get_window_extent().height > 1.3 * wide.height


@pytest.mark.parametrize(
    ("values", "scale"),
    [
        (np.geomspace(0.5, 8.0, 7), "log"),
        (np.geomspace(8.0, 0.5, 7), "log"),
        (np.linspace(0.5, 8.0, 7), "linear"),
        (np.geomspace(1.0, 2.0, 7), "linear"),
        (np.array([1.0, 10.0]), "linear"),
    ],
)
def test_a_wide_axis_with_a_constant_ratio_is_logarithmic(values, scale):
    """Maps and limits are drawn on it in test_maps.py and test_page_limits.py."""
    assert log_spaced(values) == (scale == "log")


def test_motions_that_have_not_settled_are_marked_within_the_limits(random_sweep):
    distance = np.array([0.0, 2e-6, np.nan, 1e-6])
    limits = Page(ylim=(-100.0, 100.0))
    options = {"diagnostics": ["period"], "orbit_distance": distance}
    figure = bifurcation(random_sweep({"omega": OMEGA}, **options), page=limits)
    panel = figure.axes[0]
    assert drawn(panel, "|") == [(1.0, 0.015)] and panel.get_ylim() == (-100.0, 100.0)
    (text,) = figure.legends[0].get_texts()
    assert text.get_text() == "on its way to m/q (1 of 4)"


def test_points_that_failed_are_marked_and_not_drawn(random_sweep, with_layout):
    status = np.array([0, Status.UNRESOLVED, Status.PENDING, Status.NON_FINITE], np.int8)
    wild = np.full((4, 5), 1e300)
    wild[0] = [1, 2, 3, 4, 5]
    dataset = random_sweep({"omega": OMEGA}, status=status, poincare_x=wild)
    figure = bifurcation(dataset)
    panel = figure.axes[0]
    assert drawn(panel) == [(0.8, y) for y in (1, 2, 3, 4, 5)]
    assert [x for x, _ in drawn(panel, "|")] == [1.0, 1.5, 4.0]
    (legend,) = figure.legends
    assert [text.get_text().replace("\n", " ") for text in legend.get_texts()] == [
        f"{name} (1 of 4)" for name in ("not computed yet", "unresolved", "non-finite")
    ]
    figure.draw_without_rendering()


@pytest.mark.slow
def test_very_many_points_become_a_density(random_sweep, monkeypatch, with_layout):
    """Against NumPy's histogram, with a failed point and missing impacts, on a logarithmic axis."""
    values = np.geomspace(0.5, 8.0, 1000)
    monkeypatch.setattr(diagram, "DENSITY_FROM", 100)
    monkeypatch.setattr(coordinates, "_VALUES_READ", 500)
    status = np.zeros(1000, np.int8)
    status[234] = Status.UNRESOLVED
    dataset = random_sweep({"omega": values}, status=status)
    figure = bifurcation(dataset, coordinate="impact_v")
    panel = figure.axes[0]
    assert drawn(panel) == []
    (mesh,) = [c for c in panel.collections if isinstance(c, QuadMesh)]
    figure.draw_without_rendering()
    box, scale = panel.get_window_extent(), 150.0 / figure.dpi  # the fixture cheap_pictures
    share = mesh.get_array().filled(0.0)
    assert share.shape == pytest.approx((box.height * scale, box.width * scale), abs=1.0)
    y = dataset["impact_v"].values
    keep = np.isfinite(y) & (status != Status.UNRESOLVED)[:, None]
    x = np.broadcast_to(values[:, None], y.shape)[keep]
    corners = mesh.get_coordinates()
    counts, *_ = np.histogram2d(y[keep], x, bins=(corners[:, 0, 1], corners[0, :, 0]))
    expected = counts / np.maximum(counts.sum(axis=0), 1.0)
    # A value on an edge of a cell may be rounded to either side.
    assert np.count_nonzero(np.abs(share - expected) > 1e-12) <= 20
    np.testing.assert_allclose(share[:, -1], expected[:, -1], atol=1e-12)  # with the last value
    assert panel.get_ylim()[0] <= y[keep].min() and y[keep].max() <= panel.get_ylim()[1]


def test_the_impact_section_shows_the_impacts_of_its_point(random_sweep):
    dataset = random_sweep({"R": R, "omega": OMEGA})
    panel = impacts(dataset, at={"R": 0.8, "omega": 1.6}).axes[0]
    point = dataset.isel(R=1, omega=2)
    assert drawn(panel) == pairs(point["impact_phase"].values, point["impact_v"].values)
    assert len(drawn(panel)) == 2
    assert panel.get_xlim() == (0.0, 2.0 * np.pi)
    words = r"forcing phase at the impact $\omega t\ \mathrm{mod}\ 2\pi$"
    assert plain(panel.get_xlabel()) == words


def test_a_constant_does_not_show_its_rounding_errors(random_sweep):
    noise = 0.3 + 1e-15 * np.random.default_rng(0).normal(size=(4, 5))
    low, high = bifurcation(random_sweep({"omega": OMEGA}, poincare_x=noise)).axes[0].get_ylim()
    assert low < 0.2 < 0.4 < high
    small = 1e-9 * np.random.default_rng(0).normal(size=(4, 5))
    low, high = bifurcation(random_sweep({"omega": OMEGA}, poincare_x=small)).axes[0].get_ylim()
    assert high - low < 1e-8


@pytest.mark.parametrize(
    ("axes", "at"),
    [
        ({}, {}),
        ({"R": R, "omega": OMEGA}, {"R": 0.5, "omega": 1.5}),
        ({"clearance": [0.0, 0.5]}, {"clearance": 0.5}),
    ],
)
def test_a_section_shows_its_point_and_the_stop(random_sweep, axes, at):
    dataset = random_sweep(axes)
    point = dataset.sel(at)
    panel = section(dataset, at=at).axes[0]
    assert drawn(panel) == pairs(point["poincare_x"].values, point["poincare_v"].values)
    (stop,) = [line for line in panel.lines if line.get_linestyle() == "--"]
    assert set(stop.get_xdata()) == {point["clearance"].item()}
    assert panel.get_xlabel() == "displacement at the section $x$"
    assert panel.get_ylabel() == r"velocity at the section $\dot{x}$"


@pytest.mark.slow
def test_a_trajectory_has_the_papers_three_panels(random_sweep):
    dataset = random_sweep({"omega": OMEGA})
    dataset.load()
    for name in ("trajectory_t", "trajectory_x", "trajectory_v"):
        dataset[name][1, 30:] = np.nan
    dataset["trajectory_x"][1, 7] = 10.25
    t, x, v = (dataset[f"trajectory_{name}"].values[1, :30] for name in "txv")
    assert f"t_0={t[0]:.6g}" in trajectory(dataset, at={"omega": 1.0}).get_suptitle()
    t = t - t[0]
    beyond = x > 0.25
    assert 1 < beyond.sum() < 30
    figure = trajectory(dataset, at={"omega": 1.0})
    labels = [
        ("", "displacement $x$"),
        ("time $t-t_0$", r"velocity $\dot{x}$"),
        ("displacement $x$", r"velocity $\dot{x}$"),
    ]
    by_label = {(panel.get_xlabel(), panel.get_ylabel()): panel for panel in figure.axes}
    assert len(figure.axes) == 3
    for label, (across, up) in zip(labels, [(t, x), (t, v), (x, v)], strict=True):
        panel = by_label[label]
        np.testing.assert_array_equal(panel.lines[0].get_xydata(), np.column_stack([across, up]))
        marked = [line for line in panel.lines if line.get_marker() == "x"]
        assert sorted(map(tuple, marked[0].get_xydata())) == pairs(across[beyond], up[beyond])
    assert by_label[labels[2]].get_title() == "deepest penetration 1.0e+01"


def test_a_trajectory_within_the_stop_has_no_depth(random_sweep):
    widths = {"section": 5, "impact": 3, "sample": SAMPLES}
    inside = -np.abs(picture_results(1, widths)["trajectory_x"])
    figure = trajectory(random_sweep({}, trajectory_x=inside))
    assert [panel.get_title() for panel in figure.axes] == [""] * 3
    assert all(drawn(panel) == [] for panel in figure.axes)


def test_points_that_did_not_fail_are_drawn(random_sweep):
    good = [status for status in Status if not status.failed]
    assert {Status.CERTIFIED, Status.CUT_SHORT, Status.UNBOUNDED} <= set(good)
    dataset = random_sweep({"omega": OMEGA}, status=np.array(good, np.int8))
    figure = bifurcation(dataset)
    assert drawn(figure.axes[0]) == pairs(OMEGA[:, None], dataset["poincare_x"].values)
    assert not figure.legends


@pytest.mark.parametrize("status", [Status.COMPUTED, Status.CUT_SHORT, Status.UNRESOLVED])
def test_a_title_says_more_only_where_there_is_more_to_say(random_sweep, status):
    title = section(random_sweep({}, status=np.array([status], np.int8))).get_suptitle()
    assert (status.meaning in title.replace("\n", " ")) == (status is not Status.COMPUTED)


def test_a_configuration_of_another_version_is_refused_by_its_key(random_sweep):
    dataset = random_sweep({})
    old = dataset.attrs["configuration"].replace("steps_per_period: 64", "accuracy: 1e-6")
    with pytest.raises(ConfigError, match=r"configuration, line \d+: unknown key method.accuracy"):
        section(dataset.assign_attrs(configuration=old))
