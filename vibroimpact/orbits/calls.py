"""The compiled functions of this room as Python calls them, through one for every task.

What Python calls is optimised together with all that it calls. These functions have most of that in
common, so one function that does the task of each compiles in half the time of all of them.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from vibroimpact.jit import compiled, jit
from vibroimpact.orbits import corrector, flights, hidden_roots, unknowns
from vibroimpact.orbits.corrector import System
from vibroimpact.step.integrators import Parameters

# The tasks of ``_do``.
(
    _TESTS, _MAY_MISS, _CORRECT, _TANGENT, _MULTIPLIERS, _SECTIONS, _PENETRATION, _TURNING,
    _NULL_VECTOR, _LINEARISED,
) = range(10)  # fmt: skip
_NO_VECTOR, _NO_ROWS = np.empty(0), np.empty((0, 0))

#: A point of a path: the unknowns, the direction of the path, and the test functions there. It is a
#: plain tuple, since a call with one that has names takes 3 us longer.
PlainPoint: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray]
_NO_POINT = _NO_VECTOR, _NO_VECTOR, _NO_ROWS
#: Number of starts per period from which the turns of a flight are sought.
_STARTS = 16


@jit
def _do(task, system, begin, end, points, rows, count, number, results):
    """Do a task at a point of a path or, for all but the first two, at each of some points."""
    X, along, tests = begin
    if task == _TESTS:
        hidden_roots.set_test_functions(system, X, along, rows, tests)
    elif task == _MAY_MISS:
        results[0] = hidden_roots.step_may_miss(system, begin, end, number)
    for k in range(points.shape[0]):
        each, planes = results.size // points.shape[0], rows.shape[0] // points.shape[0]
        out, plane = results[each * k : each * (k + 1)], rows[planes * k : planes * (k + 1)]
        _do_at(task, system, points[k], plane, count, number, out)


@jit
def _do_at(task, system, X, planes, count, number, results):
    """Do a task at a point."""
    pt, m, q = corrector.parameters_at(system, X), system.m, system.q
    if task == _CORRECT:
        results[0] = corrector.newton_method(system, X, planes, count)
    elif task == _TANGENT:
        corrector.set_tangent(system, X, results)
    elif task == _MULTIPLIERS:
        corrector.set_multipliers(system, X, results)
    elif task == _SECTIONS:
        flights.set_sections(pt, m, X, q, number, results)
    elif task == _PENETRATION:
        results[0], results[1], results[2] = flights.find_penetration(pt, m, X, q)
    elif task == _TURNING:
        results[0], results[1] = flights.find_turning_point(pt, X, count, number)
    else:
        F, A, B = corrector.linearised_flights(system, X)
        if task == _NULL_VECTOR:
            unknowns.set_null_vector(A, B, number, results)
            return
        for i in range(system.q):
            for row in range(2):
                at = 5 * (2 * i + row)
                results[at] = F[i, row]
                for j in range(2):
                    results[at + 1 + j], results[at + 3 + j] = A[i, row, j], B[i, row, j]


def _call(
    task: int,
    system: System,
    size: int = 1,
    *,
    begin: PlainPoint = _NO_POINT,
    end: PlainPoint = _NO_POINT,
    points: np.ndarray = _NO_ROWS,
    rows: np.ndarray = _NO_ROWS,
    count: int = 0,
    number: float = 0.0,
) -> np.ndarray:
    """Do a task as `_do` does; return its results, in all at most `size`."""
    results, points = np.empty(size), np.atleast_2d(points)
    arguments = task, system, begin, end, points, rows, count, number, results
    if not _do.overloads:
        compiled(_do, *arguments)
    _do(*arguments)
    return results


def parameters(system: System, X: np.ndarray) -> Parameters:
    """Return the ``Parameters`` at a vector of unknowns, or arrays of those at each row of X."""
    numbers = np.multiply.outer(system.point, np.ones(X.shape[:-1]))
    numbers[system.free] = np.moveaxis(unknowns.free(X, system.q) * system.spans, -1, 0)
    pt: Parameters = flights.parameters_in.py_func(numbers)  # not worth compiling
    return pt


def correct(system: System, X: np.ndarray, planes: np.ndarray, most: int) -> np.ndarray:
    """Do what ``corrector.newton_method`` does for X, or each row of X with a plane each, (n,)."""
    return _call(_CORRECT, system, X.size // X.shape[-1], points=X, rows=planes, count=most) > 0.0


def tangent(system: System, X: np.ndarray) -> np.ndarray:
    """Return the direction of a path, as ``corrector.set_tangent`` sets it."""
    return _call(_TANGENT, system, X.size, points=X)


def test_functions(
    system: System, X: np.ndarray, tangent: np.ndarray, bounds: np.ndarray
) -> np.ndarray:
    """Return the test functions, as ``hidden_roots.set_test_functions`` sets them, (2, 2 k + 2)."""
    tests = np.empty((2, 2 * len(bounds) + 2))
    _call(_TESTS, system, begin=(X, tangent, tests), rows=bounds)
    return tests


def may_miss(system: System, begin: PlainPoint, end: PlainPoint, length: float) -> bool:
    """Do what ``hidden_roots.step_may_miss`` does."""
    return bool(_call(_MAY_MISS, system, begin=begin, end=end, number=length)[0])


def first_penetration(system: System, X: np.ndarray) -> tuple[int, float, float]:
    """Do what ``flights.find_penetration`` does."""
    flight, phase, highest = _call(_PENETRATION, system, 3, points=X).tolist()
    return int(flight), phase, highest


def turning_point(system: System, X: np.ndarray, i: int, phase: float) -> tuple[float, float]:
    """Do what ``flights.find_turning_point`` does."""
    at, y = _call(_TURNING, system, 2, points=X, count=i, number=phase).tolist()
    return at, y


def turning_points(system: System, X: np.ndarray, i: int) -> np.ndarray:
    """Return the phase and x - clearance of each turning point within flight i, shape (n, 2)."""
    pt, phases = parameters(system, X), unknowns.phases(X, system.q)
    begin, end = np.append(phases, phases[0] + 2.0 * math.pi * system.m)[i : i + 2]
    spacing = 2.0 * math.pi / _STARTS / max(1.0, pt.p / pt.omega)
    count = _STARTS + math.ceil((end - begin) / spacing)
    starts = np.linspace(begin, end, count, endpoint=False)[1:].tolist()
    turns = np.array([turning_point(system, X, i, start) for start in starts])
    return turns[(begin < turns[:, 0]) & (turns[:, 0] < end)]


def sections(system: System, X: np.ndarray, phase: float) -> np.ndarray:
    """Return the states that ``flights.set_sections`` sets for each row of X, shape (n, m, 2)."""
    states = _call(_SECTIONS, system, 2 * system.m * len(X), points=X, number=phase)
    return states.reshape(-1, system.m, 2)


def linearised(system: System, X: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return F, A and B of the flights (``flights.residuals``) of X or of each row of X."""
    results = _call(_LINEARISED, system, 10 * system.q * X.size // X.shape[-1], points=X)
    rows = results.reshape(*X.shape[:-1], system.q, 2, 5)
    return rows[..., 0], rows[..., 1:3], rows[..., 3:]


def multipliers(system: System, X: np.ndarray) -> np.ndarray:
    """Return the complex numbers that ``corrector.set_multipliers`` sets for each row, (n, 2)."""
    return _call(_MULTIPLIERS, system, 4 * len(X), points=X).view(complex).reshape(-1, 2)


def null_vector(system: System, X: np.ndarray, mu: float) -> np.ndarray:
    """Return the vector that ``unknowns.set_null_vector`` sets for a multiplier, (2 q,)."""
    return _call(_NULL_VECTOR, system, 2 * system.q, points=X, number=mu)
