"""The complete file of a sweep: written in one pass, and verified before HDF5 opens it.

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
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Lock
from typing import Any, BinaryIO, TypeVar

import h5py
import numpy as np

from sweeps.errors import StoreError
from sweeps.grid import Block
from sweeps.interrupts import check
from sweeps.store.paths import (
    FORMAT_VERSION,
    NO_LOCKS,
    Content,
    UnreadableError,
    content,
    error_number,
    open_regular,
)
from sweeps.store.replacing import TRAILER
from sweeps.store.schema import Schema, schema_in, write_schema
from sweeps.text import missing_text

#: The end of the trailer: size and checksum of the table before it, magic.
_END = struct.Struct("<QI8s")
#: Name in the table for bytes outside the data of variables: coordinates, attributes, metadata.
_REST = "rest"
#: Most bytes under one checksum, so that several threads can share the work.
_PIECE = 1 << 22
#: Most bytes of blocks that are gathered, besides the last block.
_GATHERED = 1 << 26
#: Most bytes of an array that is joined with others.
_SMALL = 1 << 17

#: A part of the file: variable, start, size and checksum.
Row = tuple[str, int, int, int]
#: A box of points, and the results of a variable there.
Part = tuple[Block, np.ndarray]
Opened = TypeVar("Opened")


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

    def refuse_error(self) -> None:
        """Raise the kept error, if there is one."""
        if self.error is not None:
            raise self.error


def write_file(
    new: BinaryIO,
    schema: Schema,
    blocks: Iterable[tuple[Block, Mapping[str, np.ndarray]]],
    pieces: Iterable[tuple[str, Block, np.ndarray]],
    seconds: Callable[[], float],
    *,
    compressed: bool,
) -> None:
    """Write the complete file of a sweep to a new file.

    `blocks` has the results of every box of points, without the trajectories; `pieces` has the
    columns of these: the variable, a box of points, and samples of shape (box..., samples).
    `seconds` returns the duration.
    """
    with _Draft(new.fileno(), "r+", closefd=False) as draft:
        try:
            with h5py.File(draft, "w", libver="earliest") as file:
                write_schema(file, schema, compressed=compressed)
                for some in _gathered(blocks):
                    for name in some[0][1]:
                        for box, array in _joined([(box, all_[name]) for box, all_ in some]):
                            _put(file[name], box, array, draft)
                for name, box, array in pieces:
                    _put(file[name], box, array, draft)
                file.attrs["duration"] = seconds()
        finally:  # this error tells more than the error of HDF5 that follows from it
            draft.refuse_error()
    add_table(new, schema.variables)


def _put(dataset: h5py.Dataset, box: Block, array: np.ndarray, draft: _Draft) -> None:
    """Write an array to a box of points; its record may be shorter than the widest."""
    check()
    dataset[(*box, *(slice(0, width) for width in array.shape[len(box) :]))] = array
    draft.refuse_error()


def _gathered(
    blocks: Iterable[tuple[Block, Mapping[str, np.ndarray]]],
) -> Iterator[list[tuple[Block, Mapping[str, np.ndarray]]]]:
    """Gather blocks, so that the chunks of a variable lie side by side in the file."""
    some: list[tuple[Block, Mapping[str, np.ndarray]]] = []
    size = 0
    for block, results in blocks:
        some.append((block, results))
        size += sum(array.nbytes for array in results.values())
        if size > _GATHERED:
            yield some
            some, size = [], 0
    if some:
        yield some


def _joined(parts: Iterable[Part]) -> Iterator[Part]:
    """Join small arrays whose boxes follow each other along an axis, as each call of HDF5 costs."""
    boxes: list[Block] = []
    arrays: list[np.ndarray] = []
    axis = 0
    for box, array in parts:
        differing = [i for i, cut in enumerate(box) if boxes and cut != boxes[-1][i]]
        if (
            len(differing) != 1
            or box[differing[0]].start != boxes[-1][differing[0]].stop
            or (len(boxes) > 1 and differing != [axis])
            or array.nbytes > _SMALL
            or array.shape[len(box) :] != arrays[-1].shape[len(box) :]
        ):
            if boxes:
                yield _join(boxes, arrays, axis)
            boxes, arrays = [], []
        else:
            (axis,) = differing
        boxes.append(box)
        arrays.append(array)
    yield _join(boxes, arrays, axis)


def _join(boxes: Sequence[Block], arrays: Sequence[np.ndarray], axis: int) -> Part:
    """Return the box of boxes that follow each other along an axis, and its array."""
    if len(boxes) == 1:
        return boxes[0], arrays[0]
    first = boxes[0]
    cut = slice(first[axis].start, boxes[-1][axis].stop)
    return (*first[:axis], cut, *first[axis + 1 :]), np.concatenate(arrays, axis)


def add_table(new: BinaryIO, variables: Iterable[str] = ()) -> None:
    """Append the table of checksums to an HDF5 file that has data of these variables."""
    end = new.seek(0, os.SEEK_END)
    with h5py.File(new, "r") as file:
        spans = [(*span, name) for name in variables for span in _spans(file[name])]
    rows: list[Row] = []
    at = 0
    for start, size, name in [*sorted(spans), (end, 0, "")]:
        rows += [(_REST, at, start - at, 0)] * (start > at) + [(name, start, size, 0)] * (size > 0)
        at = start + size
    found = zip(rows, _checksums(new, rows), strict=True)
    table = json.dumps([(*row[:3], crc) for row, crc in found]).encode()
    new.seek(end)
    new.write(table + _END.pack(len(table), zlib.crc32(table), TRAILER))


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


def _checksums(file: BinaryIO, rows: Iterable[Row]) -> list[int]:
    """Return the checksum of the part of the file in each row; threads share the work."""
    reading = Lock()

    def checksum(row: Row) -> int:
        if row[0] != _REST:  # this part is also read after an interrupt, to report what was done
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
            found = _rows(file)
            rows = [row for row in found or () if verify or row[0] == _REST]
            pairs = list(zip(rows, _checksums(file, rows), strict=True))
    except FileNotFoundError:
        raise StoreError(missing_text(path)) from None
    except OSError as error:
        raise UnreadableError(path, error) from error
    kind = content(path) if found is None else Content.SWEEP
    if kind not in (None, Content.SWEEP):
        raise StoreError(f"{path} is {kind.value}")
    damaged = sorted({name for (name, _, _, crc), now in pairs if crc != now})
    if not rows or _REST in damaged:
        raise StoreError(
            f"{path} is damaged outside its results, truncated, changed by another program, or "
            f"not of format version {FORMAT_VERSION}: what is in it cannot be trusted; run its "
            "configuration again, and overwrite it"
        )
    if damaged:
        raise StoreError(
            f"{path} is damaged: {', '.join(damaged)}; to compute it again: "
            f"vibroimpact run {path} -o NEW.h5"
        )
    return _digest(found)


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


def _digest(rows: Sequence[Row] | None) -> str:
    """Return a digest of all data of a complete file, from its table of checksums."""
    return hashlib.blake2b(json.dumps(rows).encode()).hexdigest()[:32]


def open_unchanged(path: Path, digest: str, **options: Any) -> h5py.File:
    """Open a complete file with options of h5py; refuse it if it has another digest."""
    try:
        file = h5py.File(path, **options)
        with path.open("rb") as now:  # after it was opened, or it could still be replaced
            if _digest(_rows(now)) == digest:
                return file
        file.close()
    except FileNotFoundError:
        raise StoreError(f"{path} was removed by another program") from None
    raise StoreError(f"{path} was replaced by another program; open the sweep again")


def open_despite_locks(open_file: Callable[[dict[str, Any]], Opened]) -> Opened:
    """Open a complete file with options of h5py: without a lock, where the file system has none.

    HDF5 locks what it reads. A complete file never changes, but other programs of this process may
    have it open, and HDF5 refuses to open it both with and without a lock.
    """
    try:
        return open_file({})
    except OSError as error:
        if error_number(error) not in NO_LOCKS:
            raise
    return open_file({"locking": False})


def schema_of(path: Path) -> Schema:
    """Verify a complete file and return its schema."""
    check_file(path)
    with open_despite_locks(lambda options: h5py.File(path, "r", **options)) as file:
        return schema_in(file)
