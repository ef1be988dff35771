"""Limits of the axes: what is drawn within them, and what has nothing to draw."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from sweeps import branches, plotting
from sweeps.errors import Refused
from sweeps.plotting import Page, bifurcation, parameter_map, section
from tests.helpers.equal_points import R, equal_points
from tests.sweeps.plotting import test_pictures

FILES = {name: test_pictures.FILES[name] for name in ("map", "table")}


@pytest.fixture
def dataset(loaded):
    return loaded["map"]


@pytest.fixture(scope="module")
def one_impact(loaded):
    """Return the exact branches of 1/1 at R = 0.8."""
    return branches(loaded["map"], "omega", {"R": 0.8}, classes=[(1, 1)])


@pytest.mark.parametrize("most", [10, 10**9])
def test_the_ordinate_fits_what_is_within_the_limits_of_the_abscissa(dataset, monkeypatch, most):
    """As markers and as a density; also below the diagram, with exact branches and of a motion."""
    monkeypatch.setattr("sweeps.plotting.diagram.DENSITY_FROM", most)
    page, seen = Page(xlim=(2.25, 2.45)), dataset.sel(omega=slice(2.25, 2.45), R=0.6)
    figure = bifurcation(dataset, page=page, below=["fastest_impact"])
    for panel, name in zip(figure.axes, ("poincare_x", "fastest_impact"), strict=False):
        low, high = seen[name].values.min(), seen[name].values.max()
        room = 0.05 * (high - low)
        assert panel.get_ylim() == pytest.approx((low - room, high + room))
    fixed = bifurcation(dataset, page=Page(xlim=page.xlim, ylim=(-9.0, 9.0)))
    assert fixed.axes[0].get_ylim() == (-9.0, 9.0)


def test_the_ordinate_fits_the_part_of_a_motion_and_of_branches_in_view(dataset, one_impact):
    page = Page(xlim=(0.3, 0.6))
    panel = plotting.trajectory(dataset, at={"omega": 2.3}, page=page).axes[0]
    t, x = panel.lines[0].get_xydata().T
    part = x[(t >= 0.3) & (t <= 0.6)]
    assert panel.get_ylim() == pytest.approx((part.min(), part.max()), abs=0.1 * np.ptp(part))
    page = Page(xlim=(2.25, 2.35))
    options = {"at": {"R": 0.8}, "exact": one_impact}
    low, high = bifurcation(dataset, page=page, **options).axes[0].get_ylim()
    least, most = bifurcation(dataset, **options).axes[0].get_ylim()
    assert high - low < 0.9 * (most - least)


WITHOUT_DATA = [
    ("map", "bifurcation", {"below": "impulse"}, {"xlim": (2.31, 2.39)}, "xlim .* 2.3, 2.4"),
    ("map", "bifurcation", {"color": "period"}, {"xlim": (2.31, 2.39)}, "xlim .* 2.3, 2.4"),
    ("map", "section", {"color": "R"}, {"xlim": (-0.5101, -0.51)}, "xlim = -0.5101:-0.51; .*"),
    ("map", "bifurcation", {}, {"xlim": (2.15, 2.25), "ylim": (-0.4, 0.0)},
     "xlim = 2.15:2.25 and ylim = -0.4:0"),
    ("map", "impacts", {"color": "period"}, {"xlim": (2.3, 3.1)}, ".* 2.22227, 3.19355"),
    ("table", "table", {"axes": ["h"]}, {"xlim": (0.06, 0.09)}, "xlim = 0.06:0.09; .* 0.05, 0.1"),
    ("map", "bifurcation", {}, {"xlim": (5.0, 6.0)}, "xlim = 5:6; the data range from .*"),
    ("map", "bifurcation", {}, {"ylim": (1.0, 2.0)}, "ylim = 1:2; the data range from .*"),
]  # fmt: skip


@pytest.mark.parametrize(("file", "kind", "options", "limits", "message"), WITHOUT_DATA)
def test_limits_beyond_or_between_data_are_refused(loaded, file, kind, options, limits, message):
    with pytest.raises(Refused, match=f"nothing to draw with {message}$"):
        plotting.KINDS[kind].draw(loaded[file], page=Page(**limits), **options)


@pytest.mark.parametrize("xlim", [None, (2.31, 2.39)])
def test_limits_between_the_branches_of_a_density_are_refused(dataset, monkeypatch, xlim):
    """Of whole columns, and of those wider than the panel; limits that hold a value are drawn."""
    monkeypatch.setattr("sweeps.plotting.diagram.DENSITY_FROM", 10)
    x = dataset["poincare_x"].sel(R=0.6)
    values = np.unique(x)
    after = int(np.argmax(np.diff(values)))
    low, high = values[after : after + 2].tolist()
    gap, inside = (0.9 * low + 0.1 * high, 0.1 * low + 0.9 * high), x.sel(omega=2.3).values[-1]
    with pytest.raises(Refused, match=rf"nothing to draw with .*ylim = {gap[0]:.3g}"):
        bifurcation(dataset, page=Page(xlim=xlim, ylim=gap, marks=False))
    page = Page(xlim=xlim, ylim=(inside - 1e-3, inside + 1e-3))
    assert bifurcation(dataset, page=page).axes[0].collections[-1].get_array().count()


@pytest.mark.parametrize("most", [10, 10**9])
def test_what_lies_between_values_of_an_axis_is_drawn(dataset, one_impact, monkeypatch, most):
    """The cell of a map, an exact branch, a measured point, the column of a density."""
    monkeypatch.setattr("sweeps.plotting.diagram.DENSITY_FROM", most)
    page, at = Page(xlim=(2.31, 2.39)), {"R": 0.8}
    measured = {"omega": [2.35], "poincare_x": [-0.5]}
    parameter_map(dataset, page=page)
    for options in [{"exact": one_impact}, {"overlay": measured}, *([{}] if most == 10 else [])]:
        figure = bifurcation(dataset, at=at, page=page, **options)
        assert figure.axes[0].get_xlim() == page.xlim


@pytest.mark.parametrize("side", ["x", "y"])
@pytest.mark.parametrize(
    ("draw", "options"),
    [
        (bifurcation, {"overlay": {"omega": [2.0, 5.0], "poincare_x": [0.5, 2.0]}}),
        (bifurcation, {"page": Page(xlim=(1.8, 3.2), ylim=(-1.0, 1.0))}),
        (parameter_map, {"page": Page(xlim=(1.8, 3.2), ylim=(0.4, 0.8))}),
        (section, {}),
    ],
)
def test_an_inverted_axis_stays_inverted(draw, options, side):
    limits, points = [], equal_points()
    points["poincare_v"] = points["poincare_x"]
    for panel in Figure().subplots(1, 2):
        if limits:
            getattr(panel, f"invert_{side}axis")()
        draw(points, ax=panel, **options)
        limits.append({one: getattr(panel, f"get_{one}lim")() for one in "xy"})
    plain, inverted = limits
    inverted[side] = inverted[side][::-1]
    assert inverted == plain and plain[side][0] < plain[side][1]


def test_limits_that_a_logarithmic_axis_cannot_have_are_refused():
    points = equal_points(axes={"R": R, "omega": np.array([1.0, 2.0, 4.0, 8.0])})
    for draw in (bifurcation, parameter_map):
        with pytest.raises(Refused, match="xlim = 0:3 is not allowed on a logarithmic axis"):
            draw(points, page=Page(xlim=(0.0, 3.0)))
        assert draw(points, page=Page(xlim=(1.5, 3.0))).axes[0].get_xlim() == (1.5, 3.0)


def test_an_ordinate_fits_a_motion_at_0_within_the_limits(recwarn):
    points = equal_points()
    points["poincare_x"].values[:, 3] = 5.0
    low, high = bifurcation(points, page=Page(xlim=(0.5, 3.2))).axes[0].get_ylim()
    assert low < 0.0 < high < 1.0 and not [*recwarn]


def test_the_ordinate_of_colours_fits_as_that_of_a_single_one():
    points = equal_points()
    points["poincare_x"].values[:] += np.linspace(0.1, 5.0, 4)[:, None]
    page = Page(xlim=(0.5, 2.5))
    figures = (bifurcation(points, color=name, page=page) for name in (None, "period", "R"))
    plain, *coloured = (figure.axes[0].get_ylim() for figure in figures)
    assert coloured == [plain, plain] and plain[1] < 2.0
