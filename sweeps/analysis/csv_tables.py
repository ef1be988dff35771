"""Tables as CSV files."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

from sweeps.store.replacing import replacing


def write_rows(path: Path, columns: Sequence[object], rows: Iterable[Sequence[object]]) -> None:
    """Write a table to a CSV file, whole or not at all.

    Raises
    ------
    Refused, Failed
        If the file cannot be written there, as from `replacing`.
    """
    with replacing(path, "table") as new, new.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(rows)
