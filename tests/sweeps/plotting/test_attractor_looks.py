"""The colours, hatches and names of attractors in basins, diagrams and integrity plots."""

import re
from functools import cache
from io import BytesIO
from itertools import combinations

import numpy as np
import pytest
from matplotlib.colors import to_hex, to_rgb
from PIL import Image

from sweeps.attractor.knocks import Knock
from sweeps.plotting import KINDS, Page
from sweeps.plotting.looks import _further
from sweeps.plotting.style import CLASSES, DOT_COLOURS, FURTHER, LOOKS
from tests.helpers.equal_points import legend_texts
from vibroimpact import Oscillator, simulate

#: Two orbits of the class 1/3 at each frequency.
SWEEP = """\
oscillator: {h: 0.05, R: 0.9, omega: [0.9462, 0.9576], f: 1.0, clearance: -0.5}
start: {x0: {start: -3.5, stop: -0.5, num: 13}, v0: {start: -3.0, stop: 3.0, num: 12}}
record: {transient: 400, periods: 32, impacts: 16}
"""


#: Stands for the least knock of each attractor, which takes long to find.
KNOCK = Knock(0.0, -1.0, 0.0, 0.5, 1.0, 0)


@pytest.fixture(scope="module")
def drawn(dataset, tmp_path_factory):
    """Return a function that draws a picture of the file, one for all tests that look at it."""
    kept = tmp_path_factory.mktemp("kept")

    @cache
    def draw(kind, omega=None, *, grey=False):
        at = None if omega is None else {"omega": omega}
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("sweeps.attractor.knocks._Attractors.worst", lambda *_: KNOCK)
            patch.setattr("sweeps.opened.result_cache.root", lambda: kept)
            return KINDS[kind].draw(dataset, at=at, page=Page(grey=grey))

    return draw


def further(points):
    """Return the further looks of attractors; a point is a list of their number, m and q."""
    most = max(map(len, points))
    filled = np.array([[*point, *[(-1, -1, -1)] * (most - len(point))] for point in points])
    return _further(*np.moveaxis(filled, -1, 0))


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ([[(0, 1, 1), (1, 2, 1)]], {}),
        ([[(0, 1, 1), (1, 1, 1)]], {(1, 1, 1): 0}),
        ([[(0, 1, 3), (1, 1, 1), (2, 1, 3)]], {(0, 1, 3): 0, (2, 1, 3): 1}),
        # Never beside each other.
        ([[(0, 1, 1)], [(1, 1, 1)]], {}),
        ([[(0, 1, 1)], [(0, 2, 2), (1, 1, 1)], [(1, 2, 2)]], {}),
        # Also where the first one of the class is gone.
        ([[(0, 1, 1), (1, 1, 1)], [(1, 1, 1)]], {(1, 1, 1): 0}),
        # Chaos and rest have the colours of their regimes.
        ([[(0, 1, 1), (1, 0, 0), (2, 0, 0)]], {}),
    ],
)
def test_only_the_first_attractor_of_a_class_has_the_colour_of_the_class(points, expected):
    assert further(points) == expected


def test_colours_that_are_used_up_are_those_of_attractors_that_are_not_beside():
    many = [[(number, 5, number)] for number in range(len(FURTHER) + 2)]
    chosen = further(many)
    assert sorted(chosen.values()) == [0, 0, 1, 1, *range(2, len(FURTHER))]
    beside = further([[point for (point,) in many]])
    assert list(beside.values()) == [*range(len(FURTHER)), None, None]


def legend(figure):
    """Return the colour and the hatch of each patch of the legend, by its text."""
    (one,) = figure.legends
    pairs = zip(one.get_texts(), one.legend_handles, strict=True)
    return {
        text.get_text(): (to_hex(handle.get_facecolor()), handle.get_hatch())
        for text, handle in pairs
        if hasattr(handle, "get_hatch")
    }


@pytest.mark.slow
def test_two_orbits_of_a_class_are_told_apart_by_colour_and_by_a_state(drawn):
    """A motion from a state of the legend is back there after 60 periods, as `simulate` finds."""
    found = legend(drawn("basins", 0.9576))
    assert {look for look in found.values()} == {(colour.lower(), "") for colour in FURTHER[:2]}
    for text in found:
        assert re.match(r"1/3: [\d., ]+; \d+\.\d %\nat ", text)
        x, v = (float(re.search(rf"\${name}=(-?[\d.]+)\$", text)[1]) for name in "xv")
        oscillator = Oscillator(h=0.05, R=0.9, omega=0.9576, f=1.0, clearance=-0.5)
        motion = simulate(oscillator, x0=x, v0=v, periods=60)
        np.testing.assert_allclose([motion.x[-1], motion.v[-1]], [x, v], atol=2e-3)
    grey = legend(drawn("basins", 0.9576, grey=True))
    assert set(grey) == set(found)
    looks = [(LOOKS[one][1].colour.lower(), LOOKS[one][1].hatch) for one in FURTHER[:2]]
    assert [*grey.values()] == looks


@pytest.mark.slow
def test_the_colours_are_the_same_in_all_three_pictures_of_a_file(drawn):
    of_basins = legend(drawn("basins", 0.9462))
    by_state = {re.search(r"at .*", text)[0]: look[0] for text, look in of_basins.items()}
    assert len(by_state) == 2
    by_state = {text: DOT_COLOURS[colour.upper()].lower() for text, colour in by_state.items()}
    (panel,) = drawn("attractors").axes
    lines = [line for line in panel.lines if not line.get_label().startswith("_")]
    named = {line.get_label(): to_hex(line.get_color()) for line in lines}
    at = {text: colour for text, colour in named.items() if "at" in text}
    diagram = {re.search(r"at (.*), \$\\omega", text)[0][:-9]: c for text, c in at.items()}
    assert {text.removesuffix(","): colour for text, colour in diagram.items()} == by_state
    profile = drawn("integrity").axes[0]
    assert {to_hex(line.get_color()) for line in profile.lines[:-1]} >= set(by_state.values())


@pytest.mark.slow
def test_a_grey_picture_has_no_colour_and_names_all_classes(drawn):
    figures = [drawn("basins", 0.9576, grey=True), drawn("attractors", grey=True),
               drawn("integrity", grey=True)]  # fmt: skip
    for figure in figures:
        image = BytesIO()
        figure.savefig(image, format="png", dpi=40)
        assert np.ptp(np.asarray(Image.open(image).convert("RGB"), int), axis=2).max() == 0
        assert sum(text.startswith("1/3") for text in legend_texts(figure)) >= 2
    assert "1/3" in {text.get_text()[:3] for text in figures[0].axes[0].texts}


#: Least difference of two inks of one shape, from 0 for black to 1 for white.
LEAST = 0.2


def test_any_two_attractors_in_grey_differ_in_shape_or_clearly_in_ink():
    """In lines by the dashes, and in dots by the marker."""
    for (one, (_, first)), (other, (_, second)) in combinations(LOOKS.items(), 2):
        inks = abs(to_rgb(first.dots)[0] - to_rgb(second.dots)[0])
        assert inks >= LEAST or first.marker != second.marker, (one, other)
        assert inks >= LEAST or first.dash != second.dash, (one, other)


def test_two_orbits_of_a_class_have_their_own_markers_and_dashes_in_grey(drawn):
    """The first two further looks; without them, the legend tells the orbits by ink alone."""
    diagram = drawn("attractors", grey=True)
    (legend,), (panel,) = diagram.legends, diagram.axes
    markers = [handle.get_marker() for handle in legend.legend_handles]
    assert len(set(markers)) == 2 and "o" not in markers
    for marker in markers:  # at each of the two frequencies, there is a marker at each orbit
        marks = [line.get_xdata() for line in panel.lines if line.get_marker() == marker]
        assert sorted(np.concatenate(marks)) == [0.9462, 0.9576]
    profile = drawn("integrity", grey=True)
    (legend,) = profile.legends
    of_lines = [each for each in legend.legend_handles if hasattr(each, "get_marker")]
    of_lines = [each for each in of_lines if each.get_marker() in markers]
    assert len(of_lines) == 2
    dashes = {line._unscaled_dash_pattern[1] for line in of_lines}
    assert len(dashes) == 2 and None not in dashes
    for panel in profile.axes[:3]:
        lines = [line for line in panel.lines if list(line.get_xdata()) == [0.9462, 0.9576]]
        assert {line.get_marker() for line in lines} >= set(markers)
        assert {line._unscaled_dash_pattern[1] for line in lines} >= dashes


def test_the_legend_says_which_of_two_orbits_of_a_class_a_knock_disturbs(drawn):
    (legend,) = drawn("integrity").legends
    texts = [text.get_text() for text in legend.get_texts()]
    states = {re.search("at (.*)", text)[1] for text in texts if text.startswith("1/3: ")}
    knocks = [text for text in texts if text.startswith("least knock")]
    named = {re.match(r"least knock, 1/3 at (.*):\n", text)[1] for text in knocks}
    assert len(named) == len(knocks) == 2 and named == states


def test_every_look_of_a_class_and_of_further_attractors_is_its_own():
    looks = [LOOKS[key][1][:3:2] for key in (*CLASSES, *FURTHER)]
    assert len(set(looks)) == len(looks)
    assert not set(FURTHER) & set(CLASSES.values())


def test_names_of_two_states_fit_a_column_in_grey(dataset, with_layout, no_knocks):
    KINDS["integrity"].draw(dataset, page=Page(width=3.4, grey=True)).draw_without_rendering()
