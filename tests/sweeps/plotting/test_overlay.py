"""Points of a table over pictures, labels of axes that a page gives, and their units."""

import os
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from sweeps import open_sweep
from sweeps.errors import Refused
from sweeps.opened import result_cache
from sweeps.plotting import KINDS, Page, api, bifurcation, parameter_map, plot, table_panels
from sweeps.plotting.labels import tick_in_decades
from tests.helpers.commands import SMALL, accepted, refused
from tests.helpers.equal_points import equal_points, legend_texts
from tests.helpers.sweep_files import swept
from tests.helpers.written_files import R

RIG = """\
rig: {mass: 0.5, stiffness: 8000, damping: 4, force: 8, gap: 0.0005, R: 0.7,
      frequency: {start: 22, stop: 40, num: 7}}
method: {steps_per_period: 20}
record: {transient: 20, periods: 4, impacts: 2, diagnostics: [period, extremes]}
"""
TABLE = """\
oscillator: {h: 0.1, f: 1.0}
points: {R: [0.8, 0.7, 0.75], omega: [2.4, 2.6, 2.9]}
record: {transient: 20, periods: 4, impacts: 2, diagnostics: [period]}
"""
FILES = {"rig": RIG, "table": TABLE, "small": SMALL}
#: Places within the map of `equal_points`.
PLACES = {"omega": [1.5, 2.0, 3.5], "R": [0.4, 0.6, 0.8]}


@pytest.fixture
def rig(loaded):
    return loaded["rig"]


@pytest.fixture
def table(loaded):
    return loaded["table"]


def points(panel):
    """Return the places of the points that are drawn over a panel, shape (n, 2)."""
    drawn = [each for each in panel.collections if each.get_zorder() == 7.0]
    return np.concatenate([each.get_offsets() for each in drawn])


def entries(figure):
    """Return the entries of the legend with a single marker: label, marker."""
    lines = figure.legends[0].get_lines()
    return {line.get_label(): line.get_marker() for line in lines}


@pytest.mark.parametrize(
    ("head", "factor"),
    [("poincare_x", 1e3), ("poincare_x[m]", 1.0), ("poincare_x [\N{MICRO SIGN}m]", 1e6)],
)  # fmt: skip
def test_a_column_is_in_the_unit_of_the_picture_or_in_its_own(rig, head, factor):
    """The displacements of the rig are some 0.5 mm, and its axis is in mm."""
    x = np.array([-0.4e-3, 0.1e-3, 0.45e-3])
    table = pd.DataFrame({"frequency": [23.0, 28.5, 39.0], head: factor * x})
    figure = bifurcation(rig, overlay=table)
    figure.draw_without_rendering()
    assert figure.axes[0].get_ylabel().endswith("[mm]")
    np.testing.assert_allclose(points(figure.axes[0]), np.stack([[23.0, 28.5, 39.0], x], axis=1))


def test_a_diagram_makes_room_and_names_the_labels(rig):
    Path("m.csv").write_text(
        "\N{ZERO WIDTH NO-BREAK SPACE}label,frequency,poincare_x [mm]\n"
        "before,20,0.1\n\nafter $1$,45,9\n,30,0\n_,30,0.1\nbefore,31,0.2\n",
        encoding="utf-8",
    )
    figure = bifurcation(rig, overlay="m.csv")
    (left, right), (low, high) = figure.axes[0].get_xlim(), figure.axes[0].get_ylim()
    assert left < 20.0 and 45.0 < right and low < 0.0 and 9e-3 < high
    assert [*entries(figure)][1:] == ["before", r"after \$1\$", "m", " _"]
    assert [*entries(figure).values()][1:] == ["o", "s", "D", "^"]
    figure = bifurcation(rig, overlay="m.csv", page=Page(xlim=(25, 32), width=3.4))
    assert figure.axes[0].get_xlim() == (25.0, 32.0)
    assert figure.axes[0].get_ylim()[1] < 8e-3  # fits what is seen
    assert {"before (1 of 2 outside)", r"after \$1\$ (1 of 1 outside)"} <= entries(figure).keys()


def test_a_panel_below_has_its_own_column(rig):
    table = {"frequency": [25.0, 35.0], "impulse": [0.1, 0.9]}
    above, below = bifurcation(rig, below="impulse", overlay=table).axes
    assert not [each for each in above.collections if each.get_zorder() == 7.0]
    np.testing.assert_array_equal(points(below), [[25.0, 0.1], [35.0, 0.9]])
    assert below.get_ylim()[1] > 0.9


def test_a_map_keeps_its_limits_and_gives_measured_values_its_colours():
    dataset = equal_points(impulse={(0, 0): 0.5, (2, 3): 1.0})
    plain = parameter_map(dataset, quantity="impulse")
    figure = parameter_map(dataset, quantity="impulse", overlay={**PLACES, "impulse": [0.5, 1, 2]})
    panel = figure.axes[0]
    assert panel.get_xlim() == plain.axes[0].get_xlim()
    np.testing.assert_array_equal(points(panel), np.transpose([*PLACES.values()]))
    (mesh, drawn) = (panel.collections[0], panel.collections[-1])
    colours = [to_hex(colour) for colour in drawn.get_facecolors()]
    assert colours[:2] == [to_hex(mesh.cmap(0.0)), to_hex(mesh.cmap(1.0))]
    over = {"omega": [2.0, 9.0], "R": [0.5, 0.5], "label": [1, 1]}
    figure = parameter_map(dataset, overlay=over, page=Page(grey=True))
    assert "1 (1 of 2 outside)" in legend_texts(figure)


def test_the_picture_of_a_table_has_the_points_in_the_panels_of_their_columns(table):
    measured = {"omega": [2.5], "impulse": [0.3]}
    panels = table_panels(table, quantity="impulse", overlay=measured).axes[:2]
    with_points = [panel for panel in panels if len(panel.collections) > 1]
    (panel,) = with_points
    np.testing.assert_array_equal(points(panel), [[2.5, 0.3]])
    assert "omega" in panel.get_xlabel()
    assert panel.collections[0].get_sizes() == [8.0]  # the dots of three rows show their colour


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("omega,poincare_c\n2,1\n", "the picture has no poincare_c (did you mean poincare_x?)"),
        ("omega,poincare_x,R\n2,1,1\n", "the picture has no R; expected: columns out of omega, "
         "poincare_x, label"),
        ("omega;poincare_x\n2;1\n", "with commas between them"),
        ("omega [1];poincare_x [1]\n2;1\n", "with commas between them"),
        ("omega\n2\n", "there is no column poincare_x"),
        ("omega,poincare_x [mm]\n2,1\n", "poincare_x in mm is not allowed; expected: no unit"),
        ("omega,poincare_x,poincare_x\n2,1,1\n", "column poincare_x is given twice"),
        ("omega,poincare_x\n2,1\n2,one\n", "row 2, column poincare_x = one is not allowed"),
        ("omega,poincare_x\n1.7e308,0\n", "omega = 1.7e308 is not allowed; expected: a number "),
        ("omega,poincare_x\n2,\n", "row 1, column poincare_x = (nothing) is not allowed"),
        ("omega,poincare_x\n2,1,1\n", "row 1 has 3 cells, and the header 2"),
        ("omega,poincare_x\n", "the table has no row"),
        ("", "the table is empty"),
        ("omega,poincare_x,label\n" + "".join(f"2,1,{i}\n" for i in range(11)), "11 labels"),
    ],
)  # fmt: skip
def test_a_wrong_table_is_refused_before_anything_is_computed(files, monkeypatch, text, told):
    Path("out.h5").symlink_to(files / "small.h5")
    Path("m.csv").write_text(text)
    monkeypatch.setattr(result_cache, "with_cache", lambda *_: pytest.fail("orbits are computed"))
    for exact in ((), ("--exact",)):
        message = refused("plot", "out.h5", "--kind", "bifurcation", "--overlay", "m.csv", *exact)
        assert "overlay m.csv: " in message and told in message.replace("\n", " ")


def test_no_output_replaces_the_table_and_other_pictures_take_none(files):
    Path("out.h5").symlink_to(files / "small.h5")
    Path("m.csv").write_text("omega,poincare_x\n2,0\n")
    os.link("m.csv", "m.png")
    told = refused("plot", "out.h5", "--exact", "--overlay", "m.csv", "--csv", "m.csv")
    assert "the table m.csv would replace the data" in told
    told = refused("plot", "out.h5", "--overlay", "m.csv", "-o", "m.png")
    assert "the picture m.png would replace the data" in told
    with open_sweep("out.h5") as dataset, pytest.raises(Refused, match="would replace the data"):
        plot(dataset, "m.png", "bifurcation", overlay="m.csv")
    told = refused("plot", "out.h5", "--kind", "section", "--overlay", "m.csv")
    assert "overlay can be chosen for bifurcation or map or table only" in told
    assert "does not exist" in refused("plot", "out.h5", "--overlay", "missing.csv")
    told = refused("plot", "out.h5", "--overlay", "m.csv", "--axis", "omega", "--xlim", "1.5:1.9")
    assert "no point of the overlay is within the limits" in told
    arguments = ("--axis", "omega", "--overlay", "m.csv", "--dpi", "50")
    assert accepted("plot", "out.h5", *arguments) == "out-omega-overlay-m.png\n"


PAGE = Page(xlabel="across", ylabel="up $y$")


@pytest.mark.parametrize("kind", ["bifurcation", "section", "impacts", "trajectory"])
def test_the_first_panel_has_the_labels_of_the_page(rig, kind):
    options = {"below": ["impulse"]} if kind == "bifurcation" else {}
    panels = KINDS[kind].draw(rig, page=PAGE, **options).axes
    assert panels[0].get_ylabel() == "up $y$"
    labels = [panel.get_xlabel() for panel in panels]
    assert labels.count("across") == 1
    below = kind in ("bifurcation", "trajectory")  # a panel below labels the shared axis
    assert labels[0] == ("" if below else "across")


def test_a_map_and_a_table_have_them_too(table):
    panel = parameter_map(equal_points(), page=PAGE).axes[0]
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("across", "up $y$")
    first, second = KINDS["table"].draw(table, page=PAGE).axes[:2]
    assert (first.get_xlabel(), first.get_title(loc="left")) == ("across", "up $y$")
    assert first.get_ylabel() == "" != second.get_xlabel() != "across"


@pytest.mark.parametrize(
    ("text", "factor"),
    [("no unit", 1e3), ("x [m]", 1.0), (r"x ($\mu$m)", 1e6), ("(s)", 1e3)],
)
def test_a_unit_in_a_label_is_that_of_ticks_and_overlay(rig, text, factor):
    over = {"frequency": [25.0], "poincare_x": [factor * 1e-4]}
    figure = bifurcation(rig, overlay=over, page=Page(ylabel=text))
    figure.draw_without_rendering()
    axis = figure.axes[0].yaxis
    assert axis.get_label_text() == text
    for tick in axis.get_major_ticks():
        shown = tick.label1.get_text().replace("\N{MINUS SIGN}", "-")
        if shown:
            assert float(shown) == pytest.approx(factor * tick.get_loc(), abs=1e-9 * factor)
    np.testing.assert_allclose(points(figure.axes[0]), [[25.0, 1e-4]])


def test_limits_are_in_the_unit_that_the_axis_shows(files, rig, monkeypatch):
    drawn, path = [], files / "rig.h5"
    monkeypatch.setattr(api, "save", lambda figure, *about: drawn.append(figure))
    wanted = ("plot", path, "--kind", "bifurcation", "--ylim")
    for limits in ("-0.9:0.5", "-0.9:0.5mm", "-900:500 um", "-0.0009:0.0005m"):
        accepted(*wanted, limits)
    accepted(*wanted, "-0.09:0.05")
    drawn.append(bifurcation(rig, page=Page(ylim=(-0.9e-3, 0.5e-3))))
    units, ends = ["mm", "mm", "\N{MICRO SIGN}m", "m", "mm", "mm"], np.array([-0.9e-3, 0.5e-3])
    for number, (figure, unit) in enumerate(zip(drawn, units, strict=True)):
        figure.draw_without_rendering()
        panel = figure.axes[0]
        assert panel.get_ylabel().endswith(f"[{unit}]")  # also where its own prefix is another
        np.testing.assert_allclose(panel.get_ylim(), 0.1 * ends if number == 4 else ends)
    told = refused(*wanted, "-1:1km")
    assert "ylim = -1:1 in km is not allowed; expected: m or mm" in told
    assert "--ylim 1mm is not allowed" in refused(*wanted, "1mm")


def test_the_start_of_a_motion_is_said_where_its_time_stands(rig):
    draw = partial(KINDS["trajectory"].draw, rig, at={"frequency": 25}, periods=4)
    plain, own = draw(), draw(page=Page(title=""))
    label = own.axes[-1].get_xlabel().replace("\N{NO-BREAK SPACE}", " ")
    assert "$t-t_0$ [s], $t_0=" in label and "t_0=" not in plain.axes[-1].get_xlabel()
    title = plain.get_suptitle().replace("\N{NO-BREAK SPACE}", " ")
    assert label.split(", ")[-1] in title


def test_a_label_that_cannot_be_drawn_is_refused(files, rig, table):
    refusal = r"^xlabel = 'a \$x_\$ b' is not allowed; expected: a text with formulas"
    for kind, dataset in (("section", rig), ("table", table)):
        with pytest.raises(Refused, match=refusal):
            KINDS[kind].draw(dataset, page=Page(xlabel="a $x_$ b"))
        with pytest.raises(Refused, match=refusal.replace("xlabel", "ylabel")):
            KINDS[kind].draw(dataset, page=Page(ylabel="a $x_$ b"))
    with pytest.raises(Refused, match="xlabel = 1 is not allowed; expected: a text"):
        Page(xlabel=1)
    picture = str(files / "a.png")
    given = ("plot", files / "rig.h5", "--dpi", "40", "-o", picture, "--xlabel", "")
    assert accepted(*given, "--ylabel", "x [m]") == f"{picture}\n"
    assert "ylabel = 'a $x_$'" in refused(*given, "--ylabel", "a $x_$")


def test_a_panel_below_has_the_prefix_of_its_ticks_and_an_unbroken_unit(rig, with_layout):
    figure = bifurcation(rig, below=["peak_to_peak", "impulse"], page=Page(width=3.4))
    figure.draw_without_rendering()
    _, travel, impulse = figure.axes
    assert travel.get_title(loc="left").endswith("[mm]")
    ticks = [tick.label1.get_text() for tick in travel.yaxis.get_major_ticks()]
    shown = [float(text) for text in ticks if text]
    np.testing.assert_allclose(shown, 1e3 * travel.get_yticks()[: len(shown)], rtol=1e-9)
    assert impulse.get_title(loc="left").endswith("[N\N{NO-BREAK SPACE}s]")


def test_a_bar_has_the_prefix_of_its_ticks_and_so_has_a_measured_value(with_layout):
    dataset = swept(RIG, "record.diagnostics=[extremes]", "rig.gap=[0.0005, 0.0006, 0.0007]")
    over = {"frequency": [25.0, 31.0], "gap": [0.6, 0.6], "peak_to_peak": [2.0, 9.0]}
    figure = parameter_map(dataset, quantity="peak_to_peak", overlay=over)
    figure.draw_without_rendering()
    panel, bar = figure.axes
    assert bar.get_xlabel().endswith("[mm]") and panel.get_ylabel().endswith("[mm]")
    ticks = [(tick.label1.get_text(), tick.get_loc()) for tick in bar.xaxis.get_major_ticks()]
    shown, places = zip(*((float(text), place) for text, place in ticks if text), strict=True)
    np.testing.assert_allclose(shown, 1e3 * np.array(places), rtol=1e-9)
    mesh, drawn = panel.collections[0], panel.collections[-1]
    expected = mesh.cmap(mesh.norm([2e-3, 9e-3]))
    np.testing.assert_allclose(drawn.get_facecolors(), expected)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("h", "omega", "page"),
    [
        ((1e-3, 1e4), (1.0, 7.0), {"width": 2.6, "height": 2.8, "xlim": (2.2, 4.8)}),
        ((0.02, 0.2), (1e-3, 0.5), {"width": 1.6}),
        ((1e-6, 1.0), (1e-3, 1e3), {"width": 12.0, "height": 9.0}),
        ((0.1, 0.2), (0.9999, 1.0001), {"width": 3.0}),
    ],
)
def test_labels_of_an_axis_are_legible(random_sweep, with_layout, h, omega, page):
    """They do not touch in a panel of any size, and at least two of them tell the scale."""
    spaced = np.geomspace if omega[1] > 2.0 * omega[0] else np.linspace
    axes = {"h": spaced(*h, 8), "omega": spaced(*omega, 9)}
    figure = parameter_map(random_sweep(axes), page=Page(**page, title=""), quantity="impulse")
    figure.draw_without_rendering()
    for axis, side in zip((figure.axes[0].xaxis, figure.axes[0].yaxis), "xy", strict=True):
        ticks = [tick.label1 for tick in axis.get_major_ticks() if tick.label1.get_text()]
        boxes = [getattr(text.get_window_extent(), f"interval{side}") for text in ticks]
        assert len(boxes) > 1
        assert all(after[0] >= before[1] for before, after in pairwise(map(tuple, boxes)))


def test_a_label_is_clear_of_the_common_part_of_its_ticks(random_sweep, with_layout):
    dataset = random_sweep({"R": R, "omega": 1e-120 * np.arange(1, 9)})
    figure = parameter_map(dataset, page=Page(width=2.0))
    figure.draw_without_rendering()
    axis = figure.axes[0].xaxis
    offset, label = (text.get_window_extent() for text in (axis.get_offset_text(), axis.label))
    assert axis.get_offset_text().get_text() == "1e\N{MINUS SIGN}120" and not offset.overlaps(label)


def test_every_logarithmic_axis_has_two_labels_and_no_more_than_room():
    axis, random = Figure().subplots().xaxis, np.random.default_rng(1)
    tick_in_decades(axis)
    locator = axis.get_major_locator()
    for _ in range(1000):
        low = 10.0 ** random.uniform(-250.0, 290.0)
        high = low * 10.0 ** random.uniform(0.02, random.choice([1.5, 15.0]))
        most = int(random.integers(2, 10))
        locator.set_params(numticks=most)
        ticks = [tick for tick in locator.tick_values(low, high) if low <= tick <= high]
        assert 2 <= len(ticks) <= max(3, most)
