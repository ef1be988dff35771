"""Dots and lines can be seen on paper, on a dark ground, in grey and in the user's colours."""

import itertools

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from cycler import cycler
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure

from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting import (
    Page,
    attractor_diagram,
    bifurcation,
    impacts,
    parameter_map,
    section,
    style,
    trajectory,
)
from sweeps.plotting.colours import paint_of
from sweeps.plotting.exact_lines import without_gaps
from sweeps.plotting.looks import look_of
from sweeps.plotting.style import CLASSES
from tests.helpers.equal_points import equal_points, legend_texts
from tests.helpers.sweep_files import swept
from vibroimpact.points.regimes import Regime
from vibroimpact.status import Evidence


def contrast(colour, other="white"):
    """Return the contrast of two colours, as WCAG 2.1 defines it."""
    rgb = np.array([to_rgb(colour), to_rgb(other)])
    linear = np.where(rgb <= 0.03928, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    light = linear @ [0.2126, 0.7152, 0.0722] + 0.05
    return light.max() / light.min()


#: All classes with a colour, another one, rest, chaos, unbounded and unknown motions.
KINDS = [*style.CLASSES, (5, 7), *(regime for regime in Regime if regime in style.REGIMES)]


def every_class(R=(0.8,)):
    """Return a line of points, one of each kind, at different displacements."""
    omega = np.linspace(1.0, 4.0, len(KINDS))
    dataset = equal_points(axes={"R": np.array(R), "omega": omega})
    for i, kind in enumerate(KINDS):
        m, q = kind if isinstance(kind, tuple) else (0, 0)
        dataset["period"].values[:, i], dataset["period_impacts"].values[:, i] = m, q
        dataset["rest_fraction"].values[:, i] = 0.5 * (kind is Regime.REST)
        if kind is Regime.CHAOTIC:
            dataset["lyapunov"].values[:, i] = 0.5
        if kind is Regime.UNBOUNDED:
            dataset["status"].values[:, i] = 4
    dataset["poincare_x"].values[:] = -np.arange(len(KINDS))[:, None]
    return dataset


@pytest.mark.parametrize("grey", [False, True])
@pytest.mark.parametrize("color", ["period", "class_evidence", "status", "lyapunov"])
def test_every_dot_has_a_contrast_of_three(grey, color):
    dataset = every_class()
    for i, evidence in enumerate(Evidence):
        dataset["class_evidence"].values[:, i] = evidence
    dataset["lyapunov"].values[..., 0] = np.linspace(-1.0, 1.0, len(KINDS))
    figure = bifurcation(dataset, color=color, page=Page(grey=grey))
    panel = figure.axes[0]
    drawn = {to_hex(rgba) for dots in panel.collections for rgba in dots.get_facecolors()}
    drawn |= {line.get_color() for line in panel.lines if line.get_marker() not in ("|", "None")}
    patches = (patch for legend in figure.legends for patch in legend.get_patches())
    shown = {to_hex(patch.get_facecolor()) for patch in patches}
    assert len(drawn) >= (3 if color != "status" else 1)
    assert min(map(contrast, drawn | shown)) >= 2.995


def test_directions_impacts_and_marks_have_a_contrast_of_three():
    ways = [look.colour for pair in style.DIRECTION_LOOKS for look in pair] + [style.BOTH_COLOUR]
    marks = [*itertools.chain(*style.MARKS.values()), *style.STATUS_COLOURS.values()]
    inks = [*(look_of(key, grey=True).dots for key in style.LOOKS), *style.FURTHER]
    for colour in (*ways, *marks, *inks):
        assert contrast(style.dot_colour(colour)) >= 2.995, colour


def test_in_grey_every_class_but_chaos_has_a_marker_and_rest_is_not_unknown():
    shown = paint_of(OpenedSweep(every_class()), "period", dots=True, grey=True)
    plain = {cell.label.split(" (")[0] for cell in shown.cells if cell.look.marker == "."}
    assert plain == {"chaotic"}
    fills = {
        cell.label.split(" (")[0]: (cell.look.colour, cell.look.hatch)
        for cell in paint_of(OpenedSweep(every_class()), "period", grey=True).cells
    }
    assert len({*fills.values()}) == len(fills)
    assert fills["unknown"][1] and style.hatch_on(fills["unknown"][0]) == style.WHITE
    figure = parameter_map(every_class((0.7, 0.8)), page=Page(grey=True, width=7))
    edges = {to_hex(patch.get_edgecolor()) for patch in figure.axes[0].patches}
    assert {"#ffffff", style.HATCH} <= edges


@pytest.mark.parametrize("count", [200, 20_000])
def test_marks_cover_the_share_of_the_axis_that_motions_on_their_way_have(count):
    omega = np.linspace(1.0, 4.0, count)
    dataset = equal_points(axes={"R": np.array([0.8]), "omega": omega}).isel(section=[0])
    away = np.random.default_rng(2).permutation(count) < 0.057 * count
    dataset["orbit_distance"].values[:] = np.where(away, 0.5, 0.0)
    dataset["poincare_x"].values[0, :, 0] = np.sin(omega)
    figure = bifurcation(dataset)
    (marks,) = (line for line in figure.axes[0].lines if line.get_marker() == "|")
    places = np.unique(marks.get_xdata())
    assert legend_texts(figure)[-1] == f"on its way to m/q ({away.sum():,} of {count:,})"
    if count == 200:
        np.testing.assert_array_equal(places, omega[away])
        return
    width = figure.axes[0].get_window_extent().width * 72.0 / figure.dpi
    columns = len(np.unique(np.floor((places - 1.0) / 3.0 * width)))
    assert 0.03 < columns / width < 0.075
    assert np.isin(np.round(places, 2), np.round(omega[away], 2)).all()


def test_short_runs_do_not_alternate_along_a_branch():
    mask = np.repeat([False, True, False, True, True, False, True], [40, 3, 30, 50, 1, 2, 40])
    kept = without_gaps(mask, 5)
    assert np.count_nonzero(np.diff(kept.astype(int))) == 1
    assert kept[-90:].all() and not kept[:70].any()


def test_dashes_do_not_close_over_several_periods():
    """In the phase plane, a dashed orbit is drawn once."""
    orbit = swept({
        "oscillator": {"h": 0.1, "R": 0.8, "omega": [2.2, 2.3], "f": 1.0},
        "follow": {"axis": "omega", "direction": "both"},
        "record": {"transient": 60, "periods": 8, "diagnostics": ["period"]},
    }).isel(omega=[0])  # fmt: skip
    figure = trajectory(orbit, color="direction", periods=4, page=Page(grey=True))
    over_time, phase_plane, velocity = figure.axes
    dashed = [line for line in phase_plane.lines if line.get_linestyle() == "--"]
    dashed = [line for line in dashed if len(line.get_xdata()) > 2]
    solid = [line for line in phase_plane.lines if len(line.get_xdata()) > 100]
    assert len(dashed) == 1 and len(solid) == 2
    lengths = sorted(len(line.get_xdata()) for line in solid)
    assert lengths[0] <= 0.27 * lengths[1]
    assert "$t_0$ after" in velocity.get_xlabel()
    assert len(over_time.lines[1].get_xdata()) == lengths[1]


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
record: {transient: 60, periods: 32, diagnostics: [period, lyapunov]}
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
    assert any("chaotic" in text for text in legend_texts(figures[-1]))
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
