"""Marks of diagrams: each has a line in the legend, and a page can do without them."""

import numpy as np

from sweeps import branches, open_sweep
from sweeps.plotting import Page, bifurcation
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
