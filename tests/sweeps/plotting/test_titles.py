"""The lines of a title, and titles that cannot be drawn."""

import pytest

from sweeps.plotting import Page
from sweeps.plotting.canvas import Picture
from tests.helpers.commands import call
from tests.helpers.written_files import OMEGA

LOOSE = "$h=0.05$, $R=0.8$, costs 5$"  # an odd number of signs: all are drawn as such


def lines_within(figure):
    """Return the lines of the title of a figure; none is wider than the figure."""
    title = figure._suptitle
    assert title.get_window_extent().width <= figure.bbox.width
    return title.get_text().split("\n")


def test_a_title_is_broken_again_if_the_width_changes():
    figure = Picture(Page(width=6.0))
    figure.add_title(5 * "some words of a title ")
    wide = lines_within(figure)
    figure.set_figwidth(3.0)
    assert len(lines_within(figure)) > len(wide)
    assert " ".join(lines_within(figure)) == 5 * "some words of a title "
    figure.set_size_inches(6.0, 4.0)
    assert lines_within(figure) == wide
    figure.suptitle("another")
    figure.set_figwidth(3.0)
    assert figure.get_suptitle() == "another"


def test_a_title_of_which_a_piece_is_no_formula_is_broken_elsewhere():
    figure = Picture(Page(width=3.4))
    figure.add_title(" ".join(5 * [LOOSE]))
    assert " ".join(lines_within(figure)) == " ".join(5 * [LOOSE])


@pytest.mark.slow
def test_a_title_that_cannot_be_drawn_is_refused(random_sweep, unpainted):
    file = random_sweep({"omega": OMEGA}).encoding["source"]
    assert call("plot", file, "--title", " ".join(3 * [LOOSE])).exit_code == 0
    for title, piece in (("a $x_$ b", "'$x_$'"), ("a\udcffb", r"'a\udcffb'")):
        wrong = call("plot", file, "--title", title)
        assert (wrong.exit_code, wrong.stderr.count("\n")) == (2, 1)
        assert f"title = {title!r} is not allowed; expected: a text with" in wrong.stderr
        assert f"cannot draw {piece}" in wrong.stderr
