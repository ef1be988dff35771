"""Rigs in SI units: their configurations, and what is read of their sweeps."""

import csv
from pathlib import Path

import numpy as np

FREQUENCY = "{start: 2.0, stop: 12.0, num: 41}"
VALUES = {
    "mass": 2.5, "stiffness": 801.0, "damping": 1.3, "force": 10.1, "gap": 0.0007, "R": 0.8,
    "base": 0.0003,
}  # fmt: skip
#: The rig of the scene joint-clearance.
MASS, STIFFNESS, DAMPING, FORCE, GAP, R = 0.5, 8000.0, 4.0, 8.0, 0.0005, 0.7
JOINT = f"""\
rig: {{mass: {MASS}, stiffness: {STIFFNESS}, damping: {DAMPING}, force: {FORCE}, gap: {GAP},
      R: {R}, frequency: {{start: 22, stop: 41, num: 39}}}}
record: {{transient: 500, periods: 8, phase: 1.5}}
"""


def rig(**changes):
    """Return a one-line configuration with a rig of these values; None omits a value."""
    given = {**VALUES, "frequency": FREQUENCY, **changes}
    items = ", ".join(f"{name}: {value}" for name, value in given.items() if value is not None)
    return f"rig: {{{items}}}\n"


def points_of(config):
    return config.sweep.grid.points()


def rows_of(path):
    with Path(path).open() as file:
        return list(csv.DictReader(file))


def columns_of(path, *names):
    return [np.array([float(row[name] or "nan") for row in rows_of(path)]) for name in names]
