"""What the commands tell about a sweep: before it is run, after it, and when it ended early.

As in ``cli.py``, what a report needs is imported inside it.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping
from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from sweeps.config import SweepConfig
    from vibroimpact.status import Status


def plan(sweep: SweepConfig, path: Path) -> str:
    """Describe a sweep before it is run."""
    from sweeps.variables import shown_bytes

    periods = sweep.grid.size * (sweep.record.transient + sweep.record.periods)
    axes = [_axis(name, values) for name, values in sweep.grid.axes.items()]
    steps = [
        ("steps per period", f"{sweep.steps:,}"),
        ("steps", f"{periods * sweep.steps:,}"),
    ]
    if sweep.method.accuracy is not None:
        asked = f"the cheapest with an error <= {sweep.method.accuracy:g}, found by a pilot run"
        steps = [("method", asked)]
    return _table(
        [
            ("name", sweep.name),
            *(("axis", axis) for axis in axes or ["none, a single point"]),
            ("points", f"{sweep.grid.size:,}"),
            ("forcing periods", f"{periods:,}"),
            *steps,
            ("estimated size", shown_bytes(estimated_size(sweep))),
            ("output", str(path)),
        ]
    )


def estimated_size(sweep: SweepConfig) -> int:
    """Return about how many bytes the file of a sweep will have."""
    from sweeps.variables import bytes_per_point

    return sweep.grid.size * bytes_per_point(sweep.widths, sweep.record.diagnostics)


def summary(path: Path) -> str:
    """Describe a sweep after it was run."""
    from sweeps.store import open_sweep, status_counts

    with open_sweep(path) as dataset:
        seconds = float(dataset.attrs["duration"])
        outcome = f"{path}: {_outcomes(status_counts(dataset))}"
    return f"{outcome} in {seconds:.3g} s"


def next_command(paths: Iterable[Path]) -> str:
    """Say what to type after sweeps were run."""
    return f"next: vibroimpact plot {shlex.join(map(str, paths))}"


def kept(path: Path) -> str:
    """Say what a run that ended early left behind."""
    from sweeps.store import StoreError, open_sweep, status_counts
    from vibroimpact.status import Status

    try:
        with open_sweep(path) as dataset:
            counts = status_counts(dataset)
    except StoreError:
        return "nothing is kept"
    points = sum(counts.values())
    return f"{points - counts[Status.PENDING]:,} of {_count(points, 'point')} kept in {path}"


def contents(dataset: xr.Dataset) -> str:
    """Describe an opened sweep: attributes, outcome, axes, variables, pilot and configuration."""
    from sweeps.store import status_counts

    attributes = dict(dataset.attrs)
    configuration = attributes.pop("configuration")
    pilot = attributes.pop("pilot", "")
    if pilot:  # as a comment, so that what is below the table can be run again
        pilot = "# pilot:\n" + indent(pilot, "#   ")
    rows = [(str(name), str(value)) for name, value in attributes.items()]
    rows.append(("points", _outcomes(status_counts(dataset))))
    axes = map(str, dataset["status"].dims)
    rows += [("axis", _axis(axis, dataset[axis].values)) for axis in axes]
    for name, variable in dataset.data_vars.items():
        sizes = ", ".join(f"{dim}: {size}" for dim, size in variable.sizes.items())
        rows.append(("variable", f"{name} ({sizes})"))
    return f"{_table(rows)}\n\n{pilot}{configuration}"


def _table(rows: list[tuple[str, str]]) -> str:
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:{width}}  {text}" for name, text in rows)


def _axis(name: str, values: np.ndarray) -> str:
    from vibroimpact.oscillator import PARAMETERS

    unit = PARAMETERS[name].unit
    ends = f"{values[0]:g} .. {values[-1]:g}" + ("" if unit == "1" else f" [{unit}]")
    return f"{name} = {ends}, {_count(len(values), 'value')}"


def _count(number: int, noun: str) -> str:
    return f"{number:,} {noun}" if number == 1 else f"{number:,} {noun}s"


def _outcomes(counts: Mapping[Status, int]) -> str:
    """Say how many points there are, and of which there is more to say."""
    from sweeps.variables import is_remarkable
    from vibroimpact.status import Status

    remarks = [
        f"{number:,} {status.name} ({status.meaning})"
        for status, number in counts.items()
        if number and is_remarkable(status)
    ]
    points = sum(counts.values())
    text = _count(points, "point")
    if counts[Status.CERTIFIED] == points:
        return f"{text}, all certified: every impact found, none missed"
    return f"{text}, of which {'; '.join(remarks)}" if remarks else text
