"""The start and the samples of `simulate`: a phase, a transient, and states between the steps."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from vibroimpact import Oscillator, integrate, one_impact_orbit, simulate
from vibroimpact.trajectory import exact_samples

OSC = Oscillator(h=0.05, R=0.7, omega=2.3, f=1.0)


def test_a_transient_leaves_out_the_first_periods():
    whole, late = simulate(OSC, periods=12), simulate(OSC, periods=5, transient=7)
    assert_allclose(late.section_x, whole.section_x[7:], rtol=0, atol=0)
    assert_allclose(late.impact_v, whole.impact_v[whole.impact_t > late.t[0]], rtol=0, atol=0)
    assert late.t[0] == pytest.approx(7 * 2.0 * np.pi / OSC.omega)


def test_a_phase_starts_the_motion_there():
    """On the closed-form orbit: launched at its impact, it comes back after a period."""
    orbit = one_impact_orbit(OSC)
    launched = simulate(OSC, periods=3, x0=0.0, v0=-OSC.R * orbit.v, phase=orbit.phase)
    assert launched.t[0] == pytest.approx(orbit.phase / OSC.omega)
    assert_allclose(launched.impact_v, orbit.v, rtol=1e-12)
    assert_allclose(OSC.omega * launched.impact_t[:2] % (2 * np.pi), orbit.phase, rtol=1e-12)


def test_a_motion_goes_on_from_a_state_of_its_section():
    """A section at phase 1 of a motion from t = 0 by the batch run, continued."""
    record = integrate(OSC.at(-0.2, 0.1), transient=4, periods=6, phase=1.0)
    x, v = (record[name][0] for name in ("poincare_x", "poincare_v"))
    rest = simulate(OSC, periods=5, x0=x[0], v0=v[0], phase=1.0)
    assert_allclose(np.stack([rest.section_x, rest.section_v]), [x[1:], v[1:]], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "value"), [("phase", 7.0), ("phase", -0.1), ("transient", -1), ("transient", 1.5)]
)
def test_what_is_not_allowed_is_named(name, value):
    with pytest.raises(ValueError, match=f"{name} must be"):
        simulate(OSC, **{name: value})


@pytest.mark.slow
@pytest.mark.parametrize(
    "osc",
    [
        OSC,
        Oscillator(0.0, 0.8, 1.0, 1.0),
        Oscillator(1.0, 0.8, 0.7, 1.0, clearance=0.4),
        Oscillator(0.05, 0.7, 2.3, 1.0, clearance=-0.2),
    ],
)
def test_states_between_the_steps_are_on_the_flow(osc):
    """Against an integration of eq. (1) by SciPy, also at resonance and critical damping."""
    run = simulate(osc, periods=3, x0=-0.5, v0=0.2)
    t, x, v = exact_samples(osc, run.t, run.x, run.v, 150)
    assert np.diff(t).max() <= 2.0 * np.pi / osc.omega / 150 * (1.0 + 1e-9)
    stored = np.isin(t, run.t)
    assert set(run.x) <= set(x[stored])
    between = np.searchsorted(t, run.t[0]), np.searchsorted(t, run.impact_t[0])
    flight = slice(between[0], between[1] + 1)

    def slope(time, y):
        force = osc.f * np.sin(osc.omega * time)
        return [y[1], -2.0 * osc.h * y[1] - osc.p**2 * y[0] - force]

    expected = solve_ivp(
        slope, (t[0], run.impact_t[0]), [-0.5, 0.2], t_eval=t[flight], rtol=1e-10, atol=1e-12
    )
    assert_allclose([x[flight], v[flight]], expected.y, atol=1e-8)


def test_a_rest_stays_on_the_stop():
    osc = Oscillator(h=0.0, R=0.5, omega=0.5, f=1.0)
    run = simulate(osc, periods=2, transient=2)
    t, x, _ = exact_samples(osc, run.t, run.x, run.v, 200)
    begin, end = run.rests[1]
    assert len(x[(t > begin) & (t < end)]) > 20
    assert (x[(t > begin) & (t < end)] == 0.0).all()
    assert x.max() < 1e-12
