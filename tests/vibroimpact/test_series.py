"""A flight as a polynomial: its first root."""

import math

import mpmath as mp
import numpy as np
import pytest

from vibroimpact.step.series import TERMS, first_crossing

NONE = -1.0


def padded(c):
    """Coefficients from the constant term on, filled up with zeros."""
    out = np.zeros(TERMS)
    out[: len(c)] = c
    return out


def crossing(c, m=0, end=1.0):
    """Where the polynomial first crosses, and its highest turning point."""
    return first_crossing(padded(c), m, end)


def from_roots(roots, lead=1.0):
    """Coefficients of lead (u - r_1) (u - r_2) ..., rounded once."""
    with mp.workdps(50):
        c = [mp.mpf(lead)]
        for r in roots:
            c = [(c[k - 1] if k else 0) - (r * c[k] if k < len(c) else 0)
                 for k in range(len(c) + 1)]  # fmt: skip
        return np.array([float(q) for q in c])


def first_root(c, m, end):
    """The first root in (0, end] at which the rounded polynomial rises, by mpmath; and its slope.

    None without one.
    """
    with mp.workdps(50):
        c = [mp.mpf(float(q)) for q in np.trim_zeros(c[m:], "b")]
        roots = mp.polyroots(c[::-1], maxsteps=400, extraprec=400)
        real = sorted(r.real for r in map(mp.mpc, roots) if abs(r.imag) < mp.mpf(10) ** -30)
        real = [r for r in real if 0 < r <= end]
        if not real:
            return None
        return real[0], sum(k * q * real[0] ** (k - 1) for k, q in enumerate(c) if k)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Descending")
def test_random_roots():
    """100 polynomials of degree up to 8, roots all around: the first in the step, or none."""
    rng = np.random.default_rng(1)
    found = 0
    for _ in range(100):
        count = int(rng.integers(1, 9))
        m = int(rng.integers(0, 3))
        end = rng.choice([1.0, rng.uniform(0.1, 1.0)])
        roots = rng.uniform(-2.0, 3.0, count)
        inner = from_roots(roots)
        inner *= -np.sign(inner[0])  # below the stop at the launch
        c = padded(np.concatenate([np.zeros(m), inner]))
        true = first_root(c, m, end)
        u, _ = first_crossing(c, m, end)
        if true is None:
            assert u == NONE
            continue
        root, slope = map(float, true)
        assert slope > 0.0
        found += 1
        assert abs(u - root) <= 4e-16 * root + 8e-16 * np.abs(c).sum() / slope
    assert found > 40


@pytest.mark.parametrize("m", [0, 1, 2, 3])
def test_the_root_at_the_launch_is_divided_out(m):
    """u^m (u - r) (u + 2), r down to 1e-12: all digits of r."""
    for r in (0.9, 1e-2, 1e-6, 1e-12):
        c = np.concatenate([np.zeros(m), from_roots([r, -2.0])])
        u, _ = crossing(c, m)
        assert u == pytest.approx(r, rel=1e-15)


def test_a_root_at_the_end():
    """On it: found there; beyond it: none."""
    for end in (1.0, 0.5, 0.3):
        assert crossing(from_roots([end - 1e-9, -1.0]), 0, end)[0] == pytest.approx(end - 1e-9)
        assert crossing(from_roots([end + 1e-9, -1.0]), 0, end)[0] == NONE
    assert crossing([-1.0, 1.0 + 1e-15])[0] == pytest.approx(1.0, abs=2e-15)


def test_no_root():
    """Below the stop throughout, with turning points and without."""
    assert crossing([-1.0, 0.5]) == (NONE, -math.inf)
    assert crossing([-1.0]) == (NONE, -math.inf)
    u, turn = crossing([-1.0, 1.0, -1.0])
    assert (u, turn) == (NONE, pytest.approx(-0.75, rel=1e-15))
    u, turn = crossing([0.0, -1.0, 1.0, -1.0], 1)
    assert u == NONE


@pytest.mark.parametrize("at", [0.1, 1 / 3, 0.5, 0.77, 0.998])
@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-7])
def test_two_close_roots(at, gap):
    """-(u - at)^2 + gap^2 / 4 rises through the first; lowered by twice that, it has none."""
    top = (gap / 2) ** 2
    with mp.workdps(50):
        shape = [mp.mpf(-at) * at, 2 * mp.mpf(at), mp.mpf(-1), mp.mpf(0)]
        for lift in (top, -top):
            c = np.array([float(q + (lift if k == 0 else 0)) for k, q in enumerate(shape)])
            u, turn = crossing(c)
            exact = mp.mpf(c[0]) + mp.mpf(c[1]) ** 2 / (-4 * mp.mpf(c[2]))
            if exact > 1e-15:
                root = mp.mpf(c[1]) / 2 - mp.sqrt(exact)
                assert abs(u - root) <= 1e-16 / math.sqrt(exact) + 2e-16
            elif exact < -1e-15:
                assert u == NONE
                assert turn == pytest.approx(float(exact), abs=3e-16)


def test_roots_a_billionth_apart_are_not_jumped():
    """Roots r and r + 1e-9, where coefficients of one allow it: divided by their size, near 0."""
    for r in (1e-6, 1e-5, 1e-4):
        c = from_roots([r, r + 1e-9, 2.0])
        u, turn = crossing(c)
        assert c[0] < 0.0
        assert u == pytest.approx(r, rel=1e-5 * r / 1e-6)
        assert u < r + 0.6e-9
        u, turn = crossing(from_roots([r, r + 1e-9, 2.0]) - padded([1e-18])[:4])
        assert (u, turn < 0.0) == (NONE, True)


def test_a_double_root_is_a_turning_point_at_the_stop():
    """Touched without speed: the turn is zero to rounding, whichever side of it."""
    for at in (0.25, 0.5, 0.7):
        u, turn = crossing(-from_roots([at, at]))
        assert abs(turn) <= 2e-16 if u == NONE else abs(u - at) <= 2e-8


def test_inflections():
    """A triple root is crossed once; a curve with inflections and no root has none."""
    for at in (0.3, 0.5, 0.9):
        u, _ = crossing(from_roots([at, at, at]))
        assert u == pytest.approx(at, abs=2e-5)
        u, _ = crossing(from_roots([at, at, at]) - padded([5e-7])[:4])
        assert u == pytest.approx(at + 5e-7 ** (1 / 3), abs=1e-10)
    wave = np.polynomial.Chebyshev.basis(11).convert(kind=np.polynomial.Polynomial).coef
    assert crossing(wave - padded([1.01])[: wave.size])[0] == NONE
