"""The command ``explore``, and the browser that opens the page."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from sweeps.cli.options import argument, flag, numeric, say
from sweeps.cli.run import read_config
from sweeps.interrupts import signal_came
from vibroimpact.inputs import integer

if TYPE_CHECKING:
    from sweeps.config.sweep import SweepConfig

#: Interval of the checks for signals [s].
_BETWEEN_CHECKS = 0.05


def explore_command(
    source: Path | None = argument(
        "[CONFIG|OUT.h5]", "A configuration or a sweep file; the quickstart if not given.", None
    ),
    port: int = numeric(
        "--port", integer(0, 65535), "Port on this machine; a free one if not given.", default=0
    ),
    no_browser: bool = flag("--no-browser", "Show the address without opening a browser."),
) -> None:
    """Look at a diagram in the browser: every zoom, pan or slider computes it anew."""
    import logging
    import time
    from tempfile import TemporaryDirectory

    from sweeps import explore as open_page

    config = _configuration(source)
    logging.getLogger("bokeh").setLevel(logging.ERROR)  # do not report refused requests
    explorer = open_page(config, port)
    try:
        if config.follow is not None:
            reason = "each point is computed from its own start, with the method exact by default"
            say(f"follow is left out here: {reason}", error=True)
        say(f"{explorer.address}\nCtrl-C ends it.")
        with TemporaryDirectory(prefix="vibroimpact-") as private:
            if not no_browser and not _open_browser(_redirection(explorer.address, Path(private))):
                say("no browser can be opened here; open the address in one", error=True)
            while not signal_came():
                time.sleep(_BETWEEN_CHECKS)
    finally:
        explorer.close()


def _configuration(source: Path | None) -> SweepConfig:
    """Read the configuration to show; a sweep file is verified completely, as for a picture."""
    from sweeps.config import scenes
    from sweeps.config.loading import parse_config
    from sweeps.store import is_sweep, open_sweep

    if source is None:
        return parse_config(scenes()["quickstart"], "quickstart", "quickstart")
    if is_sweep(source):
        open_sweep(source).close()
    return read_config(source)


def _redirection(address: str, private: Path) -> str:
    """Write a page that redirects to an address; return the address of the page.

    Every user of the machine can see the arguments of a browser, but must not see the address.
    """
    from html import escape

    page = private / "explore.html"
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
