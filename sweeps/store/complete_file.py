"""The complete file: written in one pass, verified by its checksums before HDF5 opens it.

HDF5 hangs or crashes on some damaged files: in a small sweep, a flipped bit did so in about one of
a thousand bytes. Therefore a trailer follows the data of HDF5, which ignores it. The trailer lists
the parts of the file, with the variable and the checksum of each. It is read from the end of the
file without HDF5, and HDF5 opens the file only if the checksums agree.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import struct
import time
import zlib
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import Any, BinaryIO

import h5py
import numpy as np

from sweeps.errors import StoreError
from sweeps.grid import Block
from sweeps.interrupts import check
from sweeps.store.paths import FORMAT_VERSION, NO_LOCKS, Content, content, open_regular
from sweeps.store.replacing import TRAILER, UnreadableError, error_number
from sweeps.store.schema import Schema, of_this_form, schema_in, write_schema
from sweeps.text import command, missing_text

#: The end of the trailer: size and checksum of the table before it, magic.
_END = struct.Struct("<QI8s")
#: Name in the table for bytes outside the data of variables: coordinates, attributes, metadata.
_OTHER = "rest"
#: Most bytes under one checksum, so that several threads can share the work.
_PIECE = 1 << 22
#: A part of the file: variable, start, size and checksum.
Row = tuple[str, int, int, int]
#: A variable, a box of points, and the results there, of shape (box..., record); a record may be
#: shorter than the widest.
Piece = tuple[str, Block, np.ndarray]


class _Draft(io.FileIO):
    """A file for HDF5 to write to, which never fails to do so but keeps the error for later.

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

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size) if self.error is None else 0
        except BaseException as error:
            self.error = error
            return 0


def write_file(
    new: BinaryIO,
    schema: Schema,
    pieces: Iterable[Piece] | None,
    began: float = 0.0,
    *,
    compressed: bool = False,
) -> None:
    """Write the complete file of a sweep to a new file, or the schema of an incomplete one.

    `pieces` has all results; without them, the file has the blocks instead. `began` is the time
    from which the duration counts, of `time.monotonic`.
    """
    with _Draft(new.fileno(), "r+", closefd=False) as draft:
        try:
            with h5py.File(draft, "w", libver="earliest") as file:
                write_schema(file, schema, compressed=compressed, with_blocks=pieces is None)
                for name, box, array in pieces or ():
                    check()
                    record = (slice(width) for width in array.shape[len(box) :])
                    file[name][(*box, *record)] = array
                    if draft.error is not None:
                        break
                if pieces is not None:
                    file.attrs["duration"] = time.monotonic() - began
        finally:  # this error tells more than the error of HDF5 that follows from it
            if draft.error is not None:
                raise draft.error
    _add_table(new, schema.variables)


def _add_table(new: BinaryIO, variables: Iterable[str]) -> None:
    """Append the table of checksums to an HDF5 file that has these variables, with data or not."""
    end = new.seek(0, os.SEEK_END)
    spans: list[tuple[int, int, str]] = []
    with h5py.File(new, "r") as file:
        for name in variables:
            data = file[name]
            chunks: list[Any] = []
            if data.chunks is not None:
                data.id.chunk_iter(chunks.append)
            elif (offset := data.id.get_offset()) is not None:
                spans.append((offset, data.nbytes, name))
            spans += [(chunk.byte_offset, chunk.size, name) for chunk in chunks]
    rows: list[Row] = []
    at = 0
    for start, size, name in [*sorted(spans), (end, 0, "")]:
        if start > at:
            rows.append((_OTHER, at, start - at, 0))
        if rows[-1][0] == name and rows[-1][2] + size <= _PIECE:  # beside the one before
            rows[-1] = (name, rows[-1][1], rows[-1][2] + size, 0)
        elif size > 0:
            rows.append((name, start, size, 0))
        at = start + size
    pairs = zip(rows, _checksums(new, rows), strict=True)
    table = json.dumps([(*row[:3], crc) for row, crc in pairs]).encode()
    new.seek(end)
    new.write(table + _END.pack(len(table), zlib.crc32(table), TRAILER))


def _checksums(file: BinaryIO, rows: Iterable[Row]) -> list[int]:
    """Return the checksum of the part of the file in each row; threads share the work."""
    reading = Lock()

    def checksum(row: Row) -> int:
        if row[0] != _OTHER:  # these are also read after an interrupt, to report what was done
            check()
        with reading:
            file.seek(row[1])
            data = file.read(row[2])
        return zlib.crc32(data)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(checksum, rows))


def check_file(path: Path, *, verify: bool = True) -> str:
    """Refuse a file that is not a complete sweep file, or that is damaged; return its digest.

    Without `verify`, the data of variables are not compared with their checksums. The StoreError
    names the damaged variables.
    """
    try:
        with open_regular(path) as file:
            table, digest = _table(file)
            rows = [row for row in table if verify or row[0] == _OTHER]
            pairs = list(zip(rows, _checksums(file, rows), strict=True))
    except FileNotFoundError:
        raise StoreError(missing_text(path)) from None
    except OSError as error:
        raise UnreadableError(path, error) from error
    kind = Content.SWEEP if table else content(path)
    if kind not in (None, Content.SWEEP):
        raise StoreError(f"{path} is {kind.value}")
    damaged = sorted({name for (name, _, _, crc), now in pairs if crc != now})
    if not rows or _OTHER in damaged:
        raise StoreError(
            f"{path} is damaged outside its results, truncated, changed by another program, or "
            f"not of format version {FORMAT_VERSION}: what is in it cannot be trusted; run its "
            "configuration again, and overwrite it"
        )
    if damaged:
        raise StoreError(
            f"{path} is damaged: {', '.join(damaged)}; to compute it again: "
            f"{command('run', path)} -o NEW.h5"
        )
    return digest


def _table(file: BinaryIO) -> tuple[list[Row], str]:
    """Return the table of a file and a digest of it; empty without one that covers the file."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - _END.size))
    footer = file.read()
    if len(footer) == _END.size and footer.endswith(TRAILER):
        length, crc, _ = _END.unpack(footer)
        start = size - _END.size - length
        file.seek(max(0, start))
        table = file.read(length) if start > 0 else b""
        if table and zlib.crc32(table) == crc:
            with suppress(ValueError, TypeError, RecursionError):  # sound, but of another form
                rows, at = json.loads(table), 0
                for row in rows:
                    if [*map(type, row)] != [str, int, int, int] or row[1] != at or row[2] < 1:
                        return [], ""
                    at += row[2]
                if at == start:
                    return rows, hashlib.blake2b(table).hexdigest()[:32]
    return [], ""


def open_file(path: Path, digest: str, *, mode: str = "r") -> h5py.File:
    """Open a complete file with HDF5; refuse it if it has another digest than when it was checked.

    HDF5 locks what it reads; where the file system has no locks, it goes without. A complete file
    never changes, but other programs of this process may have it open, and HDF5 refuses to open it
    both with and without a lock. A manager of xarray gives the `mode`: one that is sent to another
    process, as by Dask, gives one in any case.
    """
    try:
        open_regular(path).close()  # HDF5 would wait for the writer of a FIFO
        try:
            file = h5py.File(path, mode)
        except OSError as error:
            if error_number(error) not in NO_LOCKS:
                raise
            file = h5py.File(path, mode, locking=False)
        with open_regular(path) as now:  # after it was opened, or it could still be replaced
            if _table(now)[1] == digest:
                return file
        file.close()
    except FileNotFoundError:
        raise StoreError(f"{path} was removed by another program") from None
    except OSError as error:
        raise UnreadableError(path, error) from error
    raise StoreError(f"{path} was replaced by another program; open the sweep again")


def schema_of(path: Path) -> Schema:
    """Verify a complete file and return its schema."""
    with open_file(path, check_file(path)) as file, of_this_form(path):
        return schema_in(file)


def schema_in_parts(path: Path) -> tuple[Schema, int]:
    """Verify the schema of an incomplete sweep; return it and the checksum of these very bytes."""
    data = b""
    while check_file(path) != _table(io.BytesIO(data))[1]:
        data = path.read_bytes()
    with of_this_form(path), h5py.File(io.BytesIO(data)) as file:
        return schema_in(file), zlib.crc32(data)


def per_point(path: Path, names: Iterable[str]) -> tuple[dict[str, np.ndarray], float]:
    """Return those variables of one value per point that a file has, and the duration [s]."""
    with open_file(path, check_file(path, verify=False)) as file, of_this_form(path):
        values = {name: file[name][()] for name in names if name in file}
        return values, float(file.attrs["duration"])
