"""Labels of axes that a page gives, and the unit of the ticks that one names."""

import numpy as np
import pytest

from sweeps import open_sweep
from sweeps.errors import Refused
from sweeps.plotting import KINDS, Page, bifurcation, parameter_map
from tests.helpers.commands import accepted, refused
from tests.helpers.equal_points import equal_points
from tests.helpers.sweep_files import run_in
from tests.sweeps.plotting.test_overlay import RIG, TABLE, points

FILES = {"rig": RIG, "table": TABLE}
PAGE = Page(xlabel="across", ylabel="up $y$")


@pytest.mark.parametrize("kind", ["bifurcation", "section", "impacts", "trajectory"])
def test_the_first_panel_has_the_labels_of_the_page(files, kind):
    with open_sweep(files / "rig.h5") as dataset:
        options = {"below": ["impulse"]} if kind == "bifurcation" else {}
        panels = KINDS[kind].draw(dataset, page=PAGE, **options).axes
    assert panels[0].get_ylabel() == "up $y$"
    labels = [panel.get_xlabel() for panel in panels]
    assert labels.count("across") == 1
    below = kind in ("bifurcation", "trajectory")  # a panel below labels the shared axis
    assert labels[0] == ("" if below else "across")


def test_a_map_and_a_table_have_them_too(files):
    panel = parameter_map(equal_points(), page=PAGE).axes[0]
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("across", "up $y$")
    with open_sweep(files / "table.h5") as dataset:
        first, second = KINDS["table"].draw(dataset, page=PAGE).axes[:2]
    assert (first.get_xlabel(), first.get_title(loc="left")) == ("across", "up $y$")
    assert first.get_ylabel() == "" != second.get_xlabel() != "across"


@pytest.mark.parametrize(
    ("text", "factor"),
    [("no unit", 1e3), ("x [m]", 1.0), ("x (mm)", 1e3), ("x [\N{MICRO SIGN}m]", 1e6), ("[s]", 1e3)],
)
def test_a_unit_in_a_label_is_that_of_ticks_and_overlay(files, text, factor, with_layout):
    over = {"frequency": [25.0], "poincare_x": [factor * 1e-4]}
    with open_sweep(files / "rig.h5") as dataset:
        figure = bifurcation(dataset, overlay=over, page=Page(ylabel=text))
    figure.draw_without_rendering()
    axis = figure.axes[0].yaxis
    assert axis.get_label_text() == text
    for tick in axis.get_major_ticks():
        shown = tick.label1.get_text().replace("\N{MINUS SIGN}", "-")
        if shown:
            assert float(shown) == pytest.approx(factor * tick.get_loc(), abs=1e-9 * factor)
    np.testing.assert_allclose(points(figure.axes[0]), [[25.0, 1e-4]])


def test_a_label_that_cannot_be_drawn_is_refused(files):
    refusal = r"^xlabel = 'a \$x_\$ b' is not allowed; expected: a text with formulas"
    for kind in ("rig", "table"):
        with open_sweep(files / f"{kind}.h5") as dataset:
            draw = KINDS["section" if kind == "rig" else "table"].draw
            with pytest.raises(Refused, match=refusal):
                draw(dataset, page=Page(xlabel="a $x_$ b"))
            with pytest.raises(Refused, match=refusal.replace("xlabel", "ylabel")):
                draw(dataset, page=Page(ylabel="a $x_$ b"))
    with pytest.raises(Refused, match="xlabel = 1 is not allowed; expected: a text"):
        Page(xlabel=1)
    picture = str(files / "a.png")
    given = ("plot", files / "rig.h5", "--dpi", "40", "-o", picture, "--xlabel", "")
    assert accepted(*given, "--ylabel", "x [m]") == f"{picture}\n"
    assert "ylabel = 'a $x_$'" in refused(*given, "--ylabel", "a $x_$")


def test_a_panel_below_has_the_prefix_of_its_ticks_and_an_unbroken_unit(tmp_path, with_layout):
    text = RIG.replace("[period]", "[period, extremes]")
    with open_sweep(run_in(tmp_path, text)) as dataset:
        figure = bifurcation(dataset, below=["peak_to_peak", "impulse"], page=Page(width=3.4))
    figure.draw_without_rendering()
    _, travel, impulse = figure.axes
    assert travel.get_title(loc="left").endswith("[mm]")
    ticks = [tick.label1.get_text() for tick in travel.yaxis.get_major_ticks()]
    shown = [float(text) for text in ticks if text]
    np.testing.assert_allclose(shown, 1e3 * travel.get_yticks()[: len(shown)], rtol=1e-9)
    assert impulse.get_title(loc="left").endswith("[N\N{NO-BREAK SPACE}s]")
