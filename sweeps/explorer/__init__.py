"""The live page in the browser.

This is the only room that imports Bokeh. `sweeps.explore(config)` opens the page.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sweeps.config.sweep import SweepConfig
    from sweeps.explorer.server import Explorer


def explore(
    config: SweepConfig | Mapping[str, Any] | str | Path,
    port: int = 0,
    folder: str | Path | None = None,
) -> Explorer:
    """Open the live picture of a configuration.

    Parameters
    ----------
    config : SweepConfig, mapping, str or Path
        From `sweeps.load_config`, or an argument for it. ``follow`` is ignored: each
        point is computed from its own start.
    port : int, optional
        By default any free port.
    folder : str or Path, optional
        Where the page saves configurations, by default the current folder.

    Returns
    -------
    Explorer
        A running server. Jupyter shows it as the page itself if it is the value of a cell;
        otherwise open its ``address`` in a browser on this machine. ``close()`` ends it.

    Raises
    ------
    Refused
        If Bokeh is not installed, or the port is in use.

    Examples
    --------
    >>> page = sweeps.explore(scene)  # of the example of `run_sweep`
    >>> page.address.startswith("http://127.0.0.1:")
    True
    >>> page.close()
    """
    from sweeps.config.loading import load_config
    from sweeps.config.sweep import SweepConfig
    from sweeps.errors import Refused
    from vibroimpact.inputs import Allowed, integer

    integer(0, 65535).checked("port", port, Refused)
    existing = Allowed(
        lambda value: isinstance(value, str | Path) and os.path.isdir(value), "an existing folder"
    )
    existing.checked("folder", Path() if folder is None else folder, Refused)
    if not isinstance(config, SweepConfig):
        config = load_config(config)
    if config.points is not None:
        raise Refused("the live picture needs axes; this sweep has the rows of a table as points")
    try:
        import bokeh  # noqa: F401
    except ImportError:
        raise Refused(
            "the live picture needs Bokeh, which is not installed; install it, in a clone of the "
            "program, with pip install '.[explore]'"
        ) from None
    from sweeps.explorer.server import Explorer

    return Explorer(config, port, None if folder is None else Path(folder))
