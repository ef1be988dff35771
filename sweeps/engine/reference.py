"""The exact motion of some points of a sweep, and the error of a method against it.

The error of a point is the largest of |x - x_exact| / X and |v - v_exact| / V at its sections, with
X and V the largest |x| and |v| of the exact sections: so it does not change with f, which scales
the motion. Three sections per forcing period are compared, the recorded phase among them, since a
mass at rest at one of them has forgotten every error.

A state just before an impact is near one just after it: they are as far apart as both are from the
impact (Biemond, van de Wouw, Heemels & Nijmeijer 2013, IEEE Trans. Autom. Control 58, 876-890).

Where the motion is chaotic, or grazes, two exact runs part: a section is judged as long as a
neighbouring start was amplified less than ``MOST_GROWTH`` times; what follows no method computes.
An error that takes more than ``PERIODS`` to build up, at almost no damping, is not seen whole.
"""

from __future__ import annotations

import math

import numpy as np

from sweeps.config.sweep import SweepConfig
from vibroimpact.integrate import integrate

#: Forcing periods that the points are followed for, at the most, and sections in each.
PERIODS, SECTIONS = 60, 3
#: Neighbouring starts that part by more than this are not judged any further, from this distance.
MOST_GROWTH, APART, ROUNDING = 1e3, 1e-9, 1e-13

#: Integrator and impact rule of the exact engine.
EXACT = ("exact", "exact")


class Reference:
    """The exact motion of some points of a sweep, and what of it can be compared.

    Parameters
    ----------
    config : SweepConfig
    points : ndarray of dtype ``POINT``, shape (n,)
    threads : int, optional

    Attributes
    ----------
    impacts : float
        Mean impacts per forcing period.
    judged : ndarray of bool, shape (n, periods, SECTIONS)
        Sections up to the one where neighbours have parted.
    """

    def __init__(self, config: SweepConfig, points: np.ndarray, threads: int | None = None) -> None:
        self.config = config
        self.points = points
        self._threads = threads
        record = config.record
        self._periods = min(PERIODS, record.transient + record.periods)
        self._sections, self.impacts = self._run(self.points, EXACT, config.steps)
        self._scale = np.nanmax(np.abs(self._sections), axis=(1, 2), keepdims=True, initial=0.0)
        self._scale[self._scale == 0.0] = 1.0  # it never moves
        neighbours = self.points.copy()
        neighbours["x0"] -= APART * self._scale[:, 0, 0, 0]
        apart = self._distance(self._run(neighbours, EXACT, config.steps)[0])
        apart = np.maximum(apart, ROUNDING).reshape(self.points.size, -1)
        nearest = np.minimum.accumulate(apart, axis=1)
        judged = np.logical_and.accumulate(apart < MOST_GROWTH * nearest, axis=1)
        self.judged = judged.reshape(self._sections.shape[:3])

    @property
    def any_judged(self) -> bool:
        """Whether there is anything to compare."""
        return bool(self.judged.any())

    def about(self) -> dict[str, object]:
        """Describe the sample, and the share of its sections that is judged."""
        return {
            "points": self.points.size,
            "periods": self._periods,
            "judged": round(float(self.judged.mean()), 3),
        }

    def errors(self, method: tuple[str, str], steps: int) -> tuple[np.ndarray, float]:
        """Run a method: the error of every point, and the mean impacts per period."""
        sections, impacts = self._run(self.points, method, steps)
        errors = np.max(self._distance(sections), axis=(1, 2), where=self.judged, initial=0.0)
        return errors, impacts

    def _run(
        self, points: np.ndarray, method: tuple[str, str], steps: int
    ) -> tuple[np.ndarray, float]:
        """Return sections, shape (n, periods, SECTIONS, 2), and the mean impacts per period."""
        sections, impacts = [], 0.0
        for k in range(SECTIONS):
            results = integrate(
                points,
                integrator=method[0],
                impact=method[1],
                steps_per_period=steps,
                transient=0,
                periods=self._periods,
                phase=(self.config.record.phase + 2.0 * math.pi * k / SECTIONS) % (2.0 * math.pi),
                impacts=0,
                threads=self._threads,
            )
            sections.append(np.stack([results["poincare_x"], results["poincare_v"]], axis=-1))
            impacts += float(np.nan_to_num(results["impacts_per_period"]).mean()) / SECTIONS
        return np.stack(sections, axis=2), impacts

    def _distance(self, sections: np.ndarray) -> np.ndarray:
        """Return the error of every section; inf where there is none."""
        R = self.points["R"][:, None, None]
        stop = self.points["clearance"][:, None, None]
        (x, v), (x_0, v_0) = np.moveaxis(sections, -1, 0), np.moveaxis(self._sections, -1, 0)
        X, V = np.moveaxis(self._scale, -1, 0)
        with np.errstate(all="ignore"):
            direct = np.maximum(np.abs(x - x_0) / X, np.abs(v - v_0) / V)
            to_stop = np.maximum(np.abs(x - stop), np.abs(x_0 - stop)) / X
            rebound = np.abs(np.minimum(v, v_0) + R * np.maximum(v, v_0)) / V
            apart = np.minimum(direct, np.maximum(to_stop, rebound))
        return np.where(np.isfinite(apart), apart, np.inf)
