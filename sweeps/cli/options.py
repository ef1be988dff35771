"""Checks of options that several commands have."""

from __future__ import annotations

import os
from pathlib import Path

from sweeps.errors import Refused


def check_csv(path: Path | None) -> None:
    """Refuse a file that is no .csv file in an existing folder."""
    if path is not None and not (path.suffix == ".csv" and os.path.isdir(path.absolute().parent)):
        raise Refused(f"--csv {path} is not allowed; expected: a .csv file in an existing folder")


def check_threads(threads: int | None) -> None:
    """Refuse a number of threads that numba does not have."""
    import numba

    cores: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    if threads is not None and not 1 <= threads <= cores:
        raise Refused(f"--threads {threads} is not allowed; expected: an integer from 1 to {cores}")
