"""Sine and cosine of the compiled code, against forty digits."""

import mpmath
import numpy as np

from vibroimpact.step.trigonometry import sin_cos, sine_after


def test_both_are_right_to_rounding():
    """Every quadrant, next to and at its ends, and thousands of radians: to 2^-52 of their size."""
    rng = np.random.default_rng(1)
    ends = np.arange(-40, 41) * (np.pi / 4)
    angles = np.concatenate(
        [rng.uniform(-50.0, 50.0, 2000), ends, ends + rng.normal(0.0, 1e-9, ends.size),
         rng.uniform(0.0, 5e3, 500)]
    )  # fmt: skip
    with mpmath.workdps(40):
        true = [(mpmath.sin(a), mpmath.cos(a)) for a in map(mpmath.mpf, angles)]
        for angle, known in zip(angles, true, strict=True):
            for found, value in zip(sin_cos(angle), known, strict=True):
                assert abs(found - value) <= abs(value) * 2.0**-52


def test_what_is_no_angle_is_no_number():
    """A run that overflowed must not come back to life."""
    for angle in (np.nan, np.inf, -np.inf):
        assert np.isnan(sin_cos(angle)).all()


def test_the_sine_after_a_turn():
    """The addition theorem, at every quadrant of both."""
    for start in np.linspace(-7.0, 7.0, 29):
        for turn in np.linspace(0.0, 1.6, 9):
            found = sine_after(np.sin(start), np.cos(start), turn)
            np.testing.assert_allclose(found, np.sin(start + turn), atol=1e-15)
