"""The stability limits and the failures as tables for the terminal, and as rows for a CSV file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from sweeps.bench.failures import FAILURES, STEPS, Failure
from sweeps.bench.scenes import Method
from sweeps.bench.stability import LONGEST, ZETAS, Limits
from sweeps.text import table

#: Behind a figure that is a failure.
MARK = "!"
# As many columns as 80 letters hold.
_COLUMNS = 4

Figures = Mapping[tuple[Method, str], float]


def of_limits(limits: Mapping[str, Limits]) -> str:
    """Return a row per integrator and h / p, and a single one where there is no limit."""
    rows = [["integrator", "h/p", "closed form", "spectral radius", "in a run"]]
    for name, limit in limits.items():
        values = np.array(limit).T
        if np.isinf(values).all():
            rows.append([name, "each", "every step", *2 * [f"> {LONGEST:g}"]])
            continue
        for zeta, (closed, *measured) in zip(ZETAS, values, strict=True):
            shown_limits = (f"{value:.4f}" for value in measured)
            first = f"{closed:.4f}" if closed > 0.0 else "no step"
            rows.append([name if zeta == ZETAS[0] else "", f"{zeta:g}", first, *shown_limits])
    return (
        "Greatest stable p T of free motion: in closed form, from the spectral radius of\n"
        f"the map, and from the growth in a run\n\n{table(rows, words=1)}\n"
    )


def of_failures(figures: Figures) -> Iterator[str]:
    """Yield the failures, a row per method, in tables that fit a terminal, with their scenes."""
    yield f"Where methods fail ({MARK}), at {STEPS} steps per period unless said otherwise\n"
    methods = dict.fromkeys(method for method, _ in figures)
    for start in range(0, len(FAILURES), _COLUMNS):
        columns = FAILURES[start : start + _COLUMNS]
        rows = [("method", *(f"{failure.name} " for failure in columns))]
        for method in methods:
            cells = (shown(failure, figures[method, failure.name]) for failure in columns)
            rows.append((" ".join(method), *cells))
        scenes = "\n".join(f"  {failure.name}: {failure.scene}" for failure in columns)
        yield f"{table(rows, words=1)}\n\n{scenes}\n"


def shown(failure: Failure, figure: float) -> str:
    """Write a figure, marked where it is a failure."""
    if math.isnan(figure):
        return ""
    if math.isinf(figure) and not failure.fails(figure):
        return "never "
    return f"{figure:{failure.digits}}{MARK if failure.fails(figure) else ' '}"


COLUMNS = ("method", "figure", "scene", "value")


def rows(limits: Mapping[str, Limits], figures: Figures) -> Iterator[tuple[str, str, str, float]]:
    """Yield everything as rows of ``COLUMNS``."""
    for name, limit in limits.items():
        for source, values in limit._asdict().items():
            for zeta, value in zip(ZETAS, values, strict=True):
                yield name, f"limit of p T, {source}", f"h/p = {zeta:g}", value
    scenes = {failure.name: failure.scene for failure in FAILURES}
    for (method, name), figure in figures.items():
        if not math.isnan(figure):
            yield " ".join(method), name, scenes[name], figure
