"""Pictures of motions in time and in the phase plane: where they go on, how long, and how fine."""

import numpy as np
import pytest

from sweeps import open_sweep, plotting, run_sweep
from sweeps.opened.opened_sweep import OpenedSweep
from tests.helpers.sweep_files import run_in
from tests.sweeps.plotting.test_pictures import MAP
from vibroimpact import Oscillator, one_impact_orbit

pytestmark = pytest.mark.slow


@pytest.fixture
def dataset(tmp_path):
    with open_sweep(run_in(tmp_path, MAP, name="map.h5")) as opened:
        yield opened


def test_a_motion_goes_on_from_the_stored_state(dataset):
    """On the closed-form orbit at omega = 2.3: one impact per period, at its speed."""
    figure = plotting.trajectory(dataset, at={"omega": 2.3, "R": 0.8}, periods=3)
    over_time, velocity, _ = figure.axes
    orbit = one_impact_orbit(Oscillator(h=0.05, R=0.8, omega=2.3, f=1.0))
    (impacts,) = [line for line in velocity.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(impacts.get_ydata(), 3 * [orbit.v], rtol=1e-6)
    t, x = over_time.lines[0].get_xydata().T
    assert t[0] == 0.0 and t[-1] == pytest.approx(3 * 2.0 * np.pi / 2.3)
    first = dataset["poincare_x"].sel(omega=2.3, R=0.8, method="nearest").values[-1]
    assert x[0] == first
    assert np.diff(t).max() < 2.0 * np.pi / 2.3 / 199  # no corners
    assert x.max() < 1e-9
    assert "after 132 forcing periods" in figure.get_suptitle()


def test_a_motion_is_shown_over_two_repetitions_with_its_class():
    """A 3/2 motion over six periods; where no class is known, over four."""
    for diagnostics, shown, periods in ((["period"], "class 3/2, $t_0=", 6), ([], "$t_0=", 4)):
        oscillator = {"h": 0.05, "R": 0.5, "omega": 5.18, "f": 1.0}
        record = {"transient": 300, "periods": 40, "diagnostics": diagnostics}
        run_sweep({"oscillator": oscillator, "record": record}, "motion.h5", overwrite=True)
        with open_sweep("motion.h5") as dataset:
            figure = plotting.trajectory(dataset)
        t = figure.axes[0].lines[0].get_xdata()
        assert t[-1] == pytest.approx(periods * 2.0 * np.pi / 5.18)
        assert f", {shown}" in figure.get_suptitle()


LONG = """
oscillator: {h: 0.05, R: 0.8, omega: 2.3, f: 1.0}
record: {transient: 0, periods: 3000, trajectory: {every: 7}}
"""


@pytest.mark.parametrize("recorded", [True, False])
def test_a_long_motion_is_drawn_by_whole_periods_from_all_of_it(tmp_path, recorded):
    """No more samples than pixels, however long the record; here one period of three."""
    with open_sweep(run_in(tmp_path, LONG)) as dataset:
        figure = plotting.trajectory(dataset, periods=None if recorded else 3000)
        t, x = figure.axes[0].lines[0].get_xdata(), figure.axes[0].lines[0].get_ydata()
        assert len(t) < 1000 * 250
        gaps = np.flatnonzero(np.isnan(t))
        periods = np.split(t / (2.0 * np.pi / 2.3), gaps)
        begins = np.array([piece[0 if i == 0 else 1] for i, piece in enumerate(periods[:1000])])
        ends = np.array([piece[-1] for piece in periods[:1000]])
        step = 7 / OpenedSweep(dataset).config.method.steps_per_period * (1 if recorded else 0)
        np.testing.assert_allclose(begins, 3 * np.arange(1000), atol=step + 1e-6)
        assert (ends - begins > 1.0 - step - 1e-6).all()
        assert np.nanmax(x) < 1e-9 and np.nanmin(x) < -0.3
        assert "1,000 of 3,000 periods" in figure.get_suptitle().replace("\n", " ")
