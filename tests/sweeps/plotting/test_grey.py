"""Pictures without colour: diagrams, both directions of a sweep, sections, motions, numbers."""

import io

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.image import imread

from sweeps import branches, open_sweep, run_sweep
from sweeps.plotting import KINDS, Page, bifurcation, diagram
from sweeps.plotting.style import grey_ramp
from tests.helpers.equal_points import equal_points
from tests.sweeps.plotting.test_marks import SWEEP  # noqa: F401 - of the fixture path

PAGE = Page(grey=True)


def colourful(figure):
    """Return the greatest difference of red, green and blue in a figure, from 0 to 1."""
    figure.savefig(buffer := io.BytesIO(), format="png", dpi=40)
    buffer.seek(0)
    return np.ptp(imread(buffer)[..., :3], axis=-1).max()


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("bifurcation", {"below": ["impacts_per_period"]}),
        ("bifurcation", {"at": {"direction": "up"}}),
        ("section", {}),
        ("impacts", {"color": "impulse"}),
        ("trajectory", {}),
        ("trajectory", {"color": "direction"}),
    ],
)
def test_no_pixel_has_a_colour(dataset, kind, options):
    if kind == "bifurcation":
        options = {**options, "exact": branches(dataset, classes=[(1, 1)])}
    assert colourful(KINDS[kind].draw(dataset, page=PAGE, **options)) < 0.01


def test_a_density_has_no_colour(dataset, monkeypatch):
    monkeypatch.setattr(diagram, "DENSITY_FROM", 10)
    assert colourful(bifurcation(dataset, page=PAGE)) < 0.01
    assert colourful(bifurcation(dataset)) > 0.1


def test_each_direction_has_its_marker(dataset):
    """Both ways differ between the graze at 1.286, which long steps miss, and the fold."""
    figure = bifurcation(dataset, page=PAGE)
    (panel,), omega, drawn = figure.axes, dataset["omega"].values, {}
    for line in panel.lines:
        if line.get_marker() in "o^v" and len(line.get_xdata()):
            drawn.setdefault(line.get_marker(), set()).update(line.get_xdata().tolist())
    apart = {*omega[(omega > 1.31) & (omega < 1.6504)].tolist()}
    assert drawn == {"^": apart, "v": apart, "o": {*omega.tolist()} - apart}
    markers = {line.get_label(): line.get_marker() for line in figure.legends[0].get_lines()}
    assert list(markers.values())[:3] == ["^", "v", "o"]


def test_classes_differ_by_their_markers_and_motions_by_their_dashes(dataset):
    figure = bifurcation(dataset, color="period", page=PAGE)
    curves = KINDS["trajectory"].draw(dataset, color="direction", page=PAGE).legends[0]
    lines = figure.legends[0].get_lines()
    looks = {line.get_label(): (line.get_marker(), line.get_color()) for line in lines}
    assert {"1/0, no impact", "1/1"} <= looks.keys() and len({*looks.values()}) == len(looks)
    drawn = {(line.get_marker(), line.get_color()) for line in figure.axes[0].lines}
    assert {looks["1/1"], looks["1/0, no impact"]} <= drawn
    up, down = curves.get_lines()[:2]
    assert up.get_linestyle() != down.get_linestyle()


def test_a_map_and_a_table_of_numbers_are_grey(tmp_path):
    dataset = equal_points(lyapunov={(0, 1): 0.5, (1, 2): -np.inf}, rest_fraction={(1, 2): 0.1})
    for name in ("lyapunov", "impulse", "status"):
        assert colourful(KINDS["map"].draw(dataset, quantity=name, page=PAGE)) < 0.01, name
    rows = {"R": [0.8, 0.7, 0.75], "omega": [2.4, 2.6, 2.9]}
    scene = {"oscillator": {"h": 0.1, "f": 1.0}, "points": rows, "record": {"transient": 20}}
    with open_sweep(run_sweep(scene, tmp_path / "table.h5")) as table:
        for color in (None, "impulse"):
            assert colourful(KINDS["table"].draw(table, color=color, page=PAGE)) < 0.01


@pytest.mark.parametrize("dark", [False, True])
def test_greys_of_numbers_are_monotone_in_lightness(dark):
    colours = {"axes.facecolor": "black", "text.color": "white"} if dark else {}
    with mpl.rc_context(colours):
        levels = grey_ramp(0.1)(np.linspace(0.0, 1.0, 64))
    assert np.ptp(levels[:, :3], axis=1).max() == 0.0
    steps = np.diff(levels[:, 0])
    assert (steps > 0.0).all() if dark else (steps < 0.0).all()
