"""Colours without a meaning come from the settings of matplotlib, also on a dark ground."""

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from cycler import cycler
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from sweeps.plotting import (
    Page,
    attractor_diagram,
    bifurcation,
    impacts,
    parameter_map,
    section,
    trajectory,
)
from sweeps.plotting.style import CLASSES
from tests.helpers.equal_points import equal_points
from tests.sweeps.plotting.test_contrast import contrast

#: Flips to chaos, followed both ways past a graze: every line and colour of a diagram is there.
CONFIG = """\
name: all lines
oscillator:
  h: 0.1
  R: 0.8
  omega: {start: 2.3, stop: 3.1, num: 25}
  f: 1.0
  clearance: [0.0, 0.1]
follow: {axis: omega, direction: both}
record: {transient: 60, periods: 12, diagnostics: [period, lyapunov]}
"""


@pytest.fixture(params=["dark_background", "black panels"])
def dark(request):
    """Draw with a style of matplotlib, or with nothing but black panels, and black texts."""
    black = {"axes.facecolor": "black"}
    style = black if request.param == "black panels" else request.param
    with plt.style.context(style):
        yield


def drawn_colours(panel):
    """Yield the colour of every line, marker and cloud of points of a panel."""
    for line in panel.lines:
        yield line.get_color()
        if line.get_marker() not in ("None", "", None) and line.get_markersize() > 3.0:
            yield line.get_markeredgecolor()
    for points in panel.collections:
        yield from {tuple(rgba) for rgba in points.get_facecolors()}


@pytest.mark.slow
def test_nothing_is_dark_on_a_dark_panel(dataset, dark):
    at, seen = {"omega": 2.9, "clearance": 0.1}, 0
    figures = [attractor_diagram(dataset, page=Page(grey=True))]
    figures += [draw(dataset, at=at) for draw in (section, impacts, trajectory)]
    figures += [bifurcation(dataset, below=["lyapunov"]), bifurcation(dataset, color="period")]
    for figure in figures:
        for panel in figure.axes:
            for colour in drawn_colours(panel):
                seen += 1
                assert contrast(colour, "black") > 2.2, (panel.get_ylabel(), colour)
    assert seen > len(figures)


def test_names_curves_and_marks_are_legible_on_their_edge(dark):
    dataset = equal_points(axes={"R": np.linspace(0.3, 0.9, 40), "omega": np.linspace(1, 4, 60)})
    figure = parameter_map(dataset)
    (name,) = figure.axes[0].texts
    (edge,) = name.get_path_effects()
    assert contrast(name.get_color(), edge._gc["foreground"]) > 10.0
    assert contrast(edge._gc["foreground"], "black") == 1.0
    (patch,) = figure.legends[0].get_patches()
    assert to_hex(patch.get_facecolor()) == CLASSES[1, 1].lower()  # a class keeps its colour
    assert contrast(patch.get_edgecolor(), "black") > 10.0


@pytest.mark.slow
def test_data_of_one_kind_have_the_colours_of_the_cycle(dataset):
    at = {"omega": 2.9, "clearance": 0.0}
    one = {"direction": "up"}
    with mpl.rc_context({"axes.prop_cycle": cycler(color=["#aa0011", "#00aa22"])}):
        figures = [draw(dataset, at=at) for draw in (section, impacts, trajectory)]
        figures += [bifurcation(dataset, at=one), bifurcation(dataset, at=one, below="impulse")]
    for figure in figures:
        colours = [to_hex(line.get_color()) for line in figure.axes[-1].lines]
        assert "#aa0011" in colours
    assert "#00aa22" in [to_hex(line.get_color()) for line in figures[2].axes[0].lines]
    figure = Figure()
    plain = section(dataset, at=at, ax=figure.subplots())
    assert to_hex(plain.axes[0].lines[0].get_color()) == to_hex("C0")


def test_numbers_on_a_map_have_the_colours_of_the_settings():
    dataset = equal_points(impulse={(0, 0): 0.5})
    with mpl.rc_context({"image.cmap": "magma"}):
        chosen = parameter_map(dataset, quantity="impulse").axes[0].collections[0]
    usual = parameter_map(dataset, quantity="impulse").axes[0].collections[0]
    assert (chosen.cmap.name, usual.cmap.name) == ("magma", "cividis")
