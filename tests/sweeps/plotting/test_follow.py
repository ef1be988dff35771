"""Pictures of sweeps followed up and down: both branches, or the chosen one."""

import itertools

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.colors import to_hex

from sweeps import load_config, open_sweep, run_sweep
from sweeps.errors import Refused
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting import attractor_diagram, bifurcation, diagram, impacts, section, trajectory
from sweeps.plotting.maps import parameter_map
from sweeps.plotting.marks import in_both
from sweeps.plotting.style import BOTH_COLOUR, DIRECTION_LOOKS
from tests.helpers.commands import call
from tests.helpers.equal_points import legend_texts

pytestmark = pytest.mark.slow

# With impacts up to a fold at 1.6504 on the way up, without down to a graze at 1.2861.
CONFIG = """\
name: both ways
oscillator: {h: [0.05, 0.06], R: 0.8, f: 1, clearance: 1.5,
             omega: {start: 1.2, stop: 1.8, num: 25}}
follow: {axis: omega, direction: both}
record: {transient: 150, periods: 4, trajectory: {every: 8}, diagnostics: [period]}
"""
UP, DOWN = (look.colour for look in DIRECTION_LOOKS[False])
WAYS = [r"up, $\omega \rightarrow$", r"down, $\omega \leftarrow$"]


def markers(panel):
    """Return the points of a panel by colour, and the size of their markers."""
    lines = [line for line in panel.lines if line.get_marker() == "o" and len(line.get_xdata())]
    points = {}
    for line in lines:
        colour = to_hex(line.get_color()).upper()
        points[colour] = np.concatenate([points.get(colour, np.empty((0, 2))), line.get_xydata()])
    sizes = {to_hex(line.get_color()).upper(): line.get_markersize() for line in lines}
    return points, sizes


@pytest.mark.parametrize("order", [["up", "down"], ["down", "up"]])
def test_neither_direction_hides_the_other(dataset, order):
    """Free from the fold on and on the way down, with impacts on the way up (closed forms)."""
    figure = bifurcation(dataset.sel(direction=order))
    points, sizes = markers(figure.axes[0])
    assert len(set(sizes.values())) == 1
    omega, both = dataset["omega"].values, points[BOTH_COLOUR]
    apart = omega[(omega > 1.2861) & (omega < 1.6504)]
    for colour, way in ((UP, "up"), (DOWN, "down")):
        assert np.unique(points[colour][:, 0]).tolist() == apart.tolist()
        y = dataset["poincare_x"].sel(direction=way).isel(h=0).values
        expected = np.stack([np.broadcast_to(omega[:, None], y.shape), y], axis=-1)
        drawn = {tuple(point) for point in (*points[colour], *both)}
        assert {tuple(point) for point in expected.reshape(-1, 2)} <= drawn
    assert set(both[:, 0]) == set(omega) - set(apart)
    assert legend_texts(figure)[:3] == [*WAYS, "both"]
    assert "followed" not in figure.get_suptitle()


def test_an_arrow_leads_from_the_end_of_each_motion_to_the_next(dataset):
    """Up beyond the fold at 1.6504, down below the graze at 1.2861."""
    omega, x = dataset["omega"].values, dataset["poincare_x"].isel(h=0, section=-1)
    fold, graze = np.searchsorted(omega, [1.6504, 1.2861])
    expected = [("up", fold - 1, fold, UP), ("down", graze, graze - 1, DOWN)]
    arrows = bifurcation(dataset).axes[0].texts
    assert len(arrows) == 2
    for arrow, (way, start, stop, colour) in zip(arrows, expected, strict=True):
        motion = x.sel(direction=way).values
        assert arrow.xyann == pytest.approx((omega[start], motion[start]), rel=1e-3)
        assert arrow.xy == pytest.approx((omega[stop], motion[stop]), rel=1e-3)
        assert to_hex(arrow.arrow_patch.get_edgecolor()).upper() == colour


def test_neither_direction_hides_the_other_below(dataset):
    (points, _) = markers(bifurcation(dataset, below="impulse").axes[1])
    omega = dataset["omega"].values
    assert (points[DOWN][:, 1] == 0.0).all() and (points[UP][:, 1] > 0.0).all()
    counts = [len(points[colour]) for colour in (UP, DOWN, BOTH_COLOUR)]
    assert counts[0] == counts[1] > 0 and sum(counts) == 2 * len(omega)


@pytest.mark.parametrize("way", ["up", "down"])
def test_one_direction_can_be_picked(dataset, way):
    figure = bifurcation(dataset, at={"direction": way, "h": 0.06}, coordinate="poincare_v")
    alone = bifurcation(dataset.sel(direction=[way]), at={"h": 0.06}, coordinate="poincare_v")
    assert alone.get_suptitle() == figure.get_suptitle()
    points, _ = markers(figure.axes[0])
    (drawn,) = points.values()
    expected = dataset["poincare_v"].sel(direction=way, h=0.06).values
    np.testing.assert_array_equal(drawn[:, 1], expected.ravel())
    assert f"followed {way} along" in figure.get_suptitle()
    assert not any("omega" in text for text in legend_texts(figure))
    state = section(dataset, at={"direction": way, "omega": 1.5})
    x, v = (dataset[name].sel(direction=way, omega=1.5).isel(h=0) for name in
            ("poincare_x", "poincare_v"))  # fmt: skip
    np.testing.assert_array_equal(state.axes[0].lines[0].get_xydata(), np.stack([x, v], axis=1))
    assert f"followed {way} along" in state.get_suptitle()


def test_what_shows_one_branch_shows_the_way_up(dataset):
    for draw in (section, trajectory, parameter_map):
        title = draw(dataset, **({} if draw is parameter_map else {"at": {"omega": 1.5}}))
        assert "followed up along" in title.get_suptitle()
    maps = [parameter_map(dataset, at=at, quantity="impacts_per_period")
            for at in (None, {"direction": "up"}, {"direction": "down"})]  # fmt: skip
    default, up, down = (
        np.concatenate([m.get_array().ravel().filled(-1) for m in one.axes[0].collections
                        if isinstance(m, QuadMesh)]) for one in maps)  # fmt: skip
    np.testing.assert_array_equal(default, up)
    assert (up != down).any()


@pytest.mark.parametrize("way", ["up", "down"])
def test_a_colour_shows_the_motions_of_one_direction(dataset, way):
    """At 1.5, up is 1/1 and down is 1/0 in free oscillation: one state at the section each."""
    at = {} if way == "up" else {"direction": way}
    one = dataset.sel(omega=[1.5], method="nearest").isel(h=0)
    x = one["poincare_x"].sel(direction=way).values.ravel()
    some = OpenedSweep(dataset).at_values({"omega": [1.4, 1.5]})
    states = section(some, at={"h": 0.05} | at, color="omega")
    (drawn,) = states.axes[0].collections
    places = drawn.get_offsets()[:, 0]
    assert len(places) == 2 * dataset.sizes["section"] and set(x) <= set(places)
    motions = trajectory(some, at={"h": 0.05} | at, color="omega")
    assert len(motions.axes[0].lines) == 3  # one of each frequency, and the stop
    colours = bifurcation(dataset, at=at, color="period")
    assert colours.axes[0].collections[0].get_offsets().shape[0] == dataset["poincare_x"][0, 0].size
    for figure in (states, motions, colours):
        assert f"followed {way} along $\\omega$" in figure.get_suptitle()


def test_colours_tell_the_directions_apart(dataset):
    at = {"omega": 1.5, "h": 0.05}
    figures = [draw(dataset, at=at, color="direction") for draw in (section, trajectory, impacts)]
    (points,) = figures[0].axes[0].collections
    seen = {to_hex(rgba).upper(): x for x, rgba in zip(points.get_offsets()[:, 0],
            points.get_facecolors(), strict=True)}  # fmt: skip
    for colour, way in ((UP, "up"), (DOWN, "down")):
        expected = dataset["poincare_x"].sel(direction=way, omega=1.5, h=0.05).values[-1]
        assert seen[colour] == pytest.approx(expected, rel=1e-6)
    assert [to_hex(line.get_color()).upper() for line in figures[1].axes[2].lines[:2]] == [UP, DOWN]
    assert all(legend_texts(figure)[:2] == WAYS for figure in figures[:2])
    assert legend_texts(figures[2]) == WAYS[:1]  # down has no impact
    both = [bifurcation(dataset, color=color) for color in ("direction", None)]
    (points, _), (usual, _) = (markers(one.axes[0]) for one in both)
    assert points.keys() == usual.keys()
    with pytest.raises(Refused, match="color = direction shows both directions"):
        section(dataset, at=at, color="period")
    ways = (("up", UP), ("down", DOWN))
    for draw, (way, colour) in itertools.product((section, impacts), ways):
        (dots, *_) = draw(dataset, at={"direction": way}, color="direction").axes[0].collections
        assert {to_hex(rgba).upper() for rgba in dots.get_facecolors()} == {colour}


def test_a_diagram_of_attractors_says_that_both_directions_lead_to_them(dataset):
    title = attractor_diagram(dataset).legends[0].get_title().get_text()
    assert "starts" not in title and title.endswith(r"followed up and down along $\omega$")


def test_a_density_tells_the_directions_apart(dataset, monkeypatch):
    monkeypatch.setattr(diagram, "DENSITY_FROM", 99)
    figure = bifurcation(dataset)
    meshes = [m for m in figure.axes[0].collections if isinstance(m, QuadMesh)]
    drawn = [~np.ma.getmaskarray(mesh.get_array()) for mesh in meshes]
    assert [to_hex(mesh.cmap(1.0)).upper() for mesh in meshes] == [UP, DOWN, BOTH_COLOUR]
    assert not (drawn[0] & drawn[1]).any() and not (drawn[0] & drawn[2]).any()
    omega = dataset["omega"].values
    apart = drawn[0].any(axis=0) & drawn[1].any(axis=0)
    met = dataset["impacts_per_period"].isel(h=0).values > 0
    np.testing.assert_array_equal(apart[omega < 1.6], (met[0] != met[1])[omega < 1.6])
    assert legend_texts(figure)[2] == "both"
    one = bifurcation(dataset, at={"direction": "down"})
    assert len([m for m in one.axes[0].collections if isinstance(m, QuadMesh)]) == 1


def test_what_is_missing_is_counted_in_both_directions(stop_after):
    with stop_after(1, size=25), pytest.raises(KeyboardInterrupt):
        run_sweep(load_config("sweep.yaml"), "part.h5")
    with open_sweep("part.h5") as dataset:
        assert "up, $" in legend_texts(bifurcation(dataset))[0]
        figure = bifurcation(dataset, axes=["h"], at={"omega": 1.5})
        assert legend_texts(figure)[-1] == "not computed yet (2 of 4)"
        with pytest.raises(Refused, match=r"no point has a result: not computed yet .50."):
            bifurcation(dataset, at={"h": 0.06})


def test_the_command_line(path, unpainted):
    def drawn(*arguments):
        return call("plot", str(path), "-o", "picture.png", *arguments)

    assert drawn("--kind", "map", "--at", "direction=up").stdout == "picture.png\n"
    exact = ("--kind", "bifurcation", "--exact", "--classes", "1/1", "--at", "direction=down")
    told = drawn(*exact).stdout.splitlines()
    assert "1/1" in told[0] and told[-1] == "picture.png"
    several = ("--at", "omega=1.4,1.5")
    one_way = ("map",), ("section",), ("trajectory", *several), ("bifurcation", "--color", "period")
    for kind in one_way:  # of one direction, which is said
        assert "direction = up" in drawn("--kind", *kind).stderr, kind
    for kind in (("section", "--color", "direction", "--at", "omega=1.4"), ("attractors",)):
        assert "direction" not in drawn("--kind", *kind).stderr, kind
    wrong = drawn("--at", "direction=dwn")
    assert wrong.exit_code == 2
    assert "there is no direction dwn (did you mean down?); choose from: up, down" in wrong.stderr
    assert "direction is not a swept axis" in drawn("--axis", "direction").stderr


def test_two_curves_that_cross_are_of_both_directions_only_where_they_meet():
    """Though each coordinate of a point of one is near that of a point of the other."""
    x = np.linspace(-1.0, 1.0, 500)
    both = in_both(np.array([[x, x], [np.sin(3.0 * x), -np.sin(3.0 * x)]]), 0)
    assert 0 < np.count_nonzero(both) < 20
