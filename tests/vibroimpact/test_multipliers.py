"""Floquet multipliers against finite differences of the section map in 50 digits."""

import mpmath as mp
import naive
import numpy as np
import pytest

from oscillators import SectionMap
from vibroimpact.orbits.branches import branch
from vibroimpact.orbits.periodic import periodic_orbit
from vibroimpact.oscillator import Oscillator
from vibroimpact.trajectory import simulate

# m, q, h, R, omega, clearance of attractors from a zero start
ATTRACTORS = [
    (1, 2, 0.48, 0.06, 0.96, 0.6),
    (1, 2, 0.27, 0.96, 0.85, 0.0),
    (1, 3, 1.15, 0.14, 1.95, 0.0),
    (1, 4, 0.0, 0.29, 0.51, 0.6),
    (1, 5, 0.0, 0.58, 0.56, 0.0),
    (1, 6, 0.56, 0.98, 0.6, 0.0),
    (1, 8, 0.2, 0.61, 0.66, 0.0),
    (1, 11, 0.16, 0.71, 0.53, 0.0),
    (2, 1, 0.0, 0.04, 3.44, 0.1),
    (2, 2, 0.0, 0.94, 2.98, 0.0),
    (2, 3, 0.26, 0.47, 1.22, 0.0),
    (2, 5, 0.0, 0.49, 3.1, 0.0),
    (2, 8, 0.07, 0.96, 0.52, 0.0),
    (3, 1, 1.42, 1.0, 4.82, 0.0),
    (3, 2, 0.11, 0.08, 4.05, 0.1),
    (3, 5, 0.03, 0.87, 1.09, 0.0),
    (3, 6, 0.0, 0.95, 0.83, 0.2),
    (4, 1, 0.15, 0.02, 4.98, 0.1),
    (4, 3, 0.78, 0.11, 3.31, 0.0),
    (4, 6, 0.1, 0.98, 1.17, 0.0),
    (5, 2, 0.33, 0.98, 4.71, 0.0),
    (5, 3, 0.0, 0.89, 4.76, 0.0),
    (6, 2, 0.0, 0.33, 4.63, 0.1),
    (6, 3, 0.0, 0.01, 2.14, 0.4),
    (6, 5, 0.52, 0.64, 2.9, 0.0),
    (6, 8, 0.0, 0.93, 1.45, 0.0),
    (6, 9, 0.0, 0.95, 1.15, 0.0),
    (8, 9, 0.0, 0.89, 2.55, 0.0),
]


def orbits_of(m, q, h, R, omega, clearance):
    """The attractor, and an unstable orbit on its branch if there is one."""
    osc = Oscillator(h=h, R=R, omega=omega, f=1.0, clearance=clearance)
    run = simulate(osc, 300)
    orbit = periodic_orbit(osc, float(run.section_x[-1]), float(run.section_v[-1]), m)
    assert (orbit.m, orbit.q, orbit.stable) == (m, q, True)
    line = branch(orbit, "omega", 0.9 * omega, 1.1 * omega)
    others = [line.orbit(i) for i in np.flatnonzero(~line.stable).tolist()]
    unstable = [other for other in others if 1.05 < abs(other.multipliers[0]) < 100.0]
    return [orbit, *unstable[len(unstable) // 2 :][:1]]


def stays_below(osc, impacts, period):
    """Whether 500 samples of every flight do."""
    times = [float(t) for t, _ in impacts]
    for (_, v), t, end in zip(impacts, times, [*times[1:], times[0] + period], strict=True):
        flight = naive.ClosedForm(osc, t, osc.clearance, -osc.R * float(v))
        x, _ = flight(np.linspace(t, end, 501))
        if not (x[1:-1] < osc.clearance).all():
            return False
    return True


def eigenvalues(D):
    """Of a 2x2 matrix, the larger first."""
    half = (D[0, 0] + D[1, 1]) / 2
    root = mp.sqrt(mp.mpc(half * half - mp.det(D)))
    return in_order([half + root, half - root])


def in_order(multipliers):
    """The larger first; of a pair the one above the real axis."""
    return sorted(multipliers, key=lambda mu: (-abs(mu), -mu.imag))


@pytest.mark.slow
def test_the_multipliers_of_25_orbits_are_those_of_the_section_map():
    """Stable and unstable; the slowest impact has a speed of 7e-5 of that of the fastest."""
    seen = []
    for row in ATTRACTORS[::2]:
        for orbit in orbits_of(*row):
            osc, multipliers = orbit.oscillator, in_order(orbit.multipliers)
            seen.append(orbit.stable)
            with mp.workdps(50):
                section = SectionMap(orbit)
                impacts = section.polish()
                assert stays_below(osc, impacts, orbit.m * osc.forcing_period)
                D = section.derivative()
                product = mp.mpf(osc.R) ** (2 * orbit.q)
                product *= mp.exp(-4 * mp.pi * mp.mpf(osc.h) * orbit.m / mp.mpf(osc.omega))
                assert abs(mp.det(D) / product - 1) < 1e-11  # of the map itself
                assert abs(mp.fprod(multipliers) / product - 1) < 1e-13
                for mu, expected in zip(multipliers, eigenvalues(D), strict=True):
                    assert abs(mu / expected - 1) < 1e-10
            c0, _, c2 = orbit.characteristic
            assert c0 / c2 == pytest.approx(float(product), abs=1e-14)
    assert len(seen) >= 25 and seen.count(False) >= 10
