"""Whether rounding decides after how many periods a motion rests again.

After a rest a motion depends on nothing before its release, which always has the same phase. So a
computed motion that rests again after m periods repeats for ever, to the same bits, however much
its rounding errors have grown in between. No multiplier says whether others go there. The motion
has a class only if those beside it, with a slightly smaller and a slightly larger p, also rest
again after m periods, and about as long as each other. With exact impacts this is asked only where
m is greater than ``_SURE``: it changed no name of fewer periods in 24,000 random motions.
"""

from __future__ import annotations

import math

from vibroimpact.jit import jit, specialised
from vibroimpact.step.contact import KIND, RELEASE, REST, TIME, is_held
from vibroimpact.step.elementary import asin
from vibroimpact.step.propagator import coefficients_of, propagator_of
from vibroimpact.step.scheme import THETA
from vibroimpact.step.stepper import prepare, take_grid_step, take_next_step

#: The motions beside another have a p that differs by this share: some ten times its rounding.
_BESIDE = 2.0**-48
#: Most periods in which rounding has never been seen to grow enough to decide a rest.
_SURE = 12
#: Rests are about as long as each other if they differ by less than this share.
_ALIKE = 0.5


@specialised
def rest_after(pt, scheme, m, scratch, exactly):
    """Return how long a mass that is released rests before the m-th release after it, as a phase.

    It is 0 if there is no rest then, or one before.
    """
    (method, grid), events = scheme, scratch.events
    if exactly:
        eq = coefficients_of(pt)
        prepared = eq, propagator_of(eq, grid.phase_step, scratch.coefficients)
        state = 0.0, 0.0, True
    else:
        prepared, state = prepare(method, grid, pt), (pt.clearance, 0.0, True)
    release = -asin(pt.p * pt.p * pt.clearance / pt.f) - grid.table[THETA, 0]
    first, begun = int(release % (2.0 * math.pi) / grid.phase_step), 0.0
    for k in range(m * grid.size + 2):
        n = (first + k) % grid.size
        if exactly:
            state, n_events, _ = take_next_step(prepared, state, grid, n, pt, scratch)
        else:
            state, n_events, _ = take_grid_step(method, prepared, state, grid, n, pt, scratch)
        for j in range(n_events):
            at = k * grid.phase_step + events[j, TIME] * pt.omega
            if events[j, KIND] == REST:
                begun = at
            elif events[j, KIND] == RELEASE and at > math.pi:
                return at - begun if at > (2 * m - 1) * math.pi else 0.0
    return 0.0


@specialised
def rests_alike(pt, scheme, m, memory, exactly):
    """Whether motions beside one that rests again after m periods do so, too."""
    if is_held(pt):
        return True
    shortest, longest, beside = math.inf, 0.0, memory.beside[0]
    memory.beside[0] = pt
    for share in (-_BESIDE, _BESIDE):
        beside.p = pt.p * (1.0 + share)
        length = rest_after(beside, scheme, m, memory.scratch, exactly)
        if length == 0.0:
            return False
        shortest, longest = min(shortest, length), max(longest, length)
    return longest - shortest < _ALIKE * shortest


@jit
def rests_alike_exactly(pt, scheme, m, memory):
    """Do what ``rests_alike`` does, with the rule ``exact``, where m is not small."""
    return m <= _SURE or rests_alike(pt, scheme, m, memory, True)


@jit
def rests_alike_by_steps(pt, scheme, m, memory):
    """Do what ``rests_alike`` does, with a rule of time stepping."""
    return rests_alike(pt, scheme, m, memory, False)
