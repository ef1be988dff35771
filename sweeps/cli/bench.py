"""The commands of ``vibroimpact bench``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from sweeps.cli.options import (
    CSV,
    argument,
    flag,
    new_file,
    numeric,
    option,
    progress_shown,
    read_threads,
    say,
)
from sweeps.cli.run import read_config
from sweeps.errors import Failed
from sweeps.text import shown_count
from vibroimpact.inputs import number

_QUICK = flag("--quick", "Measure less, in under a minute.")


def _picture(path: Path) -> Path:
    """Refuse a path unless a picture can be written there."""
    from sweeps.plotting.saving import check_picture

    check_picture(path)
    return path


def _figure(name: str) -> Any:
    """Return the option of the picture, with its name by default."""
    return option(
        "FIGURE", "The picture to write.", "-o", "--output", default=Path(name), callback=_picture
    )


def _save(csv: Path | None, rows: Any, output: Path, draw: Callable, *measured: Any) -> None:
    """Write the picture of a bench and, to a `csv` file, its rows; print the names of the files."""
    from sweeps.opened.tables import write_csv
    from sweeps.plotting.saving import save_chart

    save_chart(output, draw, *measured)
    say(output)
    if csv is not None:
        write_csv(csv, [rows])
        say(csv)


def accuracy_speed(
    config: Path | None = argument(
        "[CONFIG]",
        "The YAML file of a sweep, or a sweep file, on which to compare the methods; if not given, "
        "the scenes of the program, also with other solvers.",
        None,
    ),
    output: Path = _figure("accuracy-speed.png"),
    csv: Path | None = CSV,
    quick: bool = _QUICK,
    threads: int = option(
        "N", "Threads of the kernel; other solvers use one.", parser=read_threads, default=1
    ),
) -> None:
    """Chart the accuracy of every method against its speed."""
    import pandas as pd

    from sweeps.bench import accuracy as bench
    from sweeps.bench import accuracy_results as results

    plan = bench.QUICK if quick else bench.FULL
    if config is not None:
        plan = bench.plan_for_sweep(read_config(config), plan)
        (scene,) = plan.scenes
        points = shown_count(len(scene.points), "point")
        say(f"{points} of the {scene.name}, each after one forcing period\n")
    with progress_shown("measuring") as report:
        measured = bench.measure_methods(plan, threads, report)
    if config is None:
        measured = pd.concat([measured, results.means(measured)])
    measured = results.with_orders(measured)
    for name in plan.peers:
        if not bench.installed(name):
            say(f"{name} is not installed, so it is not on the chart", error=True)
    say(results.of_methods(measured))
    say(results.of_targets(measured))
    _save(csv, measured, output, results.accuracy_picture, measured)


def stability(
    output: Path = _figure("stability.png"), csv: Path | None = CSV, quick: bool = _QUICK
) -> None:
    """Show how long a step may be, and where each method fails."""
    from sweeps.bench import failures as bench

    limits, figures = bench.longest_steps(quick), bench.measure_failures()
    for part in (bench.table_of(limits), *bench.failure_tables(figures)):
        say(part)
    _save(csv, bench.figure_table(limits, figures), output, bench.stability_chart, quick)


def paper(output: Path = _figure("paper.png")) -> None:
    """Compute the three cases of the paper, without and with its procedure."""
    from sweeps.bench import paper_cases as bench

    measured = bench.measure_cases()
    say(bench.case_tables(measured))
    _save(None, None, output, bench.paper_picture, measured)


def speed(
    quick: bool = _QUICK,
    json: Path | None = new_file("--json", ".json", "JSON file", "Write a .json file, too."),
    fail_below: float | None = numeric(
        "--fail-below",
        number(lambda share: 0.0 < share <= 1.0, "a number above 0, at most 1, as 0.05"),
        "Exit with 1 if the geometric mean of the shares of the peak is below SHARE.",
        "SHARE",
    ),
) -> None:
    """Show the forcing periods per second of this machine, and the share of its peak."""
    from sweeps.bench import speed
    from sweeps.opened.tables import json_text
    from sweeps.store.replacing import writing

    count, periods = (1024, 150) if quick else (4096, 300)
    with progress_shown("measuring") as report:
        record = speed.measure_speed(count, periods, report)
    say(speed.speed_text(record))
    if json is not None:
        with writing(json, "JSON file") as new:
            new.write(json_text(record).encode())
        say(json)
    share = record["mean_share"]
    if fail_below is not None and share < fail_below:
        raise Failed(
            f"the geometric mean of the shares of the peak is {share:.4g}, below {fail_below:g}"
        )
