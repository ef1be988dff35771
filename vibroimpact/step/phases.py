"""The common grid of steps, as phases of the force: one table serves every lane."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibroimpact.jit import jit

# Rows of the table.
THETA, SIN, COS = range(3)


class Phases(NamedTuple):
    """A run of equal steps.

    Attributes
    ----------
    table : ndarray, shape (3, size + 1)
        theta = omega t at the start of each step, and at the end of the last one, its sine and its
        cosine.
    step : float
        omega T.
    size : int
        Number of steps.
    """

    table: np.ndarray
    step: float
    size: int


def _phases(start: float, span: float, count: int) -> Phases:
    """Return `count` equal steps over a span of phases."""
    theta = start + span * np.arange(count + 1) / max(count, 1)
    table = np.stack([theta, np.sin(theta), np.cos(theta)])
    return Phases(table, span / max(count, 1), count)


def lead_in(phase: float, steps_per_period: int, at_section: bool = False) -> Phases:
    """Return the steps from t = 0 to the section's `phase`, none longer than the grid's.

    No steps if the start is `at_section` already.
    """
    if at_section:
        return _phases(phase, 0.0, 0)
    n = phase / (2.0 * math.pi) * steps_per_period
    return _phases(0.0, phase, math.ceil(n * (1.0 - 1e-12)))


def one_period(phase: float, steps_per_period: int) -> Phases:
    """Return the steps of one forcing period from the section's `phase`."""
    phases = _phases(phase, 2.0 * math.pi, steps_per_period)
    phases.table[SIN:, -1] = phases.table[SIN:, 0]  # where the next period begins
    return phases


@jit
def sine_at_start(lead: Phases, grid: Phases) -> float:
    """Return the sine of the phase at which a lead-in and the periods after it begin."""
    first = lead if lead.size > 0 else grid
    return first.table[SIN, 0]
