"""A sweep that is refined around a flip, and where the flips are."""

import math

from scipy.optimize import brentq

from sweep_files import load, run_in
from sweeps import open_sweep
from sweeps.analysis.regimes import changes, labels

CONFIG = """\
name: around a flip
oscillator: {h: 0.0, R: 0.8, omega: {start: 2.6, stop: 2.7, num: 21}, f: 1.0}
record: {transient: 300, periods: 100, impacts: 8, diagnostics: [period, lyapunov]}
refine: {axis: omega, levels: 17}
"""


def refined_config(folder, text, *overrides):
    return load(text, *overrides, path=folder / "c.yaml")


def refined(folder, *overrides, text=CONFIG, name="out.h5", **options):
    return run_in(folder, text, *overrides, name=name, **options)


def found(path):
    with open_sweep(path) as dataset:
        return list(changes(dataset["omega"].values, labels(dataset.load())))


def flip(n, low, high, R=0.8):
    """Return where cos^2(pi n / omega) (omega^2 - ((1 - R) / (1 + R))^2) = 1 (h = 0, p = 1)."""
    loss = ((1.0 - R) / (1.0 + R)) ** 2
    return brentq(
        lambda w: math.cos(math.pi * n / w) ** 2 * (w * w - loss) - 1.0, low, high, xtol=1e-15
    )
