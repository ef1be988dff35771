"""The complete file of a sweep: written in one pass, verified before HDF5 opens it, and read.

HDF5 hangs or crashes on some damaged files: in a small sweep, a flipped bit did so in about one of
a thousand bytes. Therefore a trailer follows the data of HDF5, which ignores it. The trailer lists
the parts of the file, with the variable and the checksum of each. It is read from the end of the
file without HDF5, and HDF5 opens the file only if the checksums agree.
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

#: The end of the trailer: size and checksum of the table before it, magic.
_END = struct.Struct("<QI8s")
#: Name in the table for bytes outside the data of variables: coordinates, attributes, metadata.
_REST = "rest"
#: Most bytes under one checksum, so that several threads can share the work.
_PIECE = 1 << 22

#: A part of the file: variable, start, size and checksum.
Row = tuple[str, int, int, int]


class _Draft(io.FileIO):
    """A file for HDF5 to write to, whose `write` never fails but keeps the error for later.

    If a write fails while HDF5 closes a file, for example on a full disk, HDF5 kills the process.
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
        """Raise the kept error, if there is one."""
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
    """Write the complete file of a sweep to `path`, where there is an empty file.

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
        finally:  # this error tells more than the error of HDF5 that follows from it
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
    """Return start and size of each part of the file that holds data of a variable."""
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
    """Return the checksum of the part of the file in each row."""

    def checksum(row: Row) -> int:
        if row[0] != _REST:  # this part is also read after an interrupt, to report what was done
            check()
        with path.open("rb") as file:
            file.seek(row[1])
            return zlib.crc32(file.read(row[2]))

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(checksum, rows))


def check_file(path: Path, *, verify: bool = True) -> None:
    """Refuse a file that is not a complete sweep file, or that is damaged.

    Without `verify`, the data of variables are not compared with their checksums. The StoreError
    names the damaged variables.
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
            "what is in it cannot be trusted; run its configuration again, and overwrite it"
        )
    if damaged:
        raise StoreError(
            f"{path} is damaged: {', '.join(damaged)}; to compute it again: "
            f"vibroimpact run {path} -o NEW.h5"
        )


def _rows(file: io.BufferedReader) -> list[Row] | None:
    """Return the table of a file; None without a sound table that covers the whole file."""
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

    If the sweep is not complete, the journal beside `path` is opened. Points that it does not
    contain have the status ``PENDING``.

    Parameters
    ----------
    path : str or Path
        The file of the sweep, also while only its journal exists.
    verify : bool
        Whether to compare the data with their checksums, which reads the whole file once. The rest
        of the file is always compared with its checksums.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    StoreError
        If the file does not exist, is not a readable sweep of this format, or is damaged.

    Examples
    --------
    >>> import sweeps
    >>> omega = {"start": 2.6, "stop": 2.7, "num": 20}
    >>> scene = {"oscillator": {"h": 0.1, "R": 0.8, "omega": omega, "f": 1.0}}
    >>> ds = sweeps.open_sweep(sweeps.run_sweep(scene, "flip.h5", overwrite=True))
    >>> ds["period"].values
    array([1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2])
    """
    import xarray as xr  # slow to import

    path = Path(path)
    try:
        if content(path) in (None, Content.NOTHING):
            with suppress(FileNotFoundError):  # no journal, or a run has just completed the file
                from sweeps.store.partial import open_journal

                return open_journal(Journal(journal_path(path), verify=verify))
        check_file(path, verify=verify)
        return xr.open_dataset(path, engine="h5netcdf")
    except (OSError, ValueError) as error:
        raise StoreError(f"{str(path)!r} cannot be read: {reason(error)}") from error


def schema_of(path: Path) -> Schema:
    """Verify a complete file and return its schema."""
    check_file(path)
    with h5py.File(path, "r") as file:
        return schema_in(file)


def per_point(path: Path, names: Iterable[str]) -> tuple[dict[str, np.ndarray], float]:
    """Return those of the variables, with a single value per point, that the file has.

    Also returns the duration of the run [s].
    """
    check_file(path, verify=False)
    with h5py.File(path, "r") as file:
        held = {name: file[name][()] for name in names if name in file}
        return held, float(file.attrs["duration"])


def status_counts(variables: Mapping[Any, Any]) -> dict[Status, int]:
    """Count the points of a sweep with each outcome, including the outcomes without points."""
    values = np.asarray(variables["status"])
    return {status: int(np.count_nonzero(values == status)) for status in Status}
