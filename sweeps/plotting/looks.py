"""The looks of classes, of regimes, and of attractors: of their class, or one of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Self

import numpy as np
import xarray as xr

from sweeps.attractor.attractor_table import AttractorRow
from sweeps.plotting.style import (
    CLASSES,
    FURTHER,
    GREY_CLASSES,
    GREY_FURTHER,
    GREY_OTHER,
    GREY_REGIMES,
    OTHER_CLASS,
    OTHER_RESTS,
    REGIMES,
    RESTS,
    Look,
)
from vibroimpact.points.regimes import Regime


def look_of_class(m: int, q: int, grey: bool = False) -> Look:
    """Return the look of a class, or of all other classes."""
    if grey:
        return GREY_CLASSES.get((m, q), GREY_OTHER).on_ground()
    colour = CLASSES.get((m, q), OTHER_CLASS)
    return Look(colour, colour).on_ground()


def look_of_regime(regime: Regime, grey: bool = False) -> Look:
    """Return the look of a regime other than periodic."""
    look = GREY_REGIMES[regime] if grey else Look(REGIMES[regime], REGIMES[regime])
    return look.on_ground()


def look_of_rest(m: int, grey: bool = False) -> Look:
    """Return the look of motions with rest that repeat after m periods; 0: not known to repeat."""
    return look_of_regime(Regime.REST, grey)._replace(hatch=RESTS.get(m, OTHER_RESTS))


class Looks(NamedTuple):
    """The looks of the attractors of a sweep, the same in all pictures of its file.

    The first attractor of a class has the look of the class. Others, and those of classes without a
    look, have a ``further`` one, by number, m and q, as an index in ``FURTHER``; some have none.
    """

    further: Mapping[tuple[int, int, int], int | None]
    grey: bool

    @classmethod
    def of(cls, found: xr.Dataset, grey: bool = False) -> Self:
        """Return the looks of the result of `sweeps.attractors`."""
        periodic = found[["number", "m", "q"]].where(found["motion"] == Regime.PERIODIC, -1)
        columns = (periodic[name].transpose(..., "coexisting").values for name in periodic)
        return cls(_further(*(column.reshape(-1, column.shape[-1]) for column in columns)), grey)

    @classmethod
    def of_rows(cls, table: Sequence[AttractorRow]) -> Self:
        """Return the looks of attractors at one parameter point."""
        orbits = [row for row in table if row.regime is Regime.PERIODIC]
        columns = ([[getattr(row, name) for row in orbits]] for name in ("number", "m", "q"))
        return cls(_further(*map(np.array, columns)), grey=False)

    def has_own(self, row: AttractorRow) -> bool:
        """Whether an attractor has a look that it shares with none beside it."""
        return self.further.get((row.number, row.m, row.q), 0) is not None

    def look(self, row: AttractorRow) -> Look:
        """Return the look of an attractor, or of its regime."""
        if row.regime is not Regime.PERIODIC:
            return look_of_regime(row.regime, self.grey)
        key = row.number, row.m, row.q
        if key not in self.further:
            return look_of_class(row.m, row.q, self.grey)
        index = self.further[key]
        if index is None:
            return look_of_class(0, 0, self.grey)
        look = GREY_FURTHER[index] if self.grey else Look(FURTHER[index], FURTHER[index])
        return look.on_ground()

    def series(self, table: Sequence[AttractorRow]) -> list[list[int]]:
        """Return the places of the attractors with the same look, the most frequent ones first."""
        places: dict[Look, list[int]] = {}
        for i in sorted(range(len(table)), key=lambda i: (table[i].number, table[i].m)):
            places.setdefault(self.look(table[i]), []).append(i)
        return list(places.values())

    def split(self, table: Sequence[AttractorRow]) -> tuple[list[AttractorRow], list[AttractorRow]]:
        """Return the attractors that have a look of their own, and the others."""
        return [row for row in table if self.has_own(row)], [
            row for row in table if not self.has_own(row)
        ]


def _further(
    number: np.ndarray, m: np.ndarray, q: np.ndarray
) -> dict[tuple[int, int, int], int | None]:
    """Return the index of a further look for each attractor and class without the look of a class.

    The arrays have the shape (parameter points, coexisting). No two attractors at one point have
    the same further look; each takes the one with the fewest points.
    """
    classes = np.stack([number, m, q], axis=-1)[(number >= 0) & (m > 0)]
    nowhere = np.zeros(len(number), bool)
    of_class: dict[tuple[int, int], np.ndarray] = {}
    without: dict[int, np.ndarray] = {}
    keys = []
    for own, periods, impacts in np.unique(classes, axis=0).tolist():
        at = ((number == own) & (m == periods) & (q == impacts)).any(axis=1)
        taken = of_class.get((periods, impacts), nowhere)
        if (periods, impacts) in CLASSES and not (taken & at).any():
            of_class[periods, impacts] = taken | at
        else:
            without[own] = without.get(own, nowhere) | at
            keys.append((own, periods, impacts))
    used = [nowhere] * len(FURTHER)
    chosen: dict[int, int | None] = {}
    for own, at in without.items():
        free = [i for i, taken in enumerate(used) if not (taken & at).any()]
        chosen[own] = min(free, key=lambda i: np.count_nonzero(used[i]), default=None)
        if (index := chosen[own]) is not None:
            used[index] = used[index] | at
    return {key: chosen[key[0]] for key in keys}
