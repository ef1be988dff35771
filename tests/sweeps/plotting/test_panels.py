"""The panels of a picture that are asked for, of a table, and basins beside each other."""

from itertools import combinations
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
import yaml
from matplotlib.figure import Figure
from numpy.testing import assert_array_equal

from sweeps import plotting
from sweeps.errors import Refused
from sweeps.plotting import Page, attractor_diagram, basins, integrity, table_panels
from tests.helpers.commands import accepted, refused
from tests.helpers.equal_points import legend_texts
from tests.helpers.sweep_files import swept
from tests.sweeps.config.test_points import FIXED, GRIDS, RECORD, shuffled, write_csv

STARTS = {"x0": {"start": -3, "stop": 0, "num": 6}, "v0": {"start": -2, "stop": 2, "num": 6}}
SWEEP = {"oscillator": {"h": 0.05, "R": 0.8, "omega": [2.6, 2.65, 2.7], "f": 1.0}}
SWEEP |= {"start": STARTS, "record": {"transient": 200}}


ROWS = {"R": [0.8, 0.7, 0.75], "omega": [2.4, 2.6, 2.9], "f": [1.0, 1.1, 1.2]}
FILES = {"table": {"oscillator": {"h": 0.1}, "points": ROWS, "record": {"transient": 20}}}


@pytest.fixture
def table(loaded):
    return loaded["table"]


def titles(figure):
    return [panel.get_title(loc="left") for panel in figure.axes]


def test_an_integrity_picture_has_the_panels_in_the_order_typed(dataset, no_knocks):
    figure = integrity(dataset, panels=["local_integrity", "fraction"])
    assert integrity(dataset, page=Page(width=3.4)).get_figheight() <= 9.0
    one = integrity(dataset, panels=["basins"], at={"omega": 2.65})
    assert titles(figure) == ["local integrity, a distance", "share of the starts"]
    assert [panel.get_xlabel() for panel in figure.axes].count("") == 1
    assert not {"largest disc", "attractors at the section"} & {*legend_texts(figure)}
    assert titles(one) == [r"basins at $\omega=2.65$"]
    assert "lower bound" not in legend_texts(one)


def test_the_panels_asked_for_are_drawn_into_panels_of_another_figure(dataset, no_knocks):
    own = Figure().subplots(2)
    assert integrity(dataset, panels=["fraction", "basins"], ax=own) is own[0].figure
    assert own[0].lines and own[1].collections
    own = Figure().subplots(2)
    integrity(dataset, panels=["fraction", "basins"], ax=own, page=Page(legend=False))
    handles, names = own[1].get_legend_handles_labels()
    assert not own[1].get_legend()
    usual = integrity(dataset, panels=["fraction", "basins"])
    assert sorted(names) == sorted(legend_texts(usual)) and "lower bound" not in names
    own[0].figure.legend(handles, names)
    own[0].figure.savefig("own.svg")


def test_labels_of_panels_do_not_collide(table, dataset, with_layout):
    with mpl.rc_context({"font.size": 14.0}):
        figure = table_panels(table)
        figure.draw_without_rendering()
        diagram = plotting.bifurcation(dataset, page=Page(width=3.35))
        diagram.draw_without_rendering()
    boxes = [panel.xaxis.label.get_window_extent() for panel in figure.axes]
    assert len(boxes) == 3
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    label, title = diagram.axes[0].yaxis.label, diagram._suptitle
    assert not label.get_window_extent().overlaps(title.get_window_extent())


@pytest.mark.parametrize("choice", ["panels", "axes"])
def test_a_panel_of_another_figure_takes_no_second_abscissa(table, choice):
    own = Figure().subplots()
    with pytest.raises(Refused, match="ax is one panel, and R, omega take 2: choose one"):
        table_panels(table, ax=own, **{choice: ["R", "omega"]})
    assert table_panels(table, ax=own, **{choice: ["omega"]}) is own.figure
    own.set_xscale("log")
    assert table_panels(table, ax=own, **{choice: ["omega"]}) is own.figure


def test_one_row_of_a_table_is_refused(table):
    with pytest.raises(Refused, match="one row of the table is left; expected: rows"):
        table_panels(table.isel(point=0))


def test_a_table_has_the_panels_in_the_order_typed(table):
    figure = table_panels(table, panels=["omega", "R"])
    labels = [panel.get_xlabel() for panel in figure.axes if panel.get_xlabel()]
    meanings = ["forcing frequency", "coefficient of restitution"]
    assert [label.split(" $")[0] for label in labels] == meanings
    assert "further" not in "".join(legend_texts(figure))


def test_other_panels_are_refused_with_the_nearest_name(path, files):
    wrong = refused("plot", path, "--kind", "integrity", "--panels", "basins,fractoin")
    assert "there is no panel fractoin (did you mean fraction?)" in wrong
    assert "integrity_factor" in wrong and "basins" in wrong
    table = files / "table.h5"
    said = refused("plot", table, "--panels", "h")
    assert "there is no panel h; choose from: R, omega, f" in said
    assert "the panel R is asked for twice" in refused("plot", table, "--panels", "R, R")
    said = refused("plot", path, "--kind", "basins", "--panels", "basins")
    assert "panels can be chosen for integrity or table only" in said


def test_too_many_panels_are_refused_by_default_and_drawn_at_a_height(table):
    axes = ["omega", "R", "f", "impulse", "energy_lost", "period", "period_impacts", "status"]
    axes += ["rest_fraction", "max_penetration", "orbit_x", "orbit_v", "chatters", "near_grazes"]
    with pytest.raises(Refused, match=r"at least 1[0-9.]+ in high; expected: at most 9 in"):
        table_panels(table, axes=axes, page=Page(width=2.0))
    high = table_panels(table, axes=axes, page=Page(width=2.0, height=30.0))
    assert high.get_figheight() == 30.0
    fit = table_panels(table, axes=axes, panels=axes[:3], page=Page(width=2.0))
    assert fit.get_figheight() <= 9.0


@pytest.mark.parametrize(("width", "panels"), [(3.4, 6), (7.0, 8)])
def test_a_table_fits_a_page_and_counts_the_columns_left_out(width, panels):
    names = ["h", "R", "omega", "p", "f", "clearance", "x0", "v0"]
    points = {name: np.linspace(0.4, 0.5, 5).tolist() for name in names}
    record = {"transient": 5, "periods": 4, "diagnostics": ["period"]}
    figure = table_panels(swept({"points": points, "record": record}), page=Page(width=width))
    assert figure.get_figheight() <= 9.0
    assert len([panel for panel in figure.axes if panel.get_xlabel()]) == panels
    assert ("2 further columns" in legend_texts(figure)) == (panels < 8)


@pytest.mark.parametrize(
    ("width", "grey", "across"),
    [(2.0, True, 1), (3.4, True, 2), (5.0, False, 3)],
)
def test_basins_of_several_values_fit_a_column(dataset, width, grey, across, with_layout):
    """A layout that has no room is a warning, which fails; those of a narrow one are below."""
    page = Page(width=width, grey=grey)
    figure = basins(dataset, beside={"omega": [2.6, 2.65, 2.7]}, page=page)
    figure.draw_without_rendering()
    boxes = [panel.get_window_extent() for panel in figure.axes]
    assert len({round(box.x0) for box in boxes}) == across
    for box in boxes:
        assert min(box.width, box.height) > 0.8 * figure.dpi and box.width < 2.0 * box.height


@pytest.mark.parametrize("page", [Page(), Page(xlim=(-2.0, -1.0), ylim=(-1.0, 1.0))])
def test_basins_of_several_values_have_one_legend_with_all_shares(dataset, page):
    figure = basins(dataset, beside={"omega": [2.6, 2.7]}, page=page)
    alone = [basins(dataset, at={"omega": value}, page=page) for value in (2.6, 2.7)]
    assert titles(figure) == [r"$\omega=2.6$", r"$\omega=2.7$"]
    for panel, one in zip(figure.axes, alone, strict=True):
        cells = [axes.collections[0].get_array() for axes in (panel, one.axes[0])]
        both = zip((panel, one.axes[0]), cells, strict=True)
        colours = [axes.collections[0].to_rgba(array) for axes, array in both]
        np.testing.assert_array_equal(*colours)
    shown = legend_texts(figure)
    assert len(figure.legends) == 1 and len(shown) == len({*shown})
    shares = [[float(one) for one in text.split(": ")[1].removesuffix(" %").split(", ")]
              for text in shown if text.endswith("%")]  # fmt: skip
    np.testing.assert_allclose(np.sum(shares, axis=0), 100.0, atol=0.3)


def test_several_values_of_basins_are_drawn_and_limited(path):
    given = ("plot", path, "--kind", "basins", "--dpi", "40", "-o", "a.png")
    assert accepted(*given, "--at", "omega=2.6,2.7") == "a.png\n"
    many = ",".join(f"{2.6 + 0.01 * i:.2f}" for i in range(7))
    said = refused(*given, "--at", f"omega={many}")
    assert "7 values beside each other; expected: at most 6" in said
    assert "the same nearest grid value" in refused(*given, "--at", "omega=2.6,2.601")


def test_attractors_between_values_of_the_axis_are_refused(dataset):
    with pytest.raises(Refused, match=r"xlim .* 2.6, 2.65$"):
        attractor_diagram(dataset, page=Page(xlim=(2.61, 2.63)))


CONFIG = f"points: table.csv\n{FIXED}\n{RECORD}\n"


@pytest.mark.slow
def test_commands_of_a_line_or_a_plane_refuse_a_table(unpainted):
    write_csv({"R": [0.5, 0.6], "omega": [2.0, 2.1], "note": ["a", "b"]})
    accepted("run", "sweep.yaml", "-o", "out.h5", "--quiet")
    table = "needs a swept axis, and the points of this file are the rows of a table"
    for options in (["--kind", "map"], ["--kind", "bifurcation"], ["--kind", "attractors"]):
        assert table in refused("plot", "out.h5", *options)
    assert "basins need two of x0, v0, phase" in refused("plot", "out.h5", "--kind", "basins")
    assert "not for table" in refused("plot", "out.h5", "--exact")
    assert table in refused("info", "out.h5", "--bifurcations")
    assert "no axis to zoom into" in refused("zoom", "out.h5", "omega=2:2.05")
    assert "no rows of the table differ" in refused("attractors", "out.h5")
    assert "there is no omga (did you mean omega?)" in refused("plot", "out.h5", "--axis", "omga")
    assert "note is not a number for each point" in refused("plot", "out.h5", "--quantity", "note")
    accepted("plot", "out.h5", "--at", "point=2")  # the motion of a row
    accepted("info", "out.h5")


@pytest.mark.slow
def test_the_picture_of_a_table_has_a_panel_for_each_column_that_varies():
    columns, _ = shuffled(GRIDS["plain"])
    weight = np.arange(columns["R"].size) * 0.5
    points = {**columns, "x0": np.zeros(weight.size), "weight": weight}
    points = {name: values.tolist() for name, values in points.items()}
    dataset = swept({"points": points, **yaml.safe_load(f"{FIXED}\n{RECORD}")})
    figure = plotting.table_panels(dataset, quantity="impulse")
    assert len(figure.axes) == 3  # x0 does not vary
    for panel, name in zip(figure.axes, ("R", "omega", "weight"), strict=True):
        (drawn,) = panel.collections
        assert_array_equal(drawn.get_offsets()[:, 0], dataset[name])
        assert_array_equal(drawn.get_offsets()[:, 1], dataset["impulse"])
        assert len(np.unique(drawn.get_facecolors(), axis=0)) > 2  # classes
    (panel,) = plotting.table_panels(dataset, axes=["impulse"], quantity="lyapunov").axes
    assert_array_equal(panel.collections[0].get_offsets()[:, 0], dataset["impulse"])
    with pytest.raises(Refused, match="point cannot be fixed here"):
        plotting.table_panels(dataset, at={"point": 3.0})
    plotting.plot(dataset, "out.svg")
    svg = Path("out.svg").read_text()
    assert "transient: " in svg and "points:" not in svg  # a million rows would take minutes
