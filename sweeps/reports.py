"""Reports as text: of a run, and of what a file contains."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import chain, repeat
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sweeps.config.rig import RigConfig
from sweeps.errors import Failed, StoreError
from sweeps.store.complete_file import per_point
from sweeps.store.parts import kept_points
from sweeps.store.paths import SCHEMA, is_sweep, parts_path
from sweeps.store.replacing import identity
from sweeps.store.variables import DIRECTION, VARIABLES, columns_of, unit_in
from sweeps.text import fewest_digits, shown_bytes, shown_count, shown_duration, shown_range, table
from sweeps.yaml_text import yaml_mapping
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.points.regimes import (
    ON_ITS_WAY,
    RESTING,
    UNKNOWN,
    has_result,
    partition,
    regimes_of,
    rest_of,
)
from vibroimpact.status import Evidence, Status

if TYPE_CHECKING:
    import xarray as xr

    from sweeps.config.sweep import SweepConfig
    from sweeps.grid import Cost, Sweep

#: If neither is above 0, the mass did not meet the stop.
_CONTACT = ("impacts_per_period", "rest_fraction")
#: The variables that say what became of a point and where its motion goes.
RESULTS = (
    "status",
    *_CONTACT,
    "class_evidence",
    "orbit_distance",
    "period",
    "period_impacts",
    "lyapunov",
    "transient",
)
#: Share of motions on their way from which the text names the transient that is chosen for each.
_MANY = 0.05


def plan(config: SweepConfig, path: Path, cost: Cost) -> str:
    """Describe a sweep and its cost before it is run."""
    sweep, spec = config.sweep, config.sweep.spec
    most = "at most " if spec.longest is not None else ""
    periods = sweep.size * sweep.most_periods
    axes = [shown_axis(*axis) for axis in _swept(config)]
    kind = "axis" if config.points is None else "column"
    rows = [("name", config.name), *((kind, axis) for axis in axes or ["none, a single point"])]
    if config.follow:
        followed = config.nomenclature.name(config.follow.axis)
        rows.append(("follow", f"{followed}, {' and '.join(spec.directions)}"))
    rows += [("points", f"{sweep.size:,}"), ("forcing periods", f"{most}{periods:,}")]
    rows.append(("steps per period", f"{spec.steps_per_period:,}"))
    rows.append(("steps", f"{most}{periods * spec.steps_per_period:,}"))
    if spec.scaled:
        rows.append(("f", "one value is computed, the others are scaled"))
    compressed = "" if config.compression == "none" else f" before {config.compression}"
    rows += [
        ("expected time", f"about {shown_duration(cost.seconds)}"),
        ("size of the file", shown_bytes(cost.file) + compressed),
        ("memory", f"about {shown_bytes(cost.memory)} for the blocks in work"),
        ("output", str(path)),
    ]
    return table(rows)


def _swept(config: SweepConfig) -> Iterator[tuple[str, np.ndarray, str]]:
    """Yield name, values and unit of each parameter that varies, as the reader sees them."""
    typed = () if config.points is None else config.points.dtype.names or ()
    for name in typed:
        if name in config.column_units:
            assert config.points is not None
            yield name, config.points[name], config.column_units[name]
    seen = config.nomenclature
    if "mass" in typed:  # the columns of the model, which vary with it, have no single conversion
        seen = replace(seen, rig=None)
    for name, values in config.sweep.grid.swept.items():
        if config.points is None or name in typed:
            yield seen.name(name), seen.value(name, values), seen.unit(seen.about(name).unit)


def run_summary(path: Path, sweep: Sweep) -> str:
    """Describe the result of a complete run of a sweep."""
    try:
        variables, seconds = per_point(path, RESULTS)
    except StoreError as error:
        raise Failed(f"the output is gone: {error}") from error
    first = f"{path}: {outcomes(variables, sweep.spec.impact)} in {shown_duration(seconds)}"
    omega = sweep.grid.along("omega")
    return "\n".join([first, *destinations_text(variables, omega, sweep.spec.periods)])


def identities(path: Path) -> tuple[object, object]:
    """Return the `identity` of the file of a sweep and of the schema of its blocks."""
    return identity(path.resolve()), identity(parts_path(path) / SCHEMA)


def kept_text(path: Path, command: str, old: tuple[object, object] = (None, None)) -> str:
    """Say what a run that ended early has kept, and which command continues it.

    `old` are the `identities` of the files that the run would have overwritten.
    """
    name = parts_path(path)
    try:
        (file, schema), points = identities(path), kept_points(path)
        complete = file is not None and is_sweep(path)
    except StoreError as error:
        return f"what is kept is not known, because {error}; to go on: {command}"
    if points is not None and schema != old[1]:
        done, total = points
        return f"{done:,} of {shown_count(total, 'point')} kept in {name}; to go on: {command}"
    if old != (None, None) and (file, schema) == old:
        return f"nothing of it is kept, and the old {path if file else name} is unchanged"
    return f"all of it is kept in {path}" if complete else "nothing is kept"


def shown_axis(name: str, values: np.ndarray, unit: str) -> str:
    """Describe an axis or a column: its range, its unit and the number of its values."""
    if name == DIRECTION:
        return f"{name} = {', '.join(values)}"
    if values.dtype.kind in "OU":
        return f"{name}, {shown_count(len(values), 'text')}"
    ends = shown_range(values.tolist()) + ("" if unit == "1" else f" [{unit}]")
    return f"{name} = {ends}, {shown_count(len(values), 'value')}"


def status_counts(variables: Mapping[Any, Any]) -> dict[Status, int]:
    """Count the points of a sweep with each outcome, including the outcomes without points."""
    values = np.asarray(variables["status"])
    return {status: int(np.count_nonzero(values == status)) for status in Status}


def outcomes(variables: Mapping[Any, Any], impact: str) -> str:
    """Say how many points of an impact rule there are, and how many are not as usual."""
    counts = status_counts(variables)
    remarks = [
        f"{number:,} {status.name} ({remark})"
        for status, number in counts.items()
        if number and (remark := status.remark(impact))
    ]
    points = sum(counts.values())
    text = shown_count(points, "point")
    if counts[Status.CERTIFIED] == points:
        text += ", every impact found and certified"
    elif remarks:
        text += f", of which {'; '.join(remarks)}"
    status = np.asarray(variables["status"])
    known = has_result(status[status != Status.PENDING])
    contact = (np.asarray(variables[name]) > 0.0 for name in _CONTACT)  # False for NaN
    if known.size and known.all() and not any(met.any() for met in contact):
        text += "; no impact in any record: no motion meets the stop"
    return text


def destinations_text(
    results: Mapping[str, np.ndarray], omega: np.ndarray, periods: int
) -> list[str]:
    """Say how many motions go where, and what is known of those of which this is unknown.

    `results` are those of `regimes_of`, with ``orbit_distance``; empty if there are no classes.
    """
    if "class_evidence" not in results or not has_result(results["status"]).any():
        return []
    regimes = regimes_of(results, omega, periods)
    parts = partition(regimes, results["orbit_distance"])
    reasons = [
        f"{number:,} {reason.meaning}"
        for reason in (Evidence.NONE, Evidence.UNSTABLE, Evidence.UNREACHED)
        if (number := int((parts[UNKNOWN] & (results["class_evidence"] == reason)).sum()))
    ]
    hint = []
    if "transient" not in results and parts[ON_ITS_WAY].mean() >= _MANY:
        hint = ["to settle them: record.transient: auto, or with follow a longer transient"]
    if regimes.size == 1:
        (word,) = (word for word, mask in parts.items() if mask.any())
        m, q = (int(results[name].item()) for name in ("period", "period_impacts"))
        word = rest_of([m]) if word == RESTING else word
        why = f", {reasons[0][2:]}" if reasons else ""
        return [f"the motion: {word.replace('m/q', f'{m}/{q}')}{why}", *hint]
    total = sum(int(mask.sum()) for mask in parts.values())
    lines = [
        "; ".join(
            f"{word}: {number:,} ({100.0 * number / total:.3g} %)"
            for word, mask in parts.items()
            if (number := int(mask.sum()))
        )
    ]
    if reasons:
        chaos = "" if "lyapunov" in results else "; Lyapunov exponents tell which are chaotic"
        lines.append(f"unknown: {', '.join(reasons)}{chaos}")
    return lines + hint


def destination_counts(
    results: Mapping[str, np.ndarray], omega: np.ndarray, periods: int
) -> dict[str, int]:
    """Return the number of motions of each kind that `destinations_text` tells apart."""
    if "class_evidence" not in results:
        return {}
    parts = partition(regimes_of(results, omega, periods), results["orbit_distance"])
    return {word: int(mask.sum()) for word, mask in parts.items()}


def contents(dataset: xr.Dataset) -> str:
    """Describe an opened sweep: outcome, axes, variables, attributes and configuration."""
    attributes = dict(dataset.attrs)
    configuration = attributes.pop("configuration")
    impact = str(yaml_mapping(attributes.pop("computation"), "the computation").get("impact"))
    attributes.pop("columns", None)  # shown in another form
    rows = [
        ("name", str(attributes.pop("name"))),
        ("points", outcomes(dataset, impact)),
        *zip(chain(["classes"], repeat("")), destinations_text(*_motions(dataset)), strict=False),
        *(
            ("axis", shown_axis(str(axis), dataset[axis].values, _unit(dataset, str(axis))))
            for axis in dataset["status"].dims
        ),
        *(
            ("column", shown_axis(name, values, _unit(dataset, name)))
            for name, values in columns_of(dataset).items()
        ),
        *_of_rig(dataset),
    ]
    names = [name for name in VARIABLES if name in dataset]
    shapes = [f"{name} ({_sizes(dataset[name])})" for name in names]
    width = max(map(len, shapes))
    rows += [
        ("variable", f"{shape:{width}}  {dataset[name].long_name}{_bracketed(dataset, name)}")
        for name, shape in zip(names, shapes, strict=True)
    ]
    attributes["duration"] = shown_duration(float(attributes["duration"]))
    rows += [(str(name), str(value)) for name, value in attributes.items()]
    return f"{table(rows)}\n\n{configuration}"


def contents_by_key(dataset: xr.Dataset) -> dict[str, Any]:
    """Return the same for other programs: numbers, texts and mappings by the names of keys."""
    attributes = dict(dataset.attrs)
    configuration = attributes.pop("configuration")
    return {
        "name": attributes.pop("name"),
        "points": dataset["status"].size,
        "outcomes": {
            status.name.lower().replace("_", "-"): number
            for status, number in status_counts(dataset).items()
            if number
        },
        "classes": destination_counts(*_motions(dataset)),
        "axes": {
            str(axis): {"units": dataset[axis].attrs.get("units"), "values": dataset[axis].values}
            for axis in dataset["status"].dims
        },
        "columns": [*columns_of(dataset)],
        "variables": {
            name: {
                "dimensions": {str(dim): size for dim, size in dataset[name].sizes.items()},
                "long_name": dataset[name].attrs["long_name"],
                "units": dataset[name].attrs.get("units"),
            }
            for name in VARIABLES
            if name in dataset
        },
        "attributes": attributes,
        "configuration": yaml_mapping(configuration, "the configuration"),
    }


def _motions(dataset: xr.Dataset) -> tuple[dict[str, np.ndarray], np.ndarray, int]:
    """Return results and omega in the shape of ``status``, and the periods of a record."""
    dims = dataset["status"].dims
    held = [name for name in RESULTS if name in dataset]
    results = {name: dataset[name].transpose(*dims, ...).values for name in held}
    omega = dataset["omega"].broadcast_like(dataset["status"]).transpose(*dims).values
    return results, omega, dataset.sizes["section"]


def _of_rig(dataset: xr.Dataset) -> list[tuple[str, str]]:
    """Return a row for the mass and each fixed quantity of a rig; none without a rig."""
    fixed = [name for name in RigConfig.model_fields if name in dataset and not dataset[name].dims]
    return [
        ("rig", f"{name} = {fewest_digits(dataset[name].item())}{_bracketed(dataset, name)}")
        for name in fixed
        if "mass" in dataset
    ]


def _unit(dataset: xr.Dataset, name: str) -> str:
    """Return the unit of a variable, in which a length or a time may have no name."""
    about = PARAMETERS.get(name) or VARIABLES.get(name)
    return dataset[name].attrs.get("units") or unit_in(dataset.attrs, about.unit if about else "1")


def _bracketed(dataset: xr.Dataset, name: str) -> str:
    """Return the unit of a variable after a space, in brackets; none for a pure number."""
    unit = _unit(dataset, name)
    return "" if unit == "1" else f" [{unit}]"


def _sizes(variable: xr.DataArray) -> str:
    return ", ".join(f"{name}: {size}" for name, size in variable.sizes.items())
