"""Integrity measures against an exhaustive search, knocks against independent motions."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from sweeps import Refused, attractors, integrity, knocks
from sweeps.attractor.integrity import measures_of
from sweeps.attractor.knocks import _CLOSER, _MOMENTS, _SIZES
from sweeps.plotting import integrity as draw_integrity
from sweeps.plotting import plot
from tests.helpers.commands import accepted, refused
from tests.helpers.sweep_files import run_in
from vibroimpact import Oscillator, integrate, periodic_orbit, simulate
from vibroimpact.oscillator import POINT
from vibroimpact.points.regimes import Regime

pytestmark = pytest.mark.slow

#: The free oscillation (1/0) and a motion with an impact in two periods (2/1).
CONFIG = """\
oscillator: {h: 0.1, R: 0.8, omega: [2.6, 2.7], f: 1.0, clearance: 0.6}
start: {x0: {start: -3.0, stop: 0.6, num: 31}, v0: {start: -3.0, stop: 3.0, num: 41}}
record: {transient: 200, periods: 8, impacts: 4}
"""


def outside(inside, x, v, at_stop):
    """Return every start outside the basin, and one row of starts around the window."""
    dx, dv = x[1] - x[0], v[1] - v[0]
    more_x, more_v = np.r_[x[0] - dx, x, x[-1] + dx], np.r_[v[0] - dv, v, v[-1] + dv]
    around = np.ones((len(more_x), len(more_v)), bool)
    around[1:-1, 1:-1] = ~inside
    around[-1] &= not at_stop
    return np.stack([grid[around] for grid in np.meshgrid(more_x, more_v, indexing="ij")], axis=1)


def distances(places, ends, unit):
    """Return the distance of every place to every end, inf to one beyond all."""
    ends = np.vstack([ends, [[np.inf, np.inf]]])
    return np.sqrt((((places[:, None] - ends) * unit) ** 2).sum(axis=2))


@pytest.mark.parametrize("gap", [0.0, 0.2], ids=["at the stop", "before the stop"])
@pytest.mark.parametrize("weight", [0.4, 3.0])
def test_measures_equal_an_exhaustive_search(gap, weight):
    rng = np.random.default_rng(3)
    x, v = np.linspace(-2.0, 0.5, 26), np.linspace(-1.0, 3.0, 33)
    edges = set()
    for share in (0.5, 0.9, 0.99, 1.0):
        inside = rng.random((26, 33)) < share
        if share == 0.9:  # the basin ends in the window
            inside[[0, -1]] = inside[:, [0, -1]] = False
        others, unit = outside(inside, x, v, gap == 0.0), [1.0, weight]
        grids = np.meshgrid(x, v, indexing="ij")
        starts, seen = (
            np.stack([grid[mask] for grid in grids], axis=1) for mask in (inside, ~inside)
        )
        away, open_away = (distances(starts, ends, unit).min(axis=1) for ends in (others, seen))
        states = starts[rng.integers(len(starts), size=3)] + rng.uniform(-0.045, 0.045, (3, 2))
        states[:, 0] = np.minimum(states[:, 0], 0.5 + gap)
        measures = measures_of(inside, x, v, weight, 0.5 + gap, states)
        radius, *centre, at_edge, local, local_at_edge = measures
        assert radius == pytest.approx(away.max())
        assert away[np.abs(starts - centre).sum(axis=1).argmin()] == pytest.approx(radius)
        nearest = distances(states, others, unit).min()
        assert local == pytest.approx(nearest, rel=1e-12)
        # A bound is what grows as soon as nothing beyond the window counts as outside.
        assert at_edge == (open_away.max() > 1.0000001 * radius)
        assert local_at_edge == (distances(states, seen, unit).min() > 1.0000001 * local)
        edges.add(at_edge)
    assert edges == {False, True}
    leaves = np.array([[-1.0, 0.0], [-9.0, 0.0]])
    assert measures_of(inside, x, v, weight, 0.5, leaves)[-2:] == (0.0, True)


@pytest.mark.parametrize("cells", [24, 25])
def test_starts_in_the_middle_of_cells_reach_the_stop_in_every_unit(cells):
    """Half a spacing before the stop, as it is rounded in this unit."""
    for unit in (1.0, 1e-3, 1e-6, 377.0, 3e-5):
        x = np.linspace(-3.0 * unit, 0.6 * unit, 2 * cells + 1)[1::2]
        v = np.linspace(-3.0 * unit, 3.0 * unit, 31)
        inside = np.add.outer(x**2, v**2) < (1.5 * unit) ** 2
        radius, *_, local, at_edge = measures_of(inside, x, v, 1.0, 0.6 * unit, np.zeros((1, 2)))
        others = outside(inside, x, v, at_stop=True)
        assert local == pytest.approx(np.hypot(*others.T).min(), rel=1e-12) and not at_edge
        assert radius == pytest.approx(1.5 * unit, rel=0.1)


@pytest.mark.parametrize("unit", [2.0**-1000, 2.0**1000])
def test_the_measures_have_the_same_bits_in_extreme_units(unit):
    """Squares of the distances would be 0, or infinite."""
    x, v = np.linspace(-2.0, 0.5, 26), np.linspace(-1.0, 3.0, 33)
    inside, state = np.add.outer(x**2, v**2) < 1.0, np.array([[-0.2, 0.1]])
    expected = measures_of(inside, x, v, 0.7, 0.8, state)
    measures = measures_of(inside, unit * x, unit * v, 0.7, unit * 0.8, unit * state)
    lengths = np.array([1.0, 1.0, 1.0, 0.0, 1.0, 0.0])
    assert list(measures) == [*np.where(lengths, unit, 1.0) * expected]


def test_the_measures_of_each_attractor_along_an_axis(dataset):
    found = integrity(dataset)
    assert found["number"].values.tolist() == [[0, 1], [0, 1]]
    x, v = dataset["x0"].values, dataset["v0"].values
    for i, k in np.ndindex(2, 2):
        one = found.isel(omega=i, coexisting=k)
        inside = (found["attractor"].isel(omega=i) == one["number"]).transpose("x0", "v0").values
        others = outside(inside, x, v, at_stop=True)
        start = np.zeros(1, POINT)
        for name in ("h", "R", "omega", "f", "p", "clearance"):
            start[name] = dataset["omega"][i] if name == "omega" else dataset[name]
        start["x0"], start["v0"] = one["section_x"], one["section_v"]
        m = int(one["m"])
        run = integrate(start, transient=0, periods=m, at_section=True)
        points = np.stack([run["poincare_x"][0], run["poincare_v"][0]], axis=1)
        assert len(points) == (1, 2)[k]
        nearest = np.sqrt(((points[:, None] - others) ** 2).sum(axis=2)).min()
        assert one["local_integrity"] == pytest.approx(nearest, rel=1e-12)
        assert one["local_integrity"] <= one["integrity_factor"] + 0.1
        row, column = np.abs(x - one["disc_x"].item()), np.abs(v - one["disc_v"].item())
        assert inside[row.argmin(), column.argmin()]


def impacts_per_period(dataset, phase, x, velocities):
    """Return the impacts per period of motions from x at a phase, after 400 periods."""
    points = np.zeros(len(velocities), POINT)
    for name in ("h", "R", "f", "p", "clearance"):
        points[name] = dataset[name]
    points["omega"], points["x0"], points["v0"] = 2.6, x, velocities
    options = {"phase": phase % (2.0 * np.pi), "at_section": True}
    return integrate(points, transient=400, periods=4, **options)["impacts_per_period"]


@pytest.fixture
def all_knocks(monkeypatch):
    """Try as many knocks as a user does; they were read before `few_knocks` has changed them."""
    monkeypatch.setattr("sweeps.attractor.knocks._MOMENTS", _MOMENTS)
    monkeypatch.setattr("sweeps.attractor.knocks._SIZES", _SIZES)
    monkeypatch.setattr("sweeps.attractor.knocks._CLOSER", _CLOSER)


def test_the_least_knock_is_on_the_boundary_and_no_smaller_one_is_harmful(dataset):
    found = knocks(dataset.isel(omega=0))
    home = {0: 0.0, 1: 0.5}
    assert found["knock_ends"].values.tolist() == [1, 0]
    assert found["knock_certified"].all() and not found["knock_fractal"].any()
    for k in range(2):
        names = "phase", "x", "v", "harmless", "harmful"
        phase, x, v, harmless, harmful = (found[f"knock_{name}"].values[k] for name in names)
        assert 0.0 < (harmful - harmless) / harmful <= 1e-9
        both = impacts_per_period(dataset, phase, x, v + np.array([harmless, harmful]))
        assert both.tolist() == [home[k], home[1 - k]]
        smaller = np.linspace(-1.0, 1.0, 201) * abs(harmless)
        assert (impacts_per_period(dataset, phase, x, v + smaller) == home[k]).all()
        start = found["section_x"].values[k], found["section_v"].values[k]
        for x, v, phase in [*motion(dataset, *start)][::8]:
            ends = impacts_per_period(dataset, phase, x, v + 0.999 * smaller[::5])
            assert (ends == home[k]).all()


def test_a_thin_tongue_is_found_or_the_knock_is_called_fractal(tmp_path, all_knocks):
    """At other phases a tongue of 0.1 % of the knock is 0.4 % nearer; thinner ones more."""
    osc = Oscillator(h=0.0605, R=0.8748, omega=1.79, f=1.0, clearance=0.4613)
    file = run_in(
        tmp_path,
        "oscillator: {h: 0.0605, R: 0.8748, omega: 1.79, f: 1.0, clearance: 0.4613}",
        "start={x0: {start: -2.5387, stop: 0.4613, num: 16}, v0: {start: -3, stop: 3, num: 16}}",
        "record={transient: 300, periods: 32, diagnostics: [period]}",
    )
    found = knocks(file, numbers=[0]).isel(coexisting=0)
    assert found["number"] == 0 and found["knock_fractal"]
    orbit = periodic_orbit(osc, found["section_x"].item(), found["section_v"].item(), 1)
    points = np.repeat(osc.at(0.0), 500)
    for phase in (5.1326, 5.1817, 5.2308):
        points["x0"], v = orbit.sections(phase)[0]
        points["v0"] = v + found["knock_harmful"].item() * np.linspace(0.98, 0.998, 500)
        run = integrate(points, phase=phase, at_section=True, transient=1000, periods=1)
        assert np.abs(run["poincare_v"] - v).max() < 1e-6


def test_no_knock_to_the_side_of_an_orbit_that_has_just_flipped_is_harmful(
    computed_starts, monkeypatch
):
    """Beside 1/1 a motion needs some 100,000 periods to reach 2/2, which is not 1 % away."""
    monkeypatch.setattr("sweeps.attractor.knocks._MOMENTS", 4)
    monkeypatch.setattr("sweeps.attractor.knocks._SIZES", 16)
    osc = Oscillator(h=0.05, R=0.8, omega=2.658884546684836 + 1e-5, f=1.0)  # beyond the flip
    starts = computed_starts(
        f"oscillator={{h: 0.05, R: 0.8, omega: {osc.omega!r}, f: 1.0}}",
        "start={x0: [-1.273, -1.09], v0: [-0.182, 0.182]}",
        "record={transient: 4000, periods: 64, diagnostics: [period]}",
    )
    found = knocks(starts, numbers=[0])
    assert found["m"].values.tolist() == found["q"].values.tolist() == [2, 12]
    one = found.isel(coexisting=0)
    assert one["knock_ends"] == 1 and one["knock_certified"] and not one["knock_fractal"]
    home = periodic_orbit(osc, one["section_x"].item(), one["section_v"].item(), 2)
    sections, phase = home.sections(one["knock_phase"].item()), one["knock_phase"].item()
    points = np.repeat(osc.at(one["knock_x"].item()), 11)
    points["v0"] = one["knock_v"].item() + np.linspace(-1, 1, 11) * one["knock_harmless"].item()
    run = integrate(points, phase=phase, at_section=True, transient=200_000, periods=2)
    assert np.abs(run["poincare_x"][..., None] - sections[:, 0]).min(axis=2).max() < 1e-9


def test_a_knock_from_which_the_mass_comes_to_rest_leads_to_the_rest(computed_starts):
    """The spring presses the mass to the stop, and the force alone never lifts it."""
    starts = computed_starts(
        "oscillator={h: 0.01, R: 0.8, omega: 5.0, f: 1.0, clearance: -1.2}",
        "start={x0: [-1.3, -1.2], v0: [-1.0, 0.0, 1.0]}",
        "record={transient: 300, periods: 32, diagnostics: [period]}",
    )
    found = knocks(starts)
    assert found["motion"].values.tolist() == [Regime.PERIODIC, Regime.REST]
    assert found["knock_ends"].values.tolist() == [found["number"].values[1], -1]
    assert found["knock_certified"].values[0] and np.isnan(found["knock_harmful"].values[1])


@pytest.fixture
def knock(dataset, monkeypatch):
    """Return a function that finds the least knock, by a rule of what is harmful.

    The rule takes the sizes of changes of velocity, the phase and the orbit.
    """

    def found(harmful, home=0):
        def ends(motions, phase, states):
            orbit = motions.orbits[home]
            sections = orbit.sections(phase)
            v = sections[np.abs(states[:, :1] - sections[:, 0]).argmin(axis=1), 1]
            reached = np.where(harmful(np.abs(states[:, 1] - v), phase, orbit), 1 - home, home)
            return reached, np.ones(len(states), bool)

        monkeypatch.setattr("sweeps.attractor.knocks._Attractors._destinations", ends)
        starts = dataset.isel(omega=0)
        found = knocks(starts, attractors(starts).isel(coexisting=[home]))
        return {
            name: found[f"knock_{name}"].item() for name in ("harmful", "phase", "fractal", "ends")
        }

    return found


def away_from(phase, moment):
    """Return the distance of a phase from a moment of the period."""
    return abs((phase - moment + np.pi) % (2.0 * np.pi) - np.pi)


def test_a_boundary_that_rounding_decides_is_fractal(knock):
    """Beyond a change of velocity by 0.3, every trial ends on an unpredictable attractor."""
    chance = np.random.default_rng(0)
    found = knock(lambda size, *_: (size > 0.3) & (chance.integers(0, 2, len(size)) == 1))
    assert abs(found["harmful"]) == pytest.approx(0.3, rel=1e-4)
    assert found["fractal"] and found["ends"] == 1


@pytest.mark.parametrize(("moment", "middle"), [(0.0, 0.8), (5.95, 1.34)])
def test_an_island_of_the_promised_size_is_found(knock, all_knocks, moment, middle):
    """It takes 1/64 of the period, and 1/128 of the knock that there would be without it."""
    height, width = 3.01 / 128, 2.0 * np.pi / 64

    def harmful(size, phase, _):
        near = away_from(phase, moment) <= 0.51 * width
        return (size > 3.01) | (near & (np.abs(size - middle) <= height / 2))

    assert abs(knock(harmful)["harmful"]) == pytest.approx(middle - height / 2)


@pytest.mark.parametrize("tongue", [False, True])
def test_the_worst_moment_and_a_tongue_at_another_one_are_found(
    knock, all_knocks, monkeypatch, tongue
):
    """The knock is 0.3 at the phase 2, and above 0.4 where the tongue is a 100th above 0.3."""
    monkeypatch.setattr("sweeps.attractor.knocks._MOMENTS", 16)

    def harmful(size, phase, _):
        squared = away_from(phase, 2.0) ** 2
        thin = tongue & (squared > 1.0) & (np.abs(size - 0.303) < 1e-3)
        return (size > 0.3 + 0.1 * squared) | thin

    found = knock(harmful)
    assert abs(found["harmful"]) == pytest.approx(0.3, rel=1e-8)
    assert found["phase"] == pytest.approx(2.0, abs=1e-3) and found["fractal"] is tongue


def test_a_knock_is_tried_just_after_the_impact(knock):
    """However short the time is for which a small one is harmful."""

    def harmful(size, phase, orbit):
        return size > (0.5 if (phase - orbit.phases[0]) % (2.0 * np.pi) < 1e-9 else 3.01)

    assert abs(knock(harmful, home=1)["harmful"]) == pytest.approx(0.5)


def motion(dataset, x, v):
    """Yield states of a motion of at most two periods, and their phases."""
    names = ("h", "R", "f", "p", "clearance")
    osc = Oscillator(**{name: dataset[name].item() for name in names}, omega=2.6)
    run = simulate(osc, 2, x0=x, v0=v)
    inside = run.v <= np.where(run.x < 0.6, np.inf, 0.0)  # after an impact, not before it
    for t, x, v in zip(run.t[inside], run.x[inside], run.v[inside], strict=True):
        yield x, v, 2.6 * t


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("start.x0=0", "integrity needs x0 and v0 as axes; the file has omega, v0"),
        ("start.x0=[-1]", "integrity needs two or more values of x0; the file has one"),
        ("start.x0=[-3, -1, 0]", "the values of x0 are not evenly spaced"),
        ("record.phase=0.5", "the starts are at omega t = 0, and the section is at 0.5"),
        ("start.phase=0.5", "again with record.phase: 0.5"),
        ("follow={axis: omega}", "run the sweep again without follow"),
    ],
)
def test_a_sweep_without_a_window_is_refused(override, message, tmp_path):
    few = "record={transient: 0, periods: 2}", "start.x0=[-2, -1, 0]", "start.v0=[-1, 0, 1]"
    path = run_in(tmp_path, CONFIG, *few, override)
    assert message in refused("integrity", path)


def test_one_phase_of_several_is_chosen_as_the_refusal_says(tmp_path, no_knocks):
    few = "record={transient: 9, periods: 2, phase: 2}", "start.x0=[-2, -1, 0]"
    few = *few, "start.v0=[-1, 0, 1]", "oscillator.omega=2.6"
    both = run_in(tmp_path, CONFIG, *few, "start.phase=[0, 2]", name="both.h5")
    one = run_in(tmp_path, CONFIG, *few, "start.phase=2", name="one.h5")
    assert "fix phase at that of the section, 2" in refused("integrity", both)
    assert accepted("integrity", both, "--at", "phase=2") == accepted("integrity", one)


def test_other_requests_are_refused(dataset):
    with pytest.raises(Refused, match="others fixed; there are omega, x0, v0"):
        knocks(dataset)
    with pytest.raises(Refused, match=r"numbers = \[9\] is .* expected: numbers out of 0, 1"):
        knocks(dataset.isel(omega=0), numbers=[9])


def test_the_command(tmp_path):
    file = run_in(tmp_path, CONFIG, "start.x0.num=16", "start.v0.num=21")
    lines = accepted("integrity", file).splitlines()
    assert [line.split()[:3] for line in lines[1:3]] == [["2.6", "0", "1/0"], ["2.6", "1", "2/1"]]
    assert "[" not in lines[0]  # no unit has a name
    assert "(dv / p)^2), at omega t = 0" in lines[-1]
    text = accepted("integrity", file, "--at", "omega=2.6", "--csv", "a.csv")
    assert "to 1" in text and "to 0" in text
    heading, *rows = Path("a.csv").read_text().splitlines()
    accepted("attractors", file, "--at", "omega=2.6", "--csv", "b.csv")
    other, *same = Path("b.csv").read_text().splitlines()
    assert other == "attractor,motion,m,q,fraction,impact_v"
    assert heading.startswith(f"{other},integrity_factor,disc_x,") and len(rows) == 2
    assert all(row.startswith(f"{start},") for row, start in zip(rows, same, strict=True))
    assert rows[1].startswith("1,periodic,2,1,")


def test_motions_that_have_not_settled_are_rows_without_measures(tmp_path):
    """Without losses few motions settle."""
    few = "start={x0: {start: -1, stop: 0.5, num: 6}, v0: {start: -1, stop: 1, num: 6}}"
    undamped = "oscillator={h: 0, R: 1, omega: 1, f: 0.3, clearance: 0.5}"
    file = run_in(tmp_path, CONFIG, few, undamped, "record={transient: 0, periods: 4}")
    lines = accepted("integrity", file, "--csv", "a.csv").splitlines()
    (row,) = (line.split() for line in lines if line.split()[1:2] == ["unknown"])
    assert row[:2] == ["-", "unknown"] and row[4:] == ["-", "-", "-"]
    assert "of the starts are unknown, which is no attractor" in "\n".join(lines)
    assert Path("a.csv").read_text().count("unknown") == 1
    assert accepted("attractors", file).splitlines()[2].split() == row[:4]


def test_a_sweep_by_time_steps_has_measures_and_no_knocks(tmp_path, unpainted):
    few = "start={x0: {start: -2, stop: 0, num: 5}, v0: {start: -2, stop: 2, num: 5}}"
    method = "method={integrator: rk4, impact: cubic}", "oscillator.omega=2.6"
    file = run_in(tmp_path, CONFIG, few, *method)
    assert "least knock" not in accepted("integrity", file)
    plot(file, "a.png", "integrity")
    with pytest.raises(Refused, match="a knock needs the impact rule exact"):
        knocks(file)


def test_integrity_is_drawn_into_panels_of_another_figure(dataset, no_knocks):
    four = Figure().subplots(4)
    assert draw_integrity(dataset, ax=four) is four[0].figure and all(panel.lines for panel in four)
    one = Figure().subplots()
    assert draw_integrity(dataset.isel(omega=0), ax=one) is one.figure and one.collections
    with pytest.raises(Refused, match="ax has 1 panel; expected: 4"):
        draw_integrity(dataset, ax=one)
    with pytest.raises(Refused, match="ax has 2 panels; expected: 4"):
        draw_integrity(dataset, ax=four[:2])
    with pytest.raises(Refused, match="expected: 1 or 2 or 3 or 4 panels of a figure"):
        draw_integrity(dataset, ax=Figure().subplots(5))
