"""The parameters of eq. (1): what is valid, and what is said of what is not."""

import dataclasses
import math

import numpy as np
import pytest

from vibroimpact import Oscillator, integrate, simulate
from vibroimpact.oscillator import PARAMETERS, POINT
from vibroimpact.trajectory import exact_samples

GOOD = {"h": 0.1, "R": 0.8, "omega": 2.0, "f": 1.0, "p": 1.0, "clearance": 0.0, "a": 0.5}
NOT_NUMBERS = [True, np.True_, "0.5", None, [0.5], 1j, np.array([0.5]), np.complex128(2.0)]


@pytest.mark.parametrize(
    ("name", "values", "allowed"),
    [
        ("h", [-1.0, -5e-324, 10**400], "a finite number >= 0"),
        ("R", [1.2, np.nextafter(1.0, 2.0), -0.1], "a number from 0 to 1"),
        ("omega", [0.0, -2.0], "a finite number > 0"),
        ("f", [-1.0], "a finite number >= 0"),
        ("p", [0.0, -1.0], "a finite number > 0"),
    ],
)
def test_out_of_range_is_refused_with_key_value_and_range(name, values, allowed):
    for value in values:
        with pytest.raises(ValueError) as refusal:
            Oscillator(**GOOD | {name: value})
        message = str(refusal.value)
        assert message.startswith(f"{name} ({PARAMETERS[name].meaning})")
        assert allowed in message
        assert str(value)[:60] in message and len(message) < 200


def made(name, value):
    """Make an oscillator, or its start, with another value of a parameter."""
    if name in GOOD:
        return Oscillator(**GOOD | {"a": 0.0, name: value})
    return Oscillator(**GOOD).at(**{name: value})


@pytest.mark.parametrize("name", [*GOOD, "x0", "v0"])
def test_what_is_no_finite_number_is_refused(name):
    for value in (math.nan, math.inf, -math.inf):
        with pytest.raises(ValueError, match=rf"^{name} \(.* = {value} .*; expected: a .*number"):
            made(name, value)
    for value in NOT_NUMBERS:
        with pytest.raises(TypeError, match=rf"^{name} \("):
            made(name, value)
    for values in (np.linspace(1.0, 2.0, 5), [0.1, 0.2], (1.0,)):
        with pytest.raises(TypeError, match=r"for many points.*vibroimpact\.integrate") as refusal:
            made(name, values)
        assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("clearance", [-0.5, 0.0, 0.25])
def test_a_start_beyond_the_stop_is_refused(clearance):
    osc = Oscillator(**GOOD | {"clearance": clearance})
    assert osc.at(x0=clearance)["x0"] == clearance
    with pytest.raises(ValueError, match=rf"clearance = {clearance:g}") as refusal:
        osc.at(x0=clearance + 0.125)
    assert f"x0 = {clearance + 0.125:g}" in str(refusal.value)
    with pytest.raises(ValueError, match="beyond the stop"):
        osc.at(x0=np.nextafter(clearance, 1.0))


def test_values_become_floats():
    osc = Oscillator(h=0, R=1, omega=np.int64(2), f=np.float32(0.5))
    assert [type(getattr(osc, name)) for name in GOOD] == [float] * len(GOOD)
    assert (osc.omega, osc.f, osc.p, osc.clearance, osc.a) == (2.0, 0.5, 1.0, 0.0, 0.0)
    assert osc.forcing_period == math.pi


def test_a_point_holds_every_parameter_under_its_name():
    """No two parameters change places on the way to the kernel."""
    given = {name: 0.1 + 0.1 * k for k, name in enumerate(GOOD)}
    (point,) = Oscillator(**given).at(x0=-3.0, v0=7.0, phase=1.5)
    assert point.dtype == POINT
    start = {"x0": -3.0, "v0": 7.0, "phase": 1.5}
    assert {name: point[name] for name in POINT.names} == given | start


RIG = {
    "mass": 0.5, "stiffness": 8000.0, "damping": 4.0, "force": 8.0, "frequency": 10.0,
    "gap": 0.0005, "R": 0.7, "base": 0.0002,
}  # fmt: skip


def test_a_rig_moves_as_its_own_equation():
    """The steady free motion of the rig, from its complex amplitude in SI units, is a motion."""
    osc = Oscillator.from_rig(**RIG | {"gap": 1.0})
    w = 2.0 * math.pi * RIG["frequency"]
    impedance = RIG["stiffness"] - RIG["mass"] * w**2 + 1j * w * RIG["damping"]
    amplitude = -(RIG["force"] + RIG["mass"] * RIG["base"] * w**2) / impedance
    x0, v0 = amplitude.imag, (1j * w * amplitude).imag
    tr = simulate(osc, periods=3, steps_per_period=50, x0=x0, v0=v0)
    expected = (amplitude * np.exp(1j * w * tr.t)).imag
    np.testing.assert_allclose(tr.x, expected, atol=1e-12 * abs(amplitude))


def test_a_rig_and_back():
    osc = Oscillator.from_rig(**RIG)
    assert osc.to_rig(RIG["mass"]) == pytest.approx(RIG, rel=1e-15)
    again = Oscillator.from_rig(**osc.to_rig(mass=2.0))
    assert dataclasses.astuple(again) == pytest.approx(dataclasses.astuple(osc), rel=1e-15)
    for name, value in {"p": 1e200, "h": 1e308}.items():
        with pytest.raises(ValueError, match=r"^(stiffness|damping) \[.* = inf .*; expected: a "):
            Oscillator(**GOOD | {name: value, "omega": 1.0}).to_rig(mass=2.0)
    for name in ("h", "f"):
        with pytest.raises(ValueError, match=r"^mass \[kg\] = 1e-200 is not allowed"):
            Oscillator(**GOOD | {name: 1e-200}).to_rig(mass=1e-200)


@pytest.mark.parametrize(
    ("name", "value"),
    [("mass", 0.0), ("stiffness", -1.0), ("damping", -0.1), ("force", -1.0), ("frequency", 0.0),
     ("gap", math.inf), ("R", 1.2), ("base", -1.0)],
)  # fmt: skip
def test_a_rig_that_cannot_be(name, value):
    with pytest.raises(ValueError, match=rf"^{name} [\[(].* = {value} .*; expected: a "):
        Oscillator.from_rig(**RIG | {name: value})
    with pytest.raises(TypeError, match=rf"^{name} "):
        Oscillator.from_rig(**RIG | {name: "1"})


def test_a_force_or_a_base_is_required():
    """Where only a base is given, f is 0; the force that both make must be finite."""
    osc = Oscillator(h=0.1, R=0.8, omega=2.0, a=0.5)
    assert (osc.f, osc.force) == (0.0, 2.0)
    assert Oscillator(**GOOD).force == 3.0
    for missing in ({}, {"a": 0.0}):
        with pytest.raises(TypeError, match=r"^f \(.*is missing; expected: f, a > 0, or both"):
            Oscillator(h=0.1, R=0.8, omega=2.0, **missing)
    with pytest.raises(ValueError, match=r"f \+ a omega\^2 must be a finite number"):
        Oscillator(**GOOD | {"omega": 1e200, "a": 1e-20})
    rig = {name: value for name, value in RIG.items() if name not in ("force", "base")}
    assert Oscillator.from_rig(**rig, base=0.001).f == 0.0
    with pytest.raises(TypeError, match=r"^force .* missing; expected: force, base > 0, or both"):
        Oscillator.from_rig(**rig)


@pytest.mark.parametrize("many", [np.array([0.1, 0.2]), np.array([0.0])])
def test_many_bases_without_a_force_are_refused_with_a_hint(many):
    with pytest.raises(TypeError, match=r"^a \(.*; for many points at once use vibroimpact\."):
        Oscillator(h=0.1, R=0.8, omega=2.0, a=many)
    rig = {name: value for name, value in RIG.items() if name not in ("force", "base")}
    with pytest.raises(TypeError, match=r"^base \[m\] .*; for many points .* use vibroimpact\."):
        Oscillator.from_rig(**rig, base=many)


def test_points_whose_force_is_not_finite_are_refused():
    points = Oscillator(**GOOD).at().repeat(3)
    points["omega"][1], points["a"][1] = 1e200, 1e-20
    with pytest.raises(ValueError, match=r"points\[1\]: the force f \+ a omega\^2 must be"):
        integrate(points, transient=0, periods=1)


def motions(points, **how):
    results = integrate(points, transient=20, periods=8, **how)
    return {name: values.tobytes() for name, values in results.items()}


@pytest.mark.parametrize(
    "how",
    [{"lyapunov": True}, *({"integrator": "rk4", "impact": rule, "steps_per_period": 50}
     for rule in ("plain", "reduced-step", "cubic"))],
    ids=lambda how: how.get("impact", "exact"),
)  # fmt: skip
def test_one_force_gives_the_same_bits_however_it_is_made(how):
    osc = Oscillator(h=0.02, R=0.8, omega=1.0, f=0.0, clearance=0.1, a=0.25)
    base, both, force = (osc.at().repeat(40) for _ in range(3))
    omega = np.linspace(0.5, 4.0, 40)
    base["omega"] = both["omega"] = force["omega"] = omega
    force["f"], force["a"] = 0.25 * omega * omega, 0.0
    both["a"] = 0.125
    both["f"] = force["f"] - 0.125 * omega * omega
    assert motions(base, **how) == motions(both, **how) == motions(force, **how)
    assert motions(base, **how) != motions(osc.at().repeat(40), **how)


def test_one_force_gives_the_same_trajectory():
    """The rests, too, whose ends depend on the force, and the exact states between the steps."""
    base = Oscillator(h=0.0, R=0.3, omega=0.5, a=4.0, clearance=-0.2)
    force = dataclasses.replace(base, f=1.0, a=0.0)
    runs = [simulate(osc, periods=5, x0=-0.2) for osc in (base, force)]
    assert len(runs[0].rests) > 2
    for name in ("t", "x", "v", "impact_t", "impact_v", "rests"):
        assert np.array_equal(getattr(runs[0], name), getattr(runs[1], name)), name
    both = zip((base, force), runs, strict=True)
    assert np.array_equal(*(exact_samples(osc, tr.t, tr.x, tr.v) for osc, tr in both))
