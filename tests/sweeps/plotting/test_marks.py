"""Marks of diagrams, and the limits: what is marked is named, and what is named is seen."""

from functools import partial

import numpy as np
import pytest
from PIL import Image

from sweeps import branches, open_sweep
from sweeps.plotting import Page, basins, bifurcation, parameter_map, plot, section
from tests.helpers.commands import accepted
from tests.helpers.equal_points import equal_points
from vibroimpact.status import Status

#: With impacts up to a fold at 1.6504 on the way up, without down to a graze at 1.2861.
SWEEP = """\
oscillator: {h: 0.05, R: 0.8, f: 1, clearance: 1.5, omega: {start: 1.2, stop: 1.8, num: 13}}
follow: {axis: omega, direction: both}
record: {transient: 100, periods: 4, diagnostics: [period]}
"""


def texts(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_jumps_and_bifurcations_are_in_the_legend_or_not_drawn(path):
    with open_sweep(path) as dataset:
        found = branches(dataset, classes=[(1, 1)])
        figure = bifurcation(dataset, exact=found)
        plain = bifurcation(dataset, exact=found, page=Page(marks=False))
    assert len(figure.axes[0].texts) == 2 and "jump" in texts(figure)
    assert {"fold"} <= {*texts(figure)}
    assert not plain.axes[0].texts
    assert not {"jump", "fold", "graze", "flip"} & {*texts(plain)}
    assert not {"s", "^"} & {line.get_marker() for line in plain.axes[0].lines}
    assert accepted("plot", path, "--no-marks", "--dpi", "40", "-o", "a.png") == "a.png\n"


def test_points_that_failed_are_marked_without_marks():
    dataset = equal_points(status={(0, 1): Status.UNRESOLVED}, orbit_distance={(0, 2): 0.5})
    line = dataset.isel(R=[0]).assign(poincare_x=dataset["poincare_x"] + np.arange(4)[:, None])
    assert "on its way to m/q (1 of 4)" in texts(bifurcation(line))
    assert texts(bifurcation(line, page=Page(marks=False))) == ["unresolved (1 of 4)"]


def test_a_motion_without_a_class_has_no_period_below_the_diagram():
    line = equal_points(period={(0, 1): 0, (0, 3): 2}).isel(R=[0])
    _, below = bifurcation(line, below=["period"]).axes
    (dots,) = below.lines
    y = dots.get_ydata()
    assert y[np.isfinite(y)].tolist() == [1.0, 1.0, 2.0]


def by_hand(**changed):
    """Return points of 1/1 at R and omega = 1, 2, 3, 4, with x = omega, and changes."""
    axes = {"R": np.arange(1.0, 3.0), "omega": np.arange(1.0, 5.0)}
    made = equal_points(axes=axes, **changed)
    made["poincare_x"].values += made["omega"].values[:, None]
    return made.assign(poincare_v=made["poincare_x"])


FOUR = by_hand(
    period={(0, 3): 2, (1, 3): 2},
    orbit_distance={(0, 3): 0.5, (1, 3): 0.5},
    status={(0, 0): Status.UNRESOLVED, (1, 0): Status.UNRESOLVED},
)


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
    ],
)  # fmt: skip
def test_a_legend_names_only_what_is_within_the_limits(draw, limits, names, grey):
    figure = draw(FOUR.isel(R=[0]), page=Page(grey=grey, **limits))
    shown = {text for text in texts(figure) if not text.startswith("stop")}
    assert shown == (names or set())


def test_a_map_names_only_what_is_within_the_limits():
    every = parameter_map(FOUR)
    assert [text[:3] for text in texts(every)] == ["1/1", "2/1", "unr", "on "]
    assert texts(parameter_map(FOUR, page=Page(xlim=(1.6, 3.4)))) == ["1/1"]
    assert texts(parameter_map(FOUR, page=Page(xlim=(3.6, 4.4))))[0] == "2/1"
    assert texts(parameter_map(FOUR, quantity="lyapunov", page=Page(xlim=(2.0, 4.0)))) == []


def test_the_stop_is_named_where_it_is_seen():
    line = FOUR.isel(R=[0])
    figures = [section(line, at={"omega": 2}, page=Page(xlim=ends)) for ends in ((0, 3), (1, 3))]
    assert [len(figure.legends) for figure in figures] == [1, 0]


def test_a_jump_is_named_where_it_is_seen(dataset):
    whole, part = (bifurcation(dataset, page=Page(xlim=ends)) for ends in (None, (1.35, 1.6)))
    assert "jump" in texts(whole) and "jump" not in texts(part)


def test_basins_are_named_where_they_are_seen(computed_starts):
    made = computed_starts()
    one = Page(xlim=(-2.45, -2.35), ylim=(-2.05, -1.95))  # within a cell
    (name,), whole = texts(basins(made, page=one)), texts(basins(made))
    assert len(whole) == 3 and name in whole


def test_marks_beside_each_other_have_no_gaps(with_layout):
    omega = np.linspace(1.0, 4.0, 20_000)
    line = equal_points(axes={"R": np.array([0.8]), "omega": omega}).isel(section=slice(0, 2))
    line["orbit_distance"].values[:] = np.where((omega > 2.0) & (omega < 3.0), 0.5, 0.0)
    line["poincare_x"].values[0] = np.stack([omega, -omega], axis=1)
    plot(line, "marks.png", "bifurcation", page=Page(width=7.0, legend=False, title=""))
    pixels = np.asarray(Image.open("marks.png").convert("RGB")).astype(int)
    purple = (abs(pixels - [0x8A, 0x2B, 0xE2]) < 3).all(axis=2)
    row = purple[np.argmax(purple.sum(axis=1))]
    assert row.sum() > 500 and np.ptp(np.flatnonzero(row)) + 1 == row.sum()
