"""The stability limits and the failures as tables for the terminal, and as rows for a CSV file."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from rich import box
from rich.table import Table

from sweeps.bench.failures import FAILURES, STEPS, Failure
from sweeps.bench.scenes import Method
from sweeps.bench.stability import LONGEST, ZETAS, Limits

#: Behind a figure that is a failure.
MARK = "!"
# As many columns as 80 letters hold.
_COLUMNS = 4

Figures = Mapping[tuple[Method, str], float]


def report(limits: Mapping[str, Limits], figures: Figures) -> Iterator[str | Table]:
    """Yield every table, with its title before it and the meaning of its columns after it."""
    yield (
        "Greatest stable p T of free motion: in closed form, from the spectral radius of the map, "
        "and from the growth in a run"
    )
    yield limit_table(limits)
    yield f"Where methods fail ({MARK}), at {STEPS} steps per period unless said otherwise"
    for table, columns in failure_tables(figures):
        yield table
        yield "\n".join(f"  {failure.name}: {failure.scene}" for failure in columns) + "\n"


def limit_table(limits: Mapping[str, Limits]) -> Table:
    """Return the limits: a row per integrator and h / p, a single row where there is no limit."""
    table = _table("integrator", "h/p", "closed form", "spectral radius", "in a run")
    for name, limit in limits.items():
        values = np.array([limit.closed, limit.radius, limit.run]).T
        if np.isinf(values).all():
            table.add_row(name, "each", "every step", *2 * [f"> {LONGEST:g}"], end_section=True)
            continue
        for zeta, (closed, *other_methods) in zip(ZETAS, values, strict=True):
            table.add_row(
                name if zeta == ZETAS[0] else "",
                f"{zeta:g}",
                f"{closed:.4f}" if closed > 0.0 else "no step",
                *(f"{value:.4f}" for value in other_methods),
                end_section=zeta == ZETAS[-1],
            )
    return table


def failure_tables(figures: Figures) -> Iterator[tuple[Table, list[Failure]]]:
    """Yield the failures, a row per method, in tables that fit a terminal, and their columns."""
    methods = list(dict.fromkeys(method for method, _ in figures))
    for start in range(0, len(FAILURES), _COLUMNS):
        columns = list(FAILURES[start : start + _COLUMNS])
        table = _table("method", *(failure.name for failure in columns))
        for method in methods:
            cells = (shown(failure, figures[method, failure.name]) for failure in columns)
            table.add_row(" ".join(method), *cells)
        yield table, columns


def shown(failure: Failure, figure: float) -> str:
    """Write a figure, marked where it is a failure."""
    if math.isnan(figure):
        return ""
    if math.isinf(figure) and not failure.fails(figure):
        return "never "
    return f"{figure:{failure.digits}}{MARK if failure.fails(figure) else ' '}"


def write(path: Path, limits: Mapping[str, Limits], figures: Figures) -> None:
    """Write everything to a CSV file: method, figure, scene, value."""
    scenes = {failure.name: failure.scene for failure in FAILURES}
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["method", "figure", "scene", "value"])
        for name, limit in limits.items():
            for source, values in vars(limit).items():
                for zeta, value in zip(ZETAS, values, strict=True):
                    table.writerow([name, f"limit of p T, {source}", f"h/p = {zeta:g}", value])
        for (method, name), figure in figures.items():
            if not math.isnan(figure):
                table.writerow([" ".join(method), name, scenes[name], figure])


def _table(*columns: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column(columns[0], no_wrap=True)
    for column in columns[1:]:
        table.add_column(column, justify="right")
    return table
