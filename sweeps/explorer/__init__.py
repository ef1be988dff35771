"""The live picture: a bifurcation diagram in the browser that is computed anew with every view.

It is the only room that imports Bokeh. `sweeps.explore(config)` opens it.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sweeps.config.sweep import SweepConfig
    from sweeps.explorer.server import Explorer


def explore(config: SweepConfig, port: int = 0, folder: Path | None = None) -> Explorer:
    """Open the live picture of a configuration.

    Parameters
    ----------
    config : SweepConfig
        From `sweeps.load_config`. Each point is computed from its own start: ``follow`` and
        ``refine`` are left out.
    port : int, optional
        By default any that is free.
    folder : Path, optional
        Where the page saves configurations, by default the present one.

    Returns
    -------
    Explorer
        The page, where it is the value of a cell in Jupyter; elsewhere, its ``address`` is for a
        browser on this machine. ``close()`` ends it.

    Raises
    ------
    Refused
        If Bokeh is not installed, or the port is in use.
    """
    from sweeps.errors import Refused

    if config.points is not None:
        raise Refused("the live picture is over axes, and the points are the rows of a table")
    try:
        import bokeh  # noqa: F401
    except ImportError:
        raise Refused(
            "the live picture needs Bokeh, which is not installed; install it with\n"
            "pip install 'vibroimpact[explore]'"
        ) from None
    from sweeps.explorer.server import Explorer

    return Explorer(config, port, folder)
