"""Pictures without colour: diagrams, both directions of a sweep, sections and motions."""

import io

import numpy as np
import pytest
from matplotlib.image import imread

from sweeps import branches, open_sweep
from sweeps.errors import Refused
from sweeps.plotting import KINDS, Page, bifurcation, diagram
from tests.helpers.commands import accepted
from tests.helpers.sweep_files import run_in
from tests.sweeps.plotting.test_marks import FOLLOWED

PAGE = Page(grey=True)


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    return run_in(tmp_path_factory.mktemp("sweep"), FOLLOWED)


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
        ("impacts", {}),
        ("trajectory", {}),
    ],
)
def test_no_pixel_has_a_colour(stored, kind, options):
    with open_sweep(stored) as dataset:
        if kind == "bifurcation":
            options = {**options, "exact": branches(dataset, classes=[(1, 1)])}
        draw = KINDS[kind].draw
        assert colourful(draw(dataset, page=PAGE, **options)) < 0.01
        assert colourful(draw(dataset, **options)) > 0.1


def test_a_density_has_no_colour(stored, monkeypatch):
    monkeypatch.setattr(diagram, "DENSITY_FROM", 10)
    with open_sweep(stored) as dataset:
        assert colourful(bifurcation(dataset, page=PAGE)) < 0.01


def test_each_direction_has_its_marker(stored):
    """Both ways differ between the graze at 1.286, which long steps miss, and the fold."""
    with open_sweep(stored) as dataset:
        (panel,) = bifurcation(dataset, page=PAGE).axes
        omega = dataset["omega"].values
    drawn = {}
    for line in panel.lines:
        if line.get_marker() in "o^v" and len(line.get_xdata()):
            drawn.setdefault(line.get_marker(), set()).update(line.get_xdata().tolist())
    apart = {*omega[(omega > 1.31) & (omega < 1.6504)].tolist()}
    assert drawn == {"^": apart, "v": apart, "o": {*omega.tolist()} - apart}
    figure = bifurcation(open_sweep(stored), page=PAGE)
    markers = {line.get_label(): line.get_marker() for line in figure.legends[0].get_lines()}
    assert list(markers.values())[:3] == ["^", "v", "o"]


def test_points_with_a_color_have_no_greys(stored):
    with open_sweep(stored) as dataset:
        for kind in ("bifurcation", "section"):
            with pytest.raises(Refused, match="color gives points colours, and in grey"):
                KINDS[kind].draw(dataset, color="period", page=PAGE)
    assert accepted("plot", stored, "--grey", "--dpi", "40", "-o", "a.png") == "a.png\n"
