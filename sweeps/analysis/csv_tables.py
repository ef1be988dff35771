"""Tables as CSV files."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from sweeps.store.replacing import replacing


def write_rows(path: Path, columns: Sequence[object], rows: Iterable[Sequence[object]]) -> None:
    """Write a table to a CSV file, whole or not at all.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    target = Path(os.path.realpath(path))  # resolve() raises where links make a loop
    with replacing(target) as new, new.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)
