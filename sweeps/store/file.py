"""The complete file of a sweep: written in one pass, verified before HDF5 opens it, and read.

HDF5 loops or crashes on some damaged files: of the bytes of a small sweep, about one in a thousand,
with one bit flipped, hung or killed it. So a trailer follows what HDF5 has written, which HDF5 does
not look at: the checksum of every part of the file, and which variable lies there. It is found
from the end of the file without HDF5, which opens only what fits.
"""

from __future__ import annotations

import io
import json
import os
import struct
import zlib
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from sweeps.errors import StoreError
from sweeps.grid import Block
from sweeps.interrupts import check
from sweeps.store.journal import Journal
from sweeps.store.paths import (
    TRAILER,
    Content,
    content,
    journal_path,
    open_regular,
    reason,
    refuse_version,
)
from sweeps.store.schema import Schema, describe, schema_in
from vibroimpact.status import Status

if TYPE_CHECKING:
    import xarray as xr

#: How the trailer ends: size and checksum of the table before it, magic.
_END = struct.Struct("<QI8s")
#: The name in the table of what is no data of a variable: coordinates, attributes, HDF5's own.
_REST = "rest"
#: Bytes under one checksum at most, so that several threads have work.
_PIECE = 1 << 22

#: A part of the file: variable, start, size and checksum.
Row = tuple[str, int, int, int]


class _Draft(io.FileIO):
    """A file that HDF5 writes into, and that keeps an error for later.

    HDF5 kills the process when it cannot write while it closes a file, on a full disk, say.
    """

    error: BaseException | None = None

    def write(self, data: Any) -> int:
        view = memoryview(data)
        try:
            while view and self.error is None:
                view = view[super().write(view) :]
        except BaseException as error:
            self.error = error
        return len(data)

    def refuse_error(self) -> None:
        """Raise the error that was kept."""
        if self.error is not None:
            raise self.error


def write_file(
    path: Path,
    schema: Schema,
    parts: Callable[[str], Iterable[tuple[Block, np.ndarray]]],
    seconds: Callable[[], float],
    *,
    compressed: bool,
) -> None:
    """Write the complete file of a sweep in place of an empty one.

    `parts` yields the boxes of a variable with their results, and `seconds` returns the duration.
    """
    with _Draft(path, "w+") as draft:
        try:
            with h5py.File(draft, "w", libver="earliest") as file:
                describe(file, schema, compressed=compressed)
                for name in schema.variables:
                    dataset = file[name]
                    for box, array in parts(name):
                        check()
                        dataset[box] = array
                        draft.refuse_error()
                file.attrs["duration"] = seconds()
        finally:  # instead of what HDF5 says of it
            draft.refuse_error()
    with h5py.File(path, "r") as file:
        spans = [(*span, name) for name in schema.variables for span in _spans(file[name])]
    rows: list[Row] = []
    at = 0
    for start, size, name in [*sorted(spans), (path.stat().st_size, 0, "")]:
        rows += [(_REST, at, start - at, 0)] * (start > at) + [(name, start, size, 0)] * (size > 0)
        at = start + size
    found = zip(rows, _checksums(path, rows), strict=True)
    table = json.dumps([(*row[:3], crc) for row, crc in found]).encode()
    with path.open("ab") as end:
        end.write(table + _END.pack(len(table), zlib.crc32(table), TRAILER))


def _spans(dataset: h5py.Dataset) -> list[tuple[int, int]]:
    """Return start and size of the parts of a file that hold the data of a variable."""
    if dataset.chunks is None:
        return [(dataset.id.get_offset(), dataset.nbytes)] if dataset.nbytes else []
    chunks: list[tuple[int, int]] = []
    dataset.id.chunk_iter(lambda chunk: chunks.append((chunk.byte_offset, chunk.size)))
    spans: list[tuple[int, int]] = []
    for start, size in sorted(chunks):
        if spans and sum(spans[-1]) == start and spans[-1][1] + size <= _PIECE:
            spans[-1] = (spans[-1][0], spans[-1][1] + size)
        else:
            spans.append((start, size))
    return spans


def _checksums(path: Path, rows: Iterable[Row]) -> list[int]:
    """Return the checksum of the part of a file that each row names."""

    def checksum(row: Row) -> int:
        if row[0] != _REST:  # which is also read to say what an interrupted run has done
            check()
        with path.open("rb") as file:
            file.seek(row[1])
            return zlib.crc32(file.read(row[2]))

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(checksum, rows))


def check_file(path: Path, *, verify: bool = True) -> None:
    """Refuse what is not the complete file of a sweep, or is damaged.

    Without `verify`, only what is not the data of a variable is compared with its checksums.
    Raises StoreError, which names the damaged variables.
    """
    try:
        with open_regular(path) as file:
            rows = _rows(file)
    except FileNotFoundError:
        raise StoreError(f"{path} does not exist") from None
    found = content(path) if rows is None else Content.SWEEP
    if found is Content.JOURNAL:
        output = str(path).removesuffix(".part")
        raise StoreError(f"{path} is the journal of a sweep that is not complete; give {output}")
    if found is Content.OLDER:
        refuse_version(path)
    if found not in (None, Content.SWEEP):
        raise StoreError(f"{path} is {found.value}")
    rows = [row for row in rows or () if verify or row[0] == _REST]
    pairs = zip(rows, _checksums(path, rows), strict=True)
    damaged = sorted({name for (name, _, _, crc), now in pairs if crc != now})
    if not rows or _REST in damaged:
        raise StoreError(
            f"{path} is damaged outside its results, truncated, or changed by another program: "
            "what is in it cannot be trusted; run its configuration again with overwrite=True"
        )
    if damaged:
        raise StoreError(
            f"{path} is damaged: {', '.join(damaged)}; to compute it again: "
            f"vibroimpact run {path} -o NEW.h5"
        )


def _rows(file: io.BufferedReader) -> list[Row] | None:
    """Return the table of a file; None if there is none that is sound and covers the file."""
    size = os.fstat(file.fileno()).st_size
    file.seek(max(0, size - _END.size))
    end = file.read()
    if len(end) < _END.size or not end.endswith(TRAILER):
        return None
    length, crc, _ = _END.unpack(end)
    start = size - _END.size - length
    if start < 0:
        return None
    file.seek(start)
    table = file.read(length)
    if zlib.crc32(table) != crc:
        return None
    rows: list[Row] = json.loads(table)
    return rows if sum(row[2] for row in rows) == start else None


def open_sweep(path: str | Path, *, verify: bool = True) -> xr.Dataset:
    """Open the file of a sweep; its arrays are read when they are used.

    Of a sweep that is not complete the journal beside `path` is opened; points that are not in it
    have the status ``PENDING``.

    Parameters
    ----------
    path : str or Path
    verify : bool
        Whether to compare the data with their checksums, which reads the whole file once.
        Everything else is compared with its own in any case.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    StoreError
        If there is no such file, it is not a readable sweep of this format, or it is damaged.
    """
    import xarray as xr  # which a short run would wait for

    path = Path(path)
    try:
        if content(path) in (None, Content.NOTHING):
            with suppress(FileNotFoundError):  # there is none, or a run has just completed the file
                from sweeps.store.partial import open_journal

                return open_journal(Journal(journal_path(path), verify=verify))
        check_file(path, verify=verify)
        return xr.open_dataset(path, engine="h5netcdf")
    except (OSError, ValueError) as error:
        raise StoreError(f"{str(path)!r} cannot be read: {reason(error)}") from error


def schema_of(path: Path) -> Schema:
    """Return the schema of a complete file, verified."""
    check_file(path)
    with h5py.File(path, "r") as file:
        return schema_in(file)


def per_point(path: Path, names: Iterable[str]) -> tuple[dict[str, np.ndarray], float]:
    """Read variables with one value for each point of a complete file, and the duration [s]."""
    check_file(path, verify=False)
    with h5py.File(path, "r") as file:
        return {name: file[name][()] for name in names}, float(file.attrs["duration"])


def status_counts(variables: Mapping[Any, Any]) -> dict[Status, int]:
    """Count the points of a sweep by outcome, also where there is none, from its ``status``."""
    values = np.asarray(variables["status"])
    return {status: int(np.count_nonzero(values == status)) for status in Status}
