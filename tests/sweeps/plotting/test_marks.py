"""Marks, limits and greys: what is marked is named, what is named is seen, and told apart."""

import io
from functools import partial

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from PIL import Image

from sweeps import branches
from sweeps.plotting import (
    KINDS,
    Page,
    attractor_diagram,
    basins,
    bifurcation,
    diagram,
    plot,
    section,
    table_panels,
)
from sweeps.plotting.marks import agreeing, draw_jumps
from sweeps.plotting.style import DIRECTION_LOOKS, grey_ramp
from tests.helpers.commands import accepted
from tests.helpers.equal_points import equal_points, legend_texts
from vibroimpact.status import Status

#: With impacts up to a fold at 1.6504 on the way up, without down to a graze at 1.2861.
SWEEP = """\
oscillator: {h: 0.05, R: 0.8, f: 1, clearance: 1.5, omega: {start: 1.2, stop: 1.8, num: 13}}
follow: {axis: omega, direction: both}
record: {transient: 100, periods: 4, diagnostics: [period]}
"""


def test_jumps_and_bifurcations_are_in_the_legend_or_not_drawn(path, dataset):
    found = branches(dataset, classes=[(1, 1)])
    figure = bifurcation(dataset, exact=found)
    plain = bifurcation(dataset, exact=found, page=Page(marks=False))
    assert len(figure.axes[0].texts) == 2 and {"jump", "fold"} <= {*legend_texts(figure)}
    assert not plain.axes[0].texts
    assert not {"jump", "fold", "graze", "flip"} & {*legend_texts(plain)}
    assert not {"s", "^"} & {line.get_marker() for line in plain.axes[0].lines}
    assert accepted("plot", path, "--no-marks", "--dpi", "40", "-o", "a.png") == "a.png\n"


def test_points_that_failed_are_marked_without_marks():
    dataset = equal_points(status={(0, 1): Status.UNRESOLVED}, orbit_distance={(0, 2): 0.5})
    line = dataset.isel(R=[0]).assign(poincare_x=dataset["poincare_x"] + np.arange(4)[:, None])
    assert "on its way to m/q (1 of 4)" in legend_texts(bifurcation(line))
    assert legend_texts(bifurcation(line, page=Page(marks=False))) == ["unresolved (1 of 4)"]


def test_a_motion_without_a_class_has_no_period_below_the_diagram():
    line = equal_points(period={(0, 1): 0, (0, 3): 2}).isel(R=[0])
    _, below = bifurcation(line, below=["period"]).axes
    (dots,) = below.lines
    y = dots.get_ydata()
    assert y[np.isfinite(y)].tolist() == [1.0, 1.0, 2.0]


#: Points of 1/1 at R and omega = 1, 2, 3, 4, with x = omega, and changes.
FOUR = equal_points(
    axes={"R": np.arange(1.0, 3.0), "omega": np.arange(1.0, 5.0)},
    period={(0, 3): 2, (1, 3): 2},
    orbit_distance={(0, 3): 0.5, (1, 3): 0.5},
    status={(0, 0): Status.UNRESOLVED, (1, 0): Status.UNRESOLVED},
)
FOUR["poincare_x"].values += FOUR["omega"].values[:, None]
FOUR["poincare_v"] = FOUR["poincare_x"]


@pytest.mark.parametrize("grey", [False, True])
@pytest.mark.parametrize(
    ("draw", "limits", "names"),
    [
        (bifurcation, {"xlim": (1.5, 4.5)}, {"on its way to m/q (1 of 3)"}),
        (bifurcation, {"xlim": (0.5, 3.5)}, {"unresolved (1 of 3)"}),
        (bifurcation, {"xlim": (1.5, 3.5)}, None),
        (partial(bifurcation, color="period"), {"xlim": (1.5, 3.5)}, {"1/1"}),
        (partial(bifurcation, color="period"), {"ylim": (3.5, 4.5)},
         {"2/1", "on its way to m/q (1 of 4)", "unresolved (1 of 4)"}),
        (partial(section, color="period"), {"xlim": (1.5, 3.5)}, {"1/1"}),
        (partial(section, color="period"), {"ylim": (3.5, 4.5)}, {"2/1"}),
        (attractor_diagram, {"xlim": (3.5, 4)}, {"2/1"}),
        (attractor_diagram, {"ylim": (3.5, 4)}, {"2/1", "unresolved (1 of 4)"}),
    ],
)  # fmt: skip
def test_a_legend_names_only_what_is_within_the_limits(draw, limits, names, grey):
    figure = draw(FOUR.isel(R=[0]), page=Page(grey=grey, **limits))
    shown = {text for text in legend_texts(figure) if not text.startswith("stop")}
    assert shown == (names or set())


COLOURED = [partial(each, color="period") for each in (bifurcation, section)]


@pytest.mark.parametrize("draw", [attractor_diagram, bifurcation, *COLOURED])
def test_a_legend_is_that_of_axes_in_the_other_order(draw):
    plain, inverted = Figure().subplots(2)
    inverted.invert_xaxis()
    inverted.invert_yaxis()
    names = []
    for panel in (plain, inverted):
        draw(FOUR.isel(R=[0]), ax=panel)
        names.append([text.get_text() for text in panel.get_legend().get_texts()])
    assert names[0] == names[1]


def test_the_stop_is_named_where_it_is_seen():
    line = FOUR.isel(R=[0])
    figures = [section(line, at={"omega": 2}, page=Page(xlim=ends)) for ends in ((0, 3), (1, 3))]
    assert [len(figure.legends) for figure in figures] == [1, 0]


def test_a_jump_is_named_where_it_is_seen(dataset):
    whole, part = (bifurcation(dataset, page=Page(xlim=ends)) for ends in (None, (1.35, 1.6)))
    assert "jump" in legend_texts(whole) and "jump" not in legend_texts(part)


@pytest.mark.parametrize(("step", "arrows"), [(0.03, 0), (0.05, 1)])
def test_a_jump_is_an_arrow_unless_it_is_short(step, arrows):
    panel, up = Figure().subplots(), np.array([[0.0], [step], [0.0], [1.0]])
    draw_jumps(panel, np.arange(4.0), up, np.where(up < 1.0, 0.0, 1.0), ("red", "blue"))
    assert len(panel.texts) == arrows


UP, DOWN = r"up, $\omega \rightarrow$", r"down, $\omega \leftarrow$"


def test_two_records_of_one_chaotic_motion_are_those_of_both_directions():
    up, down = np.random.default_rng(0).random((2, 3, 100))
    down[1] = np.resize([0.3, 0.5, 0.7], 100)  # in a window of three periods
    up[2], down[2] = 0.2, np.nan
    both = agreeing(up, down, np.full(3, True))
    assert [each.all(axis=1).tolist() for each in both] == 2 * [[True, False, False]]
    assert not both[0][2].any() and not both[1][2].any() and both[0][1].any()


@pytest.mark.parametrize("near", [0.006, 0.009])
def test_motions_with_a_class_are_those_of_both_directions_only_where_their_values_are(near):
    """Also if they are close to each other, or differ in one of many values."""
    up = np.repeat([[0.0], [0.5], [1.0]], 60, axis=1)
    down = up + np.array([[0.0], [near], [0.0]])
    down[2, 7] = 0.6
    ways = agreeing(up, down, np.full(3, False))
    assert [each.sum(axis=1).tolist() for each in ways] == [[60, 0, 60], [60, 0, 59]]


def test_directions_at_the_end_of_the_axis_are_named(dataset):
    limits = Page(xlim=dataset["omega"].values[[8, -1]].tolist())  # apart at the first one only
    part = dataset.isel(omega=[8, 10, 11, 12])
    assert legend_texts(bifurcation(part, page=limits))[:3] == [UP, DOWN, "both"]


def test_only_motions_name_directions(dataset):
    """The lines of a user do not, nor what stands for both exponents in the legend."""
    panel = Figure().subplots()
    panel.plot([1.7, 1.8], [1, 2], color=[1, 0, 0])
    panel.plot([1.7, 1.8], [0, 1], color=DIRECTION_LOOKS[False][0].colour)
    bifurcation(dataset, ax=panel, page=Page(xlim=(1.71, 1.8)))
    assert [text.get_text() for text in panel.get_legend().get_texts()] == ["both"]
    numbers = dataset["impacts_per_period"].expand_dims(exponent=2, axis=-1)
    lyapunov = numbers.assign_attrs(long_name="exponent", units="1").rename("lyapunov")
    data = dataset.assign(lyapunov=lyapunov)
    apart = bifurcation(data, below=["lyapunov"], page=Page(xlim=(1.35, 1.6)))
    assert legend_texts(apart)[:2] == [UP, DOWN] and "both" not in legend_texts(apart)


#: Seven rows, of which the last four overflow, and three.
FILES = {
    "failed": """
oscillator: {h: 0.1}
points: {omega: [2.3, 2.4, 2.5, 2.6, 2.7, 2.8, 2.9], R: [0.7, 0.8, 0.7, 0.8, 0.7, 0.8, 0.7],
         f: [1, 1, 1, 1.0e+308, 1.0e+308, 1.0e+308, 1.0e+308]}
record: {transient: 20}
""",
    "table": "oscillator: {h: 0.1, f: 1.0}\nrecord: {transient: 20}\n"
    "points: {R: [0.8, 0.7, 0.75], omega: [2.4, 2.6, 2.9]}\n",
}


@pytest.mark.parametrize(
    ("axes", "xlim", "names"),
    [
        (["omega", "impulse"], None, ["1/1", "non-finite (4 of 7)"]),
        (["impulse"], None, ["1/1", "non-finite (4 of 7)"]),
        (["omega"], (2.25, 2.65), ["1/1", "non-finite (1 of 4)"]),
        (["omega"], (2.25, 2.55), ["1/1"]),
        (["omega"], (2.55, 2.95), ["non-finite (4 of 4)"]),
        (["omega", "R"], (2.25, 2.55), ["1/1", "non-finite (4 of 7)"]),
    ],
)
def test_a_table_counts_the_points_that_failed(loaded, axes, xlim, names):
    figure = table_panels(loaded["failed"], axes=axes, page=Page(xlim=xlim))
    assert legend_texts(figure) == names


def test_the_panels_of_a_table_keep_the_limits(loaded):
    page = Page(xlim=(2.2, 3), ylim=(0, 2))
    figure = table_panels(loaded["failed"], axes=["omega", "R"], page=page)
    assert [panel.get_ylim() for panel in figure.axes] == [(0, 2), (0, 2)]
    assert figure.axes[0].get_xlim() == (2.2, 3)


def test_basins_have_their_shares_of_the_starts_that_are_seen(computed_starts):
    made = computed_starts()
    (name,) = legend_texts(basins(made, page=Page(xlim=(-2.45, -2.35), ylim=(-2.05, -1.95))))
    assert name.endswith(" 100.0 %")  # between two starts, in the cell of one
    few = made.isel(x0=slice(0, len(made["x0"]) // 2))
    page = Page(xlim=tuple(few["x0"].values[[0, -1]].tolist()))
    assert (
        legend_texts(basins(made, page=page))
        == legend_texts(basins(few))
        != legend_texts(basins(made))
    )


def test_marks_beside_each_other_have_no_gaps(with_layout):
    omega = np.linspace(1.0, 4.0, 20_000)
    line = equal_points(axes={"R": np.array([0.8]), "omega": omega}).isel(section=slice(0, 2))
    line["orbit_distance"].values[:] = np.where((omega > 2.0) & (omega < 3.0), 0.5, 0.0)
    line["poincare_x"].values[0] = np.stack([omega, -omega], axis=1)
    plot(line, "marks.png", "bifurcation", page=Page(width=7.0, dpi=300, legend=False, title=""))
    pixels = np.asarray(Image.open("marks.png").convert("RGB")).astype(int)
    purple = (abs(pixels - [0x4B, 0x00, 0x82]) < 3).all(axis=2)
    row = purple[np.argmax(purple.sum(axis=1))]
    assert row.sum() > 500 and np.ptp(np.flatnonzero(row)) + 1 == row.sum()


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


def test_a_map_and_a_table_of_numbers_are_grey(loaded):
    dataset = equal_points(lyapunov={(0, 1): 0.5, (1, 2): -np.inf}, rest_fraction={(1, 2): 0.1})
    for name in ("lyapunov", "impulse", "status"):
        assert colourful(KINDS["map"].draw(dataset, quantity=name, page=PAGE)) < 0.01, name
    for color in (None, "impulse"):
        assert colourful(KINDS["table"].draw(loaded["table"], color=color, page=PAGE)) < 0.01


@pytest.mark.parametrize("dark", [False, True])
def test_greys_of_numbers_are_monotone_in_lightness(dark):
    colours = {"axes.facecolor": "black", "text.color": "white"} if dark else {}
    with mpl.rc_context(colours):
        levels = grey_ramp()(np.linspace(0.0, 1.0, 64))
    assert np.ptp(levels[:, :3], axis=1).max() == 0.0
    steps = np.diff(levels[:, 0])
    assert (steps > 0.0).all() if dark else (steps < 0.0).all()
