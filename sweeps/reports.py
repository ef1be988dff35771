"""A run in words: its plan, axes, result, counts of status and class, what is kept of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sweeps.errors import Failed, StoreError
from sweeps.store.complete_file import per_point
from sweeps.store.parts import finished_points
from sweeps.store.paths import identities, is_sweep, parts_path
from sweeps.store.variables import DIRECTION
from sweeps.text import in_brackets, shown_bytes, shown_count, shown_duration, shown_range, table
from vibroimpact.points.regimes import (
    ON_ITS_WAY,
    RESTING,
    UNKNOWN,
    by_destination,
    chaos_hint,
    has_result,
    regimes_of,
    rest_of,
)
from vibroimpact.status import Evidence, Status

if TYPE_CHECKING:
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


def plan(config: SweepConfig, path: Path, cost: Cost, remaining: int) -> str:
    """Describe a sweep and its cost before it is run, with the time for its `remaining` points."""
    sweep, spec = config.sweep, config.sweep.spec
    most = "at most " if sweep.known_periods is None else ""
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
        ("expected time", f"about {shown_duration(cost.seconds * remaining / sweep.size)}"),
        ("size of the file", shown_bytes(cost.file) + compressed),
        ("memory", f"about {shown_bytes(cost.memory)} for the blocks in work"),
        ("output", str(path)),
    ]
    return table(rows)


def _swept(config: SweepConfig) -> Iterator[tuple[str, np.ndarray, str]]:
    """Yield name, values and unit of each parameter that varies, as the reader sees them."""
    for name, unit in config.column_units.items():
        assert config.points is not None
        yield name, config.points[name], unit
    nomenclature = config.nomenclature
    if "mass" in config.columns:  # columns of the model vary with it, without a single conversion
        nomenclature = replace(nomenclature, rig=None)
    for name, values in config.sweep.grid.swept.items():
        if config.points is None or name in config.columns:
            unit = nomenclature.unit(nomenclature.about(name).unit)
            yield nomenclature.name(name), nomenclature.value(name, values), unit


def run_summary(path: Path, sweep: Sweep) -> tuple[str, bool]:
    """Describe the result of a complete run of a sweep; say whether any point has one."""
    try:
        variables, seconds = per_point(path, RESULTS)
    except StoreError as error:
        raise Failed(f"the output is gone: {error}") from error
    outcome = outcomes(variables, sweep.spec.impact)
    first = f"{path}: {outcome}; computed in {shown_duration(seconds)}"
    omega, spec = sweep.grid.along("omega"), sweep.spec
    lines = destinations_text(variables, omega, spec.periods, spec.impact)
    return "\n".join([first, *lines]), bool(has_result(variables["status"]).any())


def kept_text(path: Path, command: str, old: tuple[object, object] = (None, None)) -> str:
    """Say what a run that ended early has kept, and which command continues it.

    `old` are the `identities` of the files that the run would have overwritten.
    """
    name = parts_path(path)
    try:
        (file, schema), counts = identities(path), finished_points(path)
        complete = file is not None and is_sweep(path)
    except StoreError as error:
        return f"what is kept is not known, because {error}; to go on: {command}"
    if counts is not None and schema != old[1]:
        done, total = counts
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
    span = shown_range(values.tolist())
    return f"{name} = {span}{in_brackets(unit)}, {shown_count(len(values), 'value')}"


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
    computed = has_result(status[status != Status.PENDING])
    contact = (np.asarray(variables[name]) > 0.0 for name in _CONTACT)  # False for NaN
    if computed.size and computed.all() and not any(met.any() for met in contact):
        proved = np.all(variables.get("class_evidence") == Evidence.FREE)
        text += f"; no impact in any record{': no motion meets the stop' if proved else ''}"
    return text


def destinations_text(
    results: Mapping[str, np.ndarray], omega: np.ndarray, periods: int, impact: str
) -> list[str]:
    """Say how many motions go where, and what is known of those of which this is unknown.

    `results` are those of `regimes_of`, with ``orbit_distance``; empty if there are no classes.
    """
    if "class_evidence" not in results or not has_result(results["status"]).any():
        return []
    regimes = regimes_of(results, omega, periods)
    masks = by_destination(regimes, results["orbit_distance"])
    reasons = [
        f"{number:,} {reason.reason(impact)}"
        for reason in (Evidence.NONE, Evidence.UNSTABLE, Evidence.UNREACHED)
        if (number := int((masks[UNKNOWN] & (results["class_evidence"] == reason)).sum()))
    ]
    hint = []
    if "transient" not in results and masks[ON_ITS_WAY].mean() >= _MANY:
        hint = ["to settle them: record.transient: auto, or with follow a longer transient"]
    if regimes.size == 1:
        (word,) = (word for word, mask in masks.items() if mask.any())
        m, q = (int(results[name].item()) for name in ("period", "period_impacts"))
        word = rest_of([m]) if word == RESTING else word
        why = f", {reasons[0][2:]}" if reasons else ""
        return [f"the motion: {word.replace('m/q', f'{m}/{q}')}{why}", *hint]
    total = sum(int(mask.sum()) for mask in masks.values())
    lines = [
        "; ".join(
            f"{word}: {number:,} ({100.0 * number / total:.3g} %)"
            for word, mask in masks.items()
            if (number := int(mask.sum()))
        )
    ]
    if reasons:
        lines.append(f"unknown: {', '.join(reasons)}{chaos_hint(results, periods)}")
    return lines + hint
