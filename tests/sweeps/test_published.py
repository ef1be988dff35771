"""Published numbers of this oscillator in one table, each with its tolerance and source.

``pytest -rP tests/sweeps/test_published.py`` shows every row with its difference.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import pytest

from sweeps import bifurcations, load_config, run_sweep
from sweeps.cli.zoom import zoomed
from tests.helpers.oscillators import TAU, bifurcation
from tests.helpers.places import CONFIGS
from vibroimpact import Oscillator, bifurcation_curve, branch, one_impact_orbit, simulate
from vibroimpact.orbits.one_impact import one_impact_orbits

EPS = 2.0**-52


class Row(NamedTuple):
    """A published number, its tolerance and the reason, a function that computes it, the source."""

    name: str
    published: float
    tolerance: float
    why: str
    find: Callable[[], float]
    source: str


def ball(R, gamma=2.0, p=1e-6):
    """A ball on a table whose acceleration is gamma times gravity, in the limit p -> 0."""
    return Oscillator(0.0, R, 1.0, gamma, p, -1.0 / p**2)


@cache
def inelastic_change(low, high):
    """Return the change of class of the scene `inelastic-ball` nearest to the middle of a piece.

    This is a flip with its exact value, or the middle of a bracket, which is zoomed into.
    """
    scene = CONFIGS / "inelastic-ball.yaml"
    config = load_config(scene, ["oscillator.f.num=63"])
    while True:
        with TemporaryDirectory() as folder:
            path = run_sweep(zoomed(config, {"f": (low, high)}), Path(folder) / "out.h5")
            found = bifurcations(path)
        middles = 0.5 * (found["low"] + found["high"])
        change = found.loc[(middles - 0.5 * (low + high)).abs().idxmin()]
        if change["value"] == change["value"]:
            return change["value"]
        low, high = change["low"], change["high"]
        if high - low < 5e-7:
            return 0.5 * (low + high)


def speed(osc, n=1):
    return one_impact_orbit(osc, n).v


@cache
def coco_grazes():
    """The graze of the orbit of COCO's example over A, and the curve of grazes over (omega, A)."""
    coco = Oscillator(h=0.05, R=0.8, omega=1.0, f=1.0, clearance=1.0)
    special = branch(one_impact_orbit(coco), "f", 0.01, 1.0).special
    (graze,) = (point for point in special if point.kind == "graze")
    curve = bifurcation_curve(graze.orbit, "graze", ("omega", 0.5, 1.5), ("f", 0.0, 1.0))
    omega, amplitude = curve.values.T
    assert omega.min() == 0.5 and omega.max() > 1.4
    return graze.value, np.max(np.abs(amplitude - np.hypot(1.0 - omega**2, 0.1 * omega)))


def first_impact(depth, h=0.05, omega=0.7):
    """Of the free motion of amplitude A with the stop at A - depth: its speed over that of the law.

    The law is v = omega sqrt(2 A d - d^2).
    """
    state = -1.0 / (1.0 - omega**2 + 2j * h * omega)
    size = abs(state)
    osc = Oscillator(h=h, R=0.8, omega=omega, f=1.0, clearance=size - depth)
    motion = simulate(osc, periods=2, x0=state.imag, v0=(1j * omega * state).imag)
    return motion.impact_v[0] / (omega * math.sqrt(2.0 * size * depth - depth**2))


@cache
def paper_motion(h, R):
    return simulate(Oscillator(h=h, R=R, omega=1.0, f=1.0), periods=300)


def paper_difference(h, R, steady):
    """Return the largest difference of steady phases and speeds of a case of the paper."""
    motion = paper_motion(h, R)
    phases, speeds = np.array(steady).T
    assert np.all(np.abs(motion.impact_v[-4 * len(speeds) :] - np.tile(speeds, 4)) < 1e-9)
    apart = motion.impact_t[-len(phases) :] % TAU - phases, motion.impact_v[-len(speeds) :] - speeds
    return np.max(np.abs(apart))


def dux_rows():
    """Yield the rows of orbits with one impact in two periods, h = 0."""
    dux = "F. Dux, thesis 1992, and github.com/FelixDux/imposcg"
    printed = "the digits printed"
    example = Oscillator(0.0, 0.8, 3.7, 1.0)
    for sigma, k, value in ((0.0, 0, 0.665693), (0.2, 0, 1.102366), (0.2, 1, 2.187444)):
        osc = replace(example, clearance=sigma)
        find = partial(lambda osc, k: one_impact_orbits(osc, 2)[k].v, osc, k)
        yield Row(f"omega = 3.7, sigma = {sigma}: speed", value, 5e-7, printed, find, dux)
    for sigma, value in ((0.0, 1), (0.2, 2), (-0.06, 0), (0.4, 0)):
        osc = replace(example, clearance=sigma)
        find = partial(lambda osc: sum(orbit.exists for orbit in one_impact_orbits(osc, 2)), osc)
        yield Row(f"omega = 3.7, sigma = {sigma}: orbits", value, 0.0, "a count", find, dux)


def ball_rows():
    """Yield the rows of the ball on a vibrating table."""
    luck = "Luck and Mehta, Phys. Rev. E 48 (1993) 3988"
    why = "p^2 times twice the height of a free flight of n periods: what the spring yields"
    for R, n in ((0.5, 1), (0.5, 2), (0.5, 3), (0.8, 1), (0.8, 2), (0.8, 3)):
        name, error = f"ball, R = {R}, {n}/1", 0.25 * (1e-6 * TAU * n) ** 2
        begin = n * math.pi * (1.0 - R) / (1.0 + R)
        flip = math.hypot(begin, 2.0 * (1.0 + R**2) / (1.0 + R) ** 2)
        for event, kind, value in (("begins", "fold", begin), ("flips", "flip", flip)):
            ends = value - 0.2 * (flip - begin), value + 0.2 * (flip - begin)
            find = partial(bifurcation, ball(R), kind, "f", *ends, n)
            yield Row(f"{name}: {event}", value, error * value, why, find, luck)
        value, find = TAU * n / (1.0 + R), partial(speed, ball(R, 0.5 * (begin + flip)), n)
        yield Row(f"{name}: speed", value, error * value, why, find, luck)
    mehta = "Mehta and Luck, Phys. Rev. Lett. 65 (1990) 393"
    for name, n, value in (
        ("leaves the table", 0, 1.0),
        ("plateau 1/1", 1, math.hypot(math.pi, 1.0)),
        ("flip of 1/1", 1, math.hypot(math.pi, 2.0)),
        ("landing speed 0", 1, math.hypot(4.493409457909064, 1.0)),  # tan x = x
        ("plateau 2/1", 2, math.hypot(TAU, 1.0)),
        ("flip of 2/1", 2, math.hypot(TAU, 2.0)),
    ):
        error = 0.25 * (1e-4 * TAU * n) ** 2 * value + 2.5e-7
        find = partial(inelastic_change, value - 0.013, value + 0.01)
        yield Row(f"inelastic ball: {name}", value, error, "the same, and a bracket", find, mehta)


def curve_rows():
    """Yield the rows of a stop with clearance: grazes, and bifurcations beside them."""
    printed = "the digits printed"
    coco = "COCO, impact oscillator: Dankowicz and Schilder 2013, example 15.2"
    osc = Oscillator(h=0.05, R=0.8, omega=1.0, f=1.0, clearance=1.0)
    leaves = partial(lambda osc: -osc.R * speed(osc), osc)
    yield Row("A = 1: velocity after the impact", -1.356586, 5e-7, printed, leaves, coco)
    yield Row("omega = 1: graze", 0.1, 64 * EPS, "roundings", lambda: coco_grazes()[0], coco)
    yield Row("curve of grazes", 0.0, 64 * EPS, "roundings", lambda: coco_grazes()[1], coco)

    vivid = "Ghosh and Simpson, arXiv 2510.16218 (VIVID), and their TwoParamDataGenerate.m"
    osc = Oscillator(h=0.02, R=0.9, omega=0.81, f=0.35, clearance=1.0)
    why = "their 1e-5 in the speed, times dF/dv = 0.033"
    find = partial(bifurcation, osc, "flip", "f", 0.3472, 0.349, 2)
    yield Row("n = 2, omega = .81: flip", 0.347533142901875, 3.3e-7, why, find, vivid)
    find = partial(bifurcation, replace(osc, omega=0.799), "fold", "f", 0.36, 0.3635, 2)
    yield Row("n = 2, omega = .799: fold", 0.36283629168999, 1e-7, "of second order", find, vivid)

    law = "the square-root law, in closed form"
    for depth in (1e-2, 1e-4, 1e-6, 1e-8, 1e-10):
        why = "the digits that A - d keeps"
        yield Row(f"d = {depth}", 1.0, 4.0 * EPS / depth, why, partial(first_impact, depth), law)


#: Phase and speed of the steady impacts of the paper's cases, by h and R.
PAPER = {
    (0.5, 1.0): [(4.566798931063947, 0.902040564502884), (5.969452473193079, 0.411362031140622)],
    (0.0, 0.5): [(4.317869374348522, 2.037529035119366), (6.017172372416884, 0.811704646702102)],
    (0.5, 0.5): [
        (4.601556825606546, 0.907496491171004),
        (5.387341285272362, 0.321900878724339),
        (5.825655719839734, 0.115762561014269),
        (6.146519773279830, 0.036454221377120),
    ],
}


def paper_rows():
    """Yield the rows of the paper's cases."""
    paper, why = "the paper's cases, in ball arithmetic", "the roundings of 300 periods"
    for (h, R), steady in PAPER.items():
        find = partial(paper_difference, h, R, steady)
        yield Row(f"h = {h}, R = {R}: steady impacts", 0.0, 1e-12, why, find, paper)
    for h, t in ((0.5, 4.602432115288520), (0.0, 4.493409457909064)):
        find = partial(lambda h: paper_motion(h, 0.5).impact_t[0], h)
        yield Row(f"h = {h}: first impact", t, 4.0 * EPS * t, "roundings", find, paper)


ROWS = [*dux_rows(), *ball_rows(), *curve_rows(), *paper_rows()]


@pytest.mark.slow
@pytest.mark.parametrize("row", ROWS, ids=[row.name for row in ROWS])
def test_what_is_published_is_found(row):
    difference = float(row.find()) - row.published
    print(f"{row.name}: {row.published:.16g}, found {difference:+.1e} from it;", end=" ")
    print(f"allowed {row.tolerance:.1e} ({row.why}); {row.source}")
    assert abs(difference) <= row.tolerance
