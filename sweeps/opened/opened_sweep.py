"""`OpenedSweep`: data, configuration, names, motions; the cut of a `Selection`."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import xarray as xr

from sweeps.config.groups import DIAGNOSTICS, STARTS
from sweeps.config.loading import parse_config
from sweeps.config.rig import Nomenclature
from sweeps.config.sweep import SweepConfig
from sweeps.errors import Refused
from sweeps.grid import TABLE
from sweeps.store.variables import COLUMN_NAMES, DIRECTION, VARIABLES
from sweeps.text import choice_of, listed, near_misses, shown_count, suggestion, told_apart
from vibroimpact.oscillator import PARAMETERS, POINT, Oscillator, oscillator_of
from vibroimpact.points.regimes import (
    OF_REGIMES,
    Label,
    impacts_met,
    labels_of,
    on_its_way,
    regimes_of,
    repetitions,
    shown_in_part,
)
from vibroimpact.points.stages import RunSpec

#: Axes along which only the start or the past differs, not the oscillator.
START_AXES = (*STARTS, DIRECTION)
#: Where a sweep is cut: a value for each swept axis, and a name for ``direction``.
Selection = Mapping[str, float | str]


@dataclass(frozen=True, eq=False)
class OpenedSweep:
    """A sweep that was opened, or a cut through one. What is computed of it is computed once."""

    data: xr.Dataset
    source: OpenedSweep | None = None  # of which this is a cut, or which it shows in SI units
    in_rig: bool = False  # whether the axes, names and units are those of a rig

    def __getitem__(self, name: str) -> xr.DataArray:
        self.check(name)
        return self.data[name]

    def __contains__(self, name: object) -> bool:
        return name in self.data

    @property
    def whole(self) -> OpenedSweep:
        """The sweep as the file holds it, not a cut, and with the names of the model."""
        return self if self.source is None else self.source.whole

    @property
    def sizes(self) -> Mapping[Any, int]:
        """The lengths of all dimensions."""
        return self.data.sizes

    @property
    def attrs(self) -> dict[str, Any]:
        """The attributes of the file."""
        return self.data.attrs

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the grid of points."""
        return self.data["status"].shape

    @property
    def grid(self) -> tuple[str, ...]:
        """The dimensions of the grid of points, with ``direction``, in the order of the file."""
        return tuple(map(str, self.data["status"].dims))

    @property
    def axes(self) -> tuple[str, ...]:
        """The swept axes, in the order of the file."""
        return tuple(name for name in self.grid if name != DIRECTION)

    @property
    def directions(self) -> tuple[str, ...]:
        """The directions of a sweep that was followed both ways; otherwise none."""
        return tuple(self.data[DIRECTION].values) if DIRECTION in self.grid else ()

    @property
    def followed_directions(self) -> tuple[str, ...]:
        """The directions in which the motions were followed; refuses a cut that lost its own."""
        if DIRECTION in self.data.coords:
            return tuple(np.atleast_1d(self.data[DIRECTION].values))
        if len(self.spec.directions) > 1:
            raise Refused("the Dataset has no coordinate direction: cut it without drop")
        return self.spec.directions

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """The columns of a sweep over a table; empty for a grid."""
        names = str(self.attrs.get(COLUMN_NAMES, "")).split()
        return {name: np.atleast_1d(self.data[name].values) for name in names if name in self}

    @property
    def oscillator(self) -> Oscillator:
        """The oscillator of a single point."""
        return oscillator_of(self.data)

    @cached_property
    def config(self) -> SweepConfig:
        """The configuration; ConfigError if it is not valid, since another version wrote it."""
        if self.source is not None:
            return self.whole.config
        text = self.attrs["configuration"]
        return parse_config(text, "its configuration", "sweep", table=self.columns)

    @property
    def spec(self) -> RunSpec:
        """What was computed of every point."""
        return self.config.sweep.spec

    @property
    def nomenclature(self) -> Nomenclature:
        """The names, units and numbers of the axes."""
        nomenclature = self.config.nomenclature
        return nomenclature if self.in_rig else replace(nomenclature, rig=None)

    @property
    def followed_symbol(self) -> str:
        """The symbol of the axis along which motions were followed; empty if they were not."""
        axis = self.spec.followed
        return "" if axis is None else self.config.nomenclature.about(axis).symbol

    def values(self, names: Iterable[str], optional: Iterable[str] = ()) -> dict[str, np.ndarray]:
        """Return parameters, swept or not, and results at every point, `optional` ones if there.

        The arrays have the shape of the grid, followed by that of a record.
        """
        points = self.data["status"].sizes
        names = (*names, *(name for name in optional if name in self))
        raw = {name: self[name].variable for name in names}
        return {name: each.set_dims({**points, **each.sizes}).values for name, each in raw.items()}

    @cached_property
    def points(self) -> np.ndarray:
        """The points, of dtype POINT, in C order."""
        points = np.empty(self.data["status"].size, POINT)
        for name, values in self.values(PARAMETERS).items():
            points[name] = values.ravel()
        points.flags.writeable = False
        return points

    # The motion of every point

    @cached_property
    def regimes(self) -> np.ndarray:
        """The `Regime` at every point of a sweep with ``period``."""
        values = self.values((*OF_REGIMES, "omega"), ["lyapunov"])
        return regimes_of(values, values["omega"], self.spec.periods)

    @property
    def transients(self) -> np.ndarray:
        """How many forcing periods every point had before the first section that is held."""
        first = int(self["section"][0]) if "section" in self else 1
        counts = self["transient"].values if self.spec.longest is not None else np.zeros(self.shape)
        return counts.astype(int) + first - 1

    @property
    def on_its_way(self) -> np.ndarray:
        """The mask of the points whose motion is on its way to its orbit."""
        if "orbit_distance" not in self:
            return np.zeros(self.shape, bool)
        return on_its_way(self.regimes, *self.values(["orbit_distance"]).values())

    @property
    def classes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Regime, m and q at every point, as `repetitions`."""
        results = self.values(("period", "period_impacts"))
        return self.regimes, *repetitions(self.regimes, *results.values())

    @property
    def labels(self) -> list[Label | None]:
        """The class at every point, in C order; None if it is not known, or without ``period``."""
        if "period" not in self:
            return [None] * self["status"].size
        results = self.values(("period", "period_impacts", "R"))
        return labels_of(*map(np.ravel, (self.regimes, *results.values())))

    @property
    def shows_part(self) -> np.ndarray:
        """The mask of the points of which less than a repetition of impacts was kept."""
        results = self.values(["impacts_per_period"], ["period", "period_impacts"])
        return shown_in_part(results, self.spec.periods, self.sizes["impact"])

    def left_out(self, record: str) -> str:
        """Return how many sections or impacts are held of how many, in words; empty if all are."""
        width, most, which = self.sizes[record], self.spec.periods, ""
        if record == "impact":
            most = int(impacts_met(self["impacts_per_period"].values, most).max(initial=0))
            which = "last " if width == self.spec.impacts else ""  # and not a cut
        several = "up to " if record == "impact" and self["status"].size > 1 else ""
        return f"{which}{width:,} of {several}{shown_count(most, record)}" if most > width else ""

    @property
    def recorded_motions(self) -> dict[str, np.ndarray]:
        """The results from which the motions are made."""
        from vibroimpact.points.computation import RECORD

        classes = (*OF_REGIMES, "period_impacts", "orbit_x", "orbit_v")
        return self.values(classes if "period" in self else RECORD, ["lyapunov"])

    @cached_property
    def motions(self) -> np.ndarray:
        """The motion of every point, of dtype ``MOTION``, in the shape of the grid."""
        from sweeps.opened.motions import motions_from  # with the compiler

        results = {
            name: values.reshape(len(self.points), *values.shape[len(self.shape) :])
            for name, values in self.recorded_motions.items()
        }
        return motions_from(self.spec, self.points, results).reshape(self.shape)

    # Cuts

    def with_data(self, data: xr.Dataset) -> Self:
        """Return this sweep with other data: a part of them, another order, further variables."""
        return replace(self, data=data, source=self)

    def isel(self, indices: Mapping[Any, Any]) -> Self:
        """Return the points at these indices, each of one dimension on its own: not pointwise."""
        data = self.data
        for name, index in indices.items():  # all at once, xarray fails after a transposition
            data = data.isel({name: index})
        return self.with_data(data)

    def sortby(self, axes: str | list[str]) -> Self:
        """Return the points with increasing values along axes."""
        return self.with_data(self.data.sortby(axes))

    def transpose(self, *dims: str) -> Self:
        """Return the sweep with its dimensions in this order."""
        return self.with_data(self.data.transpose(*dims, ...))

    @property
    def each_direction(self) -> list[Self]:
        """The sweep once for each direction in which it was followed, or the sweep itself."""
        return [self.isel({DIRECTION: i}) for i in range(len(self.directions))] or [self]

    def indices(self, at: Selection, free: Collection[str] = ()) -> dict[str, int]:
        """Return the index of the grid value nearest to each value of `at`, and of its direction.

        Refuses names that are no swept axis, or are in `free`, and values outside their axis.
        """
        axes = [name for name in self.axes if name not in free]
        indices = dict[str, int]()
        for name, value in at.items():
            if name == DIRECTION and name not in free:
                indices[name] = self._index_of_direction(str(value))
                continue
            if name not in axes:
                meant = suggestion(near_misses(name, self.axes))
                why = ": all its values are used" if name in self.grid else meant
                raise Refused(f"{name} cannot be fixed here{why}; {choice_of(axes)}")
            if isinstance(value, str):
                raise Refused(f"{name} = {value} is not a number")
            values = self.data[name].values
            low, high = float(values.min()), float(values.max())
            if not low - self.slack(name) <= value <= high + self.slack(name):
                text, first, last = told_apart(value, low, high)
                raise Refused(f"{name} = {text} is outside the sweep: {first} to {last}")
            indices[name] = int(np.argmin(np.abs(values - value)))
        return indices

    def slack(self, axis: str) -> float:
        """Return how far a typed value may be from one of an axis: 0.3 from 0.1 * 3."""
        return 1e-9 * float(np.abs(self.data[axis].values).max())

    def _index_of_direction(self, name: str) -> int:
        """Return the index of a direction of the sweep; refuse any other name."""
        valid = self.directions
        if not valid:
            raise Refused("direction cannot be fixed here; the sweep was not followed in both")
        if name not in valid:
            meant = suggestion(near_misses(name, valid))
            raise Refused(f"there is no direction {name}{meant}; choose from: {listed(valid)}")
        return valid.index(name)

    def cut(self, at: Selection | None, free: Collection[str] = ()) -> Self:
        """Fix each axis that is not in `free` at the grid value nearest to `at`, or at its first.

        ``direction`` is an axis, too; `at` may fix it also if it is in `free`.
        """
        first = {name: 0 for name in self.grid if name not in free}
        return self.isel(first | self.indices(at or {}, {*free} - {DIRECTION}))

    def at_values(self, at: Mapping[str, Sequence[float | str]]) -> Self:
        """Return the points at the grid values nearest to several values of axes."""
        chosen = dict[str, list[int]]()
        for name, values in at.items():
            indices = {self.indices({name: value})[name] for value in values}
            if len(indices) < len(values):
                typed = listed([f"{value:.12g}" for value in values])
                raise Refused(f"{name} = {typed}: two of these have the same nearest grid value")
            chosen[name] = sorted(indices)
        return self.isel(chosen)

    def chosen_axes(
        self, requested: Sequence[str], at: Selection | None, count: int, kind: str
    ) -> list[str]:
        """Return the `count` swept axes that a picture shows, or refuse the request.

        By default they are the longest ones that `at` does not fix, and of equally long axes the
        first.
        """
        axes = self.axes
        if TABLE in axes:
            raise Refused(
                f"a {kind} needs a swept axis, and the points of this file are the rows of a table"
            )
        if not axes:
            raise Refused(f"the file holds a single point: a {kind} needs a swept axis")
        for name in requested:
            if not isinstance(name, str):
                raise Refused(f"a {kind} needs names of swept axes; the file has {listed(axes)}")
            if name not in axes:
                meant = suggestion(near_misses(name, axes))
                if (called := self.config.nomenclature.name(name)) != name and called in axes:
                    meant = f" (it is called {called} here)"
                raise Refused(
                    f"{name or repr(name)} is not a swept axis{meant}; the file has {listed(axes)}"
                )
        needed = f"a {kind} has {count} swept {'axis' if count == 1 else 'axes'}"
        if len(axes) < count:
            raise Refused(f"{needed}; the file has only {listed(axes)}")
        longest = sorted(axes, key=lambda name: (name in (at or {}), -self.sizes[name]))
        chosen = [*dict.fromkeys(requested), *(name for name in longest if name not in requested)]
        if len(requested) > count or len(set(requested)) < len(requested):
            raise Refused(f"{needed}, not {listed(requested)}")
        return chosen[:count]

    def map_axes(self, axes: Sequence[str], at: Selection | None) -> list[str]:
        """Return abscissa and ordinate, by default the longest axes; if equal, the later first."""
        chosen = self.chosen_axes(axes, at, 2, "map")
        if not axes and self.sizes[chosen[0]] == self.sizes[chosen[1]]:
            chosen.reverse()
        return chosen

    # What is recorded

    def check(self, *names: str, derived: str = "") -> None:
        """Refuse a file without variables, of which `derived` may be made; say how to have them."""
        for name in (name for name in names if name in VARIABLES and name not in self):
            follows = f"{derived} follows from {name}, and " if derived not in ("", name) else ""
            raise Refused(f"{follows}the file has no {name}: {self.to_have(name)}")

    def to_have(self, name: str) -> str:
        """Return how a sweep is run so that its file has a variable."""
        diagnostic, dimension = VARIABLES[name].diagnostic, VARIABLES[name].dimension
        key = _KEYS.get(diagnostic) or _KEYS.get(dimension)
        if diagnostic in DIAGNOSTICS:
            kinds = {VARIABLES[str(each)].diagnostic for each in self.data if each in VARIABLES}
            chosen = [each for each in DIAGNOSTICS if each in kinds | {diagnostic}]
            key = f"diagnostics: [{', '.join(chosen)}]"
        again = "run the sweep again"
        return f"{again} with record.{key}" if key else f"take its whole Dataset, or {again}"


#: The key of ``record`` without which a file lacks variables, by their diagnostic or dimension.
_KEYS: Mapping[str | None, str] = {
    "longest": "transient: auto",
    "impact": "impacts: 64",
    "sample": "trajectory: {every: 1}",
}
