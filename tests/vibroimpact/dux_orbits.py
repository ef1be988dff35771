"""Dux's closed form of orbits with one impact, at any clearance: speeds, folds and flips."""

from typing import NamedTuple

import numpy as np

from vibroimpact import Oscillator

TAU = 2.0 * np.pi


class Dux(NamedTuple):
    """Random orbits of one impact in n periods, h = 0, p = f = 1, at any clearance; in closed form.

    Between two impacts the motion is symmetric in time. With x_p = -gamma sin(omega t) it is
    sin(theta) = -(sigma + c V / 2) / gamma, cos(theta) = -rho V / (2 gamma) at the impact.
    """

    omega: np.ndarray
    R: np.ndarray
    n: np.ndarray

    @classmethod
    def random(cls, count):
        rng = np.random.default_rng(1992)
        draws = rng.uniform(0.3, 6.0, count), rng.uniform(0.0, 0.98, count)
        return cls(*draws, rng.integers(1, 5, count))

    @property
    def constants(self):
        """T, gamma, rho and c."""
        T = TAU * self.n / self.omega
        c = (1.0 + self.R) / np.tan(0.5 * T)  # (1 + R) sin T / (1 - cos T)
        return T, 1.0 / (1.0 - self.omega**2), (1.0 - self.R) / self.omega, c

    def speeds(self, sigma):
        """Of both solutions, shape (2, count), orbits where > 0; NaN where there is none."""
        _, gamma, rho, c = self.constants
        with np.errstate(invalid="ignore"):
            root = np.sqrt(gamma**2 * c**2 + (gamma**2 - sigma**2) * rho**2)
        return 2.0 * np.array([-c * sigma - root, -c * sigma + root]) / (c**2 + rho**2)

    def fold(self):
        """The clearance at which both solutions with V > 0 meet."""
        _, gamma, rho, c = self.constants
        return -np.sign(c) * np.abs(gamma) * np.hypot(1.0, c / rho)

    def flip(self):
        """The clearance at which 1 + R^2 - 2 R cos T + (1 + R) (a / V) sin T = 0.

        a = -sin(theta) - sigma = -omega^2 sigma + c V / (2 gamma), so that sigma / V is known.
        """
        T, gamma, rho, c = self.constants
        K = (1.0 + self.R**2 - 2.0 * self.R * np.cos(T)) / ((1.0 + self.R) * np.sin(T))
        ratio = (K + 0.5 * c / gamma) / self.omega**2
        return ratio * np.abs(gamma) / np.hypot(ratio + 0.5 * c, 0.5 * rho)

    def state(self, t, sigma, V):
        """x and v at the time t after the impact."""
        T, gamma, rho, c = self.constants
        sine, cosine = -(sigma + 0.5 * c * V) / gamma, -0.5 * rho * V / gamma
        turn = self.omega * t
        free = -0.5 * (1.0 + self.R) * V / np.sin(0.5 * T)
        x = free * np.cos(t - 0.5 * T) - gamma * (sine * np.cos(turn) + cosine * np.sin(turn))
        rate = cosine * np.cos(turn) - sine * np.sin(turn)
        return x, -free * np.sin(t - 0.5 * T) - gamma * self.omega * rate

    def phase(self, sigma, V):
        """omega t of the impact, in [0, 2 pi)."""
        _, gamma, rho, c = self.constants
        return np.arctan2(-(sigma + 0.5 * c * V) / gamma, -0.5 * rho * V / gamma) % TAU

    def multipliers_at_minus_one(self, sigma, V):
        """1 + trace + det, which is positive up to the flip."""
        T, gamma, _, c = self.constants
        a = 0.5 * c * V / gamma - self.omega**2 * sigma
        kick = (1.0 + self.R) * (a / V) * np.sin(T)
        return 1.0 + self.R**2 - 2.0 * self.R * np.cos(T) + kick

    def oscillator(self, i, sigma):
        return Oscillator(0.0, float(self.R[i]), float(self.omega[i]), 1.0, clearance=float(sigma))
