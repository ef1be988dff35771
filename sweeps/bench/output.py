"""The files that a measurement leaves: a picture in the style of all pictures, and a table."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from sweeps.plotting.saving import save
from sweeps.plotting.style import STYLE


def draw(output: Path, picture: Callable[..., Figure], *measured: object) -> None:
    """Draw into a file what a function of the measurements returns.

    Raises
    ------
    Failed
        If the picture cannot be written.
    """
    with mpl.rc_context(STYLE):
        save(picture(*measured), output)
