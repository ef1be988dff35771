import numpy as np
import pytest

from sweeps.errors import Refused
from sweeps.plotting import Page, bifurcation, plot
from sweeps.plotting.maps import parameter_map
from sweeps.plotting.pixels import cell_edges
from tests.helpers.equal_points import OMEGA, PLAIN, R, colours, equal_points, legend, texts
from vibroimpact.status import Status


def test_every_class_has_its_colour_and_its_label():
    dataset = equal_points(
        period={(0, 1): 2, (0, 2): 2, (1, 0): 0, (1, 1): 0, (1, 2): 0},
        period_impacts={(0, 2): 3, (2, 3): 0},
        lyapunov={(1, 0): 100.0, (1, 1): 0.0, (1, 2): -0.3},
        rest_fraction={(1, 3): 0.2},
        status={(2, 0): Status.UNBOUNDED, (2, 1): Status.NON_FINITE, (2, 2): Status.PENDING},
    )
    figure = parameter_map(dataset)
    assert texts(figure)[:2].tolist() == [
        ["1/1", "2/1", "2/3", "1/1"],
        ["chaotic (10 %)", "unknown (20 %)", "unknown (20 %)", "rest, 1 period"],
    ]
    assert texts(figure)[2, [0, 1, 3]].tolist() == ["unbounded", "non-finite", "1/0, no impact"]
    assert colours(figure)[2, 2] is None  # the hatched background is visible
    assert figure.axes[0].patch.get_hatch()
    assert "not computed yet (1 of 12)" in legend(figure)
    assert len(set(legend(figure).values())) == len(legend(figure))
    assert figure.legends[0].get_title().get_text().startswith("m/q")


def test_rests_of_different_periods_are_told_apart():
    """By hatches, since no further colours can be told apart from those of the classes."""
    periods = [1, 2, 3, 4, 6, 5, 9]
    dataset = equal_points(
        axes={"omega": np.arange(1.0, 9.0), "R": np.array([0.5, 0.6])},
        period={(i, j): m for i, m in enumerate([*periods, 0]) for j in (0, 1)},
        rest_fraction={(i, j): 0.2 for i in range(8) for j in (0, 1)},
    )
    for page in (Page(), Page(grey=True)):
        figure = parameter_map(dataset, page=page)
        (one,) = figure.legends
        hatches = {patch.get_label(): patch.get_hatch() for patch in one.get_patches()}
        named = [f"rest, {m} period{'s' * (m > 1)}" for m in periods[:5]]
        assert {*hatches} == {*named, "rest, 5, 9 periods", "rest"}
        assert len({*hatches.values()}) == 7
    figure = bifurcation(dataset, at={"R": 0.5}, color="period")
    assert "rest, 1, 2, 3, ... periods" in legend(figure)


def test_the_legend_has_only_what_there_is():
    assert list(legend(parameter_map(equal_points()))) == ["1/1"]
    assert not parameter_map(equal_points()).axes[0].patch.get_hatch()


def test_lines_mark_the_motions_that_have_not_settled():
    """Those of either neighbour in a row, and of the last column; 3 of the 11 with a result."""
    near = {(0, 1): 2e-6, (0, 2): 1.0, (1, 0): 1e-6, (1, 1): np.nan, (2, 3): 0.1}
    dataset = equal_points(orbit_distance=near, status={(2, 0): Status.PENDING})
    figure = parameter_map(dataset)
    (marks,) = (patch for patch in figure.axes[0].patches if patch.get_hatch())
    centres = [[marks.get_path().contains_point((x, y)) for x in OMEGA] for y in R]
    assert np.argwhere(centres).tolist() == [[0, 1], [0, 2], [2, 3]]
    assert "on its way to m/q (27.3 %)" in legend(figure)
    assert not any(patch.get_hatch() for patch in parameter_map(equal_points()).axes[0].patches)


def test_a_class_has_one_colour_in_every_map_and_rare_classes_share_one():
    """Whatever else is in the map, as in the map of a part of the sweep."""
    many = {(i // 4, i % 4): i + 1 for i in range(12)}
    figure = parameter_map(equal_points(period=many))
    found = texts(figure)
    others = "other m/q: 4/1, 5/1, 6/1, ..."
    assert found[0].tolist() == ["1/1", "2/1", "3/1", others]
    assert np.count_nonzero(found == others) == 9
    alone = {(i // 4, i % 4): 3 for i in range(12)}
    assert legend(parameter_map(equal_points(period=alone))).items() <= legend(figure).items()


def test_a_part_of_a_map_names_the_classes_without_a_colour_that_are_in_it():
    points = equal_points(period={(..., 0): 7, (..., 3): 9})
    pages = [Page(xlim=ends, height=5.0) for ends in ((0.5, 1.4), (1.6, 3.4), (3.6, 4.4))]
    names = [legend(parameter_map(points, page=page)) for page in pages]
    assert [[*each] for each in names] == [["other m/q: 7/1"], ["1/1"], ["other m/q: 9/1"]]


def test_without_an_exponent_the_legend_says_what_is_not_known():
    figure = parameter_map(equal_points(omit=["lyapunov"], period={(0, 0): 0}))
    assert texts(figure)[0, 0] == "unknown (8.33 %)"


@pytest.mark.parametrize("quantity", ["class_evidence", "lyapunov", "orbit_x", "period", "status"])
def test_each_kind_of_quantity_draws_failed_and_missing_points(quantity):
    numbers = [name for name, value in PLAIN.items() if isinstance(value, float)]
    nothing = {name: {(0, 0): np.nan, (1, 1): np.nan} for name in numbers}
    dataset = equal_points(status={(0, 0): Status.PENDING, (1, 1): Status.UNRESOLVED}, **nothing)
    figure = parameter_map(dataset, quantity=quantity)
    found = colours(figure)
    assert found[0, 0] is None
    assert found[1, 1] == legend(figure)["unresolved"]
    assert np.count_nonzero(found == found[1, 1]) == 1
    assert sum(colour is None for colour in found.ravel()) == 1


def test_the_slowest_impact_is_dark_at_a_graze_and_unknown_in_a_chatter():
    speeds = {(0, 0): 1e-3, (0, 1): 1e-2, (0, 2): 1e-1, (1, 0): np.nan, (1, 1): 1e-12}
    dataset = equal_points(slowest_impact=speeds, rest_fraction={(1, 1): 0.1})
    figure = parameter_map(dataset, quantity="slowest_impact")
    mesh = figure.axes[0].collections[0]
    red, green, blue, _ = mesh.to_rgba(mesh.get_array())[0].T
    assert (np.diff((red + green + blue)[:4]) > 0).all()
    steps = np.diff(mesh.norm([1e-2, 1e-1, 1.0]).data)
    assert steps[0] == pytest.approx(steps[1])  # a logarithmic scale
    assert texts(figure)[1, :2].tolist() == ["no impact", "rest"]


@pytest.mark.slow
@pytest.mark.parametrize("quantity", ["energy_lost", "fastest_impact"])
def test_a_chatter_has_a_loss_and_a_fastest_impact(quantity, with_layout):
    values = {(0, 0): 1e-3, (0, 1): 1e-2, (0, 2): 1e-1, (1, 0): 0.0, (1, 1): 0.02}
    dataset = equal_points(rest_fraction={(1, 1): 0.1}, **{quantity: values})
    figure = parameter_map(dataset, quantity=quantity)
    mesh = figure.axes[0].collections[0]
    assert mesh.get_array()[1, 1] == 0.02
    steps = np.diff(mesh.norm([1e-2, 1e-1, 1.0]).data)
    assert steps[0] == pytest.approx(steps[1])  # a logarithmic scale
    assert texts(figure)[1, 0] == "no impact"
    bar = figure.axes[1]
    figure.draw_without_rendering()
    assert bar.xaxis.label.get_window_extent().width < figure.bbox.width


def test_zero_divides_the_colours_of_the_exponent():
    values = {(0, 0): 0.2, (0, 1): 0.1, (0, 2): 0.0, (0, 3): -1.0, (1, 0): -np.inf}
    figure = parameter_map(equal_points(lyapunov=values), quantity="lyapunov")
    mesh = figure.axes[0].collections[0]
    assert mesh.norm([0.0]) == 0.5
    red, _, blue, _ = mesh.to_rgba(mesh.get_array())[0].T
    assert (red - blue > 0.1).tolist() == [True, True, False, False]
    assert blue[3] - red[3] > 0.1
    assert texts(figure)[1, 0] == r"rest, $\lambda_1 = -\infty$"
    assert figure.axes[1].get_xlabel() == r"larger Lyapunov exponent $\lambda_1$"


@pytest.mark.parametrize("rate", [1.0, 2.0**-60, 2.0**60])
def test_the_colours_of_both_signs_are_the_same_in_all_units(rate):
    """An exponent is a rate like omega; exponents of the size of rounding have no colour."""
    exponents = np.array([[0.2, 0.1, 0.0, -0.3], [-0.05, 0.01, 0.02, 0.4], [-0.1, -0.2, 0.3, 0.0]])
    axes = {"R": R, "omega": rate * OMEGA}

    def places(scale, drawn=lambda dataset: "lyapunov"):
        """Return the place of every cell on the scale of colours, -1 and 1 at its ends."""
        values = dict(np.ndenumerate(scale * rate * exponents))
        dataset = equal_points(lyapunov=values, axes=axes)
        mesh = parameter_map(dataset, quantity=drawn(dataset)).axes[0].collections[0]
        return 2.0 * mesh.norm(mesh.get_array()).data - 1.0

    np.testing.assert_allclose(places(1.0), exponents / 0.4, atol=1e-15)
    own = places(1e-20, lambda dataset: dataset["lyapunov"][..., 0].rename("thrust"))
    np.testing.assert_allclose(own, exponents / 0.4, atol=1e-15)
    assert np.abs(places(1e-16)).max() < 1e-4
    assert (places(0.0) == 0.0).all()


def test_the_scale_of_exponents_has_ticks_on_both_sides_of_zero(with_layout):
    values = {(0, 0): 0.02, (0, 1): -0.02, (0, 2): -1.0}
    figure = parameter_map(equal_points(lyapunov=values), quantity="lyapunov")
    figure.draw_without_rendering()
    low, high = figure.axes[1].get_xlim()
    ticks = [tick for tick in figure.axes[1].get_xticks() if low <= tick <= high]
    assert min(ticks) < 0.0 < max(ticks)


def test_a_cell_reaches_halfway_to_its_neighbours():
    np.testing.assert_allclose(cell_edges(R, False), [0.2, 0.4, 0.7, 1.1])
    np.testing.assert_allclose(cell_edges(np.array([1.0, 4.0, 16.0]), True), [0.5, 2.0, 8.0, 32.0])
    figure = parameter_map(equal_points())
    assert figure.axes[0].get_xlim() == (0.5, 4.5)
    np.testing.assert_allclose(figure.axes[0].get_ylim(), (0.2, 1.1))
    figure = parameter_map(equal_points(axes={"R": R, "omega": np.geomspace(1.0, 64.0, 4)}))
    assert figure.axes[0].get_xscale() == "log" and figure.axes[0].get_yscale() == "linear"
    assert cell_edges(np.zeros(1), False).tolist() == [-0.5, 0.5]
    figure = parameter_map(equal_points(axes={"f": np.array([2.0]), "R": R}))
    assert figure.axes[0].get_ylim() == (1.0, 3.0)
    assert cell_edges(np.full(2, 2.0), True).tolist() == [1.0, 2.0, 3.0]  # a value that is repeated


def test_the_axes_are_the_two_longest_or_those_asked_for():
    axes = {"h": [0.1, 0.2], "R": R, "omega": OMEGA}
    dataset = equal_points(axes=axes, period={(1, 0, 3): 2, (0, 2, 0): 3})

    def shown(**options):
        panel = (figure := parameter_map(dataset, **options)).axes[0]
        return panel.get_xlabel()[-20:], panel.get_ylabel()[-20:], texts(figure)

    def ends(name):
        about = dataset[name].attrs
        return f"{about['long_name']} ${about['symbol']}$"[-20:]

    x, y, first = shown()
    assert (x, y) == (ends("omega"), ends("R")) and first[2, 0] == "3/1"
    x, y, second = shown(at={"h": 0.2})
    assert second[0, 3] == "2/1" and second[2, 0] == "1/1"
    x, y, turned = shown(axes=["R", "omega"], at={"h": 0.2})
    assert (x, y) == (ends("R"), ends("omega"))
    assert turned.tolist() == second.T.tolist()
    x, y, _ = shown(axes=["h"])
    assert (x, y) == (ends("h"), ends("omega"))


def test_of_equal_axes_the_later_is_the_abscissa_and_any_order_of_values_is_drawn():
    dataset = equal_points(axes={"R": R[::-1], "h": [0.1, 0.2, 0.3]}, period={(0, 2): 2})
    figure = parameter_map(dataset)
    assert "damping" in figure.axes[0].get_xlabel()
    assert texts(figure)[2, 2] == "2/1"  # R = 0.9 is at the top


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"quantity": "period"}, "has no period: run the sweep again with record.diagnostics"),
        ({"axes": ["R", "omega", "R"]}, "a map has 2 swept axes, not R, omega, R"),
        ({"at": {"R": 0.5}}, "R cannot be fixed here: all its values are used; there is no axis"),
        ({"coordinate": "impact_v"}, "chosen for bifurcation or attractors only, not for map"),
    ],
)
def test_requests_that_do_not_fit_are_refused(tmp_path, options, message):
    dataset = equal_points(omit=["period", "period_impacts", "lyapunov"])
    with pytest.raises(Refused, match=message):
        plot(dataset, tmp_path / "a.png", "map", **options)
    assert not list(tmp_path.iterdir())


def test_a_quantity_without_values_is_no_picture():
    dataset = equal_points(max_penetration={...: 0.0}, slowest_impact={...: np.nan})
    with pytest.raises(Refused, match="max_penetration is 0 at every point"):
        parameter_map(dataset, quantity="max_penetration")
    for draw in (
        lambda: parameter_map(dataset, quantity="slowest_impact"),
        lambda: bifurcation(dataset, below=["max_penetration", "slowest_impact"]),
    ):
        with pytest.raises(Refused, match="no point has a finite value of slowest_impact"):
            draw()
    bifurcation(dataset, below="max_penetration")


def test_a_map_of_nothing_yet_has_the_axes_of_the_sweep():
    computed, pending = equal_points(), equal_points(status={...: Status.PENDING})
    for page in (Page(), Page(xlim=(2.0, 2.6))):
        panels = [parameter_map(points, page=page).axes[0] for points in (computed, pending)]
        ends = [(panel.get_xlim(), panel.get_ylim()) for panel in panels]
        assert ends[0] == ends[1] != ((0.0, 1.0), (0.0, 1.0))
