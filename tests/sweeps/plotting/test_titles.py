"""Titles of several lines, and titles that cannot be drawn."""

from io import BytesIO

import pytest
from matplotlib._mathtext import Parser
from matplotlib.backends import backend_agg
from matplotlib.mathtext import MathTextParser

from sweeps import load_config
from sweeps.errors import Refused
from sweeps.plotting import Page, bifurcation
from sweeps.plotting.canvas import Picture
from sweeps.plotting.labels import method_text
from tests.helpers.commands import call
from tests.helpers.written_files import OMEGA

NEWMARK = {
    "oscillator": {"h": 0.1, "R": 0.8, "omega": 2.0, "f": 1.0},
    "method": {"integrator": "newmark", "impact": "reduced-step", "steps_per_period": 120},
}
LOOSE = "$h=0.05$, $R=0.8$, costs 5$"  # an odd number of signs: all are drawn as such


def height_within(figure):
    """Return the height of the title of a figure, which is not wider than the figure."""
    title = figure._suptitle.get_window_extent()
    assert title.width <= figure.bbox.width
    return title.height


def test_a_title_is_broken_again_if_the_width_changes():
    figure = Picture(Page(width=6.0))
    figure.add_title(5 * "some words of a title ")
    wide = height_within(figure)
    figure.set_figwidth(3.0)
    assert height_within(figure) > 1.8 * wide
    figure.set_size_inches(6.0, 4.0)
    assert height_within(figure) == wide


@pytest.fixture
def parsed(monkeypatch):
    """List the formulas that are parsed, with their sizes and resolutions."""
    parsed, parse = [], Parser.parse

    def counted(self, text, fonts, size, dpi):
        parsed.append((text, size, dpi))
        return parse(self, text, fonts, size, dpi)

    monkeypatch.setattr(Parser, "parse", counted)
    monkeypatch.setattr(backend_agg, "MathTextParser", MathTextParser)  # not that of all tests
    return parsed


def test_a_formula_is_parsed_once_for_each_resolution(with_layout, parsed):
    """Also if the height changes: for the title, for the legend, for the page, and by the user."""
    figure = Picture(Page(width=3.4, height=4.0))
    panel = figure.add_subplot(xlabel=r"frequency $\omega$", ylabel="place $x$")
    figure.add_title("$h=0.05$, $R=0.8$, $f=1$, some words of a title that is too wide")
    figure.add_legend(panel.plot([0.0, 1.0], label=r"$\lambda_1$"), None)
    figure.set_height()
    for dpi in (100.0, 150.0):
        figure.savefig(BytesIO(), format="png", dpi=dpi)
    figure.set_figheight(5.0)
    assert figure.axes[0].xaxis.label.get_window_extent().width > 0.0
    assert {text for text, *_ in parsed} >= {"$\\lambda_1$", "place $x$", "$h=0.05$, $R=0.8$,"}
    assert len(parsed) == len(set(parsed)) > 8


def test_a_title_with_a_loose_sign_is_drawn_or_refused():
    for text in (LOOSE, " ".join(5 * [LOOSE]), 8 * "costs 5$ ", "costs \\$5, " * 8):
        for width in (1.5, 3.4, 6.0):
            figure = Picture(Page(width=width))
            try:
                figure.add_title(text)
            except Refused as error:
                assert r"and \$ for the sign" in str(error) and text != LOOSE
            else:
                height_within(figure)


def test_a_title_of_too_many_levels_is_refused():
    for braces in ("{" * 300, "{" * 300 + "x" + "}" * 300):
        with pytest.raises(Refused, match=r"^title = .* but matplotlib cannot draw it"):
            Picture(Page(width=6.0)).add_title(f"${braces}$")


def test_a_title_names_the_method_unless_it_is_exact():
    named = method_text(load_config(NEWMARK).sweep.spec)
    parts = ["newmark", "impact rule reduced-step", "120 steps per period"]
    assert [part.replace("\N{NO-BREAK SPACE}", " ") for part in named] == parts
    assert method_text(load_config({**NEWMARK, "method": {}}).sweep.spec) == []


def test_a_word_that_is_too_long_for_a_picture_is_small(random_sweep, with_layout):
    dataset, word = random_sweep({"omega": OMEGA}, name="x" * 200), "w" * 99
    figure = bifurcation(dataset, page=Page(xlabel=word, ylabel=f"a {word}"))
    figure.draw_without_rendering()
    (panel,) = figure.axes
    for text in (figure._suptitle, panel.xaxis.label, panel.yaxis.label):
        box = text.get_window_extent()
        assert (box.min >= 0.0).all() and (box.max <= figure.bbox.max).all()
    assert figure.get_suptitle().startswith("x" * 200)


def test_a_title_that_cannot_be_drawn_is_refused(random_sweep, unpainted):
    file = random_sweep({"omega": OMEGA}).encoding["source"]
    assert call("plot", file, "--title", "costs 5$").exit_code == 0
    for title in ("a $x_$ b", "a\udcffb"):
        wrong = call("plot", file, "--title", title)
        assert (wrong.exit_code, wrong.stderr.count("\n")) == (2, 1)
        assert f"title = {title!r} is not allowed; expected: a text with" in wrong.stderr
