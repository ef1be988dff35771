"""A straightforward, slow implementation, which shares no code with the package.

States are (x, v); `osc` is any object with the attributes h, R, omega, f, p, clearance and a. It
uses time, never phase, and computes every step from eq. (1).
"""

import cmath
import math
from decimal import Decimal, localcontext
from types import SimpleNamespace

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq


def oscillator(h, R, omega, f=1.0, p=1.0, clearance=0.0, a=0.0):
    """Return an object with the parameters of eq. (1) as attributes."""
    return SimpleNamespace(h=h, R=R, omega=omega, f=f, p=p, clearance=clearance, a=a)


def force_of(osc):
    """Return the amplitude of the force and of the shaken base together."""
    return osc.f + osc.a * osc.omega**2


def acceleration(osc, t, x, v):
    """Return x'' of eq. (1)."""
    return -2.0 * osc.h * v - osc.p**2 * x - force_of(osc) * math.sin(osc.omega * t)


def flow(osc, x, v, s, c, T):
    """Return the flow of eq. (1) over T from (x, v), theta as sine and cosine, to 40 digits.

    One Taylor series over the whole step, with as many digits as its cancellation requires.
    """
    given = osc.h, osc.p, osc.omega, force_of(osc), x, v, s, c, T
    h, p, w, f, x, v, s, c, T = (Decimal(float(q)) for q in given)
    size = abs(float((2 * h + p + w) * T))
    with localcontext() as context:
        context.prec = 60 + int(2.0 * size / math.log(10.0))
        x_T = v_T = Decimal(0)
        weight = Decimal(1)
        for k in range(1, 100 + int(6.0 * size)):
            x_T += x * weight
            v_T += v * weight
            x, v = v, -2 * h * v - p * p * x - f * s
            s, c = w * c, -w * s
            weight = weight * T / k
    return float(x_T), float(v_T)


def exact_step(osc, t, x, v, T):
    """Return the flow of eq. (1) from time t."""
    return flow(osc, x, v, math.sin(osc.omega * t), math.cos(osc.omega * t), T)


def after_impact(osc, n, v, theta, phase):
    """Return the states at omega t = `phase` in n periods after an impact (`theta`, `v`)."""
    first = (phase - theta) % (2.0 * math.pi) / osc.omega
    times = first + 2.0 * math.pi / osc.omega * np.arange(n)
    s, c = math.sin(theta), math.cos(theta)
    return np.array([flow(osc, osc.clearance, -osc.R * v, s, c, t) for t in times])


def rk4_step(osc, t, x, v, T):
    """Take the classical Runge-Kutta step."""

    def rate(time, y):
        return np.array([y[1], acceleration(osc, time, *y)])

    y = np.array([x, v])
    k1 = rate(t, y)
    k2 = rate(t + T / 2, y + T / 2 * k1)
    k3 = rate(t + T / 2, y + T / 2 * k2)
    k4 = rate(t + T, y + T * k3)
    return tuple(y + T / 6 * (k1 + 2 * k2 + 2 * k3 + k4))


def newmark_from(osc, t, x, v, a, T):
    """Constant average acceleration: solve three linear equations for (x, v, a) after T."""
    matrix = np.array([[1.0, 0.0, -(T**2) / 4], [0.0, 1.0, -T / 2], [osc.p**2, 2.0 * osc.h, 1.0]])
    force = -force_of(osc) * math.sin(osc.omega * (t + T))
    right = np.array([x + T * v + T**2 / 4 * a, v + T / 2 * a, force])
    return tuple(np.linalg.solve(matrix, right))


def newmark_step(osc, t, x, v, T):
    """Constant average acceleration, starting with the acceleration of eq. (1)."""
    return newmark_from(osc, t, x, v, acceleration(osc, t, x, v), T)[:2]


def euler_step(osc, t, x, v, T):
    """Step along the tangent at the start."""
    return x + T * v, v + T * acceleration(osc, t, x, v)


def semi_implicit_euler_step(osc, t, x, v, T):
    """Step the velocity first, then the displacement with the new velocity."""
    v = v + T * acceleration(osc, t, x, v)
    return x + T * v, v


def verlet_step(osc, t, x, v, T):
    """Central differences: x_T is explicit, v_T and a_T solve two linear equations."""
    a = acceleration(osc, t, x, v)
    x_T = x + T * v + T**2 / 2 * a
    pull = -(osc.p**2) * x_T - force_of(osc) * math.sin(osc.omega * (t + T))
    matrix = np.array([[1.0, -T / 2], [2.0 * osc.h, 1.0]])
    v_T, _ = np.linalg.solve(matrix, [v + T / 2 * a, pull])
    return x_T, v_T


STEPS = {"euler": euler_step, "semi-implicit-euler": semi_implicit_euler_step}
STEPS |= {"verlet": verlet_step, "newmark": newmark_step, "rk4": rk4_step, "exact": exact_step}


def plain(osc, step, periods, n, x=0.0, v=0.0):
    """Apply the rule (2)-(5) at the ends of steps; return the states, and (t, v) of impacts."""
    T = 2.0 * math.pi / osc.omega / n
    states, impacts = [], []
    for k in range(periods * n):
        x, v = step(osc, k * T, x, v, T)
        if x >= osc.clearance and v > 0.0:
            impacts.append(((k + 1) * T, v))
            x, v = osc.clearance, -osc.R * v
        states.append((x, v))
    return np.array(states), np.array(impacts).reshape(-1, 2)


def on_the_chord(osc, step, t, x, v, x_T, v_T, rest):
    """Return the fraction of the step and the speed at the impact, from eqs (6), (7), (9).

    After a rebound the mean velocity (x - clearance) / time replaces x in eq. (7).
    """
    if x == osc.clearance:
        mean_0, mean_T = v, (x_T - osc.clearance) / rest
        share = -mean_0 / (mean_T - mean_0)
    else:
        share = (osc.clearance - x) / (x_T - x)
    return share, v + share * (v_T - v)


def on_the_cubic(osc, step, t, x, v, x_T, v_T, rest):
    """Return the fraction at which the Hermite interpolant meets the stop, and the speed there."""
    spline = CubicHermiteSpline([0.0, 1.0], [x, x_T], [rest * v, rest * v_T])
    roots = spline.solve(osc.clearance, extrapolate=False)
    share = min(roots[roots > 1e-9])
    return share, step(osc, t, x, v, share * rest)[1]


def shortened(osc, step, periods, n, x=0.0, v=0.0, locate=on_the_chord):
    """Shorten steps to their impacts, then take the remainders; not for complete chatters."""
    T = 2.0 * math.pi / osc.omega / n
    states, impacts = [], []
    for k in range(periods * n):
        t, end = k * T, (k + 1) * T
        for _ in range(6):
            rest = end - t
            x_T, v_T = step(osc, t, x, v, rest)
            if x_T <= osc.clearance:
                break
            share, speed = locate(osc, step, t, x, v, x_T, v_T, rest)
            assert 0.0 < share <= 1.0 and speed > 0.0, "a turning point inside the step"
            t += share * rest
            impacts.append((t, speed))
            x, v = osc.clearance, -osc.R * speed
        else:
            raise AssertionError("a chatter")
        x, v = x_T, v_T
        states.append((x, v))
    return np.array(states), np.array(impacts).reshape(-1, 2)


def literal(osc, periods, n):
    """Eqs (6)-(10) literally, stop at 0: impacts (t, v), and the time of a standstill or None."""
    T = 2.0 * math.pi / osc.omega / n
    t = x = v = a = 0.0
    impacts = []
    while t < periods * 2.0 * math.pi / osc.omega - 1e-9 * T:
        x_T, v_T, a_T = newmark_from(osc, t, x, v, a, T)
        if x_T <= 0.0:
            t, x, v, a = t + T, x_T, v_T, a_T
            continue
        share = (0.0 - x) / (x_T - x)
        if share == 0.0:
            return np.array(impacts).reshape(-1, 2), t
        t, x, v, a = t + share * T, 0.0, v + share * (v_T - v), a + share * (a_T - a)
        if v > 0.0:
            impacts.append((t, v))
            v = -osc.R * v
    return np.array(impacts).reshape(-1, 2), None


# --- every impact from the closed form, found by dense sampling ---


class ClosedForm:
    """A flight from (t0, x, v) as three complex exponentials; not for h = p or resonance."""

    def __init__(self, osc, t0, x, v):
        self.t0 = t0
        root = cmath.sqrt(complex(osc.h**2 - osc.p**2))
        force = 1j * osc.omega
        # x_p = Im(steady e^(i omega t)), written as two conjugate exponentials.
        steady = -force_of(osc) / (osc.p**2 - osc.omega**2 + 2j * osc.h * osc.omega)
        steady *= cmath.exp(force * t0)
        x_h, v_h = x - steady.imag, v - (force * steady).imag
        one, two = -osc.h + root, -osc.h - root
        self.rates = np.array([one, two, force])
        weights = (v_h - two * x_h) / (2 * root), -(v_h - one * x_h) / (2 * root), 0
        self.weights = np.array(weights)
        self.weights[2] = -1j * steady

    def __call__(self, t):
        """Return x and x' at time t."""
        waves = self.weights * np.exp(np.multiply.outer(t - self.t0, self.rates))
        return waves.sum(axis=-1).real, (waves * self.rates).sum(axis=-1).real


def series(osc, t0, y, v, terms=40):
    """Return the Taylor coefficients of x - clearance about t0."""
    c = [y, v]
    f = force_of(osc) * cmath.exp(1j * osc.omega * t0)
    for k in range(terms):
        load = osc.p**2 * osc.clearance if k == 0 else 0.0
        pull = 2 * osc.h * (k + 1) * c[k + 1] + osc.p**2 * c[k] + f.imag + load
        c.append(-pull / ((k + 1) * (k + 2)))
        f *= 1j * osc.omega / (k + 1)
    return np.array(c)


def first_touch(value, slope, grid):
    """Return the first root of `value` on a grid, and the highest local maximum below 0."""
    y, dy = value(grid), slope(grid)
    near = -math.inf
    for i in np.flatnonzero((y[1:] > 0.0) | ((dy[:-1] > 0.0) & (dy[1:] <= 0.0))):
        end = grid[i + 1]
        if y[i + 1] <= 0.0:
            end = brentq(slope, grid[i], end, xtol=1e-300, rtol=1e-15) if dy[i + 1] else end
            if value(end) <= 0.0:
                near = max(near, float(value(end)))
                continue
        return brentq(value, grid[i], end, xtol=1e-300, rtol=1e-15), near
    return None, near


class ExactOrbit:
    """All `sections` (x, v), `impacts` (t, v) and `rests` (start, end) from t = 0.

    ``graze`` is the time at which the orbit first came within `margin` of a graze, inf if it never
    did; ``reached`` is the end of the periods, or the time of impact number `most`.
    """

    def __init__(self, osc, periods, x=0.0, v=0.0, margin=1e-6, shortest=1e-13, most=10**6):
        self.osc, self.margin, self.shortest, self.graze = osc, margin, shortest, math.inf
        self.period = 2 * math.pi / osc.omega
        self.end = periods * self.period
        self.sections, self.impacts, self.rests = [], [], []
        self.rate = 2 * osc.h + osc.p + osc.omega
        t = 0.0
        if x == osc.clearance and v > 0.0:
            self.impacts.append((0.0, v))
            v = -osc.R * v
        while t < self.end and len(self.impacts) < most:
            released = bool(self.rests) and self.rests[-1][1] == t
            if x == osc.clearance and v == 0.0 and self.push(t) > 0.0 and not released:
                t, x, v = self.rest(t)
            else:
                t, x, v = self.fly(t, x, v)
        self.reached = t

    def push(self, t):
        """Return the acceleration that presses the resting mass onto the stop."""
        osc = self.osc
        return -force_of(osc) * math.sin(osc.omega * t) - osc.p**2 * osc.clearance

    def pass_sections(self, t0, t, state):
        """Record the sections in (t0, t]."""
        while len(self.sections) * self.period + self.period <= min(t, self.end) * (1 + 1e-14):
            at = (len(self.sections) + 1) * self.period
            x, v = state(at)
            self.sections.append((float(x), float(v)))

    def rest(self, t):
        """Rest until the force no longer presses the mass onto the stop."""
        grid = t + np.linspace(0.0, self.period, 2001)
        force = np.array([self.push(q) for q in grid])
        pulls = np.flatnonzero(force[1:] <= 0.0)
        release = math.inf
        if pulls.size:
            release = brentq(self.push, grid[pulls[0]], grid[pulls[0] + 1], xtol=1e-300, rtol=1e-15)
        self.pass_sections(t, release, lambda _: (self.osc.clearance, 0.0))
        self.rests.append([t, release])
        return release, self.osc.clearance, 0.0

    def fly(self, t, x, v):
        """Follow one flight and the impact at its end."""
        osc, stop = self.osc, self.osc.clearance
        panel = 0.2 / self.rate
        c = series(osc, t, x - stop, v)
        released = bool(self.rests) and self.rests[-1][1] == t
        m = 3 if released else ((1 if v else 2) if x == stop else 0)
        c[:m] = 0.0
        # The first panel uses the series divided by its root at the launch, for short flights.
        quotient, whole = np.polynomial.Polynomial(c[m:]), np.polynomial.Polynomial(c)
        if x == stop and self.push(t) > 0.0:
            panel = min(panel, max(8 * abs(v) / self.push(t), 1e-3 * panel))
        grid = np.linspace(0.0, panel, 129)
        at, near = first_touch(quotient, quotient.deriv(), grid)
        state = lambda q: (stop + whole(q - t), whole.deriv()(q - t))  # noqa: E731
        flight, start = None, t + panel
        if at is not None:
            at += t
            speed = float(whole.deriv()(at - t))
            near = near * panel**m
        else:
            at, speed, flight, near = self.long_flight(start, state, near * panel**m)
            state_short, state_long = state, flight
            state = lambda q: state_short(q) if q <= start else state_long(q)  # noqa: E731
        if -self.margin < near < 0.0:
            self.graze = min(self.graze, t)
        self.pass_sections(t, at, state)
        if at >= self.end:
            return at, stop, speed
        a = self.push(at)
        if a < 0.0 and speed**2 < -2.0 * a * self.margin:
            self.graze = min(self.graze, at)
        self.impacts.append((at, speed))
        v = -osc.R * speed
        if a > 0.0 and -v < self.shortest:
            v = 0.0
        return at, stop, v

    def long_flight(self, start, state, near):
        """Follow a flight after its first panel with the closed form, window by window."""
        osc, stop = self.osc, self.osc.clearance
        form = ClosedForm(osc, start, *map(float, state(start)))
        # Local maxima are at least about half a period of the fastest motion apart.
        spacing = 0.02 * 2 * math.pi / self.rate
        t = start
        while t < self.end:
            grid = t + spacing * np.arange(201)
            at, close = first_touch(lambda q: form(q)[0] - stop, lambda q: form(q)[1], grid)
            near = max(near, close)
            if at is not None and at < self.end:
                return at, float(form(at)[1]), form, near
            t = grid[-1]
        return self.end * (1 + 1e-12), 0.0, form, near
