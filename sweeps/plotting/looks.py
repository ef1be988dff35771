"""Chooses looks and names of classes, attractors, statuses; points as `Cells`, rows `by_look`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
import xarray as xr
from matplotlib.patches import Patch, Rectangle

from sweeps.plotting import style
from sweeps.plotting.labels import Names, as_variable, equation, status_name
from sweeps.text import shown_count
from vibroimpact.points.regimes import NO_CLASS, Label, Regime, rest_of

if TYPE_CHECKING:
    from sweeps.attractor.attractor_table import AttractorRow

#: Name of the classes without a look of their own.
OTHERS = "other m/q"


def look_of(key: style.LookKey, grey: bool = False) -> style.Look:
    """Return the look of a class, or of all other classes, of a regime or a further attractor."""
    look = style.LOOKS.get(key, style.LOOKS[None])[grey]
    return look._replace(dots=style.dot_colour(look.dots))


def patch_named(label: str, **props: Any) -> Patch:
    """Return a patch for a legend, which shows nothing in a panel."""
    return Rectangle((np.nan, np.nan), 0.0, 0.0, label=label, **props)


class Cells(NamedTuple):
    """The points of a picture with the same look, and their name, which may say their share."""

    name: str
    look: style.Look
    where: np.ndarray
    whole: np.ndarray | None = None  # of which the name has the share in place of a % format

    @property
    def share(self) -> float:
        """The share of the whole [%]."""
        assert self.whole is not None
        return 100.0 * float(self.where.sum() / max(1, int(self.whole.sum())))

    @property
    def label(self) -> str:
        """The text of the legend."""
        return self.name if self.whole is None else self.name % self.share

    def within(self, visible: Any) -> Self:
        """Return the cells within limits, given their mask or indices."""
        whole = None if self.whole is None else self.whole[visible]
        return self._replace(where=self.where[visible], whole=whole)

    def handle(self) -> Patch:
        """Return the patch for the legend."""
        edge = style.hatch_on(self.look.colour) if self.look.hatch else style.ink()
        props: dict[str, Any] = {"edgecolor": edge, "hatch": self.look.hatch, "linewidth": 0.4}
        return patch_named(self.label, facecolor=self.look.colour, **props)


def failed_cells(status: np.ndarray, hatched: bool = False) -> list[Cells]:
    """Return the failed points, by outcome; `hatched` beside a scale of greys."""
    return [
        Cells(
            status_name(outcome),
            look if hatched else style.Look.plain(style.STATUS_COLOURS[outcome]),
            status == outcome,
        )
        for outcome, look in style.GREY_FAILED.items()
    ]


def period_cells(
    regimes: np.ndarray, m: np.ndarray, q: np.ndarray, *, grey: bool = False, hatched: bool = True
) -> list[Cells]:
    """Return the points of each of ``CLASSES`` and regime, `hatched` by the period of rest."""
    # Chaotic and unknown motions have their share of the points with a result.
    periodic = regimes == Regime.PERIODIC
    cells = []
    for periods, impacts in style.CLASSES:
        where = periodic & (m == periods) & (q == impacts)
        text = f"{periods}/{impacts}" + (", no impact" if impacts == 0 else "")
        cells.append(Cells(text, look_of((periods, impacts), grey), where))
        periodic = periodic & ~where
    cells.append(Cells(OTHERS, look_of(None, grey), periodic))
    for regime in style.REGIMES:
        where, look = regimes == regime, look_of(regime, grey)
        if regime is Regime.REST:
            cells += _rest_cells(where, m, grey, hatched)
        elif regime in NO_CLASS:
            cells.append(Cells(f"{regime.word} (%.3g %%)", look, where, regimes > Regime.FAILED))
        else:
            cells.append(Cells(regime.word, look, where))
    return cells


def _rest_cells(rest: np.ndarray, m: np.ndarray, grey: bool, hatched: bool) -> list[Cells]:
    """Return the points with `rest`, those of each period of ``RESTS`` apart if `hatched`."""
    look = look_of(Regime.REST, grey)
    if not hatched:
        return [Cells(_name_of_rests(m[rest]), look, rest)]
    groups = {hatch: rest & (m == n) for n, hatch in style.RESTS.items()}
    groups[style.OTHER_RESTS] = rest & ~np.isin(m, [*style.RESTS])
    return [
        Cells(_name_of_rests(m[where]), look._replace(hatch=hatch), where)
        for hatch, where in groups.items()
    ]


def _name_of_rests(m: np.ndarray) -> str:
    """Name motions with rest by their periods; of many, by the most frequent ones."""
    periods, counts = np.unique(m, return_counts=True)
    return rest_of(periods[np.argsort(-counts, kind="stable")].tolist())


def class_numbers(
    regimes: np.ndarray, m: np.ndarray, q: np.ndarray
) -> tuple[np.ndarray, dict[int, str]]:
    """Return a number for the class of each motion, and the names of classes."""
    numbers = m << 40 | q << 8 | regimes
    unique = np.unique(numbers).tolist()
    classes = {n: Label(Regime(n % 256), n >> 40, (n >> 8) % 2**32) for n in unique}
    named = (Regime.PERIODIC, Regime.REST, Regime.UNBOUNDED)
    return numbers, {n: str(label) for n, label in classes.items() if label.regime in named}


class Looks(NamedTuple):
    """The looks of the attractors of a sweep, the same in all pictures of its file.

    The first attractor of a class has the look of the class. Others, and those of classes without a
    look, have a ``further`` one, by number, m and q, as an index in ``FURTHER``; some have none.
    """

    further: Mapping[tuple[int, int, int], int | None]
    grey: bool

    @classmethod
    def of(cls, result: xr.Dataset, grey: bool = False) -> Self:
        """Return the looks of the result of `sweeps.attractors`."""
        periodic = result[["number", "m", "q"]].where(result["motion"] == Regime.PERIODIC, -1)
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

    def look(self, row: AttractorRow) -> style.Look:
        """Return the look of an attractor, or of its regime."""
        if row.regime is not Regime.PERIODIC:
            return look_of(row.regime, self.grey)
        key = row.number, row.m, row.q
        if key not in self.further:
            return look_of((row.m, row.q), self.grey)
        index = self.further[key]
        return look_of(None if index is None else style.FURTHER[index], self.grey)

    def by_look(self, table: Sequence[AttractorRow]) -> list[list[AttractorRow]]:
        """Return the attractors with the same look together, the most frequent ones first."""
        series: dict[style.Look, list[AttractorRow]] = {}
        for row in sorted(table, key=lambda row: (row.number, row.m)):
            series.setdefault(self.look(row), []).append(row)
        return list(series.values())

    def split(self, table: Sequence[AttractorRow]) -> tuple[list[AttractorRow], list[AttractorRow]]:
        """Return the attractors that have a look of their own, and the others."""
        distinct = [row for row in table if self.has_own(row)]
        return distinct, [row for row in table if not self.has_own(row)]


def _further(
    number: np.ndarray, m: np.ndarray, q: np.ndarray
) -> dict[tuple[int, int, int], int | None]:
    """Return a further look for each attractor without that of its class, if any is free."""
    # The arrays have the shape (parameter points, coexisting). No two attractors at one point have
    # the same further look; each takes the one with the fewest points.
    classes = np.stack([number, m, q], axis=-1)[(number >= 0) & (m > 0)]
    nowhere = np.zeros(len(number), bool)
    of_class: dict[tuple[int, int], np.ndarray] = {}
    without: dict[int, np.ndarray] = {}
    keys = []
    for attractor, periods, impacts in np.unique(classes, axis=0).tolist():
        at = ((number == attractor) & (m == periods) & (q == impacts)).any(axis=1)
        points = of_class.get((periods, impacts), nowhere)
        if (periods, impacts) in style.CLASSES and not (points & at).any():
            of_class[periods, impacts] = points | at
        else:
            without[attractor] = without.get(attractor, nowhere) | at
            keys.append((attractor, periods, impacts))
    points_of = [nowhere] * len(style.FURTHER)
    chosen: dict[int, int | None] = {}
    for attractor, at in without.items():
        free = [i for i, points in enumerate(points_of) if not (points & at).any()]
        chosen[attractor] = min(free, key=lambda i: np.count_nonzero(points_of[i]), default=None)
        if (index := chosen[attractor]) is not None:
            points_of[index] = points_of[index] | at
    return {key: chosen[key[0]] for key in keys}


def class_of_numbers(table: Sequence[AttractorRow]) -> dict[int, str]:
    """Return the names of classes by the numbers of attractors."""
    named = (Regime.PERIODIC, Regime.REST)
    return {row.number: row.name for row in table if row.regime in named}


def basin_cells(
    table: Sequence[AttractorRow], numbers: np.ndarray, looks: Looks, source: Names
) -> list[Cells]:
    """Return the cells of each basin, given the number of the attractor of each start."""
    rows, others = looks.split(table)
    cells = []
    for row, (name, location) in zip(rows, names_of([[row] for row in rows], source), strict=True):
        speeds = f"{row.shown_speeds}; " if len(row.speeds) else ""
        text = f"{name}: {speeds}%.1f %%" + location.replace("%", "%%")
        cells.append(Cells(text, looks.look(row), numbers == row.number, numbers >= 0))
    if others:
        text = f"{shown_count(len(others), 'other periodic attractor')}: %.1f %%"
        where = np.isin(numbers, [row.number for row in others])
        cells.append(Cells(text, looks.look(others[0]), where, numbers >= 0))
    return cells


def names_of(
    series: Sequence[Sequence[AttractorRow]], source: Names, axis: xr.DataArray | None = None
) -> list[tuple[str, str]]:
    """Name the classes or the regime of each series, and a state where two have one class."""
    # The state is at the section, for several values of an `axis` with that value.
    counts = Counter(
        name for rows in series for name in {row.name for row in rows if len(row.states)}
    )
    names = list[tuple[str, str]]()
    for rows in series:
        location = ""
        if row := next((row for row in rows if counts[row.name] > 1), None):
            state = zip(("x0", "v0"), ("x", "v"), row.states[0], strict=True)
            parts = [
                equation(symbol, as_variable(name, source), float(f"{value:.3g}"))
                for name, symbol, value in state
            ]
            if axis is not None:
                parts.append(equation(axis.symbol, axis, row.parameters[str(axis.name)]))
            location = f"\nat {', '.join(parts)}"
        names.append((class_names(rows), location))
    return names


def class_names(attractor: Sequence[AttractorRow]) -> str:
    """Name the classes of one attractor over several parameter points, or its regime."""
    from sweeps.attractor.attractor_table import classes_text  # needs the compiler

    free = attractor[0].regime is Regime.PERIODIC and not any(row.q for row in attractor)
    return classes_text(attractor) + (", no impact" if free else "")
