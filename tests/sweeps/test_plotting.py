from pathlib import Path

import numpy as np
import pytest
import yaml
from matplotlib.collections import QuadMesh

from sweep_files import random_results
from sweeps.analysis import selection
from sweeps.errors import Refused
from sweeps.grid import Grid
from sweeps.plotting import (
    KINDS,
    bifurcation,
    bifurcation_diagram,
    density,
    impacts,
    kinds,
    plot,
    saving,
    section,
    trajectory,
)
from sweeps.plotting.palette import VERMILION
from sweeps.store.layout import Layout
from sweeps.store.reader import open_sweep
from sweeps.store.variables import VARIABLES
from sweeps.store.writer import sweep_writer
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status

FIXED = {"h": 0.1, "R": 0.8, "omega": 2.0, "f": 1.0, "p": 1.0, "clearance": 0.25, "x0": 0, "v0": 0}
OMEGA = np.array([0.8, 1.0, 1.5, 4.0])
R = np.array([0.5, 0.8])
SAMPLES = 40


def results(points, widths, seed=0):
    arrays = random_results(points, widths, seed, scale=1.0)
    random = np.random.default_rng(seed + 1)
    arrays["period"] = random.integers(0, 3, points)
    arrays["rest_fraction"] = random.integers(0, 2, points) / 4.0
    arrays["impact_v"][..., -1:] = np.nan
    return arrays


@pytest.fixture
def sweep(tmp_path):
    """Return a function that writes and opens a sweep of random numbers."""
    opened = []

    def make(
        axes,
        *,
        sections=5,
        impacts=3,
        with_trajectory=True,
        name="a test",
        fixed=FIXED,
        diagnostics=(),
        **changed,
    ):
        fixed = {key: value for key, value in fixed.items() if key not in axes}
        grid = Grid({key: np.asarray(values, float) for key, values in axes.items()}, fixed)
        configuration = {
            "oscillator": {k: v for k, v in fixed.items() if k not in ("x0", "v0")},
            "start": {k: v for k, v in fixed.items() if k in ("x0", "v0")},
            "method": {"integrator": "newmark", "impact": "cubic", "steps_per_period": 64},
            "record": {"transient": 1000, "periods": 7, "phase": 0.5},
        }
        widths = {"section": sections, "impact": impacts, "sample": SAMPLES * with_trajectory}
        path = tmp_path / f"{len(opened)}.h5"
        layout = Layout.of(
            grid,
            grid.blocks(grid.size),
            attributes={
                "name": name,
                "configuration": yaml.safe_dump(configuration),
                "numerics": "",
            },
            widths=widths,
            first_section=11,
            diagnostics=diagnostics,
        )
        with sweep_writer(path, layout) as store:
            store.write(
                tuple(slice(0, n) for n in grid.shape), {**results(grid.size, widths), **changed}
            )
        opened.append(open_sweep(path, verify=False))  # which refuses pending points in a block
        return opened[-1]

    yield make
    for dataset in opened:
        dataset.close()


def drawn(panel, marker="o"):
    """Return the points of every line drawn with this marker, sorted."""
    found = [line.get_xydata() for line in panel.lines if line.get_marker() == marker]
    return sorted(map(tuple, np.concatenate(found))) if found else []


def pairs(x, y):
    x, y = np.broadcast_arrays(x, y)
    keep = np.isfinite(y)
    return sorted(zip(x[keep], y[keep], strict=True))


@pytest.mark.parametrize("coordinate", ["poincare_x", "poincare_v", "impact_v", "impact_phase"])
def test_a_bifurcation_shows_every_value_over_its_axis(sweep, coordinate):
    dataset = sweep({"R": R, "omega": OMEGA})
    figure = bifurcation(dataset, coordinate=coordinate, at={"R": 0.79})
    panel = figure.axes[0]
    assert drawn(panel) == pairs(OMEGA[:, None], dataset[coordinate].values[1])
    assert panel.get_xlabel() == r"forcing frequency $\omega$ [rad/time]"
    assert VARIABLES[coordinate].long_name in panel.get_ylabel()
    assert f"${VARIABLES[coordinate].symbol}$" in panel.get_ylabel()
    assert panel.get_xscale() == "linear"
    assert not figure.legends


def test_a_bifurcation_takes_the_longest_axis_and_the_first_value_of_others(sweep):
    dataset = sweep({"omega": OMEGA, "R": R})
    values = dataset["poincare_x"].values
    assert drawn(bifurcation(dataset).axes[0]) == pairs(OMEGA[:, None], values[:, 0])
    figure = bifurcation(dataset, axes=["R"])
    assert drawn(figure.axes[0]) == pairs(R[:, None], values[0])
    assert figure.axes[0].get_xlabel() == "coefficient of restitution $R$"


def test_the_title_names_what_is_fixed_and_how_it_was_computed(sweep):
    dataset = sweep({"R": R, "omega": OMEGA}, name="a $ sweep")
    title = bifurcation(dataset, at={"R": 0.79}).get_suptitle()
    assert title.startswith("a \\$ sweep\n")
    assert "$R = 0.8$" in title  # the value of the grid, not 0.79
    assert "$h = 0.1$" in title
    assert r"$\sigma = 0.25$" in title
    assert "omega" not in title
    assert "phase 0.5 rad, transient 1,000, record 7 periods" in title
    assert "newmark" not in title
    point = section(dataset, at={"omega": 1.5}).get_suptitle()
    assert all(f"${parameter.symbol} = " in point for parameter in PARAMETERS.values())
    assert r"$\omega = 1.5$" in point


@pytest.mark.parametrize(
    ("values", "scale"),
    [
        (np.geomspace(0.5, 8.0, 7), "log"),
        (np.geomspace(8.0, 0.5, 7), "log"),
        (np.linspace(0.5, 8.0, 7), "linear"),
        (np.geomspace(1.0, 2.0, 7), "linear"),
        ([1.0, 10.0], "linear"),
    ],
)
def test_a_log_spaced_axis_is_drawn_so(sweep, tmp_path, values, scale):
    dataset = sweep({"omega": values})
    assert bifurcation(dataset).axes[0].get_xscale() == scale
    plot(dataset, tmp_path / "a.png")


def test_points_that_failed_are_marked_and_not_drawn(sweep, tmp_path):
    status = np.array([0, Status.UNRESOLVED, Status.PENDING, Status.NON_FINITE], np.int8)
    wild = np.full((4, 5), 1e300)
    wild[0] = [1, 2, 3, 4, 5]
    dataset = sweep({"omega": OMEGA}, status=status, poincare_x=wild)
    figure = bifurcation(dataset)
    panel = figure.axes[0]
    assert drawn(panel) == [(0.8, y) for y in (1, 2, 3, 4, 5)]
    assert [x for x, _ in drawn(panel, "|")] == [1.0, 1.5, 4.0]
    (legend,) = figure.legends
    assert [text.get_text().replace("\n", " ") for text in legend.get_texts()] == [
        f"{status.meaning} (1 of 4)"
        for status in (Status.PENDING, Status.UNRESOLVED, Status.NON_FINITE)
    ]
    plot(dataset, tmp_path / "a.png")


@pytest.mark.parametrize("values", [np.linspace(1.0, 2.0, 40), np.geomspace(0.5, 8.0, 40)])
def test_very_many_points_become_a_density(sweep, tmp_path, monkeypatch, values):
    monkeypatch.setattr(bifurcation_diagram, "DENSITY_FROM", 100)
    dataset = sweep({"omega": values}, poincare_x=np.tile([1.0, 2.0, 2.0, 2.0, 3.0], (40, 1)))
    figure = bifurcation(dataset)
    (mesh,) = [c for c in figure.axes[0].collections if isinstance(c, QuadMesh)]
    share = mesh.get_array().filled(0.0)
    assert drawn(figure.axes[0]) == []
    np.testing.assert_allclose(share.sum(axis=0), 1.0)
    rows = np.flatnonzero(share.sum(axis=1))
    np.testing.assert_allclose(share[rows], np.tile([[0.2], [0.6], [0.2]], 40))
    plot(dataset, tmp_path / "a.png")


def test_a_density_is_counted_in_parts_at_the_resolution_of_the_picture(sweep, monkeypatch):
    """Against NumPy's histogram, with a point that failed and impacts that there were not."""
    monkeypatch.setattr(bifurcation_diagram, "DENSITY_FROM", 100)
    monkeypatch.setattr(density, "_PART_SIZE", 50)
    values = np.linspace(1.0, 2.0, 3000)
    status = np.zeros(3000, np.int8)
    status[1234] = Status.UNRESOLVED
    dataset = sweep({"omega": values}, status=status)
    figure = bifurcation(dataset, coordinate="impact_v")
    panel = figure.axes[0]
    (mesh,) = [c for c in panel.collections if isinstance(c, QuadMesh)]
    figure.draw_without_rendering()
    box, scale = panel.get_window_extent(), 300.0 / figure.dpi
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
    assert panel.get_ylim()[0] <= y[keep].min() and y[keep].max() <= panel.get_ylim()[1]


def test_the_impact_section_shows_the_impacts_of_its_point(sweep):
    dataset = sweep({"R": R, "omega": OMEGA})
    panel = impacts(dataset, at={"R": 0.8, "omega": 1.6}).axes[0]
    point = dataset.isel(R=1, omega=2)
    assert drawn(panel) == pairs(point["impact_phase"].values, point["impact_v"].values)
    assert len(drawn(panel)) == 2
    assert panel.get_xlim() == (0.0, 2.0 * np.pi)
    assert panel.get_xlabel() == r"forcing phase at the impact $\omega t\ \mathrm{mod}\ 2\pi$ [rad]"


def test_a_constant_does_not_show_its_rounding_errors(sweep):
    noise = 0.3 + 1e-15 * np.random.default_rng(0).normal(size=(4, 5))
    low, high = bifurcation(sweep({"omega": OMEGA}, poincare_x=noise)).axes[0].get_ylim()
    assert low < 0.2 < 0.4 < high
    small = 1e-9 * np.random.default_rng(0).normal(size=(4, 5))
    low, high = bifurcation(sweep({"omega": OMEGA}, poincare_x=small)).axes[0].get_ylim()
    assert high - low < 1e-8


@pytest.mark.parametrize("axes", [{}, {"R": R, "omega": OMEGA}])
def test_a_section_shows_its_point_and_the_stop(sweep, axes):
    dataset = sweep(axes)
    at = {"omega": 1.6} if axes else None
    point = dataset.isel(R=0, omega=2) if axes else dataset
    panel = section(dataset, at=at).axes[0]
    assert drawn(panel) == pairs(point["poincare_x"].values, point["poincare_v"].values)
    (stop,) = [line for line in panel.lines if line.get_linestyle() == "--"]
    assert set(stop.get_xdata()) == {0.25}
    assert panel.get_xlabel() == "displacement at the section $x$ [length]"
    assert panel.get_ylabel() == r"velocity at the section $\dot{x}$ [length/time]"


def test_the_stop_of_a_swept_clearance_is_that_of_the_point(sweep):
    dataset = sweep({"clearance": [0.0, 0.5]})
    panel = section(dataset, at={"clearance": 0.5}).axes[0]
    (stop,) = [line for line in panel.lines if line.get_linestyle() == "--"]
    assert set(stop.get_xdata()) == {0.5}


def test_a_trajectory_has_the_papers_three_panels(sweep):
    dataset = sweep({"omega": OMEGA})
    dataset.load()
    for name in ("trajectory_t", "trajectory_x", "trajectory_v"):
        dataset[name][1, 30:] = np.nan
    dataset["trajectory_x"][1, 7] = 10.25
    t, x, v = (dataset[f"trajectory_{name}"].values[1, :30] for name in "txv")
    assert f"t_0 = {t[0]:.6g}" in trajectory(dataset, at={"omega": 1.0}).get_suptitle()
    t = t - t[0]
    beyond = x > 0.25
    assert 1 < beyond.sum() < 30
    figure = trajectory(dataset, at={"omega": 1.0})
    labels = [
        ("", "displacement\n$x$ [length]"),
        ("time $t - t_0$ [time]", "velocity\n$\\dot{x}$ [length/time]"),
        ("displacement $x$ [length]", "velocity $\\dot{x}$ [length/time]"),
    ]
    by_label = {(panel.get_xlabel(), panel.get_ylabel()): panel for panel in figure.axes}
    assert len(figure.axes) == 3
    for label, (across, up) in zip(labels, [(t, x), (t, v), (x, v)], strict=True):
        panel = by_label[label]
        np.testing.assert_array_equal(panel.lines[0].get_xydata(), np.column_stack([across, up]))
        marked = [line for line in panel.lines if line.get_color() == VERMILION]
        assert sorted(map(tuple, marked[0].get_xydata())) == pairs(across[beyond], up[beyond])
    assert by_label[labels[2]].get_title() == "deepest penetration 1.0e1"


def test_a_trajectory_within_the_stop_says_so(sweep):
    inside = -np.abs(results(1, {"section": 5, "impact": 3, "sample": SAMPLES})["trajectory_x"])
    figure = trajectory(sweep({}, trajectory_x=inside))
    assert "no sample beyond the stop" in [panel.get_title() for panel in figure.axes]
    assert all(drawn(panel) == [] for panel in figure.axes)


def test_points_that_did_not_fail_are_drawn(sweep):
    good = [status for status in Status if not status.failed]
    assert {Status.CERTIFIED, Status.SETTLED, Status.UNBOUNDED} <= set(good)
    dataset = sweep({"omega": OMEGA}, status=np.array(good, np.int8))
    figure = bifurcation(dataset)
    assert drawn(figure.axes[0]) == pairs(OMEGA[:, None], dataset["poincare_x"].values)
    assert not figure.legends


@pytest.mark.parametrize("status", [s for s in Status if s is not Status.PENDING])
def test_a_title_says_more_only_where_there_is_more_to_say(sweep, status):
    title = section(sweep({}, status=np.array([status], np.int8))).get_suptitle()
    plain = status in (Status.COMPUTED, Status.CERTIFIED)
    assert (status.meaning in title.replace("\n", " ")) != plain


def test_the_configuration_is_read_once_per_picture(sweep, tmp_path, monkeypatch):
    dataset = sweep({"x0": R - 2.0, "v0": R, "omega": OMEGA}, diagnostics=["period"])
    read, calls = selection.yaml.safe_load, []
    monkeypatch.setattr(selection.yaml, "safe_load", lambda text: calls.append(1) or read(text))
    for kind in KINDS:
        calls.clear()
        selection._parsed.cache_clear()
        plot(dataset, tmp_path / "a.png", kind)
        assert len(calls) == 1


@pytest.mark.parametrize("link", ["symbolic", "hard", "dotted"])
def test_the_data_are_never_replaced(sweep, tmp_path, link):
    dataset = sweep({"omega": OMEGA})
    data, picture = tmp_path / "0.h5", tmp_path / "link.png"
    before = data.read_bytes()
    if link == "symbolic":
        picture.symlink_to("0.h5")
    elif link == "hard":
        picture.hardlink_to(data)
    else:
        (tmp_path / "folder").mkdir()
        picture = tmp_path / "folder" / ".." / "0.h5"
    with pytest.raises(Refused, match="would replace the data; give -o another file"):
        plot(dataset, picture)
    assert data.read_bytes() == before


def test_a_picture_is_replaced_whole_or_not_at_all(sweep, tmp_path, monkeypatch):
    dataset = sweep({"omega": OMEGA})
    target, link = tmp_path / "a.png", tmp_path / "link.png"
    target.write_text("old")
    link.symlink_to("a.png")

    def fail(self, path, **_):
        Path(path).write_text("half")
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(saving.Figure, "savefig", fail)
        plot(dataset, target)
    assert target.read_text() == "old"
    plot(dataset, link)
    assert link.is_symlink() and target.read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0.h5", "a.png", "link.png"]


def test_a_name_that_the_font_lacks_gives_no_warning(sweep, tmp_path):
    plot(sweep({"omega": OMEGA}, name="振動 衝突"), tmp_path / "a.png")


def test_powers_of_ten_are_set_as_such(sweep, tmp_path):
    dataset = sweep({"omega": OMEGA}, fixed={**FIXED, "clearance": 1e300, "f": 2.5e-7})
    figure = section(dataset)
    assert r"$f = 2.5 \times 10^{-7}$" in figure.get_suptitle()
    assert r"$\sigma = 1 \times 10^{300}$" in figure.get_suptitle()
    (legend,) = figure.legends
    assert r"\sigma = 1 \times 10^{300}$" in legend.get_texts()[0].get_text()


def test_a_point_that_failed_is_titled_so(sweep):
    dataset = sweep({}, status=np.array([Status.UNRESOLVED], np.int8))
    assert Status.UNRESOLVED.meaning in section(dataset).get_suptitle()
    assert Status.UNRESOLVED.meaning in trajectory(dataset).get_suptitle()


@pytest.mark.parametrize(
    ("ending", "start"),
    [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml"), ("PNG", b"\x89")],
)
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_every_kind_is_written_in_every_format(sweep, tmp_path, kind, ending, start):
    output = tmp_path / f"a.{ending}"
    dataset = sweep({"x0": R - 2.0, "v0": R, "omega": OMEGA}, diagnostics=["period"])
    assert plot(dataset, output, kind) == output
    assert output.read_bytes().startswith(start)


@pytest.mark.parametrize(
    ("axes", "with_trajectory", "expected"),
    [
        ({"omega": OMEGA}, True, "bifurcation"),
        ({}, True, "trajectory"),
        ({}, False, "section"),
    ],
)
def test_the_default_kind(sweep, tmp_path, monkeypatch, axes, with_trajectory, expected):
    called = []

    def spy(name):
        draw = KINDS[name].draw
        return KINDS[name]._replace(draw=lambda *a, **b: called.append(name) or draw(*a, **b))

    monkeypatch.setattr(kinds, "KINDS", {name: spy(name) for name in KINDS})
    plot(sweep(axes, with_trajectory=with_trajectory), tmp_path / "a.png")
    assert called == [expected]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"output": "a.jpg"}, r"a\.jpg must end in one of \.png, \.svg, \.pdf"),
        ({"output": "a"}, r"must end in one of"),
        ({"output": "missing/a.png"}, r"the folder .*missing of the picture a\.png does not exist"),
        ({"output": "folder.png"}, r"folder\.png is a directory"),
        ({"kind": ""}, "no picture ''; choose one of"),
        ({"axes": [""]}, "'' is not a swept axis"),
        ({"coordinate": ""}, "no '' to draw; choose from: poincare_x"),
        (
            {"kind": "pie"},
            "no picture 'pie'; choose one of bifurcation, attractors, basins, map, sec",
        ),
        ({"axes": ["h"]}, "h is not a swept axis; the file has R, omega"),
        ({"at": {"h": 1.0}}, "h cannot be fixed here; choose from: R"),
        ({"at": {"omega": 1.0}}, "omega cannot be fixed here; choose from: R"),
        ({"at": {"R": 0.9}}, "R = 0.9 is outside the sweep: 0.5 to 0.8"),
        ({"at": {"R": float("nan")}}, "R = nan is outside the sweep"),
        (
            {"coordinate": "status"},
            "status is no coordinate of the motion; choose from: poincare_x",
        ),
        (
            {"coordinate": "impact_v"},
            "has no impact_v to draw; choose from: poincare_x, poincare_v",
        ),
        (
            {"kind": "section", "axes": ["R"]},
            "axes can be chosen for a bifurcation or attractors or map only",
        ),
        (
            {"kind": "section", "exact": True},
            "exact can be chosen for a bifurcation or map only, not a section",
        ),
        ({"axes": ["R", "omega"]}, "a bifurcation has 1 swept axis, not R, omega"),
        (
            {"coordinate": "max_penetration"},
            "max_penetration is no coordinate of the motion; choose from: poincare_x, poincare_v; "
            "--below max_penetration draws it",
        ),
        (
            {"below": ("status",)},
            "status cannot be drawn below a diagram; choose from: impacts_per",
        ),
        ({"below": ("rest_fraction",) * 2}, "rest_fraction is asked for twice"),
        ({"kind": "map", "below": ("rest_fraction",)}, "below can be chosen for a bifurcation"),
        (
            {"kind": "trajectory", "periods": -1},
            "periods = -1 is not allowed; expected: an integer",
        ),
        ({"kind": "map", "quantity": "chatters"}, "a map does not show chatters; choose from: "),
        ({"kind": "section", "at": {"f": 1.0}}, "f cannot be fixed here; choose from: R, omega"),
    ],
)
def test_requests_that_do_not_fit_are_refused(sweep, tmp_path, options, message):
    (tmp_path / "folder.png").mkdir()
    dataset = sweep({"R": R, "omega": OMEGA}, impacts=0, with_trajectory=False)
    with pytest.raises(Refused, match=message):
        plot(dataset, **{**options, "output": tmp_path / options.get("output", "a.png")})
    assert not (tmp_path / "a.png").exists()


def test_the_outermost_value_may_be_rounded(sweep):
    dataset = sweep({"R": [0.1 * 3, 0.1], "omega": OMEGA})
    assert "$R = 0.3$" in section(dataset, at={"R": 0.3}).get_suptitle()


def test_a_single_point_has_no_bifurcation(sweep):
    with pytest.raises(Refused, match="a single point"):
        bifurcation(sweep({}))


def test_nothing_to_draw_is_said(sweep):
    nothing = np.full((4, 5), np.nan)
    pending = np.full(4, Status.PENDING, np.int8)
    dataset = sweep({"omega": OMEGA}, status=pending, poincare_x=nothing)
    with pytest.raises(Refused, match=r"no point has a result: not computed yet .4."):
        bifurcation(dataset)
    with pytest.raises(Refused, match="nothing to draw at this point: not computed yet"):
        section(dataset)
