"""The command that opens the live picture: arguments and exit codes only."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sweeps.cli.options import say
from sweeps.interrupts import came

if TYPE_CHECKING:
    from sweeps.config.sweep import SweepConfig

#: How often a signal is looked for [s].
_WAIT = 0.05


def explore(
    source: Annotated[
        Path | None,
        typer.Argument(
            metavar="[CONFIG|OUT.h5]",
            help="A configuration, or the file of a sweep; the quickstart if not given.",
        ),
    ] = None,
    port: Annotated[
        int, typer.Option(metavar="N", help="Port on this machine; any that is free if not given.")
    ] = 0,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Show the address, and open no browser.")
    ] = False,
) -> None:
    """Look at a diagram in the browser: every zoom, pan or slider computes it anew."""
    import logging
    import time
    from tempfile import TemporaryDirectory

    from sweeps import explore as open_page

    config = _configuration(source)
    for logger in ("tornado.access", "bokeh"):  # a refused request is no news for the terminal
        logging.getLogger(logger).setLevel(logging.ERROR)
    explorer = open_page(config, port)
    try:
        for line in _left_out(config):
            say(line, error=True)
        say(f"{explorer.address}\nCtrl-C ends it.")
        with TemporaryDirectory(prefix="vibroimpact-") as private:
            if not no_browser and not _open(_redirection(explorer.address, Path(private))):
                say("no browser can be opened here; open the address in one", error=True)
            while not came():
                time.sleep(_WAIT)
    finally:
        explorer.close()


def _configuration(source: Path | None) -> SweepConfig:
    """Read what to look at; a file of a sweep is checked whole, as for a picture of it."""
    from sweeps.config.loading import parse_config
    from sweeps.config.scenes import scenes
    from sweeps.engine.configurations import read_config
    from sweeps.store import is_sweep, open_sweep

    if source is None:
        return parse_config(scenes()["quickstart"], "quickstart", "quickstart")
    if is_sweep(source):
        open_sweep(source).close()
    return read_config(source)


def _left_out(config: SweepConfig) -> list[str]:
    """Say what of a configuration the live picture does not do."""
    keys = {
        "follow": config.follow is not None,
        "refine": config.refine is not None,
    }
    reason = "each point is computed from its own start, with the method exact by default"
    return [f"{key} is left out here: {reason}" for key, present in keys.items() if present]


def _redirection(address: str, private: Path) -> str:
    """Write a page that leads to an address; return its own address.

    Every user of the machine sees the arguments of a browser, and must not see that one.
    """
    from html import escape

    page = private / "explore.html"
    page.touch(mode=0o600)
    page.write_text(f'<meta http-equiv="refresh" content="0; url={escape(address)}">\n')
    return page.as_uri()


def _open(address: str) -> bool:
    """Open a browser, but none that would take the terminal; return whether there is one."""
    import webbrowser

    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        return False
    if type(browser) is webbrowser.GenericBrowser:
        return False
    return browser.open(address)
