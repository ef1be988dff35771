"""The obvious implementation, slow and self-contained: it shares nothing with the package.

States are (x, v); `osc` is anything with the attributes h, R, omega, f, p and clearance. Time is
kept as time, never as phase, and every step goes back to eq. (1).
"""

import math
from decimal import Decimal, localcontext
from types import SimpleNamespace

import numpy as np


def oscillator(h, R, omega, f=1.0, p=1.0, clearance=0.0):
    """The parameters of eq. (1) under their names."""
    return SimpleNamespace(h=h, R=R, omega=omega, f=f, p=p, clearance=clearance)


def acceleration(osc, t, x, v):
    """x'' of eq. (1)."""
    return -2.0 * osc.h * v - osc.p**2 * x - osc.f * math.sin(osc.omega * t)


def flow(osc, x, v, s, c, T):
    """The flow of eq. (1) over T from (x, v), theta given by its sine and cosine, to 40 digits.

    One Taylor series over the whole step, with as many digits as its cancellation costs.
    """
    h, p, w, f, x, v, s, c, T = (
        Decimal(float(q)) for q in (osc.h, osc.p, osc.omega, osc.f, x, v, s, c, T)
    )
    size = float((2 * h + p + w) * T)
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
    """The flow, from time t."""
    return flow(osc, x, v, math.sin(osc.omega * t), math.cos(osc.omega * t), T)


def rk4_step(osc, t, x, v, T):
    """The classical Runge-Kutta step on the vector (x, v)."""

    def rate(time, y):
        return np.array([y[1], acceleration(osc, time, *y)])

    y = np.array([x, v])
    k1 = rate(t, y)
    k2 = rate(t + T / 2, y + T / 2 * k1)
    k3 = rate(t + T / 2, y + T / 2 * k2)
    k4 = rate(t + T, y + T * k3)
    return tuple(y + T / 6 * (k1 + 2 * k2 + 2 * k3 + k4))


def newmark_from(osc, t, x, v, a, T):
    """Constant average acceleration from (x, v, a): three linear equations for the three at T."""
    matrix = np.array(
        [
            [1.0, 0.0, -(T**2) / 4],
            [0.0, 1.0, -T / 2],
            [osc.p**2, 2.0 * osc.h, 1.0],
        ]
    )
    force = -osc.f * math.sin(osc.omega * (t + T))
    right = np.array([x + T * v + T**2 / 4 * a, v + T / 2 * a, force])
    return tuple(np.linalg.solve(matrix, right))


def newmark_step(osc, t, x, v, T):
    """Constant average acceleration from an acceleration that obeys eq. (1)."""
    return newmark_from(osc, t, x, v, acceleration(osc, t, x, v), T)[:2]


STEPS = {"newmark": newmark_step, "rk4": rk4_step, "exact": exact_step}


def plain(osc, step, periods, n, x=0.0, v=0.0):
    """The rule (2)-(5) at the ends of steps: states at the grid, and (t, v) of the impacts."""
    T = 2.0 * math.pi / osc.omega / n
    states, impacts = [], []
    for k in range(periods * n):
        x, v = step(osc, k * T, x, v, T)
        if x >= osc.clearance and v > 0.0:
            impacts.append(((k + 1) * T, v))
            x, v = osc.clearance, -osc.R * v
        states.append((x, v))
    return np.array(states), np.array(impacts).reshape(-1, 2)


def reduced(osc, step, periods, n, x=0.0, v=0.0):
    """The reduced step and the remainder of the step; where no chatter comes near completion.

    After a rebound the mean velocity (x - clearance) / time takes the place of x in eq. (7).
    """
    T = 2.0 * math.pi / osc.omega / n
    states, impacts = [], []
    for k in range(periods * n):
        t, end = k * T, (k + 1) * T
        for _ in range(6):
            rest = end - t
            x_T, v_T = step(osc, t, x, v, rest)
            if x_T <= osc.clearance:
                break
            if x == osc.clearance:
                mean_0, mean_T = v, (x_T - osc.clearance) / rest
                share = -mean_0 / (mean_T - mean_0)
            else:
                share = (osc.clearance - x) / (x_T - x)
            speed = v + share * (v_T - v)
            assert 0.0 < share <= 1.0 and speed > 0.0, "a turning point inside the step"
            t += share * rest
            impacts.append((t, speed))
            x, v = osc.clearance, -osc.R * speed
        else:
            raise AssertionError("a chatter")
        x, v = x_T, v_T
        states.append((x, v))
    return np.array(states), np.array(impacts).reshape(-1, 2)


def literal(osc, periods, n, carry=True):
    """Eqs (6)-(10) to the letter, stop at 0: impacts (t, v), and where time stopped or None.

    With `carry` the acceleration of eq. (10), that before the impact, starts the next step;
    without, eq. (1) is asked again after the impact.
    """
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
            if not carry:
                a = acceleration(osc, t, x, v)
    return np.array(impacts).reshape(-1, 2), None
