"""Numbers per point on maps, below a diagram and as colours: of the file or computed from it."""

import numpy as np
import pytest
from matplotlib.colors import to_hex, to_rgba
from matplotlib.text import Text

from sweeps.errors import Refused
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting import (
    bifurcation,
    diagram,
    impacts,
    parameter_map,
    plot,
    section,
    style,
    table_panels,
    trajectory,
)
from sweeps.plotting.looks import period_cells
from sweeps.store.xarray_engine import open_sweep
from tests.helpers.equal_points import legend
from tests.helpers.sweep_files import swept
from vibroimpact import Status

SWEEP = """
oscillator: {h: 0.05, R: [0.6, 0.8], f: 1.0, omega: {start: 2.2, stop: 3.4, num: 13}}
record: {transient: 200, periods: 8, impacts: 4, diagnostics: [period, lyapunov]}
"""


#: The sweep with 500 samples of each period, in mm and s.
RECORDED = SWEEP.replace("impacts: 4", "trajectory: {every: 1}, impacts: 4")
RECORDED = RECORDED.replace("lyapunov", "extremes") + "method: {steps_per_period: 500}\n"
FILES = {"recorded": RECORDED + "units: {length: mm, time: s}\n"}


@pytest.fixture
def recorded(loaded):
    return loaded["recorded"]


def own(dataset, **about):
    """Return a quantity that changes its sign."""
    values = dataset["impulse"] * dataset["omega"] - 3.0
    return values.rename("thrust").assign_attrs(about)


def points_of(figure):
    (marks,) = (c for c in figure.axes[0].collections if len(c.get_offsets()))
    return np.asarray(marks.get_offsets()), marks.get_facecolors()


def test_a_quantity_of_ones_own_is_mapped_with_its_label_and_units(dataset):
    figure = parameter_map(dataset, quantity=own(dataset, long_name="thrust", units="kN"))
    mesh = figure.axes[0].collections[0]
    np.testing.assert_array_equal(mesh.get_array(), own(dataset).values)
    assert mesh.norm(0.0) == 0.5  # both signs
    assert figure.axes[1].get_xlabel() == "thrust [kN]"
    turned = parameter_map(dataset, quantity=own(dataset).transpose())
    np.testing.assert_array_equal(turned.axes[0].collections[0].get_array(), own(dataset).values)
    assert turned.axes[1].get_xlabel() == "thrust"
    twice = (dataset["impulse"] * 2.0).rename("twice")  # with the attributes of the impulse
    masked = dataset["impulse"].where(dataset["R"] > 0.7)
    selected = [*(dataset["impulse"].sel(each) for each in ({"R": 0.6}, {"omega": 2.2})), masked]
    selected += [dataset["impulse"].transpose(), "impulse"]
    given = [parameter_map(dataset, quantity=each) for each in (twice, *selected)]
    first, *labels = [figure.axes[1].get_xlabel() for figure in given]
    assert first == "twice" and {*labels} == {
        r"impulse on the stop per forcing period and mass $J$"
    }
    given = dataset["impulse"].copy(data=2.0 * dataset["impulse"]).assign_attrs(units="kN")
    x = dataset["poincare_x"]
    parts = [given, dataset["impulse"].astype("f4"), x.isel(section=2), x.max("section")]
    labels = [parameter_map(dataset, quantity=part).axes[1].get_xlabel() for part in parts]
    assert labels == [
        "impulse [kN]", r"impulse on the stop per forcing period and mass $J$",
        r"displacement at the section $x$", "poincare_x",
    ]  # fmt: skip


@pytest.mark.slow
def test_the_mean_force_is_what_holds_the_spring(recorded):
    """A periodic motion has no mean acceleration or speed: the stop takes -p^2 times the mean x."""
    figure = parameter_map(recorded, quantity="mean_force")
    drawn = figure.axes[0].collections[0].get_array()
    label = r"mean force on the stop per mass $\overline{F}$ [mm/s$^2$]"
    assert figure.axes[1].get_xlabel() == label
    settled = (recorded["orbit_distance"] < 1e-9) & recorded["period"].isin([1, 2, 4, 8])
    settled &= recorded["rest_fraction"] == 0.0
    t, x = recorded["trajectory_t"].values, recorded["trajectory_x"].values
    for point in np.argwhere(settled.values):
        seen = np.isfinite(t[tuple(point)])
        times, places = t[tuple(point)][seen], x[tuple(point)][seen]
        mean_x = np.trapezoid(places, times) / (times[-1] - times[0])
        assert drawn[tuple(point)] == pytest.approx(-mean_x, rel=1e-4)
    assert settled.sum() > 10
    (below,) = bifurcation(recorded, at={"R": 0.8}, below="mean_force").axes[1].lines
    np.testing.assert_array_equal(below.get_ydata(), drawn[1])


def test_the_mean_force_has_no_value_where_the_mass_rests():
    points = swept(SWEEP, "oscillator.R=[0.1, 0.8]", "oscillator.omega.start=0.5")
    rests = (points["rest_fraction"] > 0.0).values
    figure = parameter_map(points, quantity="mean_force")
    assert 0 < rests.sum() < rests.size
    np.testing.assert_array_equal(figure.axes[0].collections[0].get_array().mask, rests)
    assert "rest" in legend(figure)


@pytest.mark.slow
def test_any_variable_of_the_dataset_is_mapped_also_if_it_is_given_as_a_dataarray(dataset):
    wider = dataset.assign(loud=dataset["fastest_impact"] > 1.0, phase_now=dataset["omega"] * 2.0)
    for name in ("chatters", "orbit_x", "class_evidence", "loud", "phase_now", "R"):
        parameter_map(wider, quantity=name).draw_without_rendering()
    assert "repeats" in legend(parameter_map(dataset, quantity="class_evidence"))
    one, other = (parameter_map(dataset, quantity=q) for q in ("period", dataset["period"]))
    assert legend(one) == legend(other) and "1/1" in legend(one)


def test_a_quantity_of_ones_own_is_drawn_below(dataset):
    given = own(dataset, long_name="thrust", units="kN")
    figure = bifurcation(dataset, at={"R": 0.8}, below=["impulse", given])
    panel = figure.axes[2]
    assert panel.get_title("left") == "thrust [kN]"
    np.testing.assert_array_equal(panel.lines[0].get_ydata(), given.sel(R=0.8).values)
    cut = bifurcation(dataset, at={"R": 0.8}, below=given.sel(R=0.8)).axes[1].lines[0]
    np.testing.assert_array_equal(cut.get_ydata(), panel.lines[0].get_ydata())
    nowhere = dataset["impulse"] * np.nan
    for draw in (
        lambda: bifurcation(dataset, at={"R": 0.8}, below=nowhere),
        lambda: bifurcation(dataset, at={"R": 0.8}, below=dataset["impulse"].sel(R=0.6)),
        lambda: parameter_map(dataset, quantity=nowhere),
    ):
        with pytest.raises(Refused, match="no point has a finite value of the given impulse"):
            draw()


def test_numbers_from_another_program_without_attributes_are_drawn(dataset, recorded):
    """pandas keeps no attributes, also none of the axes."""
    table = dataset["impulse"].rename("learnt").to_dataframe()["learnt"]
    learnt = table.to_xarray()
    drawn = [
        parameter_map(dataset, quantity=learnt),
        parameter_map(dataset.assign(learnt=learnt), quantity="learnt"),
    ]
    for figure in drawn:
        assert figure.axes[0].get_xlabel() == r"forcing frequency $\omega$"
        assert figure.axes[1].get_xlabel() == "learnt"
    bare = recorded.drop_attrs().assign_attrs(recorded.attrs)
    for draw in (
        lambda sweep: bifurcation(sweep, at={"R": 0.8}, below="impulse"),
        lambda sweep: bifurcation(sweep, at={"R": 0.8}, below=sweep["impulse"]),
        lambda sweep: trajectory(sweep, at={"R": 0.8, "omega": 2.2}),
        lambda sweep: parameter_map(sweep, quantity="mean_force"),
    ):
        texts = [
            [text.get_text() for text in draw(sweep).findobj(Text)] for sweep in (recorded, bare)
        ]
        assert texts[0] == texts[1]
    assert not bare["omega"].attrs


def test_numbers_from_a_record_read_no_other(files, recorded):
    with open_sweep(files / "recorded.h5") as lazy:
        parameter_map(OpenedSweep(lazy), quantity=recorded["poincare_x"].max("section"))
        assert not lazy["poincare_x"].variable._in_memory


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda q: q.mean("R"), None),
        (lambda q: q.assign_coords(h=0.1), "thrust is at other values of the axes"),
        (lambda q: q.isel(omega=0, R=0), "thrust is over no dimension; expected: numbers over R, "),
        (lambda q: q.expand_dims(shot=3), "thrust is over shot, R, omega; expected: numbers over"),
        (lambda q: q.isel(R=0).assign_coords(R=0.65), "thrust is at other values of the axes"),
        (lambda q: q.isel(omega=slice(3)), "thrust is at other values of the axes; expected"),
        (lambda q: q.astype(str), "thrust holds <U.*; expected: numbers over R, omega"),
        (lambda q: q.values, "is not allowed; expected: (a name or a|names or) DataArray"),
    ],
)
@pytest.mark.parametrize("draw", ["quantity", "below", "color"])
def test_a_dataarray_that_does_not_fit_is_refused(dataset, draw, change, message):
    picture = parameter_map if draw == "quantity" else bifurcation
    given = {draw: [change(own(dataset))] if draw == "below" else change(own(dataset))}
    if message is None:
        assert picture(dataset, **given)
        return
    with pytest.raises(Refused, match=message):
        picture(dataset, **given)


def dots_of_map(dataset):
    """Return the colours that dots have, by the labels of a map without the names of others."""
    of_map = {text.partition(":")[0]: each for text, each in legend(parameter_map(dataset)).items()}
    return {text: style.dot_colour(colour.upper()).lower() for text, colour in of_map.items()}


def test_the_classes_have_the_colours_of_the_map_in_every_picture(dataset):
    """Also a class that is rare in the file but frequent in the line that is drawn."""
    of_map = dots_of_map(dataset)
    line = dataset.sel(R=0.8)
    figure = bifurcation(dataset, at={"R": 0.8}, color="period")
    shown = {text: colour for text, colour in legend(figure).items() if "/" in text}
    assert len(shown) > 2 and shown.items() <= of_map.items()
    offsets, colours = points_of(figure)
    expected = {}
    for cell in period_cells(*OpenedSweep(line).classes):
        of_dots = style.dot_colour(cell.look.dots)
        expected |= dict.fromkeys(line["omega"].values[cell.where], to_rgba(of_dots))
    assert {tuple(c[:3]) for c in colours} > {to_rgba(style.DOT_COLOURS[style.CLASSES[1, 1]])[:3]}
    for (x, _), colour in zip(offsets, colours, strict=True):
        assert tuple(colour[:3]) == expected[x][:3]


def test_an_exponent_colours_by_a_bar_and_the_panel_below_alike(dataset):
    figure = bifurcation(dataset, at={"R": 0.8}, color="lyapunov", below="impulse")
    assert figure.axes[-1].get_xlabel() == r"larger Lyapunov exponent $\lambda_1$"
    by_omega = {}
    for panel in figure.axes[:2]:
        (marks,) = (c for c in panel.collections if len(c.get_offsets()))
        pairs = zip(np.asarray(marks.get_offsets())[:, 0], marks.get_facecolors(), strict=True)
        by_omega |= {(x, tuple(colour[:3])): None for x, colour in pairs}
    assert len(by_omega) == 13
    bright = np.array([sum(colour) for _, colour in by_omega])
    assert bright.max() < 2.6  # visible on white paper


def test_sections_of_all_points_or_of_those_left_have_the_colours(dataset):
    for draw, names in ((section, ("poincare_x", "poincare_v")),
                        (impacts, ("impact_phase", "impact_v"))):  # fmt: skip
        figure = draw(dataset, color="omega", at={"R": 0.8})
        offsets, colours = points_of(figure)
        columns = [dataset[name].sel(R=0.8).values for name in names]
        finite = np.isfinite(columns[0])
        np.testing.assert_array_equal(offsets.T, [column[finite] for column in columns])
        assert len(np.unique(colours, axis=0)) == 13
        assert "omega" in figure.axes[1].get_xlabel()
    assert len(points_of(section(dataset, color="R"))[0]) == dataset["poincare_x"].size


def test_a_few_values_of_an_axis_are_named_in_the_legend(dataset):
    """The colours of the file: each section has that of its value."""
    sweep = OpenedSweep(dataset).at_values({"omega": [3.4, 2.2]})
    figure = section(sweep, color="omega", at={"R": 0.8})
    shown = legend(figure)
    assert list(shown) == [r"$\omega=2.2$", r"$\omega=3.4$"]
    offsets, colours = points_of(figure)
    for omega, colour in zip([2.2, 3.4], shown.values(), strict=True):
        own = [dataset[name].sel(R=0.8, omega=omega) for name in ("poincare_x", "poincare_v")]
        of_colour = [to_hex(one) == colour for one in colours]
        np.testing.assert_array_equal(offsets[of_colour].T, own)
    assert len(figure.axes) == 1  # no colour bar


@pytest.mark.slow
def test_the_motions_of_those_left_have_the_colours(dataset):
    figure = trajectory(dataset, color="omega", at={"R": 0.8})
    several = [panel.lines for panel in figure.axes[:3]]
    assert "omega" in figure.axes[3].get_xlabel()
    assert "after 208 forcing periods" in figure.get_suptitle()
    colours = np.array([to_rgba(line.get_color()) for line in several[0][:13]])
    assert (np.diff(colours[:, :2].sum(axis=1)) > 0.0).all()  # cividis: from blue to yellow
    for i in (0, 6, 12):
        omega = dataset["omega"].values[i]
        alone = trajectory(dataset, at={"R": 0.8, "omega": omega})
        for panel, lines in zip(alone.axes, several, strict=True):
            np.testing.assert_array_equal(panel.lines[0].get_xydata(), lines[i].get_xydata())
            assert to_rgba(lines[i].get_color()) == tuple(colours[i])


@pytest.mark.slow
def test_motions_have_the_class_colours_and_no_stop_where_it_moves(dataset):
    figure = trajectory(dataset, color="period", periods=1)
    assert all(t[-1] < 3.0 for t in (line.get_xdata() for line in figure.axes[0].lines[:26]))
    of_map = dots_of_map(dataset)
    assert {text: c for text, c in legend(figure).items() if "/" in text}.items() <= of_map.items()
    stopped = dataset.rename(R="clearance", clearance="R")
    moving = trajectory(stopped, color="period", periods=1)
    assert [len(one.axes[1].lines) for one in (figure, moving)] == [27, 26]


@pytest.mark.slow
def test_what_motions_share_is_said_and_what_cannot_be_told_apart_refused(dataset, monkeypatch):
    monkeypatch.setattr("sweeps.opened.coordinates.MOST_DRAWN", 135)
    figure = trajectory(dataset, color="period", at={"R": 0.8}, periods=20)
    assert "after 208 forcing periods, 130 of 260 periods" in figure.get_suptitle()
    t = figure.axes[0].lines[0].get_xdata()
    assert t[-1] == pytest.approx(20 * 2.0 * np.pi / 2.2) and np.isnan(t).any()
    with pytest.raises(Refused, match="tells several motions apart, and only one point is left"):
        trajectory(dataset, color="period", at={"R": 0.8, "omega": 2.8})
    monkeypatch.setattr("sweeps.plotting.motion_pictures._MOST_MOTIONS", 25)
    with pytest.raises(Refused, match="26 motions is not readable; choose at most 25 points"):
        trajectory(dataset, color="period")


def test_a_motion_that_failed_is_left_out(dataset):
    broken = dataset.sel(R=0.8).copy(deep=True)
    broken["status"].values[3] = Status.UNRESOLVED
    assert len(trajectory(broken, color="omega", periods=1).axes[2].lines) == 12


def test_recorded_trajectories_are_coloured(recorded):
    figure = trajectory(recorded, color="impulse", at={"R": 0.8})
    first = recorded["trajectory_t"].values[1, 0, 0]
    t = figure.axes[0].lines[0].get_xdata()
    assert t[-1] == pytest.approx(8 * 2.0 * np.pi / 2.2)
    again = f"after {first * 2.2 / (2.0 * np.pi):.6g} forcing periods"
    assert again in figure.get_suptitle()


def test_a_dense_diagram_keeps_the_colours(dataset, monkeypatch):
    monkeypatch.setattr(diagram, "DENSITY_FROM", 10)
    figure = bifurcation(dataset, at={"R": 0.8}, color="period")
    (mesh,) = figure.axes[0].collections
    image = np.asarray(mesh.get_array())
    assert len(figure.axes) == 1  # no bar of a density
    seen = {to_hex(colour) for colour in image.reshape(-1, 4) if colour[3] > 0.0}
    assert seen == {colour for text, colour in legend(figure).items() if "on its way" not in text}


def test_a_class_without_a_dot_is_not_in_the_legend():
    """A motion without impacts has no dot over them."""
    oscillator = {"h": 0.1, "R": 0.8, "omega": 2.6, "f": 1.0, "clearance": 0.6}
    points = swept(
        {"oscillator": oscillator, "start": {"x0": {"start": -2, "stop": 0.6, "num": 7}, "v0": 1}}
    )
    both, over_impacts = (
        [*legend(bifurcation(points, color="period", coordinate=coordinate))]
        for coordinate in ("poincare_x", "impact_v")
    )
    assert both == ["1/0, no impact", "2/1"] and over_impacts == ["2/1"]
    assert [*legend(impacts(points, color="period"))] == ["2/1"]
    with pytest.raises(Refused, match="no point has a finite value of impact_phase"):
        impacts(points.where(points["period_impacts"] == 0, drop=True), color="period")


@pytest.mark.slow
def test_the_points_of_a_table_are_coloured():
    table = "points: {omega: [2.4, 2.5, 2.6], part: [1.0, 2.0, 3.0]}\n"
    points = swept(table + "oscillator: {h: 0.1, R: 0.8, f: 1.0}\n")
    square = (points["omega"] ** 2).rename("square").drop_attrs()
    figure = table_panels(points, quantity="impulse", color="part", axes=[square])
    assert [panel.get_xlabel() for panel in figure.axes] == ["square", "part"]
    plot(points, "a.png", color=points["impulse"], quantity=points["omega"])
    with pytest.raises(Refused, match="no point has a finite value of the given impulse"):
        table_panels(points, quantity=points["impulse"] * np.nan)


def test_the_peak_to_peak_displacement_is_what_the_samples_nearly_reach(recorded):
    """With 500 samples a period, those beside a turn miss at most about (pi / 500)^2 / 2 of it."""
    figure = parameter_map(recorded, quantity="peak_to_peak")
    drawn = figure.axes[0].collections[0].get_array()
    assert figure.axes[1].get_xlabel() == r"peak-to-peak displacement $x_\mathrm{pp}$ [mm]"
    x = recorded["trajectory_x"]
    sampled = (x.max("sample") - x.min("sample")).values
    (below,) = bifurcation(recorded, at={"R": 0.8}, below="peak_to_peak").axes[1].lines
    assert recorded["x_min"].attrs["units"] == recorded["x_max"].attrs["units"] == "mm"
    np.testing.assert_allclose(drawn, sampled, rtol=1e-4)
    assert (drawn >= sampled).all() and (drawn > sampled).any()
    np.testing.assert_array_equal(below.get_ydata(), drawn[1])


@pytest.mark.parametrize("name", ["peak_to_peak", "x_min", "x_max"])
def test_an_extreme_is_the_ordinate_of_a_diagram(recorded, name):
    panel = bifurcation(recorded, coordinate=name, at={"R": 0.8}).axes[0]
    (dots,) = (line for line in panel.lines if line.get_marker() == "o" and len(line.get_ydata()))
    x_min, x_max = (recorded[each].sel(R=0.8).values for each in ("x_min", "x_max"))
    expected = {"peak_to_peak": x_max - x_min, "x_min": x_min, "x_max": x_max}[name]
    np.testing.assert_array_equal(dots.get_ydata(), expected)
    assert "displacement" in panel.get_ylabel()
    with pytest.raises(Refused, match=r"did you mean peak_to_peak\?.*x_max"):
        bifurcation(recorded, coordinate="peak_to_peek")
