"""The map from a section to a later one (`Flow`, `Passage`), and its derivative."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibroimpact.jit import inlined, jit, widest_vectors
from vibroimpact.step.contact import IMPACT, KIND, REST, Scratch, is_held, pressing
from vibroimpact.step.propagator import (
    Coefficients,
    Forcing,
    Propagator,
    from_dimensionless,
    to_dimensionless,
)
from vibroimpact.step.scheme import SIN, THETA, PhaseGrid
from vibroimpact.step.stepper import take_next_step
from vibroimpact.step.variational import carry_tangents, propagate_tangent

#: Rows of the memory for the states at the sections of a motion.
MOST_SECTIONS = 64


class Flow(NamedTuple):
    """What the motion of one point needs: its parameters, its propagator, and memory."""

    pt: np.void
    eq: Coefficients
    propagators: tuple[Propagator, Forcing]
    grid: PhaseGrid
    scratch: Scratch
    #: States (y, w) at the sections that the last motion passed, shape (MOST_SECTIONS, 2).
    passed: np.ndarray


class Passage(NamedTuple):
    """The motion over some forcing periods, from one section to another."""

    y: float
    w: float
    #: The derivative of (y, w) at the end with respect to the start: its columns.
    columns: tuple[tuple[float, float], tuple[float, float]]
    impacts: int
    smooth: bool  #: Whether the mass did not rest, and no number overflowed.


@jit
def follow(flow, y, w, periods, carrying):
    """Follow a motion that does not rest for some forcing periods; return its ``Passage``.

    The derivative is computed only if `carrying`. A motion that rests ends there. Unlike a run, the
    state is not rounded to (x, v) at the sections: at a stop far from the rest position that would
    hide how distances shrink.
    """
    widest_vectors()  # it keeps LLVM from merging this function into each of its callers
    grid, events = flow.grid, flow.scratch.events
    of_y, of_w, impacts = (1.0, 0.0), (0.0, 1.0), 0
    for k in range(periods):
        for n in range(grid.size):
            (y, w, _), n_events, _ = take_next_step(
                (flow.eq, flow.propagators), (y, w, False), grid, n, flow.pt, flow.scratch
            )
            for j in range(n_events):
                if events[j, KIND] != IMPACT:
                    return Passage(y, w, (of_y, of_w), impacts, False)
                impacts += 1
            M = flow.propagators[0]
            if carrying and n_events == 0:  # what `carry_tangents` does, without a call
                of_y, of_w = propagate_tangent(M, of_y), propagate_tangent(M, of_w)
            elif carrying:
                of_y, of_w = carry_tangents(
                    (flow.eq, M), (of_y, of_w), events, n_events, 0.0, grid.table[THETA, n],
                    grid.phase_step, flow.pt.omega,
                )  # fmt: skip
        if k < MOST_SECTIONS:
            flow.passed[k, 0], flow.passed[k, 1] = y, w
    return Passage(y, w, (of_y, of_w), impacts, np.isfinite(y) and np.isfinite(w))


@inlined
def section_state(pt, sections, k):
    """Return the state (y, w) at section `k` of a record."""
    return to_dimensionless(sections[k, 0], sections[k, 1], pt.clearance, pt.omega)


@jit
def derivative_over(flow, sections, periods):
    """Return the derivative of the map of so many periods, and whether the mass does not rest.

    The motion repeats them, so they begin at the last section. Each begins at its section in the
    record, as in the run: an unstable motion would else leave it. The derivative is that of (y, w),
    row after row.
    """
    a, b, c, d, last = 1.0, 0.0, 0.0, 1.0, sections.shape[0] - 1
    for k in range(periods):
        y, w = section_state(flow.pt, sections, last - periods + k if k > 0 else last)
        end = follow(flow, y, w, 1, True)
        if not end.smooth or (y == 0.0 and w == 0.0):
            return (0.0, 0.0, 0.0, 0.0), False
        (yy, wy), (yw, ww) = end.columns
        a, b, c, d = yy * a + yw * c, yy * b + yw * d, wy * a + ww * c, wy * b + ww * d
    return (a, b, c, d), True


@jit
def replay(flow, y, w, periods, rounding):
    """Follow a motion, which may rest, for some forcing periods; return its end.

    These are y, w, the number of impacts, and whether it comes to rest. With `rounding` the state
    is rounded to (x, v) at the sections, as in a run.
    """
    pt, grid, events, impacts, rests = flow.pt, flow.grid, flow.scratch.events, 0, False
    resting = y == 0.0 and w == 0.0 and (pressing(grid.table[SIN, 0], pt) > 0.0 or is_held(pt))
    for _ in range(periods):
        for n in range(grid.size):
            (y, w, resting), n_events, _ = take_next_step(
                (flow.eq, flow.propagators), (y, w, resting), grid, n, pt, flow.scratch
            )
            for j in range(n_events):
                impacts += events[j, KIND] == IMPACT
                rests |= events[j, KIND] == REST
        if rounding:
            x, v = from_dimensionless(y, w, pt.clearance, pt.omega)
            y, w = to_dimensionless(x, v, pt.clearance, pt.omega)
    return y, w, impacts, rests
