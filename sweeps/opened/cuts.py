"""Cuts through an opened sweep: its axes, values on them, and the points that are left."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import xarray as xr

from sweeps.config.groups import STARTS
from sweeps.errors import Refused
from sweeps.grid import TABLE
from sweeps.opened.dataset import config_of
from sweeps.store.variables import DIRECTION
from sweeps.text import choice_of, listed, near_miss, suggestion, told_apart

#: Axes along which only the start or the past differs, not the oscillator.
START_AXES = (*STARTS, DIRECTION)
#: Where a sweep is cut: a value for each swept axis, and a name for ``direction``.
Selection = Mapping[str, float | str]


def swept_axes(dataset: xr.Dataset) -> tuple[str, ...]:
    """Return the names of the swept axes in the order of the file."""
    return tuple(str(name) for name in dataset["status"].dims if name != DIRECTION)


def directions(dataset: xr.Dataset) -> tuple[str, ...]:
    """Return the directions of a sweep that was followed both ways; otherwise none."""
    return tuple(dataset[DIRECTION].values) if DIRECTION in dataset["status"].dims else ()


def split_directions(line: xr.Dataset) -> list[xr.Dataset]:
    """Return a line once for each direction in which it was followed, or the line itself."""
    return [line.sel({DIRECTION: direction}) for direction in directions(line)] or [line]


def places(dataset: xr.Dataset, at: Selection, kept: Collection[str] = ()) -> dict[str, int]:
    """Return the index of the grid value nearest to each value of `at`, and of its direction.

    Refuses names that are no swept axis, or are in `kept`, and values outside their axis.
    """
    axes = [name for name in swept_axes(dataset) if name not in kept]
    found = dict[str, int]()
    for name, value in at.items():
        if name == DIRECTION and name not in kept:
            found[name] = _place_of_direction(dataset, str(value))
            continue
        if name not in axes:
            known = name in dataset["status"].dims
            meant = "" if known else suggestion(near_miss(name, axes))
            raise Refused(f"{name} cannot be fixed here{meant}; {choice_of(axes)}")
        if isinstance(value, str):
            raise Refused(f"{name} = {value} is not a number")
        values = dataset[name].values
        low, high = float(values.min()), float(values.max())
        slack = 1e-9 * max(abs(low), abs(high))  # a user types 0.3 for a grid value of 0.1 * 3
        if not low - slack <= value <= high + slack:
            asked, first, last = told_apart(value, low, high)
            raise Refused(f"{name} = {asked} is outside the sweep: {first} to {last}")
        found[name] = int(np.argmin(np.abs(values - value)))
    return found


def _place_of_direction(dataset: xr.Dataset, name: str) -> int:
    """Return the index of a direction of the sweep; refuse any other name."""
    valid = directions(dataset)
    if not valid:
        raise Refused("direction cannot be fixed here; the sweep was not followed in both")
    if name not in valid:
        meant = suggestion(near_miss(name, valid))
        raise Refused(f"there is no direction {name}{meant}; choose from: {listed(valid)}")
    return valid.index(name)


def cut_at(dataset: xr.Dataset, at: Selection | None, free: Collection[str] = ()) -> xr.Dataset:
    """Fix each axis that is not in `free` at the grid value nearest to `at`, or at its first.

    ``direction`` is an axis, too; `at` may fix it also if it is in `free`.
    """
    first = {str(name): 0 for name in dataset["status"].dims if name not in free}
    return dataset.isel(first | places(dataset, at or {}, {*free} - {DIRECTION}))


def part(dataset: xr.Dataset, at: Selection) -> xr.Dataset:
    """Return the points of a sweep at the grid values nearest to `at`, with all its dimensions."""
    return dataset.isel({name: slice(i, i + 1) for name, i in places(dataset, at).items()})


def several(dataset: xr.Dataset, at: Mapping[str, Sequence[float]]) -> xr.Dataset:
    """Return the points of a sweep at the grid values nearest to several values of axes."""
    for name, values in at.items():
        chosen = {places(dataset, {name: value})[name] for value in values}
        if len(chosen) < len(values):
            given = listed([f"{value:.12g}" for value in values])
            raise Refused(f"{name} = {given}: two of these have the same nearest grid value")
        dataset = dataset.isel({name: sorted(chosen)})
    return dataset


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
            meant = suggestion(near_miss(name, axes))
            if (called := config_of(dataset).nomenclature.name(name)) != name and called in axes:
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
