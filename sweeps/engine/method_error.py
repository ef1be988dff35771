"""The exact motion of a sample of points, and the error of a method against it.

The error of a point is the largest of |x - x_exact| / X and |v - v_exact| / V at its sections, with
X and V the largest |x| and |v| of the exact sections: so it does not change with f, which scales
the motion. Three sections per forcing period are compared, the recorded phase among them, since a
mass at rest at one of them has forgotten every error. States before and after an impact are
compared through the impact (`vibroimpact.orbits.cycles.section_distance`).

Where the motion is chaotic, or grazes, two exact runs part. So each point is run twice, from starts
``START_OFFSET`` apart, and compared only until these are ``MAX_AMPLIFICATION`` times as far apart.
An error that takes more than ``PERIODS`` to build up, at almost no damping, is not seen whole.
"""

from __future__ import annotations

import math

import numpy as np

from sweeps.config.sweep import SweepConfig
from sweeps.engine.background import check_given_up, interrupt
from vibroimpact import integrate
from vibroimpact.orbits.cycles import section_distance

#: Forcing periods that the points are followed for, at the most, and sections in each.
PERIODS, SECTIONS = 60, 3
#: How far apart the two starts of a point are, as a share of the greatest displacement.
START_OFFSET = 1e-9
#: Sections are compared until the distance of the two runs has grown by this factor.
MAX_AMPLIFICATION = 1e3
#: Distances of the two runs below this are rounding.
ROUNDING = 1e-13

#: Integrator and impact rule of the exact engine.
EXACT_METHOD = ("exact", "exact")


class ExactSample:
    """The exact motion of some points of a sweep, and which of its sections can be compared.

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
        Sections before the two runs of the point have parted.
    """

    def __init__(self, config: SweepConfig, points: np.ndarray, threads: int | None = None) -> None:
        self.config = config
        self.points = points
        self._threads = threads
        record = config.record
        self._periods = min(PERIODS, record.transient + record.periods)
        self._sections, self.impacts = self._run(self.points, EXACT_METHOD, config.steps)
        self._scale = np.nanmax(np.abs(self._sections), axis=(1, 2), keepdims=True, initial=0.0)
        self._scale[self._scale == 0.0] = 1.0  # it never moves
        neighbours = self.points.copy()
        neighbours["x0"] -= START_OFFSET * self._scale[:, 0, 0, 0]
        apart = self._distance(self._run(neighbours, EXACT_METHOD, config.steps)[0])
        apart = np.maximum(apart, ROUNDING).reshape(self.points.size, -1)
        nearest = np.minimum.accumulate(apart, axis=1)
        judged = np.logical_and.accumulate(apart < MAX_AMPLIFICATION * nearest, axis=1)
        self.judged = judged.reshape(self._sections.shape[:3])

    def summary(self) -> dict[str, object]:
        """Return the size of the sample, and the share of its sections that can be compared."""
        return {
            "points": self.points.size,
            "periods": self._periods,
            "judged": round(float(self.judged.mean()), 3),
        }

    def errors(self, method: tuple[str, str], steps: int) -> tuple[np.ndarray, float]:
        """Run a method and compare it with the exact motion.

        Parameters
        ----------
        method : tuple of str
            Integrator and impact rule.
        steps : int
            Steps per forcing period.

        Returns
        -------
        errors : ndarray, shape (n,)
            Largest error of every point; inf where the method fails.
        impacts : float
            Mean impacts per forcing period.
        """
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
                interrupt=interrupt(),
            )
            check_given_up()
            sections.append(np.stack([results["poincare_x"], results["poincare_v"]], axis=-1))
            impacts += float(np.nan_to_num(results["impacts_per_period"]).mean()) / SECTIONS
        return np.stack(sections, axis=2), impacts

    def _distance(self, sections: np.ndarray) -> np.ndarray:
        """Return the error of every section; inf where there is none."""
        clearance, R = (self.points[name][:, None, None] for name in ("clearance", "R"))
        with np.errstate(all="ignore"):
            apart = section_distance(sections, self._sections, clearance, R, self._scale)
        return np.where(np.isfinite(apart), apart, np.inf)
