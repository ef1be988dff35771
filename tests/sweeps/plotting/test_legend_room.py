"""Room for titles, legends and ticks in narrow pictures, and branches that are left out."""

import numpy as np
import pytest
from matplotlib.lines import Line2D

from sweeps import branches, load_config
from sweeps.errors import Refused
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting import Page, bifurcation, plot
from sweeps.plotting.canvas import Picture
from sweeps.plotting.exact_lines import _BRANCHES_IN_FULL, without_idle
from sweeps.plotting.labels import method_text
from tests.helpers.commands import call
from tests.helpers.equal_points import equal_points, legend_texts
from tests.helpers.sweep_files import swept
from tests.helpers.written_files import OMEGA

#: A cascade beside many unstable branches of windows to which no motion goes.
RICH = """\
oscillator: {h: 0.0, R: 0.8, omega: {start: 2.62, stop: 2.8, num: 150}, f: 1.0}
follow: {axis: omega, direction: up}
record: {transient: 300, periods: 64, diagnostics: [period]}
"""


def with_legend(labels, title=None, width=3.4):
    figure = Picture(Page(width=width))
    figure.add_subplot()
    figure.add_legend([Line2D([], [], label=label) for label in labels], title)
    figure.draw_without_rendering()
    return figure


def test_a_legend_higher_than_a_fifth_has_two_columns_also_with_long_entries():
    long = ["on its way to m/q (12 of 4,096)", "least knock, 1/0: +0.6078 at the phase"]
    figure = with_legend([*"abcdefgh", *long, *long])
    legend = figure.legends[0]
    box = legend.get_window_extent()
    assert len({round(text.get_window_extent().x0) for text in legend.get_texts()}) >= 2
    assert figure.bbox.x0 <= box.x0 and box.x1 <= figure.bbox.x1
    words = " ".join(text.get_text().replace("\n", " ") for text in legend.get_texts())
    assert all(one in words for one in long)


def test_a_legend_with_room_is_left_as_it_is():
    long = "on its way to m/q (12 of 4,096)"
    first, *_ = with_legend([long, "up", "down"]).legends[0].get_texts()
    (alone,) = with_legend(["a"]).legends[0].get_texts()
    assert first.get_text() == long and first.get_fontsize() == alone.get_fontsize()


def test_a_legend_that_no_page_has_room_for_counts_what_is_left_out(monkeypatch):
    monkeypatch.setattr("sweeps.plotting.canvas.HIGHEST", 4.0)
    figure = with_legend([f"entry {i}, so long that it has its line" for i in range(14)])
    figure.set_height()
    assert figure.get_figheight() <= 4.0
    assert legend_texts(figure)[-1].endswith(" more")


@pytest.mark.parametrize("width", [3.4, 7.0])
def test_the_bar_beside_a_density_ends_at_the_edge(width, monkeypatch, with_layout):
    monkeypatch.setattr("sweeps.plotting.diagram.DENSITY_FROM", 0)
    figure = bifurcation(equal_points().isel(R=[0]), page=Page(width=width))
    figure.draw_without_rendering()
    beside = figure.bbox.x1 - figure.axes[1].get_tightbbox().x1
    assert 0.0 < beside < 0.03 * figure.bbox.width


@pytest.mark.slow
def test_branches_to_which_no_motion_goes_are_counted_and_drawn_on_request(unpainted, monkeypatch):
    dataset = swept(RICH)
    found = branches(dataset)
    chosen = found.assign_attrs(branches(dataset.isel(omega=slice(3)), most=1).attrs)
    kept, idle = without_idle(found, OpenedSweep(dataset))
    figure = bifurcation(dataset, exact=found)
    assert without_idle(chosen, OpenedSweep(dataset))[1] == 0
    m, q = dataset["period"].values, dataset["period_impacts"].values
    count = found["branch"].values.max() + 1
    assert count > _BRANCHES_IN_FULL and 0 < idle < count
    np.testing.assert_array_equal(np.unique(kept["branch"].values), np.arange(count - idle))
    classes = {*zip(kept["m"].values.tolist(), kept["q"].values.tolist(), strict=True)}
    assert {(1, 1), (2, 2), (4, 4)} <= classes & {*zip(m.tolist(), q.tolist(), strict=True)}
    assert f"branches not drawn: {idle}" in legend_texts(figure)
    monkeypatch.setattr("sweeps.bifurcation.exact_branches.branches", lambda *_, **__: found)
    told = call("plot", "swept.h5", "--exact").stdout
    assert f"branches not drawn, because no motion goes to them: {idle}; --most 61" in told


@pytest.mark.filterwarnings("ignore:constrained_layout not applied")
@pytest.mark.parametrize("width", [1.0, 1.3])
def test_a_width_without_room_for_the_labels_is_refused(tmp_path, width, with_layout):
    """Instead of a traceback of matplotlib's solver, or texts upon each other, when it is saved."""
    with pytest.raises(Refused, match=f"the labels leave no room in a width of {width:g} in"):
        plot(equal_points(), tmp_path / "a.png", "bifurcation", page=Page(width=width))
    assert not [*tmp_path.iterdir()]


def test_no_part_of_a_legend_is_cut_off():
    title = "m/q: q impacts in m forcing periods,\nspeed before each impact; share of the starts"
    labels = "1/0, no impact: 64.5 %", "least knock, 2/1: +0.2723 at $\\omega t=2.094$"
    figure = with_legend(labels, title, width=2.0)
    box = figure.legends[0].get_window_extent()
    assert figure.bbox.x0 <= box.x0 and box.x1 <= figure.bbox.x1
    words = figure.legends[0].get_title().get_text()
    assert words.count("\n") == 3 and words.split() == title.split()
    with pytest.raises(Refused, match="the legend has no room in a width of 1 in"):
        with_legend(labels, title, width=1.0)


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


def test_a_title_is_broken_again_if_the_width_changes(with_layout):
    figure = Picture(Page(width=6.0))
    figure.add_title(5 * "some words of a title ")
    wide = height_within(figure)
    figure.set_figwidth(3.0)
    assert height_within(figure) > 1.8 * wide
    figure.set_size_inches(6.0, 4.0)
    assert height_within(figure) == wide


def test_a_title_with_a_loose_sign_is_drawn_or_refused(with_layout):
    for text in (LOOSE, " ".join(5 * [LOOSE]), 8 * "costs 5$ ", "costs \\$5, " * 8):
        for width in (1.5, 3.4, 6.0):
            figure = Picture(Page(width=width))
            try:
                figure.add_title(text)
            except Refused as error:
                assert r"and \$ for the sign" in str(error) and text != LOOSE
            else:
                height_within(figure)


def test_a_title_of_too_many_levels_is_refused(with_layout):
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


def test_a_title_that_cannot_be_drawn_is_refused(random_sweep, with_layout):
    file = random_sweep({"omega": OMEGA}).encoding["source"]
    assert call("plot", file, "--title", "costs 5$").exit_code == 0
    for title in ("a $x_$ b", "a\udcffb"):
        wrong = call("plot", file, "--title", title)
        assert (wrong.exit_code, wrong.stderr.count("\n")) == (2, 1)
        assert f"title = {title!r} is not allowed; expected: a text with" in wrong.stderr
