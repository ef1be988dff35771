"""Pictures of integrity: the colours of attractors, panels and marks, discs and knocks."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.colors import same_color, to_hex
from matplotlib.patches import Circle, PathPatch
from matplotlib.path import Path
from matplotlib.text import Text

from sweeps.attractor.knocks import Knock
from sweeps.errors import Refused
from sweeps.plotting import Page
from sweeps.plotting import integrity as draw_integrity
from sweeps.plotting.canvas import Picture
from sweeps.plotting.placed_names import name_regions
from sweeps.plotting.style import CLASSES, DOT_COLOURS
from tests.helpers.equal_points import legend_texts
from vibroimpact.status import Evidence, Status

pytestmark = pytest.mark.slow


#: 2/1 is before 1/0 at 0.4, and behind it at 0.6.
SWEEP = """
oscillator: {h: 0.1, R: 0.8, omega: 2.6, f: 1.0, clearance: [0, 0.4, 0.6]}
start: {x0: {start: -3, stop: 0, num: 16}, v0: {start: -3, stop: 3, num: 21}}
record: {transient: 200, periods: 8, impacts: 4}
"""


@pytest.mark.parametrize("panels", [[], ["fraction"], ["basins"]])
def test_starts_without_a_result_are_refused(dataset, panels):
    pending = dataset.assign(status=xr.full_like(dataset["status"], Status.PENDING))
    with pytest.raises(Refused, match=r"no point has a result: not computed yet \(1,008\)"):
        draw_integrity(pending, panels=panels)


def test_a_profile_of_no_attractor_is_refused(random_sweep):
    starts = {"omega": [1.0, 2.0], "x0": [-2, -1, 0], "v0": [-1, 0, 1]}
    unbounded = {"status": np.full(18, Status.UNBOUNDED, np.int8), "period": np.zeros(18, int)}
    unbounded |= {"class_evidence": np.full(18, Evidence.NONE, np.int8)}
    dataset = random_sweep(starts, phase=0.0, diagnostics=("period",), **unbounded)
    with pytest.raises(Refused, match="there is nothing to draw: no start reaches an attractor"):
        draw_integrity(dataset, panels=["fraction"])


def test_measures_stay_in_their_panels_and_all_marks_are_named(dataset):
    figure = draw_integrity(dataset, at={"clearance": 0.6})
    *profile, panel = figure.axes
    for measures in profile:
        low, high = measures.get_ylim()
        *lines, _ = measures.lines
        y = np.concatenate([line.get_ydata() for line in lines])
        assert low <= np.nanmin(y) and np.nanmax(y) < high
    assert np.isfinite(profile[1].lines[2].get_ydata()).any()
    legend = figure.legends[0]
    names = [text.get_text() for text in legend.get_texts()]
    handles = dict(zip(names, legend.legend_handles, strict=True))
    assert same_color(handles["lower bound"].get_markerfacecolor(), panel.get_facecolor())
    arrows = {to_hex(handle.get_color()) for text, handle in handles.items() if "knock" in text}
    knocks_drawn = [text.arrow_patch for text in panel.texts if hasattr(text, "arrow_patch")]
    drawn = {to_hex(arrow.get_edgecolor()) for arrow in knocks_drawn}
    assert arrows == drawn == {DOT_COLOURS[CLASSES[one]].lower() for one in ((2, 1), (1, 0))}
    dots = [to_hex(line.get_markerfacecolor()) for line in panel.lines]  # a line for each attractor
    assert sorted(dots) == sorted(CLASSES[one].lower() for one in ((2, 1), (1, 0)))


@pytest.mark.parametrize(
    "limits, classes",
    [
        ({"xlim": (0.3, 0.7)}, {"1/0, no impact", "2/1"}),
        ({"xlim": (-0.1, 0.1)}, {"1/1"}),
        ({"ylim": (0.7, 1.1)}, {"1/1", "2/1"}),
    ],
)
def test_the_legend_of_a_profile_names_what_is_within_the_limits(dataset, limits, classes):
    page = Page(grey=True, **limits)
    joined = dataset.roll(clearance=1, roll_coords=True)  # as of two sweeps in any order
    figure = draw_integrity(joined, panels=["fraction"], page=page)
    assert {*legend_texts(figure)} == classes
    assert all((np.diff(line.get_xdata()) > 0.0).all() for line in figure.axes[0].lines)


def test_discs_and_knocks_are_those_of_the_attractors_with_a_look(dataset, no_knocks, monkeypatch):
    monkeypatch.setattr("sweeps.plotting.style.CLASSES", {(2, 1): CLASSES[2, 1]})
    monkeypatch.setattr("sweeps.plotting.style.FURTHER", ())
    figure = draw_integrity(dataset, at={"clearance": 0.6})
    (disc,) = figure.axes[-1].patches
    (edge,) = disc.get_path_effects()  # without it no disc is seen in a dark basin
    assert no_knocks == [0] and same_color(edge._gc["foreground"], "white")
    assert "no disc and no knock for 1 other attractor" in legend_texts(figure)


def test_a_knock_that_ends_beyond_the_limits_is_said_so(dataset, no_knocks, monkeypatch):
    def named(**limits):
        options = {"panels": ["basins"], "page": Page(**limits)}
        figure = draw_integrity(dataset, at={"clearance": 0.6}, **options)
        knocks = (text for text in legend_texts(figure) if "least knock" in text)
        return ["beyond the limits" in text for text in knocks]

    knock = Knock(0.0, -1.0, 0.0, 0.5, 1.0, 0)
    worst = "sweeps.attractor.knocks._Attractors.worst"
    monkeypatch.setattr(worst, lambda motions, home, limit: knock._replace(x=-1.0 - home))
    assert named() == [False, True]  # at x = -0.38 and 0.40, where no start is
    assert named(xlim=(-3.0, -1.0)) == named(xlim=(-3.0, -1.0), grey=True) == [True, True]
    assert named(xlim=(-0.5, -0.3)) == [False, True]  # where the first one ends, not begins


def test_a_small_knock_is_written_as_a_power_of_ten(dataset, no_knocks, monkeypatch):
    knock = Knock(2e-5, -1.0, 0.0, 0.0, -5e-7, 0)
    monkeypatch.setattr("sweeps.attractor.knocks._Attractors.worst", lambda *_: knock)
    figure = draw_integrity(dataset, at={"clearance": 0.6}, panels=["basins"])
    text = next(text for text in legend_texts(figure) if "least knock" in text)
    assert r"$-5\times10^{-7}$ at $\omega t=2\times10^{-5}$" in text


def test_in_grey_the_number_of_a_knock_covers_neither_a_mark_nor_a_name(dataset, with_layout):
    page = Page(width=3.4, grey=True)
    figure = draw_integrity(dataset, at={"clearance": 0.6}, panels=["basins"], page=page)
    figure.draw_without_rendering()
    (panel,) = figure.axes
    boxes = {text: Text.get_window_extent(text) for text in panel.texts if text.get_text()}
    numbers = [text for text in boxes if text.get_text().isdigit()]
    assert {text.get_text() for text in numbers} == {"1", "2"} and len(boxes) > 2
    marks = panel.transData.transform(panel.lines[0].get_xydata())
    for number in numbers:
        assert not any(boxes[number].contains(*mark) for mark in marks)
        assert not any(boxes[number].overlaps(boxes[text]) for text in boxes.keys() - {number})


def test_names_of_basins_stay_clear_of_discs_and_knocks(dataset, with_layout):
    for height in (2.6, 4.0):
        page = Page(width=3.4, height=height)
        figure = draw_integrity(dataset, at={"clearance": 0.6}, panels=["basins"], page=page)
        figure.draw_without_rendering()
        (panel,) = figure.axes
        names = [Text.get_window_extent(text) for text in panel.texts if "/" in text.get_text()]
        knocks = [(text.xyann, text.xy) for text in panel.texts if not text.get_text()]
        lines = [Path(disc.get_verts()) for disc in panel.patches]
        lines += [Path(panel.transData.transform(knock)) for knock in knocks]
        assert names and len(lines) == 4
        assert not any(line.intersects_bbox(box, filled=False) for line in lines for box in names)


def test_a_name_stays_clear_of_the_circle_around_a_number(with_layout):
    figure = Picture(Page(width=3.4, height=1.2))
    panel = figure.add_subplot(xlim=(0, 1), ylim=(0, 1))
    circle = {"boxstyle": "circle,pad=0.15"}
    number = panel.text(0.5, 0.5, "1", size="x-small", ha="center", va="center", bbox=circle)
    strip = np.array([0.0, 0.44, 0.56, 1.0])
    (name,) = name_regions(
        panel, [np.arange(2), strip], np.array([[2], [1], [2]]), {1: "rest, 1 period"}
    )
    figure.draw_without_rendering()
    box = number.get_bbox_patch().get_window_extent()
    assert not box.overlaps(Text.get_window_extent(name))


def test_a_region_that_a_disc_divides_has_one_name(with_layout):
    panel = Picture(Page(width=3.4, height=3.4)).add_subplot(xlim=(0, 1), ylim=(0, 1))
    panel.add_patch(Circle((0.5, 0.5), 0.3, fill=False))
    (name,) = name_regions(panel, [np.arange(2), np.arange(2)], np.array([[1]]), {1: "1/1"})
    assert not Path(panel.patches[0].get_verts()).intersects_bbox(name.get_window_extent(), False)


def test_a_hatch_does_not_move_a_name(with_layout):
    panel = Picture(Page(width=3.4, height=1.2)).add_subplot(xlim=(0, 1), ylim=(0, 1))
    panel.add_artist(PathPatch(Path([[0, 0], [0.5, 0], [0.5, 1], [0, 1]]), hatch="//"))
    (name,) = name_regions(panel, [np.arange(2), np.arange(2)], np.array([[1]]), {1: "1/1"})
    np.testing.assert_allclose(name.get_position(), 0.5, atol=0.02)


def test_a_name_stays_clear_of_an_arrow(with_layout):
    panel = Picture(Page(width=3.4, height=3.4)).add_subplot(xlim=(0, 1), ylim=(0, 1))
    panel.annotate("", (0.9, 0.5), (0.1, 0.5), arrowprops={"arrowstyle": "->"})
    (name,) = name_regions(panel, [np.arange(2), np.arange(2)], np.array([[1]]), {1: "1/1"})
    assert abs(name.get_position()[1] - 0.5) > 0.02
