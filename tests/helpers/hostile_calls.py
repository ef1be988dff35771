"""Hostile calls of the public functions, with valid and invalid arguments of every magnitude.

A call fails if it raises an error that the package did not raise itself, or that is not documented.
Explicit requests for long work, such as 10^9 forcing periods, are cut to `MOST_STEPS`.
"""

import math
import traceback
from dataclasses import fields
from pathlib import Path

import numpy as np

import vibroimpact
from vibroimpact import Oscillator
from vibroimpact.orbits.orbit import PeriodicOrbit
from vibroimpact.oscillator import POINT
from vibroimpact.step.scheme import default_steps

MOST_STEPS = 300_000
PACKAGE = str(Path(vibroimpact.__file__).parent)
NAMES = [field.name for field in fields(Oscillator)]
MAGNITUDES = [0.0, 5e-324, 1e-310, 1e-155, 1e-20, 1e-9, 1e-3, 0.1, 1.0, 50.0, 13781.0, 1e9, 1e100]
MAGNITUDES += [1e155, 1e200, 1.7e308]
WRONG = [math.nan, math.inf, -math.inf, None, "1", b"1", True, [1.0], 1j, 10**400, (), {}]
COUNTS = [0, 1, 2, 3, 8, 20, 64, 97, 1000, 5000, 10**5, -1, 10**12, 10**30, 1.5]


class Caller:
    """Draws calls from a seed."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)

    def one_of(self, choices):
        return choices[int(self.rng.integers(len(choices)))]

    def rarely(self, wrong, usual, share=0.06):
        return self.one_of(wrong) if self.rng.random() < share else usual

    def number(self):
        wide = self.one_of([*MAGNITUDES, 10.0 ** self.rng.uniform(-3, 3)])
        return self.one_of([wide, *self.rng.uniform(0.0, 4.0, 2).tolist()])

    def count(self):
        return self.rarely(WRONG, self.one_of(COUNTS[:6] + self.one_of([[], COUNTS])))

    def oscillator(self):
        return Oscillator(
            h=self.one_of([0.0, 0.05, 0.1, self.number()]),
            R=self.one_of([0.0, 0.5, 0.8, 1.0, 0.9999, 1.0 - 2**-53, 5e-324]),
            omega=self.number() or 1.0,
            f=self.one_of([0.0, 1.0, 1.0, self.number()]),
            p=self.one_of([1.0, 1.0, self.number() or 1.0]),
            clearance=self.one_of([0.0, 0.0, 0.3, -0.3, self.number(), -self.number()]),
        )

    def start(self, osc):
        away = self.one_of([0.0, 1e-9, self.number(), self.rng.random()])
        x = self.rarely([*WRONG, osc.clearance + 1.0], max(osc.clearance - away, -1.7e308))
        return x, self.rarely(WRONG, self.one_of([-1.0, 1.0]) * self.number())

    def phase(self):
        return self.rarely([*WRONG, -0.1, 2.0 * math.pi], self.one_of([0.0, 1.0, 6.28, 5e-324]))

    def axis(self, osc):
        name = self.one_of(NAMES)
        value, (low, high) = getattr(osc, name), self.rng.uniform([0.1, 1.0], [1.0, 3.0]).tolist()
        ends = [(value * low, value * high), (value * 1e-9, value * 1e6)]
        ends.append((self.number(), self.number()))
        low, high = self.one_of(ends)
        high = min(high, 1.0) if name == "R" else high
        return self.rarely(WRONG, name), self.rarely(WRONG, low), self.rarely(WRONG, high)

    def orbit(self):
        """Return a valid or an invalid orbit, and the oscillator around which to take ranges."""
        omega = self.one_of([0.01, 0.8, 1.3, 2.3, 2.6, 2.8, 4.1, self.number() or 1.0])
        osc = Oscillator(self.one_of([0.0, 0.05]), self.one_of([0.5, 0.8, 1.0]), omega, 1.0)
        m, q = self.one_of([(1, 1), (3, 2), (10**5, 1), (2, 5000)])
        phases = np.sort(self.rng.uniform(0.0, 2.0 * math.pi * m, q))
        made_up = PeriodicOrbit(osc, m, phases, self.rng.uniform(0.0, 2.0, q))
        try:
            orbit = vibroimpact.periodic_orbit(osc, -0.1, 0.3, self.one_of([1, 1, 2, 8, 64]))
        except ValueError:
            orbit = made_up
        return self.rarely([None, osc, made_up], orbit, 0.1), osc

    def method(self):
        integrator = self.one_of(["exact", "euler", "newmark", "rk4"])
        impact = "exact" if integrator == "exact" else self.one_of(["plain", "reduced-step"])
        return {
            "integrator": self.rarely(["rk5", *WRONG], integrator),
            "impact": self.rarely(["cubic", "soft", *WRONG], impact),
            "steps_per_period": self.one_of([None, None, self.count()]),
            "periods": self.count(),
            "transient": self.count(),
            "phase": self.phase(),
        }

    def points(self):
        oscillators = [self.oscillator() for _ in range(3)]
        points = np.concatenate([osc.at(osc.clearance, self.number()) for osc in oscillators])
        if self.rng.random() < 0.2:
            points[self.one_of(POINT.names)][1] = self.one_of([math.nan, math.inf, -3.0, 1e300])
        shapes = [points[:, None], points[0], points["h"], points.tolist(), oscillators[0], None]
        return self.rarely([*shapes, points[::2], points[:0], points.view(np.recarray)], points)

    def call(self):
        """Return a function and its arguments."""
        name = self.one_of(CALLS)
        if name == "integrate":
            points = self.points()
            impacts = {"impacts": self.count(), "threads": self.rarely(WRONG, 1)}
            return name, (points,), affordable(points, self.method()) | impacts
        if name in ("branch", "bifurcation_curve"):
            orbit, osc = self.orbit()
            if name == "branch":
                return name, (orbit, *self.axis(osc)), {}
            kind = self.rarely(WRONG, self.one_of(["flip", "fold", "graze"]))
            axes = (self.rarely(WRONG, self.axis(osc)) for _ in range(2))
            return name, (orbit, kind, *axes), {}
        osc = self.oscillator()
        given = self.rarely([None], osc)
        if name == "one_impact_orbit":
            return name, (given, self.count()), {}
        x, v = self.start(osc)
        if name == "periodic_orbit":
            return name, (given, x, v, self.count(), self.phase()), {}
        return name, (given,), affordable(osc.at(osc.clearance), self.method()) | {"x0": x, "v0": v}


CALLS = ["integrate", "simulate", "one_impact_orbit", "periodic_orbit", "branch"]
CALLS += ["bifurcation_curve"]


def affordable(points, method):
    """Return a method, and fewer periods if it needs too many steps."""
    try:
        steps = method["steps_per_period"] or default_steps(points, method["impact"])
        periods = int(MOST_STEPS / (steps * points.size)) or 1
        many = {name: min(method[name], periods) for name in ("periods", "transient")}
    except (AttributeError, TypeError, ValueError, ArithmeticError, IndexError):
        return method
    return method | {n: few for n, few in many.items() if 0 < method[n] <= 10**9}


def outcome(name, arguments, keywords):
    """Make a call; return a description of a wrong outcome, or nothing."""
    try:
        result = getattr(vibroimpact, name)(*arguments, **keywords)
        if name in ("one_impact_orbit", "periodic_orbit"):
            assert result.multipliers.shape == (2,)
    except (TypeError, ValueError) as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        own = last.filename.startswith(PACKAGE) and (last.line or "").startswith("raise")
        return "" if own else "".join(traceback.format_exception(error))
    except MemoryError as error:  # documented for many points
        return "" if name == "integrate" else repr(error)
    if name != "integrate":
        return ""
    failed = result["status"] >= vibroimpact.Status.UNRESOLVED
    numbers = [name for name, values in result.items() if np.isinf(values[~failed]).any()]
    return f"infinite in a point that has not failed: {numbers}" if numbers else ""


def main(seed, calls):
    """Make calls; fail after the last of them."""
    wrong = []
    for number in range(calls):
        call = Caller([seed, number]).call()
        if error := outcome(*call):
            wrong.append(f"call {number} of {seed}: {call}\n{error}")
    assert not wrong, "\n".join(wrong)
