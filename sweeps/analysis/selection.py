"""Selecting data of a sweep for a picture or a table: its configuration, cuts and coordinates."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import fields
from functools import lru_cache
from typing import TYPE_CHECKING, NoReturn

import numpy as np
import xarray as xr

from sweeps.config.groups import DIAGNOSTICS
from sweeps.config.loading import stored_config
from sweeps.config.rig import si_name
from sweeps.config.sweep import SweepConfig
from sweeps.errors import Refused
from sweeps.grid import TABLE
from sweeps.store.variables import DIRECTION, VARIABLES, Variable, columns_of
from sweeps.text import in_units, nearest, suggestion, told_apart, unit_name
from vibroimpact.oscillator import Oscillator
from vibroimpact.status import Status

if TYPE_CHECKING:
    from vibroimpact.orbits.orbit import PeriodicOrbit

#: Where a sweep is cut: a value for each swept axis, and a name for ``direction``.
Selection = Mapping[str, float | str]


def dataset_of(
    config: SweepConfig, axes: Mapping[str, np.ndarray], results: Mapping[str, np.ndarray]
) -> xr.Dataset:
    """Return results in memory as a Dataset like an opened file, so that all analyses can read it.

    `axes` are the swept parameters with their values, slowest first. `results` are arrays of shape
    (points, ...), in C order over the axes.
    """
    shape = tuple(map(len, axes.values()))
    variables = {}
    for name, values in results.items():
        dimension = VARIABLES[name].dimension
        dimensions = (*axes, dimension) if dimension else tuple(axes)
        variables[name] = (dimensions, values.reshape((*shape, *values.shape[1:])))
    sweep = config.sweep
    section = sweep.spec.transient + 1 + np.arange(sweep.spec.periods)
    coordinates = {**sweep.grid.fixed, **axes, "section": section}
    return xr.Dataset(variables, coordinates, {"configuration": config})


def config_of(dataset: xr.Dataset) -> SweepConfig:
    """Return the configuration of an opened sweep, or of a sweep in memory.

    Raises ConfigError if the configuration in a file is not valid, for example because another
    version wrote it.
    """
    configuration = dataset.attrs["configuration"]
    if isinstance(configuration, SweepConfig):
        return configuration
    table = columns_of(dataset)
    if table:
        return stored_config(configuration, "its configuration", "sweep", table)
    return _parsed(configuration)


@lru_cache(maxsize=8)
def _parsed(configuration: str) -> SweepConfig:
    """Parse the configuration of a file; the cache avoids doing so for each part of a picture."""
    return stored_config(configuration, "its configuration", "sweep")


def described(config: SweepConfig, meaning: str, unit: str) -> dict[str, str]:
    """Return the attributes of what is computed from a sweep, with the names of its units."""
    return {"long_name": meaning, "units": in_units(unit, dict(config.units.items()))}


def headed(name: str, variable: xr.DataArray) -> str:
    """Return the head of a column, with the unit of the variable in brackets if it has a name."""
    unit = unit_name(variable.attrs.get("units", "1"))
    return f"{name} [{unit}]" if unit else name


def oscillator_of(point: xr.Dataset | np.void | Mapping[str, float]) -> Oscillator:
    """Return the oscillator at a point of a sweep, or with parameters given by name."""
    return Oscillator(**{field.name: float(point[field.name]) for field in fields(Oscillator)})


def listed(names: Iterable[str]) -> str:
    """Join names with commas."""
    return ", ".join(names)


def choice_of(names: Collection[str], noun: str = "axis") -> str:
    """Write the allowed names for the message of a refusal."""
    return f"choose from: {listed(names)}" if names else f"there is no {noun} to choose from"


def swept_axes(dataset: xr.Dataset) -> tuple[str, ...]:
    """Return the names of the swept axes in the order of the file."""
    return tuple(str(name) for name in dataset["status"].dims if name != DIRECTION)


def directions(dataset: xr.Dataset) -> tuple[str, ...]:
    """Return the directions of a sweep that was followed both ways; otherwise none."""
    return tuple(dataset[DIRECTION].values) if DIRECTION in dataset["status"].dims else ()


def split_directions(line: xr.Dataset) -> list[xr.Dataset]:
    """Return a line once for each direction in which it was followed, or the line itself."""
    return [line.sel({DIRECTION: direction}) for direction in directions(line)] or [line]


def on_grid(dataset: xr.Dataset, at: Selection) -> dict[str, float | str]:
    """Replace values that are not on the grid, except for rounding, by the nearest grid values.

    Raises Refused if there is no such swept axis or direction, or if a value is outside its axis.
    """
    axes = swept_axes(dataset)
    fixed_at: dict[str, float | str] = {}
    for name, value in at.items():
        if name == DIRECTION:
            fixed_at[name] = _direction(dataset, str(value))
            continue
        if name not in axes:
            meant = suggestion(nearest(name, axes))
            raise Refused(f"{name} cannot be fixed here{meant}; {choice_of(axes)}")
        if isinstance(value, str):
            raise Refused(f"{name} = {value} is not a number")
        values = dataset[name].values
        low, high = float(values.min()), float(values.max())
        slack = 1e-9 * max(abs(low), abs(high))  # a user types 0.3 for a grid value of 0.1 * 3
        if not low - slack <= value <= high + slack:
            asked, first, last = told_apart(value, low, high)
            raise Refused(f"{name} = {asked} is outside the sweep: {first} to {last}")
        closest = float(values[np.argmin(np.abs(values - value))])
        fixed_at[name] = value if abs(closest - value) <= slack else closest
    return fixed_at


def _direction(dataset: xr.Dataset, name: str) -> str:
    """Return the name of a direction of the sweep; refuse any other name."""
    valid = directions(dataset)
    if not valid:
        raise Refused("direction cannot be fixed here; the sweep was not followed in both")
    if name not in valid:
        meant = suggestion(nearest(name, valid))
        raise Refused(f"there is no direction {name}{meant}; choose from: {listed(valid)}")
    return name


def select(dataset: xr.Dataset, at: Selection | None, free: Collection[str] = ()) -> xr.Dataset:
    """Fix each swept axis that is not in `free` at the grid value nearest to `at`, or at its first.

    ``direction`` is also fixed at its first value, unless it is in `free` or `at`.
    """
    axes = [name for name in swept_axes(dataset) if name not in free]
    for name in at or {}:
        if name in free and name != DIRECTION:
            raise Refused(f"{name} cannot be fixed here; {choice_of(axes)}")
    index = {name: 0 for name in axes}
    ways = directions(dataset)
    if ways and DIRECTION not in free:
        index[DIRECTION] = 0
    for name, value in on_grid(dataset, at or {}).items():
        if isinstance(value, str):
            index[name] = ways.index(value)
        else:
            index[name] = int(np.argmin(np.abs(dataset[name].values - value)))
    return dataset.isel(index)


def check_diagnostic(dataset: xr.Dataset, name: str) -> None:
    """Refuse a file in which a diagnostic was not recorded."""
    if name not in dataset:
        raise Refused(
            f"the file has no {name}: run the sweep again with {diagnostics_with(dataset, name)}"
        )


def diagnostics_with(dataset: xr.Dataset, name: str) -> str:
    """Return the key of a configuration that adds a diagnostic to those of a file."""
    return f"record.diagnostics: [{', '.join(d for d in DIAGNOSTICS if d == name or d in dataset)}]"


def chosen_axes(
    dataset: xr.Dataset, requested: Sequence[str], at: Selection | None, count: int, kind: str
) -> list[str]:
    """Return the `count` swept axes that a picture shows.

    By default they are the longest ones that `at` does not fix, and among equally long axes the
    first. Raises Refused if the file has fewer axes, or not the requested ones.
    """
    axes = swept_axes(dataset)
    if TABLE in axes:
        raise Refused(
            f"a {kind} needs a swept axis, and the points of this file are the rows of a table"
        )
    if not axes:
        raise Refused(f"the file holds a single point: a {kind} needs a swept axis")
    for name in requested:
        if name not in axes:
            meant = suggestion(nearest(name, axes))
            if (called := si_name(name, config_of(dataset).rig)) != name and called in axes:
                meant = f" (it is called {called} here)"
            raise Refused(
                f"{name or repr(name)} is not a swept axis{meant}; the file has {listed(axes)}"
            )
    needed = f"a {kind} has {count} swept {'axis' if count == 1 else 'axes'}"
    if len(axes) < count:
        raise Refused(f"{needed}; the file has only {listed(axes)}")
    longest = sorted(axes, key=lambda name: (name in (at or {}), -dataset.sizes[name]))
    chosen = [*dict.fromkeys(requested), *(name for name in longest if name not in requested)]
    if len(requested) > count or len(set(requested)) < len(requested):
        raise Refused(f"{needed}, not {listed(requested)}")
    return chosen[:count]


def recorded(
    dataset: xr.Dataset, names: tuple[str, ...], at: Selection | None
) -> tuple[xr.Dataset, list[np.ndarray]]:
    """Read variables at one point, without padding; refuse a point that has no values."""
    missing = [name for name in names if name not in dataset]
    if missing:
        raise Refused(f"the file has no {listed(missing)}: record it and run the sweep again")
    point = select(dataset, at)
    columns = np.array([point[name].values for name in names])
    columns = columns[:, np.isfinite(columns).all(axis=0)]
    if not columns.size:
        refuse_unrecorded(point, names[0])
    return point, list(columns)


def refuse_unrecorded(point: xr.Dataset, name: str) -> NoReturn:
    """Refuse a point that has no value of a variable, and say why."""
    status = Status(int(point["status"]))
    reason = status.meaning if status.failed else f"no {name} was recorded"
    raise Refused(f"there is nothing to draw at this point: {reason}")


#: The coordinates by name. The height is not in a file, but computed from x and the clearance.
COORDINATES: Mapping[str, Variable] = {
    "poincare_x": VARIABLES["poincare_x"],
    "poincare_v": VARIABLES["poincare_v"],
    "poincare_height": Variable("section", "length", "height above the stop", r"\sigma - x"),
    "impact_v": VARIABLES["impact_v"],
    "impact_phase": VARIABLES["impact_phase"],
}


def recorded_coordinate(dataset: xr.Dataset, coordinate: str) -> xr.DataArray:
    """Return a coordinate at the points of a sweep, read from the file or computed from x."""
    if coordinate != "poincare_height":
        return dataset[coordinate]
    x = dataset["poincare_x"]
    return (dataset["clearance"] - x).transpose(*x.dims)


def impacts_met(dataset: xr.Dataset) -> np.ndarray:
    """Return the number of impacts during the record of every point, in the shape of ``status``."""
    per_period = dataset["impacts_per_period"].transpose(*dataset["status"].dims).values
    return np.rint(np.nan_to_num(per_period) * config_of(dataset).record.periods).astype(int)


def impacts_left_out(dataset: xr.Dataset) -> str:
    """Say how many impacts of the record were kept at most; empty if all were."""
    kept, most = dataset.sizes["impact"], int(impacts_met(dataset).max(initial=0))
    several = "up to " if dataset["status"].size > 1 else ""
    return f"last {kept:,} of {several}{most:,} impacts" if most > kept else ""


def shows_part(dataset: xr.Dataset) -> np.ndarray:
    """Return the mask of the points of which the kept impacts are less than a repetition.

    Where no class is known, the impacts of a forcing period count.
    """
    repetition = dataset["impacts_per_period"]
    if "period" in dataset:
        repetition = dataset["period_impacts"].where(dataset["period"] > 0, repetition)
    kept = dataset.sizes["impact"]
    longer: np.ndarray = repetition.transpose(*dataset["status"].dims).values > kept
    return longer & (impacts_met(dataset) > kept)


def orbit_coordinates(orbit: PeriodicOrbit, phase: float) -> dict[str, np.ndarray]:
    """Return the coordinates of an orbit by name, in time order, shapes (m,) and (q,).

    The phases of the impacts increase. `phase` is the phase of the section [rad].
    """
    x, v = orbit.sections(phase).T
    values = (x, v, orbit.oscillator.clearance - x, orbit.speeds, orbit.phases)
    return dict(zip(COORDINATES, values, strict=True))
