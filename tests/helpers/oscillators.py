"""Oscillators, given or random, and their orbits computed independently of the package.

``SectionMap`` solves eqs (1)-(5) in multiple precision for impacts near given ones: each flight is
a closed form, and Newton's method finds its impact. It shares no code with the package, which only
provides the phases at which the search for impacts starts.
"""

from dataclasses import asdict, replace

import mpmath as mp
import numpy as np
from scipy.optimize import bisect, brentq

from tests.helpers import naive
from vibroimpact import Oscillator, one_impact_orbits, periodic_orbit, simulate
from vibroimpact.orbits.calls import linearised

TAU = 2.0 * np.pi


def oscillator(h, R, omega=1.0, clearance=0.0, f=1.0, p=1.0):
    """Return an oscillator from positional parameters."""
    return Oscillator(h=h, R=R, omega=omega, f=f, p=p, clearance=clearance)


def random_oscillators(count, seed, clearance=1.0):
    """Yield random oscillators and n: a quarter each undamped, critical, over-damped and any."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        p = rng.uniform(0.5, 2.0)
        h = (0.0, p, p * rng.uniform(1.0, 2.0), p * rng.uniform())[k % 4]
        R, omega, stop, f = rng.uniform([0, 0.3, -clearance, 0.5], [1, 7, clearance, 2]).tolist()
        yield oscillator(h, R, p * omega, stop, f, p), int(rng.integers(1, 4))


def settled_orbit(osc, m=1, *, x0=0.0, periods=600):
    """Return the orbit of m forcing periods on which a motion is after many."""
    run = simulate(osc, periods, x0=x0)
    return periodic_orbit(osc, float(run.section_x[-1]), float(run.section_v[-1]), m)


def peak(orbit):
    """Return the largest local maximum of x - clearance in the flight of a one-impact orbit.

    It is -inf if there is none. Not for h = p.
    """
    osc = orbit.oscillator
    flight = naive.ClosedForm(osc, orbit.phase / osc.omega, osc.clearance, -osc.R * orbit.v)
    t = flight.t0 + np.linspace(0.0, orbit.m * osc.forcing_period, 4001)
    v = flight(t)[1]
    tops = np.flatnonzero((v[:-1] > 0.0) & (v[1:] <= 0.0))
    tops = [brentq(lambda t: flight(t)[1], t[i], t[i + 1], xtol=1e-300, rtol=1e-15) for i in tops]
    return max((float(flight(top)[0]) for top in tops), default=-np.inf) - osc.clearance


#: Functions of the one-impact orbits, the slower first, that change sign where one bifurcates.
_SIGNS = {
    "flip": lambda orbits: np.real(np.prod(1.0 + orbits[-1].multipliers)),
    "graze": lambda orbits: peak(orbits[-1]),
    "fold": lambda orbits: 1.0 if orbits else -1.0,
}


def bifurcation(osc, kind, parameter, low, high, n=1):
    """Return the parameter value at which the one-impact orbit bifurcates, by bisection."""

    def sign(value):
        return _SIGNS[kind](one_impact_orbits(replace(osc, **{parameter: value}), n))

    return bisect(sign, low, high, xtol=1e-300, rtol=4.0 * np.finfo(float).eps, maxiter=200)


def in_digits(osc):
    """Return the parameters in multiple precision, by name."""
    return {name: mp.mpf(value) for name, value in asdict(osc).items()}


def _one_impact(parameters, n):
    """Return g, k and X of the flights of n/1 orbits, from `in_digits`.

    The free part u of the flight satisfies M u = u + (0, (1 + R) v), so that x_p = sigma + g v and
    x_p' = k omega v at the impact: (sigma + g v)^2 + (k v)^2 = |X|^2; X is the complex amplitude.
    """
    h, R, omega, p = (parameters[name] for name in ("h", "R", "omega", "p"))
    T = 2 * mp.pi * n / omega
    rate = mp.sqrt(mp.mpc(h * h - p * p))
    decay = mp.exp(-h * T)
    response = (decay * mp.sinh(rate * T) / rate).real if rate else decay * T
    trace = (2 * decay * mp.cosh(rate * T)).real
    determinant = 1 - trace + decay**2  # of I - M
    g = (1 + R) * response / determinant
    k = ((1 + R) * (1 - trace / 2 - h * response) / determinant - R) / omega
    return g, k, steady_response(parameters)


def one_impact_motions(parameters, n):
    """Return speed and phase of all n/1 motions, the slower first, from `in_digits`."""
    sigma, (g, k, X) = parameters["clearance"], _one_impact(parameters, n)
    a, b, c = g * g + k * k, sigma * g, sigma**2 - abs(X) ** 2
    if b * b < a * c:
        return []
    speeds = [(-b + sign * mp.sqrt(b * b - a * c)) / a for sign in (-1, 1)]
    return [(v, mp.arg(mp.mpc(k * v, sigma + g * v) / X) % (2 * mp.pi)) for v in speeds if v > 0]


def fold_of_one_impact(parameters, n):
    """Return the clearance at which both n/1 orbits meet, and their speed, from `in_digits`.

    There the root v > 0 is double, and sigma = -sign(g) |X| sqrt(g^2 + k^2) / |k|.
    """
    g, k, X = _one_impact(parameters, n)
    sigma = -mp.sign(g) * abs(X) * mp.hypot(g, k) / abs(k)
    return sigma, -sigma * g / (g * g + k * k)


class Flight:
    """The motion of eq. (1) from a state at time t; not for h = p or undamped resonance."""

    def __init__(self, parameters, t, x, v):
        h, p, omega = (parameters[name] for name in ("h", "p", "omega"))
        root, self.t, self.omega = mp.sqrt(mp.mpc(h * h - p * p)), t, omega
        self.rates = one, two = -h + root, -h - root
        self.steady = steady_response(parameters)
        forced = self.steady * mp.expj(omega * t)
        x, v = x - forced.imag, v - omega * forced.real
        self.weights = (v - two * x) / (2 * root), (one * x - v) / (2 * root)

    def __call__(self, t):
        """Return x and x'."""
        both = zip(self.weights, self.rates, strict=True)
        waves = [c * mp.exp(r * (t - self.t)) for c, r in both]
        rates = [wave * r for wave, r in zip(waves, self.rates, strict=True)]
        forced = self.steady * mp.expj(self.omega * t)
        return sum(waves).real + forced.imag, sum(rates).real + self.omega * forced.real


def steady_response(parameters):
    """Return the factor of exp(i omega t) in the steady motion without impacts."""
    h, omega, f, p, a = (parameters[name] for name in ("h", "omega", "f", "p", "a"))
    return -(f + a * omega * omega) / mp.mpc(p * p - omega * omega, 2 * h * omega)


def characteristic(orbit):
    """Return c0, c1, c2 of det J(mu) = c0 + c1 mu + c2 mu^2, whose roots are the multipliers."""
    _, A, B = linearised(*orbit.equations)
    q, c0, c2 = orbit.q, np.prod(np.linalg.det(A)), np.prod(np.linalg.det(B))
    J = np.zeros((q, 2, q, 2))
    for i in range(q):
        J[i, :, i] += A[i]
        J[i, :, (i + 1) % q] += B[i]
    return c0, np.linalg.det(J.reshape(2 * q, 2 * q)) - c0 - c2, c2


class SectionMap:
    """The map of a state to the state one repetition later, with impacts near those of an orbit.

    The section is in the middle of the longest flight. An impact of speed zero, at a graze, is
    treated as a flight that touches the stop.
    """

    def __init__(self, orbit):
        self.parameters = in_digits(orbit.oscillator)
        turn = 2 * mp.pi * orbit.m
        hits = [(mp.mpf(a), mp.mpf(v)) for a, v in zip(orbit.phases, orbit.speeds, strict=True)]
        impacts = [hit for hit in hits if hit[1] > 0]
        touches = [phase for phase, speed in hits if speed == 0]
        if impacts:
            phases = [phase for phase, _ in impacts]
            ends = [*phases, *(phase + turn for phase in phases)]
            longest = max(range(len(phases)), key=lambda i: ends[i + 1] - ends[i])
            self.start = (ends[longest] + ends[longest + 1]) / 2
            self.phases = ends[longest + 1 : longest + 1 + len(phases)]
            launch = -self.parameters["R"] * impacts[longest][1]
            omega, stop = self.parameters["omega"], self.parameters["clearance"]
            flight = Flight(self.parameters, ends[longest] / omega, stop, launch)
            self.state = mp.matrix(flight(self.start / omega))
        else:
            self.start, self.phases = touches[0] - 2, []
            forced = steady_response(self.parameters) * mp.expj(self.start)
            self.state = mp.matrix([forced.imag, self.parameters["omega"] * forced.real])
        self.end = self.start + turn
        self.touches = [self.start + (phase - self.start) % turn for phase in touches]

    def __call__(self, state):
        """Return the state at the end, and the times and speeds of the impacts."""
        omega, stop = self.parameters["omega"], self.parameters["clearance"]
        flight, impacts = Flight(self.parameters, self.start / omega, *state), []
        self.flights = [flight]
        for phase in self.phases:
            t = phase / omega
            x, v = flight(t)
            while abs(x - stop) > mp.mpf(10) ** -40:
                t -= (x - stop) / v
                x, v = flight(t)
            flight = Flight(self.parameters, t, stop, -self.parameters["R"] * v)
            self.flights.append(flight)
            impacts.append((t, v))
        return mp.matrix(flight(self.end / omega)), impacts

    def derivative(self):
        """Return the monodromy matrix, by central differences."""
        step, D = mp.mpf(10) ** -16, mp.matrix(2, 2)
        for j in range(2):
            beside = mp.matrix(2, 1)
            beside[j] = step
            change = self(self.state + beside)[0] - self(self.state - beside)[0]
            D[0, j], D[1, j] = change / (2 * step)
        return D

    def polish(self):
        """Take two Newton steps onto the periodic orbit; return its impacts."""
        for _ in range(2):
            end, impacts = self(self.state)
            self.phases = [t * self.parameters["omega"] for t, _ in impacts]
            self.state += mp.lu_solve(mp.eye(2) - self.derivative(), end - self.state)
        end, impacts = self(self.state)
        assert mp.norm(end - self.state) < mp.mpf(10) ** -20
        return impacts

    def cubic_coefficient(self):
        """Return the coefficient that is negative at a subcritical flip (Kuznetsov, sec. 5.4)."""
        D, step = self.derivative(), mp.mpf(10) ** -9

        def image(change):
            return self(self.state + step * change)[0]

        def null_vector(M):
            row = max(range(2), key=lambda i: mp.norm(M[i, :]))
            return mp.matrix([M[row, 1], -M[row, 0]])

        def second(change):
            return (image(change) - 2 * image(mp.zeros(2, 1)) + image(-change)) / step**2

        along, across = null_vector(D + mp.eye(2)), null_vector(D.T + mp.eye(2))
        along /= mp.norm(along)
        across /= (across.T * along)[0]
        third = image(2 * along) - 2 * image(along) + 2 * image(-along) - image(-2 * along)
        bend = mp.lu_solve(mp.eye(2) - D, second(along))
        mixed = (second(along + bend) - second(along - bend)) / 4
        return (across.T * (third / (12 * step**3) + mixed / 2))[0]

    def bifurcation(self, kind, parameter):
        """Solve for x, v and a parameter at a bifurcation; return the parameter."""
        unknowns, step = mp.matrix([*self.state, self.parameters[parameter]]), mp.mpf(10) ** -12
        for _ in range(4):
            value, J = self._equations(unknowns, kind, parameter), mp.matrix(3, 3)
            for j in range(3):
                moved = unknowns.copy()
                moved[j] += step
                J[:, j] = (self._equations(moved, kind, parameter) - value) / step
            change = mp.lu_solve(J, value)
            unknowns -= change
        assert mp.norm(change) < mp.mpf(10) ** -15
        return unknowns[2]

    def _equations(self, unknowns, kind, parameter):
        self.state, self.parameters[parameter] = mp.matrix(unknowns[:2]), unknowns[2]
        end, impacts = self(self.state)
        if kind == "graze":
            condition = self._height([t for t, _ in impacts])
        else:
            D = self.derivative()
            trace = D[0, 0] + D[1, 1]
            condition = 1 + (trace if kind == "flip" else -trace) + mp.det(D)
        return mp.matrix([end[0] - self.state[0], end[1] - self.state[1], condition])

    def _height(self, times):
        """Return how far the touching flight goes beyond the stop, at its local maximum."""
        t = self.touches[0] / self.parameters["omega"]
        flight = self.flights[sum(impact < t for impact in times)]
        for _ in range(6):
            v, beside = flight(t)[1], flight(t + mp.mpf(10) ** -15)[1]
            t -= v * mp.mpf(10) ** -15 / (beside - v)
        return flight(t)[0] - self.parameters["clearance"]


def special(found, kind):
    """Return the values of the special points of a kind on a branch, in order."""
    return sorted(point.value for point in found.special if point.kind == kind)
