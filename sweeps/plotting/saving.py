"""Writing a figure: which files are allowed, and a file that is replaced whole or not at all."""

from __future__ import annotations

import os
import warnings
from contextlib import suppress
from pathlib import Path

from matplotlib.figure import Figure

from sweeps.analysis.selection import listed
from sweeps.errors import Failed, Refused
from sweeps.plotting.style import DPI

FORMATS = ("png", "svg", "pdf")


def check_picture(output: Path) -> None:
    """Refuse a path that no picture can be written to.

    Raises
    ------
    Refused
        If its ending is none of ``FORMATS``, or its folder does not exist.
    """
    if output.suffix.lower().lstrip(".") not in FORMATS:
        raise Refused(f"{output} must end in one of {listed('.' + f for f in FORMATS)}")
    if not os.path.isdir(output.parent):  # which, unlike Path.is_dir(), never raises
        raise Refused(f"the folder {output.parent} of the picture {output.name} does not exist")
    if os.path.isdir(output):
        raise Refused(f"{output} is a directory; give -o the name of a file")


def save(figure: Figure, output: Path) -> None:
    """Write a figure to a draft beside `output`, then move the draft there.

    Raises
    ------
    Failed
        If it cannot be written.
    """
    target = Path(os.path.realpath(output))  # resolve() raises where links make a loop
    draft = target.with_name(f".picture-{os.getpid()}{output.suffix}")
    try:
        with warnings.catch_warnings():
            # The name of a sweep may be in a script that the font lacks: it is drawn as boxes.
            warnings.filterwarnings("ignore", "Glyph", UserWarning)
            figure.savefig(draft, dpi=DPI)
        os.replace(draft, target)
    except OSError as error:
        raise Failed(f"{output} cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):  # which must not hide why there is none
            draft.unlink()
