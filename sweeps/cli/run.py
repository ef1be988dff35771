"""The commands ``run`` and ``explore``: plan, run and report; the browser that opens the page."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sweeps.cli import common
from sweeps.errors import Failed, Refused
from sweeps.interrupts import Cancelled, check, raised_at_once, signal_came
from sweeps.text import command, progress_shown, shortened
from vibroimpact.inputs import integer

if TYPE_CHECKING:
    from distributed import Client

    from sweeps.config.sweep import SweepConfig
    from sweeps.opened.opened_sweep import OpenedSweep


def _completed_keys(incomplete: str) -> list[str]:
    """Return the keys that begin with a text; those of a range if the text names the range."""
    from sweeps.config.sweep import dotted_keys

    keys = dotted_keys(1 + max(1, incomplete.count(".")))
    return [f"{key}=" for key in keys if key.startswith(incomplete)]


OVERRIDES = common.option(
    "KEY=VALUE",
    "Override a value, e.g. oscillator.h=0.2, or oscillator.omega.start=2.71 in a range; "
    "repeatable.",
    "--set",
    autocompletion=_completed_keys,
    default=[],
)
DASK = common.option(
    "ADDRESS",
    "Compute on a Dask cluster: tcp://HOST:PORT of its scheduler, or local:N for N processes of "
    "this machine.",
)
DRY_RUN = common.flag("--dry-run", "Show the plan of the sweep, and compute nothing.")
QUIET = common.flag("--quiet", "Print nothing but errors.")


def run_command(
    configs: list[Path] = common.argument(
        "CONFIG...", "The YAML file of each sweep, or a sweep file whose configuration is used."
    ),
    output: Path | None = common.option(
        "OUT.h5",
        "The file to write, instead of the output in CONFIG; for a single CONFIG.",
        "-o",
        "--output",
    ),
    overrides: list[str] = OVERRIDES,
    threads: int | None = common.THREADS,
    dask: str | None = DASK,
    dry_run: bool = DRY_RUN,
    resume: bool = common.RESUME,
    overwrite: bool = common.OVERWRITE,
    quiet: bool = QUIET,
) -> None:
    """Compute the sweep that each CONFIG describes, one after the other."""
    from sweeps.store.paths import check_output, refuse_both
    from sweeps.store.schema import refuse_columns

    existing = {"overwrite": overwrite, "resume": resume}
    refuse_both(**existing)
    loaded = []
    for source in configs:
        check()
        config = read_config(source, overrides)
        with common.named(source):
            refuse_columns(config.columns)
        loaded.append(config)
    paths = common.targets(configs, output, [config.output for config in loaded])
    for source, path in zip(configs, paths, strict=True):
        check()
        of_source = output is None and not path.parent.is_dir()
        with common.named(f"{source}: output") if of_source else nullcontext():
            check_output(path, **existing)
    with client_of(dask, threads) as client:
        if dry_run:
            texts = [
                planned_text(config, path, threads, client, resume)
                for config, path in zip(loaded, paths, strict=True)
            ]
            common.say("\n\n".join(texts))
            return
        to_draw = [
            path
            for config, path in zip(loaded, paths, strict=True)
            if run_and_report(config, path, quiet, threads=threads, client=client, **existing)
        ]
    if to_draw and not quiet:
        common.say(f"next: {command('plot', *to_draw)}")


def read_config(path: Path, overrides: Sequence[str] = (), *, verify: bool = False) -> SweepConfig:
    """Read the configuration of a sweep from a YAML file or from a sweep file."""
    from sweeps.config.loading import load_config
    from sweeps.store.paths import is_sweep

    if not is_sweep(path):
        if path.suffix == ".h5" and os.path.exists(path):
            raise Refused(
                f"{path} is no file of a sweep; a configuration must not have the ending .h5"
            )
        with raised_at_once():  # reading from a pipe may never end
            return load_config(path, overrides)
    from sweeps.opened.opened_sweep import OpenedSweep  # it imports xarray, which is slow
    from sweeps.store.xarray_engine import open_sweep

    with open_sweep(path, verify=verify) as dataset:
        return config_in(OpenedSweep(dataset), path, overrides)


def config_in(sweep: OpenedSweep, path: Path, overrides: Sequence[str]) -> SweepConfig:
    """Return the configuration in an opened file, which is its output, with overrides."""
    from sweeps.config.loading import parse_config

    text, table = sweep.attrs["configuration"], sweep.whole.columns
    config = parse_config(text, f"{path}, its configuration", path.stem, overrides, table)
    if any(override.partition("=")[0].strip() == "output" for override in overrides):
        return config
    return config.model_copy(update={"output": path})


def client_of(address: str | None, threads: int | None) -> AbstractContextManager[Client | None]:
    """Return a context with a client of the cluster at an address, if one is given."""
    if address is None:
        return nullcontext()
    from sweeps.engine.cluster import check_address, connected

    with common.named(f"--dask {shortened(address)}"):
        check_address(address)
    if threads is not None:
        raise Refused(
            f"--threads {threads} is not allowed with --dask, whose workers use the threads that "
            "they were started with; for N processes of this machine give --dask local:N"
        )
    return connected(address)


def planned_text(
    config: SweepConfig, path: Path, threads: int | None, client: Client | None, resume: bool
) -> str:
    """Return the plan of a sweep in words; refuse the sweep if it takes too much."""
    from sweeps.engine.cluster import ClusterComputer
    from sweeps.engine.estimate import expected_cost
    from sweeps.engine.executors import LocalComputer
    from sweeps.reports import plan
    from sweeps.store.parts import finished_points
    from sweeps.store.paths import is_sweep

    computer = LocalComputer(threads) if client is None else ClusterComputer(client)
    with progress_shown(f"estimating the cost of {config.name}"):
        cost = expected_cost(config.sweep, path, computer, resume)
    finished, _ = (finished_points(path) if resume else None) or (0, 0)
    remaining = 0 if resume and is_sweep(path) else config.sweep.size - finished
    return plan(config, path, cost, remaining)


def run_and_report(config: SweepConfig, path: Path, quiet: bool, **options: Any) -> bool:
    """Run a sweep, print its summary or how to go on, and return whether any point has a result."""
    from sweeps import reports
    from sweeps.engine.sweep_run import run_sweep
    from sweeps.store.paths import identities

    old = identities(path) if options["overwrite"] else (None, None)
    try:
        check()
        path = run_sweep(config, path, progress=not quiet, **options)
        summary, has_result = reports.run_summary(path, config.sweep)
    except (Cancelled, KeyboardInterrupt):
        raise Failed(f"interrupted; {reports.kept_text(path, common.resuming(), old)}") from None
    except (Failed, OSError, MemoryError) as error:
        reason = str(error) or type(error).__name__
        raise Failed(
            f"the run failed: {reason}; {reports.kept_text(path, common.resuming(), old)}"
        ) from error
    if not quiet:
        common.say(summary)
    return has_result


#: Interval of the checks for signals [s].
_BETWEEN_CHECKS = 0.05


def explore_command(
    source: Path | None = common.argument(
        "[CONFIG|OUT.h5]", "A configuration or a sweep file; the quickstart if not given.", None
    ),
    overrides: list[str] = OVERRIDES,
    port: int = common.numeric(
        "--port", integer(0, 65535), "Port on this machine; a free one if not given.", default=0
    ),
    no_browser: bool = common.flag("--no-browser", "Show the address without opening a browser."),
) -> None:
    """Look at a diagram in the browser: every zoom, pan or slider computes it anew."""
    import logging
    import time
    from tempfile import TemporaryDirectory

    from sweeps import explore as open_page
    from sweeps.config.loading import parse_config

    config = (
        parse_config(common.scenes()["quickstart"], "quickstart", "quickstart", overrides)
        if source is None
        else read_config(source, overrides, verify=True)
    )
    logging.getLogger("bokeh").setLevel(logging.ERROR)  # do not report refused requests
    explorer = open_page(config, port)
    try:
        if config.follow is not None:
            common.say("follow is left out here: each point has its own start", error=True)
        if config.record.transient == "auto":
            common.say("transient: auto is left out here: all points have the default", error=True)
        common.say(f"{explorer.address}\nCtrl-C ends it.")
        with TemporaryDirectory(prefix="vibroimpact-") as private:
            if not no_browser and not _open_browser(_redirection(explorer.address, Path(private))):
                common.say("no browser can be opened here; open the address in one", error=True)
            while not signal_came():
                time.sleep(_BETWEEN_CHECKS)
    finally:
        explorer.close()


def _redirection(address: str, private: Path) -> str:
    """Write a page that redirects to an address; return the address of the page."""
    from html import escape

    page = private / "explore.html"  # every user can see the arguments of a browser
    page.touch(mode=0o600)
    page.write_text(f'<meta http-equiv="refresh" content="0; url={escape(address)}">\n')
    return page.as_uri()


def _open_browser(address: str) -> bool:
    """Open a browser that does not occupy the terminal; return False if there is none."""
    import webbrowser

    with suppress(webbrowser.Error):
        browser = webbrowser.get()
        return type(browser) is not webbrowser.GenericBrowser and browser.open(address)
    return False
