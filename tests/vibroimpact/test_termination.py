"""Every run ends, whatever the floats are, and a decay below the smallest normal number is rest."""

import itertools
import subprocess
import sys

import mpmath as mp
import numpy as np
import pytest

from tests.helpers.places import ROOT
from vibroimpact import Oscillator, Status, integrate, simulate

SMALLEST_NORMAL = sys.float_info.min


@pytest.mark.parametrize(
    ("program", "few", "many"),
    [("fuzz_steps.py", 2_000, 1_000_000), ("hostile_calls.py", 25, 10_000)],
)
@pytest.mark.parametrize(
    "seed", [pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.campaign)]
)
def test_every_step_and_every_call_ends(program, few, many, seed):
    """In a process of their own, so that a hang is a failure and not a hung suite."""
    words = ROOT / "tests/helpers" / program, seed, few if seed == 1 else many
    command = [sys.executable, "-W", "error", *map(str, words)]
    seconds = 300 if seed == 1 else 3600
    done = subprocess.run(command, capture_output=True, text=True, timeout=seconds)
    assert done.returncode == 0, done.stdout + done.stderr


def bouncing(osc, x0):
    """A free mass with the stop at its equilibrium, h < p, from rest at x0 < 0; by mpmath.

    x = x0 e^(-ht) (cos w t + h/w sin w t) up to the first impact; then each flight is
    -R v e^(-ht)/w sin w t, half a period of the damped motion long. Returns time and speed of the
    first impact, the time from impact to impact, and the ratio of the speeds of two.
    """
    h, p, R = mp.mpf(osc.h), mp.mpf(osc.p), mp.mpf(osc.R)
    w = mp.sqrt(p * p - h * h)
    first = (mp.pi - mp.atan2(w, h)) / w
    speed = -mp.mpf(x0) * p * p / w * mp.exp(-h * first) * mp.sin(w * first)
    return first, speed, mp.pi / w, R * mp.exp(-h * mp.pi / w)


DECAYS = [(0.5, 0.8, 300), (0.5, 0.5, 300), (0.1, 0.5, 400), (0.0, 0.3, 300), (0.9, 1.0, 200)]


@pytest.mark.parametrize(("h", "R", "periods"), DECAYS)
def test_a_free_decay_is_followed_to_the_smallest_normal_number(h, R, periods):
    """Every impact down to there, in closed form; after it zero, at rest, and certified."""
    osc = Oscillator(h=h, R=R, omega=1.0, f=0.0)
    tr = simulate(osc, periods, x0=-1.0)
    assert tr.status is Status.CERTIFIED
    first, speed, half, ratio = bouncing(osc, -1.0)
    with mp.workdps(30):
        count = int(mp.floor(mp.log(SMALLEST_NORMAL / speed) / mp.log(ratio)))
        assert count <= len(tr.impact_v) <= count + 4  # the last ones are within a step of it
        for k in range(count):
            tolerance = 1e-15 * (10 + 4 * k)
            assert abs(tr.impact_v[k] / (speed * ratio**k) - 1) <= tolerance
            assert abs(tr.impact_t[k] - (first + k * half)) <= tolerance
    after = tr.t > tr.impact_t[-1] + 2 * float(half)
    assert np.count_nonzero(after) > 30
    assert not tr.x[after].any() and not tr.v[after].any()


def test_a_free_decay_ends_with_every_method(integrator, rule):
    """At the equilibrium; the exact rule also on a stop with preload, where others hammer on."""
    oscillators = [
        Oscillator(h=h, R=R, omega=0.2, f=0.0, clearance=clearance)
        for h, R, clearance in itertools.product((0.2, 1.0, 2.0), (0.0, 0.5, 0.9), (0.0, 0.5, -0.5))
        if clearance >= 0.0 or rule == "exact"
    ]
    points = np.concatenate([osc.at(osc.clearance - 1.0) for osc in oscillators])
    transient = 1000 if integrator == "euler" else 250  # whose steps hold against the decay
    out = integrate(points, integrator=integrator, impact=rule, transient=transient, periods=3)
    assert set(out["status"]) == {Status.CERTIFIED if rule == "exact" else Status.COMPUTED}
    ends = np.repeat(np.minimum(points["clearance"], 0.0)[:, None], 3, axis=1)
    # The exact rule keeps x - clearance: beside it, x is known to a rounding of the clearance.
    allowed = SMALLEST_NORMAL + 4e-15 * np.abs(points["clearance"][:, None]) * (rule == "exact")
    assert (np.abs(out["poincare_x"] - ends) <= allowed).all()
