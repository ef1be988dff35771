"""Compares two sweeps: which values differ, where, by how much, because of which keys."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from sweeps.config.rig import Nomenclature
from sweeps.errors import Refused
from sweeps.opened.coordinates import in_chunks
from sweeps.opened.opened_sweep import OpenedSweep
from sweeps.store.schema import differing_keys
from sweeps.store.variables import FLAGS, VARIABLES
from sweeps.text import listed, shown_count, told_apart

#: The dimension of the only record whose width follows from the motions.
_SAMPLE = "sample"


@dataclass
class Difference:
    """The values of a variable or coordinate that differ, counted chunk by chunk."""

    name: str
    values: int = 0  # values that differ
    size: int = 0  # values that were compared
    points: int = 0  # points of the grid with a value that differs
    greatest: float = 0.0  # of the differences of two finite numbers
    at: Mapping[str, int] = field(default_factory=dict)  # index of the first one, by dimension
    first: tuple[object, object] = ("", "")  # its two values


def differences(
    first: xr.Dataset, second: xr.Dataset, rtol: float = 0.0, atol: float = 0.0
) -> Iterator[Difference]:
    """Yield the difference of each variable and coordinate that both sweeps have.

    Two values are equal if both are NaN, or if they differ by at most `atol` plus `rtol` times the
    greater magnitude; integers and texts must be the same, and phases may differ by full turns. Of
    trajectories, the samples that both sweeps have are compared. Raises Refused
    if the axes or records have other sizes.
    """
    _refuse_other_shapes(first, second)
    if _SAMPLE in first.dims and _SAMPLE in second.dims:
        width = min(data.sizes[_SAMPLE] for data in (first, second))
        first, second = (data.isel({_SAMPLE: slice(width)}) for data in (first, second))
    for name in [*first.coords, *first.data_vars]:
        if name in second.variables:
            yield _compared(first, second, str(name), rtol, atol)


def _refuse_other_shapes(first: xr.Dataset, second: xr.Dataset) -> None:
    """Refuse two sweeps whose dimensions differ, except in the number of samples."""
    axes = [dict(data["status"].sizes) for data in (first, second)]
    records = {name: size for name, size in first.sizes.items() if name in second.sizes}
    if axes[0] == axes[1]:
        differing = [
            name for name, size in records.items() if name != _SAMPLE and size != second.sizes[name]
        ]
        axes = [{name: data.sizes[name] for name in differing} for data in (first, second)]
    if axes[0] != axes[1]:
        shapes = (
            listed([f"{name}: {size}" for name, size in sizes.items()]) or "a single point"
            for sizes in axes
        )
        raise Refused(
            "the two sweeps have different shapes, {} and {}; expected: the same axes and records "
            "of the same lengths".format(*shapes)
        )


def _compared(
    first: xr.Dataset, second: xr.Dataset, name: str, rtol: float, atol: float
) -> Difference:
    """Compare a variable of two sweeps, a chunk of the points at a time."""
    difference = Difference(name)
    sizes, width, chunks = _chunks_of(first, second, name)
    for a, b, start in chunks:
        difference.size += a.size
        differ, distance = _distances(name, a, b, rtol, atol)
        indices = np.flatnonzero(differ)
        if not indices.size:
            continue
        if not difference.values:
            index = np.unravel_index(start * width + int(indices[0]), tuple(sizes.values()) or (1,))
            difference.at = dict(zip(map(str, sizes), map(int, index), strict=False))
            difference.first = a[indices[0]], b[indices[0]]
        difference.values += indices.size
        difference.points += len(np.unique(indices // width))
        difference.greatest = max(difference.greatest, float(distance[indices].max()))
    return difference


def _chunks_of(
    first: xr.Dataset, second: xr.Dataset, name: str
) -> tuple[Mapping[Hashable, int], int, Iterable[tuple[np.ndarray, np.ndarray, int]]]:
    """Return the sizes of a variable, its values per point, and chunks of it in both sweeps.

    Each chunk has flat values of both and the number of its first point.
    """
    if name in first.coords:
        bare = (data[name].drop_vars(data[name].coords) for data in (first, second))
        pair = xr.broadcast(*bare)  # a number in one may be a column in the other
        return pair[0].sizes, 1, [(pair[0].values.ravel(), pair[1].values.ravel(), 0)]
    axes = first["status"].dims
    variables = [data[name].variable.transpose(*axes, ...) for data in (first, second)]
    shape = first["status"].variable.to_base_variable()
    joint = xr.Dataset({"status": shape, "first": variables[0], "second": variables[1]})
    width = math.prod(variables[0].shape[len(axes) :])
    chunks = (
        (cut["first"].values.ravel(), cut["second"].values.ravel(), points.start)
        for cut, points in in_chunks(joint, width)
    )
    return variables[0].sizes, width, chunks


def _distances(
    name: str, first: np.ndarray, second: np.ndarray, rtol: float, atol: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return which values differ, and by how much; 0 where one of them is no finite number."""
    if "O" in (first.dtype.kind, second.dtype.kind):
        pairs = zip(first.tolist(), second.tolist(), strict=True)
        texts = np.array([a != b and not a != a != b != b for a, b in pairs], bool)
        return texts, np.zeros(texts.size)
    differ = (first != second) & ~(np.isnan(first) & np.isnan(second))
    both = np.isfinite(first) & np.isfinite(second)
    numbers = [np.where(both, values, 0.0) for values in (first, second)]
    with np.errstate(over="ignore"):
        distance = np.abs(numbers[0] - numbers[1])
        if name in VARIABLES and VARIABLES[name].unit == "rad":
            distance = np.minimum(distance, np.abs(2.0 * np.pi - distance))
    if "f" in (first.dtype.kind, second.dtype.kind):
        differ &= ~(both & (distance <= atol + rtol * np.maximum(*np.abs(numbers))))
    return differ, distance


# The differences as text


def comparison_report(
    first: xr.Dataset, second: xr.Dataset, names: tuple[str, str], rtol: float, atol: float
) -> tuple[str, bool]:
    """Write what differs in two opened sweeps of these names; return also whether anything does."""
    results = list(differences(first, second, rtol, atol))
    first_text, second_text = (str(data.attrs["configuration"]) for data in (first, second))
    keys = differing_keys(first_text, second_text)
    differing = [each for each in results if each.values]
    nomenclature = OpenedSweep(first).config.nomenclature if differing else Nomenclature()
    variables = {each.name for each in differing}  # a column ``frequency`` stands for ``omega``
    by_name = {
        called: _line(first, nomenclature, each)
        for each in differing
        if (called := nomenclature.name(each.name)) == each.name or called not in variables
    }
    causes, lines = [*keys], [*by_name.values()]
    if keys and not (rtol or atol):
        causes, lines = _in_short(by_name, keys)
    for data, without, name in ((first, second, names[0]), (second, first, names[1])):
        missing = sorted({*data} - {*without}) + sorted({*data.coords} - {*without.coords})
        lines += [f"{variable}: only in {name}" for variable in missing]
    widths = [data.sizes.get(_SAMPLE) for data in (first, second)]
    if None not in widths and widths[0] != widths[1]:
        lines.append("the longest trajectory has {:,} and {:,} samples".format(*widths))
    pair = f"{names[0]} and {names[1]}"
    allowed = [f"{rtol:g} of each value"] * bool(rtol) + [f"{atol:g}"] * bool(atol)
    if lines:
        more = f" by more than {' and '.join(allowed)}" if allowed else ""
        typed = ["{}: {} and {}".format(key, *keys[key]) for key in causes]
        return "\n".join([*typed, *lines, f"{pair} differ{more}"]), True
    within = f" to {' and '.join(allowed)}" if allowed else ""
    return f"{pair} are equal{within}: {len(results)} variables and coordinates", False


def _in_short(lines: Mapping[str, str], keys: Iterable[str]) -> tuple[list[str], list[str]]:
    """Return the keys that are a cause, and a line on what follows, one variable of it in full."""
    steps = "method.steps_per_period"  # another key may have chosen them
    causes = [key for key in keys if key != steps] or [*keys]
    chosen = [key for key in keys if key not in causes]
    changed = {key.rpartition(".")[2] for key in causes}
    results = [name for name in lines if name not in changed]
    if not results:
        return causes, []
    full = "poincare_x" if "poincare_x" in results else results[-1]
    others = chosen + [name for name in results if name != full]
    beside = f"; so {'do' if others[1:] else 'does'} {listed(others)}" if others else ""
    return causes, [f"{lines[full]}{beside}"]


def _line(sweep: xr.Dataset, nomenclature: Nomenclature, difference: Difference) -> str:
    """Write how many values of a variable differ, the first ones, and the greatest difference."""
    name, called = difference.name, nomenclature.name(difference.name)
    coordinates = [
        f"{nomenclature.name(axis)} = {_shown(nomenclature.value(axis, sweep[axis].values[index]))}"
        for axis, index in difference.at.items()
    ]
    if name in sweep.coords:
        where = f"{called}: {difference.values:,} of {difference.size:,} values differ"
        if difference.size == 1:
            where = f"{called}: differs"
        if name in sweep.dims:
            coordinates = [f"number {1 + index}" for index in difference.at.values()]
    else:
        points = shown_count(sweep["status"].size, "point")
        where = f"{name}: differs at {difference.points:,} of {points}"
        if difference.size > sweep["status"].size:
            where += f" ({difference.values:,} of {difference.size:,} values)"
    first = f", first at {', '.join(coordinates)}" if coordinates else ""
    values = " and ".join(_values(name, difference.first))
    measured = difference.greatest and name not in FLAGS
    most = f"; greatest difference {difference.greatest:.3g}" if measured else ""
    return f"{where}{first}: {values}{most}"


def _values(name: str, values: tuple[object, object]) -> list[str]:
    """Write two values so that they can be told apart, flags as words."""
    if name in FLAGS:
        words = {int(flag): flag.word for flag in FLAGS[name]}
        return [words.get(int(value), str(value)) for value in values]  # type: ignore[call-overload]
    if any(isinstance(value, str) for value in values):
        return [str(value) for value in values]
    return told_apart(*(float(value) for value in values))  # type: ignore[arg-type]


def _shown(value: object) -> str:
    return str(value) if isinstance(value, str) else f"{float(value):.12g}"  # type: ignore[arg-type]
