"""The ledger of a sweep's file: which blocks are in it, and a checksum of every byte.

It is the last dataset of the file, as bytes: one row per block, then the seal. The seal says which
parts of the file are filled block by block and holds a checksum of all the rest, that is of
coordinates, attributes and HDF5's own structures, which never change once the file is laid out.
It is found from the end of the file without HDF5, whose library loops or crashes on some
damaged files: of the bytes of a small sweep, about one in a thousand, with one bit flipped, hung
or killed it. So HDF5 is only given what the seal vouches for.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

#: One row: checksum of the block's data, samples of its longest trajectory, check of these two.
#: All zero: the block is not in the file.
ROW = np.dtype([("crc", "<u4"), ("samples", "<u4"), ("check", "<u4")])

_MAGIC = b"\x89VIBROL\n"
_SPAN = np.dtype([("start", "<u8"), ("size", "<u8")])
# Number of rows and of spans, checksum of the rest of the file, checksum of the seal, magic.
_SEAL = struct.Struct("<QQII8s")
# HDF5 may put a little of its own after the last dataset.
_TAIL = 1 << 16
_CHUNK = 1 << 22

Span = tuple[int, int]


class DamageError(Exception):
    """The checksums do not fit."""


def ledger_size(rows: int, spans: int) -> int:
    """Return the bytes of a ledger that tells of that many blocks and filled parts."""
    return rows * ROW.itemsize + spans * _SPAN.itemsize + _SEAL.size


def checksum(arrays: Iterable[np.ndarray]) -> int:
    """Return the CRC-32 of arrays, one after the other."""
    crc = 0
    for array in arrays:
        crc = zlib.crc32(flat_bytes(array), crc)
    return crc


def flat_bytes(array: np.ndarray) -> memoryview:
    """Return the bytes of an array in C order, not copied if they are so already."""
    return memoryview(np.ascontiguousarray(array).reshape(-1)).cast("B")  # type: ignore[arg-type]


class Ledger:
    """The ledger of a file that is open as `descriptor`.

    Attributes
    ----------
    start : int
        Where the rows are.
    rows : ndarray of dtype ``ROW``, shape (blocks,)
        As of the time it was read, and what was entered since.
    filled : sequence of Span
        Start and size of the parts that the seal does not guard.
    """

    def __init__(
        self, descriptor: int, start: int, rows: np.ndarray, filled: Sequence[Span]
    ) -> None:
        self._descriptor = descriptor
        self.start = start
        self.rows = rows
        self.filled = filled

    @classmethod
    def seal(cls, descriptor: int, start: int, rows: np.ndarray, filled: Sequence[Span]) -> Ledger:
        """Write the ledger at `start` of a file that is complete but for what is `filled`."""
        spans = np.array(filled, _SPAN)
        rest = _checksum_without(descriptor, filled)
        fields = len(rows), len(spans), rest
        own = zlib.crc32(spans.tobytes() + struct.pack("<QQI", *fields))
        tail = spans.tobytes() + _SEAL.pack(*fields, own, _MAGIC)
        write_all(descriptor, rows.tobytes() + tail, start)
        return cls(descriptor, start, rows, filled)

    @classmethod
    def read(cls, descriptor: int) -> Ledger | None:
        """Find the ledger of a file and hold the file, but for its blocks, against it.

        Returns
        -------
        Ledger or None
            None if there is none.

        Raises
        ------
        DamageError
            If a checksum does not fit.
        """
        size = os.fstat(descriptor).st_size
        tail = os.pread(descriptor, _TAIL, max(size - _TAIL, 0))
        found = tail.rfind(_MAGIC) + len(_MAGIC)
        if found < _SEAL.size:
            return None
        end = max(size - _TAIL, 0) + found
        n_rows, n_spans, rest, own, _ = _SEAL.unpack(tail[found - _SEAL.size : found])
        start = end - ledger_size(n_rows, n_spans)
        if start < 0:
            raise DamageError
        data = os.pread(descriptor, end - start - _SEAL.size, start)
        rows, spans = data[: n_rows * ROW.itemsize], data[n_rows * ROW.itemsize :]
        if zlib.crc32(spans + struct.pack("<QQI", n_rows, n_spans, rest)) != own:
            raise DamageError
        filled = [(int(at), int(length)) for at, length in np.frombuffer(spans, _SPAN)]
        if _checksum_without(descriptor, filled) != rest:
            raise DamageError
        return cls(descriptor, start, np.frombuffer(rows, ROW).copy(), filled)

    def entered(self) -> np.ndarray:
        """Return which blocks have a row that was written to the end."""
        return self.rows["check"] == _check(self.rows)

    def enter(self, index: int, crc: int, samples: int = 0) -> None:
        """Write the row of a block."""
        row = row_of(crc, samples)
        write_all(self._descriptor, row.tobytes(), self.start + index * ROW.itemsize)
        self.rows[index] = row


def row_of(crc: int, samples: int = 0) -> np.ndarray:
    """Return the row of a block with that checksum and that many samples."""
    row = np.array((crc, samples, 0), ROW)
    row["check"] = _check(row)
    return row


def _check(rows: np.ndarray) -> np.ndarray:
    # An odd factor maps the integers mod 2^32 one to one, so no change of one field is unseen.
    spread = rows["samples"].astype(np.uint64) * 2654435761 & 0xFFFFFFFF
    return ~(rows["crc"] ^ spread.astype(np.uint32))


def write_all(descriptor: int, data: bytes | memoryview, start: int) -> None:
    """Write `data` at `start`, all of it."""
    view = memoryview(data).cast("B")
    while view:
        written = os.pwrite(descriptor, view, start)
        view, start = view[written:], start + written


def _checksum_without(descriptor: int, filled: Sequence[Span]) -> int:
    crc = 0
    for start, stop in _gaps(filled, os.fstat(descriptor).st_size):
        for at in range(start, stop, _CHUNK):
            crc = zlib.crc32(os.pread(descriptor, min(_CHUNK, stop - at), at), crc)
    return crc


def _gaps(filled: Sequence[Span], end: int) -> Iterator[Span]:
    at = 0
    for start, size in sorted(filled):
        if start > at:
            yield at, start
        at = max(at, start + size)
    if at < end:
        yield at, end


def sync_folder(path: Path) -> None:
    """Make the names in the folder of `path` last."""
    descriptor = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
