"""The files that a measurement leaves: a picture in the style of all pictures, and a table."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Iterable, Sequence
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


def write_csv(output: Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table to a CSV file, whole or not at all.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    draft = output.with_name(f".{output.name}-{os.getpid()}")
    try:
        with draft.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([columns, *rows])
        os.replace(draft, output)
    finally:
        draft.unlink(missing_ok=True)
