"""Finds the least `Knock` from an attractor to another.

A knock is a sudden change of the velocity alone, in either direction, as caused by a blow. Many
sizes are tried at 64 moments of every forcing period and just after every impact, until no moment
has a smaller harmful size. Then moments ever closer to the worst one are tried. The interval
between the last harmless and the first harmful size is divided until it is 1e-9 of the knock.

A tongue of another basin is found only if one of the tried sizes hits it. At every moment these
sizes are 1/128 of the knock apart, and from 10 % below the knock on 1/660. If a moment has more
than one change between harmless and harmful up to 2 % above the least knock, there are tongues, and
the boundary is called fractal. The knock is then the least of those tried; a tongue that no size
has hit may contain a smaller one.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from contextlib import suppress
from typing import NamedTuple

import numpy as np
import xarray as xr

from sweeps.attractor.attractors import attractors
from sweeps.errors import Refused
from sweeps.opened.doors import takes_sweep
from sweeps.opened.motions import MOTION, ORBIT_TOLERANCE, orbit_of_motion, section_distance
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.store.variables import description_in
from sweeps.text import listed
from vibroimpact import OrbitError, PeriodicOrbit
from vibroimpact.inputs import input_text, refusal
from vibroimpact.points.computation import compute_points
from vibroimpact.points.regimes import Regime, rests
from vibroimpact.points.stages import Results, in_stages, without_class
from vibroimpact.status import Status

#: Number of moments in a forcing period, and of sizes scanned at each.
_MOMENTS, _SIZES = 64, 256
#: Number of times that moments are tried beside the worst one, each time four times as close.
_CLOSER = 7
#: Sizes near a knock at which the boundary is sought, relative to the knock.
_NEAR_SIZES = np.linspace(-0.1, 0.02, 80)
#: Forcing periods for which a motion is continued, one after the other until it has a class, and
#: the last of these that are recorded.
_STAGES, _KNOCK_RECORD = (200, 800, 3200, 12800), 32
#: A motion without a class is beside an orbit if its last sections are within this share of it.
_BESIDE = 1e-2

#: The meaning and the unit of each field of a `Knock`.
_KNOCK_FIELDS = {
    "phase": ("phase of the forcing at the worst moment", "rad"),
    "x": ("displacement at the worst moment", "length"),
    "v": ("velocity at the worst moment", "length/time"),
    "harmless": ("greatest harmless change of velocity", "length/time"),
    "harmful": ("least harmful change of velocity", "length/time"),
    "ends": ("number of the attractor to which it leads, -1: unknown", "1"),
    "certified": ("whether both motions reached an attractor with no impact missed", "1"),
    "fractal": ("whether a smaller knock may be harmful, too", "1"),
}


class Knock(NamedTuple):
    """A change of velocity that takes a motion to another attractor, and a harmless one."""

    phase: float = math.nan
    x: float = math.nan
    v: float = math.nan
    harmless: float = math.nan
    harmful: float = math.inf
    ends: int = -1
    certified: bool = False
    fractal: bool = False


@takes_sweep({})
def knocks(
    starts: OpenedSweep, found: xr.Dataset | None = None, numbers: Collection[int] | None = None
) -> xr.Dataset:
    """Find the least knock that takes each periodic motion at a parameter point to another one.

    Parameters
    ----------
    starts : Dataset
        A cut through an opened sweep at one parameter point, over x0 and v0, with exact impacts.
    found : Dataset, optional
        The result of `sweeps.attractors` or `sweeps.integrity` for it.
    numbers : collection of int, optional
        The attractors whose knocks are sought, by default all.

    Returns
    -------
    Dataset
        `found`, and for each attractor:

        - ``knock_phase``: omega t of the worst moment, in [0, 2 pi m) [rad];
        - ``knock_x``, ``knock_v``: the state of the motion at this moment;
        - ``knock_harmful``, ``knock_harmless``: changes of velocity with their sign, which differ
          by less than 1e-9 of the knock. ``knock_harmful`` is inf if no knock up to the height of
          the window of v0 is harmful, and NaN if the motion is not periodic, or not in `numbers`;
        - ``knock_ends``: the number of the attractor to which the harmful one leads, -1 if unknown;
        - ``knock_certified``: whether both motions reached an attractor with no impact missed;
        - ``knock_fractal``: whether harmless and harmful sizes alternate so closely that a smaller
          knock may be harmful, too.

    Raises
    ------
    Refused
        If the sweep has other parameter axes or another impact rule, or lacks one of `numbers`.

    Examples
    --------
    >>> ds = sweeps.open_sweep("basins.h5")  # of the example of `attractors`
    >>> sweeps.knocks(ds)["knock_harmful"].values.round(4)
    array([-0.3047,  0.2723])
    """
    if starts.spec.impact != "exact":
        raise Refused(f"a knock needs the impact rule exact; the sweep has {starts.spec.impact}")
    if set(starts.grid) != {"x0", "v0"}:
        axes = listed(starts.grid) or "none"
        raise Refused(f"a knock needs x0 and v0 as the only axes, others fixed; there are {axes}")
    found = attractors(starts) if found is None else found
    present = found["number"].values.tolist()
    requested = set(present if numbers is None else numbers)
    if not requested <= set(present):
        out_of = f"numbers out of {listed(str(number) for number in present if number >= 0)}"
        raise Refused(refusal(f"numbers = {input_text(numbers)}", out_of))
    at_point, limit = _Attractors(starts, found), float(np.ptp(starts["v0"].values))
    sought = at_point.orbits.keys() & requested
    rows = [
        at_point.worst(number, limit) if number in sought else Knock(harmful=math.nan)
        for number in present
    ]
    columns = zip(*rows, strict=True)
    return found.assign(
        {
            f"knock_{name}": ("coexisting", list(column), description_in(starts.attrs, *meaning))
            for (name, meaning), column in zip(_KNOCK_FIELDS.items(), columns, strict=True)
        }
    )


class _Attractors:
    """The attractors at a parameter point, and the knocks that lead from one to another."""

    def __init__(self, starts: OpenedSweep, result: xr.Dataset) -> None:
        self._oscillator, self._spec = starts.oscillator, starts.spec
        self._phase, numbers = self._spec.phase, result["number"].values.tolist()
        self._of_regime = dict(zip(result["motion"].values, numbers, strict=True))
        motions = np.zeros(len(numbers), MOTION)
        motions["point"] = self._oscillator.at(self._oscillator.clearance)
        motions["point"]["x0"], motions["point"]["v0"] = result["section_x"], result["section_v"]
        motions["regime"], motions["m"], motions["q"] = result["motion"], result["m"], result["q"]
        self.orbits: dict[int, PeriodicOrbit] = {}
        for number, motion in zip(numbers, motions, strict=True):
            if motion["regime"] == Regime.PERIODIC:
                with suppress(OrbitError):  # too many periods: motions that end there are unknown
                    self.orbits[number] = orbit_of_motion(motion, self._phase)
        self._cycles = {i: orbit.sections(self._phase) for i, orbit in self.orbits.items()}

    def _destinations(self, phase: float, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the attractors, or -1, that states (n, 2) lead to, and which are certified."""
        points = np.repeat(self._oscillator.at(self._oscillator.clearance, 0.0, phase), len(states))
        points["x0"], points["v0"] = states.T
        number, certified = np.full(len(states), -1), np.ones(len(states), bool)

        def run(points: np.ndarray, periods: int) -> Results:
            record = self._spec.stage(periods - _KNOCK_RECORD, _KNOCK_RECORD, 0, False)
            return compute_points(record, points, None)

        def goes_on(rows: np.ndarray, _: int, results: Results) -> np.ndarray:
            rest = rests(results)
            endless = without_class(results["class_evidence"], results["status"]) & ~rest
            certified[rows] &= results["status"] == Status.CERTIFIED
            number[rows] = np.where(endless, self._of_regime.get(Regime.CHAOTIC, -1), -1)
            for attractor, orbit in self.orbits.items():
                fits = (results["period"] == orbit.m) & (results["period_impacts"] == orbit.q)
                of_class = self._near(attractor, results, "orbit", fits, ORBIT_TOLERANCE)
                # Without a class a motion is taken for chaos, unless it lingers beside an orbit
                # that has just flipped, and therefore beside the orbit of twice the period.
                lingering = self._near(attractor, results, "poincare", endless, _BESIDE)
                number[rows[of_class]] = number[rows[lingering]] = attractor
            number[rows[rest]] = self._of_regime.get(Regime.REST, -1)
            return endless

        in_stages(points, np.cumsum(_STAGES), self._phase, run, goes_on)
        return number, certified

    def _near(
        self, attractor: int, results: Results, states: str, among: np.ndarray, share: float
    ) -> np.ndarray:
        """Return which motions `among` some have all states within a share of an orbit's size."""
        o, cycle, rows = self._oscillator, self._cycles[attractor], np.flatnonzero(among)
        size = share * np.abs((cycle - [o.clearance, 0.0]) / [1.0, o.omega]).max()
        x, v = (results[f"{states}_{name}"].reshape(len(among), -1).T for name in "xv")
        for section in np.stack([x, v], axis=2):
            if not rows.size:
                break
            apart = section_distance(section[rows, None], cycle, o.clearance, o.R, (1.0, o.omega))
            rows = rows[apart.min(axis=1) <= size]
        return rows

    def _try(self, home: int, phase: float, states: np.ndarray, changes: np.ndarray) -> Knock:
        """Return the knock of the first harmful size, or one of infinite size if none is harmful.

        `states`, shape (n, 2), are the motion at this phase in successive forcing periods. Each row
        of `changes`, shape (k, sizes), has changes of velocity that start with a harmless one.
        """
        knocked = states[:, None, None] + np.stack([np.zeros_like(changes), changes], axis=2)
        destinations = self._destinations(phase % math.tau, knocked.reshape(-1, 2))
        number, certified = (values.reshape(knocked.shape[:3]) for values in destinations)
        harmful = number != home
        harmful[:, :, 0] = False  # known; at a fractal boundary, rounding could change it
        if not harmful.any():
            return Knock()
        size = int(harmful.any(axis=(0, 1)).argmax())
        turn, row = np.argwhere(harmful[:, :, size])[0]
        (x, v), (low, high) = states[turn], changes[row, size - 1 : size + 1]
        to, fractal = number[turn, row, size], np.count_nonzero(np.diff(harmful[turn, row])) > 1
        certain = number[turn, row, size - 1] == home and to >= 0
        certain &= certified[turn, row, size - 1 : size + 1].all()
        return Knock(phase + math.tau * turn, x, v, low, high, to, bool(certain), bool(fractal))

    def _scan(self, home: int, phase: float, sizes: np.ndarray) -> Knock:
        """Return the least harmful knock at a phase, out of sizes that increase from 0."""
        phase %= math.tau
        states = self.orbits[home].sections(phase)
        return self._try(home, phase, states, np.stack([sizes, -sizes]))

    def _narrow(self, home: int, knock: Knock, share: float) -> Knock:
        """Divide the interval of a knock until its length is at most this share of the knock."""
        while abs(knock.harmful - knock.harmless) > share * _knock_size(knock) < math.inf:
            sizes = np.linspace(knock.harmless, knock.harmful, 17)
            state = np.array([[knock.x, knock.v]])
            first = self._try(home, knock.phase, state, sizes[None])
            if math.isinf(first.harmful):
                break
            knock = first._replace(fractal=first.fractal or knock.fractal)
        return knock

    def _search(self, home: int, phase: float, near: float, zoom: float = 1.0) -> Knock:
        """Return the least harmful knock at a phase, to 1e-7 of it, or one of infinite size.

        It is sought near the size `near`, the more closely the larger the `zoom`.
        """
        sizes = near * np.array([0.0, *(1.0 + _NEAR_SIZES / zoom)])
        return self._narrow(home, self._scan(home, phase, sizes), 1e-7)

    def worst(self, home: int, limit: float) -> Knock:
        """Return the least harmful knock up to a limit, over all moments."""
        width, before = math.tau / _MOMENTS, math.inf
        after_impacts = (self.orbits[home].phases + 1e-12) % math.tau
        moments = np.sort([*(width * np.arange(_MOMENTS)), *after_impacts]).tolist()
        while limit < 0.5 * before:
            before = limit
            for phase in moments:
                sizes = limit * np.arange(_SIZES + 1) / _SIZES
                limit = min(limit, _knock_size(self._scan(home, phase, sizes)))
        everywhere = [self._search(home, phase, limit) for phase in moments]
        sizes = np.array([_knock_size(knock) for knock in everywhere])
        lowest = np.isfinite(sizes) & (sizes <= np.minimum(np.roll(sizes, 1), np.roll(sizes, -1)))
        best = Knock()
        for knock in (everywhere[i] for i in np.flatnonzero(lowest)):
            for zoom in 2.0 ** np.arange(_CLOSER):
                near = (knock.phase + width / zoom**2 * np.linspace(-1.0, 1.0, 9)).tolist()
                tried = (self._search(home, phase, _knock_size(knock), zoom) for phase in near)
                knock = min(knock, *tried, key=_knock_size)
            best = min(best, knock, key=_knock_size)
        best = self._narrow(home, best, 1e-9)
        return best._replace(fractal=best.fractal or any(knock.fractal for knock in everywhere))


def _knock_size(knock: Knock) -> float:
    return abs(knock.harmful)
