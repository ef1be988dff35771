"""The numbers of ``sweeps.bench.paper`` as tables for the terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from rich import box
from rich.table import Table

from sweeps.bench import paper
from vibroimpact.step.integrators import INTEGRATORS
from vibroimpact.step.rules import IMPACT_RULES


def tables(measured: paper.Measured) -> Iterator[tuple[str, Table]]:
    """Yield the titles and tables of what `paper.measure` returned."""
    at, procedures = f"with T = 2 pi/{paper.STEPS}", list(paper.PROCEDURES)
    yield (
        f"Deepest penetration {at}",
        _by_case(measured, procedures, lambda case, key: f"{case.deepest[key]:.2g}"),
    )
    yield (
        f"Impacts in {paper.PERIODS} periods {at}",
        _by_case(measured, [*procedures, "exact"], lambda case, key: f"{case.impacts[key]}"),
    )
    yield (
        f"Order, from the times and speeds of the first {paper.FIRST} impacts",
        _by_case(measured, procedures, lambda case, key: f"{case.orders[key]:.2f}"),
    )
    chatter = paper.CHATTER
    yield (
        f"Where the procedure stalls, to the letter: h = {chatter.h:g}, R = {chatter.R:g}, "
        f"omega = {chatter.omega:g}",
        _stalls(measured),
    )
    yield (
        f"Fully dissipative case {at}: impacts per period and speed of the slowest; *: right",
        _resolved(measured),
    )


def _table(*columns: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD)
    table.add_column(columns[0])
    for column in columns[1:]:
        table.add_column(column, justify="right")
    return table


def _by_case(
    measured: paper.Measured, columns: list[str], cell: Callable[[paper.Case, str], str]
) -> Table:
    table = _table("case", *columns)
    for name, case in measured.cases.items():
        table.add_row(name, *(cell(case, key) for key in columns))
    return table


def _stalls(measured: paper.Measured) -> Table:
    end = measured.chatter.rests[0, 0]
    table = _table("steps per period", "stall at t", f"before the rest at t = {end:.5f}")
    for steps, run in measured.stalls.items():
        at = run.stalled_at
        table.add_row(
            f"{steps:,}", *("none" if at is None else f"{at:.5f}", f"{end - run.t[-1]:.2g}")
        )
    return table


def _resolved(measured: paper.Measured) -> Table:
    table = _table("integrator", *IMPACT_RULES)
    for integrator in INTEGRATORS:
        cells = []
        for rule in IMPACT_RULES:
            impacts = measured.resolved.get((integrator, rule))
            star = "*" if impacts and measured.resolves(integrator, rule) else " "
            cells.append(f"{impacts[0]:g} {impacts[1]:.4f}{star}" if impacts else "")
        table.add_row(integrator, *cells)
    return table
