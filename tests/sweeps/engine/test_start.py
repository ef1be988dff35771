"""The phase of the force at the start of every motion: `start: {phase: 1.5}`."""

import math
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sweeps import attractors, knocks, plotting
from sweeps.errors import ConfigError, Refused
from sweeps.explorer.view import View
from sweeps.opened.coordinates import motion_of
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.plotting import integrity_picture
from sweeps.plotting.api import default_kind
from tests.helpers import naive
from tests.helpers.commands import accepted, refused
from tests.helpers.configurations import load
from tests.helpers.kernel_cases import integrated
from tests.helpers.sweep_files import data, run_and_read, run_in, swept
from vibroimpact import INTEGRATORS, Oscillator, integrate, simulate

pytestmark = pytest.mark.slow

OSC = Oscillator(h=0.05, R=0.8, omega=1.3, f=0.4, clearance=0.3, a=0.2)
CONFIG = """
oscillator: {h: 0.05, R: 0.8, omega: 1.3, f: 0.4, clearance: 0.3, a: 0.2}
start: {x0: [-1.0, 0.0, 0.3], v0: [-0.5, 0.6], phase: 4.0}
record: {transient: 0, periods: 6, phase: 1.0, trajectory: {every: 1}}
"""


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_free_motion_from_any_phase_is_the_closed_form(integrator):
    """To the error of the steps, from starts before and beyond the phase of the section."""
    free, error = naive.oscillator(0.05, 0.8, 1.3, clearance=50.0, a=0.2), []
    for start in (0.0, 0.9, 2.5, 6.1):
        points = Oscillator(**vars(free)).at(-0.7, 0.4, start)
        flight = naive.ClosedForm(free, start / 1.3, -0.7, 0.4)
        rule = "exact" if integrator == "exact" else "plain"
        run = integrated(points, integrator, rule, 1000, periods=2, phase=1.7)
        turns = np.arange(1, 3) + (start > 1.7)
        x, v = flight((1.7 + 2.0 * math.pi * turns) / 1.3)
        error += [run["poincare_x"][0] - x, run["poincare_v"][0] - v]
    order = INTEGRATORS[integrator].order
    assert np.abs(error).max() < {None: 1e-12, 1: 0.1, 2: 1e-4, 4: 1e-9}[order]


@pytest.mark.parametrize("start", [-0.1, 2.0 * math.pi, math.nan, "1", True])
def test_a_phase_that_cannot_be_is_refused(start):
    said = r"phase \(forcing phase at the start\) = .*; expected: a number >= 0 and < 2 pi"
    with pytest.raises((ValueError, TypeError), match=said):
        OSC.at(phase=start)
    points = OSC.at().repeat(2)
    points["phase"][1] = 2.0 * math.pi
    with pytest.raises(ValueError, match=r"points\[1\]: " + said):
        integrate(points)


def test_a_sweep_starts_at_the_phase_of_its_start():
    """Results, trajectories and their times are those of `simulate` from that phase."""
    swept = run_and_read(load(CONFIG))
    flat = swept.stack(point=("x0", "v0"))
    for i in range(flat.sizes["point"]):
        one = flat.isel(point=i)
        run = simulate(OSC, 8, phase=4.0, x0=float(one["x0"]), v0=float(one["v0"]))
        t = one["trajectory_t"].values[np.isfinite(one["trajectory_t"].values)]
        assert t[[0, -1]] == pytest.approx((1.0 + 2.0 * math.pi * np.array([1, 7])) / 1.3)
        hits = np.flatnonzero(np.diff(t) == 0.0)
        expected = run.impact_t[(run.impact_t > t[0]) & (run.impact_t < t[-1])]
        assert len(expected) > 2
        np.testing.assert_allclose(t[hits], expected, atol=1e-11)
        speeds = run.impact_v[(run.impact_t > t[0]) & (run.impact_t < t[-1])]
        np.testing.assert_allclose(one["trajectory_v"].values[hits], speeds, atol=1e-11)


@pytest.mark.parametrize("transient", ["7", "auto"])
def test_every_way_to_run_a_point_starts_there(transient):
    """Grid, table, first points of chains, and transients that are found have the same bits."""
    change = [f"record.transient={transient}", "record.trajectory=false"]
    grid = run_and_read(load(CONFIG, *change))
    assert (run_and_read(load(CONFIG, *change, "start.phase=3.9"))["poincare_x"]
            != grid["poincare_x"]).any()  # fmt: skip
    table = """
oscillator: {h: 0.05, R: 0.8, omega: 1.3, f: 0.4, clearance: 0.3, a: 0.2}
points: {x0: [-1.0, 0.3], v0: [0.6, -0.5], setting: [8, 9]}
start: {phase: 4.0}
record: {transient: 0, periods: 6, phase: 1.0}
"""
    rows = run_and_read(load(table, *change[:1]))
    corners = [grid.sel(x0=-1.0, v0=0.6), grid.sel(x0=0.3, v0=-0.5)]
    for row, corner in enumerate(corners):
        assert np.array_equal(rows["poincare_x"][row], corner["poincare_x"])
    if transient != "auto":
        text = CONFIG + "follow: {axis: omega, direction: down}\n"
        steps = f"method.steps_per_period={load(CONFIG).method.steps_per_period + 3}"
        chain = run_and_read(load(text, *change, "oscillator.omega=[1.2, 1.3]", steps))
        grid = run_and_read(load(CONFIG, *change, steps))
        assert np.array_equal(chain["poincare_x"].sel(omega=1.3), grid["poincare_x"])


BASINS = """
oscillator: {h: 0.1, R: 0.8, omega: 2.6, f: 1.0, clearance: 0.6}
start: {x0: {start: -3, stop: 0.6, num: 9}, v0: {start: -3, stop: 3, num: 9}, phase: 1.1}
record: {transient: 100, periods: 16, phase: 1.1}
"""


def test_basins_at_another_phase(monkeypatch):
    """Each start is classed as one period of its motion later, and a knock is that of phase 0."""
    dataset = swept(BASINS)
    period = dataset["period"].values
    assert set(np.unique(period)) == {1, 2}
    points = load(BASINS).sweep.grid.points((slice(None),) * 2)
    later = integrate(points, transient=0, periods=1, phase=0.0)
    points["x0"], points["v0"] = later["poincare_x"][:, 0], later["poincare_v"][:, 0]
    points["phase"] = 0.0
    ends = integrate(points, transient=100, periods=4)["poincare_x"]
    twice = np.abs(ends[:, -1] - ends[:, -2]) > 1e-6
    assert np.array_equal(twice.reshape(period.shape), period == 2)
    here = []
    monkeypatch.setattr(
        integrity_picture, "with_cache",
        lambda find: lambda *given: here.append(find(*given)) or here[0],
    )  # fmt: skip
    figure = plotting.integrity(dataset)
    texts = [text for panel in figure.axes for text in panel.texts]
    arrows = [text for text in texts if hasattr(text, "arrowprops")]
    assert len(arrows) == 2
    for arrow in arrows:  # from a state of its orbit at the section
        x, v = arrow.xyann
        away = np.hypot(dataset["poincare_x"] - x, dataset["poincare_v"] - v)
        assert float(away.min()) < 1e-3
    there = swept(BASINS, "start.phase=0", "record.phase=0")
    assert attractors(there).sizes["coexisting"] == 2
    harmful = [np.sort(np.abs(table["knock_harmful"])) for table in (*here, knocks(there))]
    assert harmful[0] == pytest.approx(harmful[1], rel=1e-6)


def test_the_phase_is_kept_and_shown(tmp_path):
    """In the file, on the page, in the title, and in the configuration that each of them saves."""
    path = run_in(tmp_path, CONFIG, "start.x0=0", "start.v0=0", "record.trajectory=false")
    assert "phase: 4.0" in accepted("info", path, "--config")
    again = run_in(tmp_path, accepted("info", path, "--config"), name="again.h5")
    assert data(again).equals(data(path))
    view = View.of(load(CONFIG))
    assert view.diagram(3).start.phase == 4.0
    assert view.with_query("phase=3.5&section=2").diagram(3).start.phase == 3.5
    figure = plotting.trajectory(path)
    title = figure.get_suptitle().replace("\n", " ")
    assert "after 6.52254 forcing periods" in title  # (14 pi - 3) / 2 pi
    figure = plotting.section(path)
    title = figure._suptitle.get_text().replace("\N{NO-BREAK SPACE}", " ")
    title = title.replace("\n", " ")
    assert r"$\omega t_0=4$" in title and "phase 1 rad, transient 0" in title


def test_the_times_of_a_followed_sweep():
    """Only the first point of a chain starts before the section, at the phase of the start."""
    omega, ways = [2.6, 2.7], ("up", "down")
    text = f"oscillator: {{h: 0.1, R: 0.8, omega: {omega}, f: 1.0}}"
    record = "record={transient: 10, periods: 5, phase: 0.5, trajectory: {every: 1}}"
    dataset = swept(text, "start.phase=1", record, "follow={axis: omega, direction: both}")
    for way, value in product(ways, omega):
        at = {"direction": way, "omega": value}
        first = value == (2.6 if way == "up" else 2.7)
        t = dataset.sel(at)["trajectory_t"].values
        turn = 2.0 * math.pi / value
        motion = motion_of(OpenedSweep(dataset).cut(at), 4)
        after = motion.rows[0, 0] + motion.turns * turn
        assert after == pytest.approx(np.nanmax(t), rel=1e-12)
        since = 11.0 - 0.5 / (2.0 * math.pi) if first else 10.0
        for periods, more in ((None, 0), (4, 5)) if way == "up" and first else ((None, 0),):
            title = plotting.trajectory(dataset, at=at, periods=periods).get_suptitle()
            assert f"after {since + more:.6g} forcing periods" in title.replace("\n", " ")


def test_the_times_of_a_motion_with_a_transient_of_its_own():
    """Are those of a run with this transient."""
    text = "oscillator: {h: 0.05, R: 0.8, omega: [2.5, 2.6], f: 1.0}"
    found = swept(text, "record={transient: auto, longest: 500, periods: 5}")
    given = swept(text, f"record={{transient: {found['transient'][1].item()}, periods: 5}}")
    kept = [ds.isel(section=slice(-n, None)) for ds in (found, given) for n in (2, 5)]
    title, *others = (plotting.trajectory(ds, at={"omega": 2.6}).get_suptitle() for ds in kept)
    assert others == 3 * [title] != 3 * [""]


OVER_PHASE = """
oscillator: {h: 0.05, R: 0.8, omega: 2.6, f: 1.0}
start: {x0: 0.0, v0: [-0.5, 0.3], phase: [0.0, 1.0, 6.283185307179585]}
record: {transient: 0, periods: 6, phase: 1.0, trajectory: {every: 1}}
"""


@pytest.mark.parametrize("method", ["{}", "{integrator: rk4, impact: cubic}"])
def test_a_sweep_over_the_phase_is_a_sweep_of_every_phase(method):
    """To the last bit, with the times of each; the longer way has as many periods."""
    over = run_and_read(load(OVER_PHASE, f"method={method}"))
    assert over["status"].dims == ("v0", "phase") and over["phase"].attrs["units"] == "rad"
    for phase in over["phase"].values.tolist():
        one = run_and_read(load(OVER_PHASE, f"method={method}", f"start.phase={phase!r}"))
        here = over.sel(phase=phase)
        for name in one.data_vars:
            assert_array_equal(here[name], one[name].reindex_like(here[name]), err_msg=name)


BASINS_OVER_PHASE = """
oscillator: {h: 0.1, R: 0.8, omega: 2.6, f: 1.0, clearance: 0.6}
start: {x0: 0.6, v0: {start: -3, stop: 0, num: 12}, phase: {start: 0, stop: 6.2, num: 15}}
record: {transient: 200, periods: 16}
"""


def test_basins_over_phase_and_velocity():
    """The phase is the abscissa."""
    dataset = swept(BASINS_OVER_PHASE)
    found = attractors(dataset)
    assert found["attractors"].item() == 2 and found["attractor"].dims == ("v0", "phase")
    assert 10 < (dataset["period"] == 2).sum() < 170
    assert default_kind(OpenedSweep(dataset)) == "basins"
    panel = plotting.basins(dataset).axes[0]
    assert "at the start" in panel.get_xlabel() and r"v_0" in panel.get_ylabel()
    with pytest.raises(Refused, match="integrity needs x0 and v0 as axes"):
        plotting.integrity(dataset)


def test_the_three_starts_as_axes(unpainted):
    """A plane of two is drawn at a value of the third, which must be said."""
    change = "start={x0: [-1, 0, 0.6], v0: [-1, 0, 1], phase: [0, 2, 4]}"
    path = run_in(Path(), BASINS_OVER_PHASE, change)
    assert "one of them must be fixed" in refused("plot", path, "--kind", "basins")
    for fixed in ("x0=0.6", "v0=1", "phase=2"):
        assert accepted("plot", path, "--at", fixed, "-o", "a.svg") == "a.svg\n"
    assert "fix phase at that of the section, 0" in refused("integrity", path)
    point = ("--set", "start.v0=1", "--set", "start.x0=0")
    accepted("zoom", path, "phase=1:3", "-o", "zoomed.h5", *point)
    assert data("zoomed.h5")["phase"].values.tolist() == [1.0, 2.0, 3.0]
    chain = "follow={axis: phase, direction: up}"
    with pytest.raises(ConfigError, match="phase is a start, but only the first"):
        load(BASINS_OVER_PHASE, chain)
