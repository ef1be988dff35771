"""Checks of options that several commands have."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path

from sweeps.errors import Refused

_PER_INCH = {"in": 1.0, "cm": 2.54, "mm": 25.4, "pt": 72.0}


def check_csv(path: Path | None) -> None:
    """Refuse a file that is no .csv file in an existing folder."""
    if path is not None and not (path.suffix == ".csv" and os.path.isdir(path.absolute().parent)):
        raise Refused(f"--csv {path} is not allowed; expected: a .csv file in an existing folder")


def inches(text: str) -> float:
    """Read a width with its unit."""
    match = re.fullmatch(r"\s*([0-9.]+)\s*(in|cm|mm|pt)\s*", text)
    try:
        width = float(match[1]) / _PER_INCH[match[2]] if match else math.nan
    except ValueError:
        width = math.nan
    if not 1.0 <= width <= 40.0:
        raise Refused(
            f"--width {text} is not allowed; expected: a length from 1in to 40in, as 3.4in, 8.6cm, "
            "86mm or 245pt"
        )
    return width


def limits(option: str, text: str) -> tuple[float, float]:
    """Read the limits of an axis."""
    low, colon, high = text.partition(":")
    try:
        ends = float(low), float(high)
    except ValueError:
        ends = math.nan, math.nan
    if not (colon and math.isfinite(ends[0]) and math.isfinite(ends[1]) and ends[0] < ends[1]):
        raise Refused(
            f"{option} {text} is not allowed; expected: LOW:HIGH, two numbers of which the first "
            "is smaller, as 2.4:3"
        )
    return ends


def check_threads(threads: int | None) -> None:
    """Refuse a number of threads that numba does not have."""
    import numba

    cores: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    if threads is not None and not 1 <= threads <= cores:
        raise Refused(f"--threads {threads} is not allowed; expected: an integer from 1 to {cores}")
