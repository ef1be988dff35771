"""Extremes as ordinate, limits in the unit of the ticks, the start of a motion, and TIFF."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image

from sweeps import plotting
from sweeps.plotting import Page
from tests.helpers.commands import accepted, refused
from tests.helpers.sweep_files import run_in

SWEEP = """\
rig: {mass: 2.0, stiffness: 8000.0, damping: 12.0, force: 10.0, gap: 0.0005, R: 0.8,
      frequency: {start: 8.0, stop: 12.0, num: 30}}
record: {transient: 50, periods: 8, diagnostics: [period, extremes]}
"""
PLAIN = """\
oscillator: {h: 0.1, R: 0.8, f: 1, omega: {start: 2.0, stop: 3.0, num: 12}}
record: {transient: 50, periods: 8}
"""


@pytest.mark.parametrize("name", ["peak_to_peak", "x_min", "x_max"])
def test_an_extreme_is_the_ordinate_of_a_diagram(path, dataset, name):
    panel = plotting.bifurcation(dataset, coordinate=name).axes[0]
    (dots,) = (line for line in panel.lines if line.get_marker() == "o" and len(line.get_ydata()))
    x_min, x_max = dataset["x_min"].values, dataset["x_max"].values
    expected = {"peak_to_peak": x_max - x_min, "x_min": x_min, "x_max": x_max}[name]
    np.testing.assert_array_equal(dots.get_ydata(), expected)
    assert "displacement" in panel.get_ylabel()
    accepted("plot", path, "--coordinate", name, "--dpi", "40", "-o", "a.png")


def test_an_extreme_that_is_not_there_is_refused_before_anything_is_computed(folder, path):
    run_in(folder, PLAIN, name="plain.h5")
    told = refused("plot", "plain.h5", "--coordinate", "peak_to_peak")
    assert "peak_to_peak follows from x_min" in told
    assert "record.diagnostics: [period, extremes]" in told
    told = refused("plot", path, "--coordinate", "peak_to_peek")
    assert "did you mean peak_to_peak?" in told and "x_max" in told
    assert not [*Path().glob("*.png")]


def test_limits_are_in_the_unit_that_the_axis_shows(path, dataset, monkeypatch):
    drawn = []
    monkeypatch.setattr(plotting.api, "save", lambda figure, *about: drawn.append(figure))
    wanted = ("plot", path, "--kind", "bifurcation", "--ylim")
    for limits in ("-0.9:0.5", "-0.9:0.5mm", "-900:500 um", "-0.0009:0.0005m"):
        accepted(*wanted, limits)
    accepted(*wanted, "-0.09:0.05")
    for figure in drawn:
        figure.draw_without_rendering()
    *same, close = (figure.axes[0] for figure in drawn)
    for panel in same:
        np.testing.assert_allclose(panel.get_ylim(), (-0.9e-3, 0.5e-3))
    assert [panel.get_ylabel().split()[-1] for panel in same] == [
        "[mm]", "[mm]", "[\N{MICRO SIGN}m]", "[m]"
    ]  # fmt: skip
    assert close.get_ylabel().endswith("[mm]")  # also where its own prefix would be another
    np.testing.assert_allclose(close.get_ylim(), (-0.09e-3, 0.05e-3))
    told = refused(*wanted, "-1:1km")
    assert "ylim = -1:1 in km is not allowed; expected: m or mm" in told
    assert "--ylim 1mm is not allowed" in refused(*wanted, "1mm")
    figure = plotting.bifurcation(dataset, page=Page(ylim=(-0.9e-3, 0.5e-3)))
    np.testing.assert_allclose(figure.axes[0].get_ylim(), (-0.9e-3, 0.5e-3))


def test_the_start_of_a_motion_is_said_where_its_time_stands(dataset):
    frequency = {"omega": float(dataset["omega"][3])}
    plain = plotting.trajectory(dataset, at=frequency, periods=4)
    own = plotting.trajectory(dataset, at=frequency, periods=4, page=Page(title=""))
    label = own.axes[-1].get_xlabel()
    assert "$t-t_0$ [s], $t_0=" in label and "t_0=" not in plain.axes[-1].get_xlabel()
    assert label.split(", ")[-1].replace("\N{NO-BREAK SPACE}", " ") in (
        plain.get_suptitle().replace("\N{NO-BREAK SPACE}", " ")
    )


def test_a_tiff_has_the_pixels_of_the_png_and_its_description(path):
    for name in ("a.png", "a.tiff"):
        accepted("plot", path, "--dpi", "60", "--width", "3.4in", "-o", name)
    with Image.open("a.tiff") as image:
        assert image.mode == "RGB" and image.info["compression"] == "tiff_lzw"
        assert image.info["dpi"] == pytest.approx((60, 60), abs=0.01)
        assert "configuration:" in image.tag_v2[270] and "vibroimpact" in image.tag_v2[305]
        pixels = np.asarray(image) / 255.0
    np.testing.assert_allclose(pixels, imread("a.png")[..., :3], atol=1e-6)
    assert ".tiff" in refused("plot", path, "-o", "a.tfif")
