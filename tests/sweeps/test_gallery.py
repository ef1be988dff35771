"""The scenes of configs/ against their comments, on coarser grids where that is enough."""

import importlib.util

import numpy as np
import pytest
from matplotlib.colors import same_color
from numpy.testing import assert_allclose

from sweeps import attractors, curves, integrity, load_config, open_sweep, run_sweep
from sweeps.attractor.attractor_table import attractor_rows
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting import KINDS
from tests.helpers import naive
from tests.helpers.places import CONFIGS
from vibroimpact import (
    Oscillator,
    branch,
    integrate,
    one_impact_orbit,
    one_impact_orbits,
    periodic_orbit,
)
from vibroimpact.orbits.orbit import free_orbit
from vibroimpact.oscillator import POINT
from vibroimpact.points.regimes import Regime

pytestmark = pytest.mark.slow


@pytest.fixture
def scene(tmp_path):
    """Return a function that runs a scene with overrides and reads the file."""

    def run(name, *overrides):
        path = tmp_path / f"{name}.h5"
        config = load_config(CONFIGS / f"{name}.yaml", overrides)
        run_sweep(config, path, progress=False, overwrite=True)
        with open_sweep(path) as dataset:
            return dataset.load()

    return run


def script(name):
    """Return a script of configs/ as a module."""
    spec = importlib.util.spec_from_file_location(name, CONFIGS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def values(*given):
    return "[" + ", ".join(map(str, given)) + "]"


def classes(dataset):
    """Return the class m/q or the kind of motion of every point."""
    named = []
    for motion, m, q in zip(
        OpenedSweep(dataset).regimes.ravel(), dataset["period"].values.ravel(),
        dataset["period_impacts"].values.ravel(), strict=True,
    ):  # fmt: skip
        named.append(f"{m}/{q}" if motion == Regime.PERIODIC else Regime(motion).name.lower())
    return named


def test_scattering_parts_have_the_probabilities_of_a_sample_ten_times_as_large(scene):
    """Of independent draws; and the scatter of the impulse is that of the restitution."""
    from scipy.stats import binomtest  # half a second, which no other test needs

    dataset, n, draws = scene("tolerances"), 512, np.random.default_rng(1)
    table = np.loadtxt(CONFIGS / "tolerances.csv", delimiter=",", skiprows=1, usecols=range(4))
    assert_allclose(table.T, [dataset[name] for name in ("clearance", "R", "p", "f")], rtol=0)
    points = np.zeros(10_240, POINT)
    points["h"], points["omega"] = 4.0, 236.0
    points["clearance"] = draws.normal(5e-4, 1e-5, points.size)
    points["R"] = draws.uniform(0.6, 0.8, points.size)
    points["p"] = np.sqrt(draws.normal(8e3, 80.0, points.size) / 0.5)
    points["f"] = draws.normal(8.0, 0.16, points.size) / 0.5
    direct = integrate(points, transient=1500, periods=60, impacts=0)
    share = (direct["impacts_per_period"] == 0.0).mean()
    missed = dataset["impacts_per_period"].values[: 2 * n] == 0.0
    low, high = binomtest(int(missed.sum()), 2 * n).proportion_ci(0.99, method="wilson")
    assert low < share < high
    picture = script("tolerances_picture")
    assert picture.classes(dataset)["1/0"] == missed.sum()
    first, total = picture.indices(dataset["impulse"])
    assert first[1] > 0.7 and (total[[0, 2, 3]] < 0.25).all()
    assert len(picture.draw(dataset).axes) == 3


def slow_speeds(osc, q, **start):
    """Return the last q impact speeds by RK4 and a cubic root, in plain Python, increasing."""
    _, impacts = naive.shortened(osc, naive.rk4_step, 80, 100, **start, locate=naive.on_the_cubic)
    return np.sort(impacts[-q:, 1])


def inner(labels):
    """Return a mask of the points with eight neighbours of the same label."""
    same = np.zeros(labels.shape, bool)
    same[1:-1, 1:-1] = True
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            same &= np.roll(labels, (i, j), axis=(0, 1)) == labels
    return same


def test_joint_clearance(scene):
    """The rig of the comment gives the oscillator, and both ranges have two motions."""
    dataset = scene("joint-clearance", "oscillator.omega.num=221")
    rig = dict(mass=0.5, stiffness=8000, damping=4, force=8, gap=0.0005, R=0.7)
    osc = Oscillator.from_rig(**rig, frequency=10.0)
    for name in ("h", "R", "f", "p", "clearance"):
        assert dataset[name].item() == getattr(osc, name)
    assert_allclose(dataset["omega"].values[[0, -1]], 2 * np.pi * np.array([10, 45]), rtol=3e-3)
    up, down = dataset["impacts_per_period"].values
    omega = dataset["omega"].values
    amplitude = osc.f / np.hypot(osc.p**2 - omega**2, 2 * osc.h * omega)
    graze = omega[amplitude < osc.clearance][0]
    one_or_none = omega[(up == 1.0) & (down == 0.0)]
    assert_allclose(one_or_none[[0, -1]], [graze, 238.1013], atol=1.5)
    two_or_one = omega[(up == 2.0) & (down == 1.0)]
    assert_allclose(two_or_one[[0, -1]], [100.93, 106.36], atol=1.5)
    assert dataset["poincare_v"].attrs["units"] == "m/s"


def test_basins(scene):
    """Another grid confirms the fractions of the full one, and slow steps single starts."""
    x0, v0 = "{start: -2.98, stop: -0.03, num: 61}", "{start: -2.97, stop: 2.95, num: 67}"
    grid = f"start={{x0: {x0}, v0: {v0}}}"
    dataset = scene("basins", grid)
    found = attractors(dataset)
    table = {row.name: row for row in attractor_rows(OpenedSweep(dataset), found)}
    assert set(table) == {"1/1", "2/3"}
    assert table["1/1"].fraction == pytest.approx(0.181, abs=0.012)  # edge / grid: 0.01
    assert_allclose(table["1/1"].speeds, [one_impact_orbit(Oscillator(0.0, 0.8, 1.3, 1.0)).v])
    assert_allclose(table["2/3"].speeds, [0.7030, 1.1145, 2.2536], atol=1e-4)
    own = found["attractor"].values
    osc = naive.oscillator(0.0, 0.8, 1.3)
    for row in table.values():
        places = np.argwhere(inner(own) & (own == row.number))
        for i, j in places[:1]:
            start = {"x": dataset["x0"].values[i], "v": dataset["v0"].values[j]}
            assert_allclose(slow_speeds(osc, row.q, **start), row.speeds, atol=1e-3)


def test_basins_on_the_stop(scene):
    """The launch of each orbit at its impact leads to it, and the basins go on beyond one turn."""
    v0, phase = "{start: -2.99, stop: -0.01, num: 61}", "{start: 0, stop: 6.28, num: 67}"
    grid = f"start={{x0: 0, v0: {v0}, phase: {phase}}}"
    dataset = scene("basins-at-impact", grid)
    found = attractors(dataset)
    table = {row.name: row for row in attractor_rows(OpenedSweep(dataset), found)}
    assert set(table) == {"1/1", "2/3"}
    assert table["1/1"].fraction == pytest.approx(0.244, abs=0.012)
    osc = Oscillator(0.0, 0.8, 1.3, 1.0)
    twice = periodic_orbit(osc, *table["2/3"].states[0], m=2)
    for orbit, name in ((one_impact_orbit(osc), "1/1"), (twice, "2/3")):
        for phase, speed in zip(orbit.phases % (2.0 * np.pi), orbit.speeds, strict=True):
            start = {"phase": phase, "v0": -0.8 * speed}
            assert found["attractor"].sel(start, method="nearest") == table[name].number
    first, last = found["attractor"].sel(phase=[0.0, 6.28]).transpose("phase", ...).values
    assert (first != last).mean() < 0.05


def test_basins_with_a_clearance(scene):
    x0, v0 = "{start: -2.98, stop: 0.57, num: 61}", "{start: -2.97, stop: 2.95, num: 67}"
    grid = f"start={{x0: {x0}, v0: {v0}}}"
    dataset = scene("basins-clearance", grid)
    table = {row.name: row for row in attractor_rows(OpenedSweep(dataset), attractors(dataset))}
    assert set(table) == {"1/0", "2/1"}
    steady = -1.0 / (1.0 - 2.6**2 + 2j * 0.1 * 2.6)
    assert_allclose(table["1/0"].states, [[steady.imag, (2.6j * steady).imag]], atol=1e-9)
    assert table["2/1"].fraction == pytest.approx(0.360, abs=0.012)
    orbit = one_impact_orbit(Oscillator(0.1, 0.8, 2.6, 1.0, clearance=0.6), n=2)
    assert orbit.stable
    assert_allclose(table["2/1"].speeds, [orbit.v], rtol=1e-9)


def test_grazing(scene):
    dataset = scene("grazing", f"oscillator.clearance={values(1.845, 1.9, 1.925)}")
    found = {}
    for row in attractor_rows(OpenedSweep(dataset), attractors(dataset)):
        found.setdefault(row.parameters["clearance"], set()).add(row.name)
    assert found == {1.845: {"1/1"}, 1.9: {"2/1", "1/0"}, 1.925: {"1/0"}}
    for clearance, exists in ((1.9205, True), (1.9207, False)):
        osc = Oscillator(0.1, 0.8, 0.7, 1.0, clearance=clearance)
        assert any(orbit.stable for orbit in one_impact_orbits(osc, n=2)) == exists


#: Scenes at a few values, and the classes there. The first flip of the cascade is at 4.6437, and
#: 3/1 begins at 5.303; that of the quickstart is at 2.65888454668484, and 2/1 begins at 3.338. In
#: the map lie the tongues of one impact in one, two and three periods (windows at h = 0).
CLASSES = {
    "restitution": (
        ["oscillator.R=[0.35, 0.45, 0.545, 0.5585, 0.58]"],
        ["2/2", "4/4", "8/8", "16/16", "chaotic"],
    ),
    "cascade": (
        ["oscillator.omega=[4.63, 4.66, 4.715, 4.76, 5.29, 5.32]"],
        ["2/1", "4/2", "8/4", "chaotic", "6/3", "3/1"],
    ),
    "quickstart": (
        ["oscillator.omega=[2.5, 2.65, 2.67, 2.95, 3.4]", "record.diagnostics=[period, lyapunov]"],
        ["1/1", "1/1", "2/2", "chaotic", "2/1"],
    ),
    "period-map": (
        ["oscillator.R=0.8", "oscillator.omega=[2.0, 2.64, 2.68, 4.0, 6.0]"],
        ["1/1", "1/1", "2/2", "2/1", "3/1"],
    ),
}


@pytest.mark.parametrize("name", CLASSES)
def test_a_scene_has_the_classes_of_its_comment(scene, name):
    overrides, expected = CLASSES[name]
    assert classes(scene(name, *overrides)) == expected


def test_impacts_are_added_one_by_one_down_to_rest(scene):
    """The paper's third case has four; the chatter is complete below R = 0.4693426554."""
    R = values(0.65, 0.55, 0.5, 0.48, 0.4694, 0.4693)
    dataset = scene("impact-adding", f"oscillator.R={R}")
    assert classes(dataset)[:4] == ["1/2", "1/3", "1/4", "1/5"]
    assert (dataset["rest_fraction"].values > 0.0).tolist() == [False] * 5 + [True]
    speeds = np.sort(dataset["impact_v"].values[2, -4:])
    expected = [0.036454221377120, 0.115762561014269, 0.321900878724339, 0.907496491171004]
    assert_allclose(speeds, expected)


def test_damping(scene):
    """3/2 and 4/3, also by slow steps."""
    dataset = scene("damping", f"oscillator.h={values(0.1, 0.19, 0.25, 0.35, 0.5)}")
    assert classes(dataset) == ["chaotic", "rest", "3/2", "chaotic", "4/3"]
    for place, h, q in ((2, 0.25, 2), (4, 0.5, 3)):
        speeds = np.sort(dataset["impact_v"].values[place, -q:])
        assert_allclose(slow_speeds(naive.oscillator(h, 0.8, 2.9), q), speeds, atol=1e-3)


def test_chatter(scene):
    """Rest up to about 0.361; at h = 0.05, omega = 0.3 for as long as by slow steps."""
    omega = values(0.2, 0.3, 0.35, 0.37)
    dataset = scene("chatter", f"oscillator.omega={omega}", "oscillator.h=0.03")
    assert (dataset["rest_fraction"].values > 0.0).tolist() == [True, True, True, False]
    dataset = scene("chatter", f"oscillator.omega={values(0.3, 0.31)}", "oscillator.h=0.05")
    slow = naive.ExactOrbit(naive.oscillator(0.05, 0.8, 0.3), 4)
    begin, end = slow.rests[-1]
    fraction = (end - begin) * 0.3 / (2.0 * np.pi)
    assert_allclose(dataset["rest_fraction"].values[0], fraction, atol=1e-6)


def test_integrity(scene):
    """The disc of 2/1 has .64 at 2.6 and shrinks until 2/1 ends; at 2.75 only 1/0 is left."""
    few = "start.x0.num=73", "start.v0.num=121"  # one start in 0.05
    dataset = scene("integrity", f"oscillator.omega={values(2.6, 2.74, 2.75)}", *few)
    found = integrity(dataset)
    assert found["m"].values.tolist() == [[1, 2], [1, 2], [1, -1]]
    factor, local = found["integrity_factor"].values, found["local_integrity"].values
    assert_allclose(factor[:2, 1], [0.64, 0.38], atol=0.06)
    assert_allclose(local[:2, 1], [0.20, 0.06], atol=0.06)
    assert found["factor_at_edge"].values[2, 0] and found["local_at_edge"].values[2, 0]
    figure = KINDS["integrity"].draw(dataset, at={"omega": 2.75})
    *profile, basins = figure.axes
    share = found["fraction"].values
    edges = np.zeros(share.shape, bool), found["factor_at_edge"], found["local_at_edge"]
    for panel, measure, bound in zip(profile, (share, factor, local), edges, strict=True):
        free, dots, bounds, other, *_, here = panel.lines
        assert_allclose(free.get_ydata(), measure[:, 0])
        assert_allclose(other.get_ydata(), measure[:, 1])
        for marks, shown in ((dots, ~bound[:, 0]), (bounds, bound[:, 0])):
            assert_allclose(marks.get_ydata(), np.where(shown, measure[:, 0], np.nan))
        assert np.nanmax(measure) < panel.get_ylim()[1]
        assert same_color(bounds.get_markerfacecolor(), panel.get_facecolor())  # hollow
        assert set(here.get_xdata()) == {2.75}
    assert basins.get_title("left") == r"basins at $\omega=2.75$"
    assert any("2/1" in text.get_text() for text in figure.legends[0].get_texts())


def test_bouncing_ball(scene):
    """Downwards; omega^2 is pi / 3 at the fold and 1.5268237 at the flip; v = 4 pi / (3 omega)."""
    omega = np.sqrt([0.98, 1.04, 1.06, 1.15, 1.3, 1.5, 1.6, 1.68, 1.7, 1.75])
    dataset = scene("bouncing-ball", f"oscillator.omega={values(*omega.tolist())}")
    expected = ["rest"] * 2 + ["1/1"] * 4 + ["2/2", "4/4", "8/8", "chaotic"]
    assert classes(dataset) == expected
    assert dataset["impacts_per_period"].values[0] == 0.0 < dataset["impacts_per_period"].values[1]
    speeds = 4.0 * np.pi / (3.0 * omega[2:6])
    assert_allclose(dataset["impact_v"].values[2:6, -1], speeds, rtol=1e-6)


def test_vibrating_table(scene):
    """The fold and the flip of 1/1 are on the curves of the closed form, and 1/1 is between."""
    few = "rig.frequency.num=5", "rig.base.num=81"
    dataset = scene("vibrating-table", *few)
    found = curves(dataset)
    acceleration = (found["a"] * found["omega"] ** 2 / 9.81).values
    flip = np.sqrt((np.pi / 3.0) ** 2 + 4.0 * 1.25**2 / 1.5**4)
    single = (found["m"] == 1).values & (found["q"] == 1).values
    for kind, expected in (("fold", np.pi / 3.0), ("flip", flip)):
        on_curve = acceleration[single & (found["kind"] == kind).values]
        assert len(on_curve) > 2
        assert_allclose(on_curve, expected, rtol=1e-6)
    level = (dataset["a"] * dataset["omega"] ** 2 / 9.81).transpose(*dataset["period"].dims).values
    period = np.where(dataset["rest_fraction"].values > 0.0, -1, dataset["period"].values)
    inside = (level > np.pi / 3.0 + 0.01) & (level < flip - 0.01)
    assert (period[inside] == 1).mean() > 0.8 and set(period[inside]) <= {1, -1}
    assert not (period[level < np.pi / 3.0] == 1).any()


def test_shaker(scene):
    """Impacts begin and end where a omega^2 / |p^2 - omega^2 + 2 i h omega| is the gap."""
    dataset = scene("shaker", "rig.frequency.num=171")
    omega = dataset["omega"].values
    amplitude = 5e-5 * omega**2 / np.hypot(16000.0 - omega**2, 8.0 * omega)
    above, hertz = amplitude > 3e-4, omega / (2.0 * np.pi)
    assert_allclose(hertz[above][[0, -1]], [18.7549, 21.9161], atol=0.1)
    up, down = (dataset["impacts_per_period"].values > 0.0)[:2]
    assert np.array_equal(down, above)
    assert np.array_equal(up, (hertz > 18.7549) & (hertz < 29.8532))
    grazes = [end.value for end in branch(
        free_orbit(Oscillator.from_rig(mass=0.5, stiffness=8000, damping=4, base=5e-5, gap=3e-4,
                                       R=0.7, frequency=15.0)), "omega", 80.0, 160.0,
    ).special if end.kind == "graze"]  # fmt: skip
    assert_allclose(grazes, [2.0 * np.pi * 18.7548527643], rtol=1e-11)
