"""The ledger of a sweep's file: the state and checksum of every block, and a checksum of the rest.

It is the last dataset of the file, as bytes: a summary, one row per block, then the seal. The seal
says which parts of the file change while blocks are written, and holds a checksum of all the rest:
coordinates, attributes and HDF5's own structures. It is found from the end of the file without
HDF5, whose library loops or crashes on some damaged files (of the bytes of a small sweep, about one
in a thousand, with one bit flipped). So HDF5 only opens a file whose seal fits.

The checksum of a row is that of the bytes of its block as they are, fill values included. So every
byte of the file has a checksum, whether its block is computed or not, except those of a block
that is being written.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np

#: One row: state, checksum of the block's data, samples of its longest trajectory, check of these.
ROW = np.dtype([("state", "<u4"), ("crc", "<u4"), ("samples", "<u4"), ("check", "<u4")])
#: State of the file, check of the summary, duration and the one before it, which the attribute
#: ``duration`` may still hold.
SUMMARY = np.dtype(
    [("state", "<u4"), ("check", "<u4"), ("seconds", "<f8"), ("before", "<f8"), ("spare", "<u8")]
)

_MAGIC = b"\x89VIBRO3\n"
_SPAN = np.dtype([("start", "<u8"), ("size", "<u8")])
# Number of rows and of spans, checksum of the rest of the file, checksum of the seal, magic.
_SEAL = struct.Struct("<QQII8s")
# HDF5 may put a little of its own after the last dataset.
_TAIL = 1 << 16
_CHUNK = 1 << 22
# Summary and rows start at a multiple of this, so that none lies in two pages or sectors.
_ALIGNMENT = 32
_FACTORS = np.array([2654435761, 2246822519, 3266489917, 668265263], np.uint64)

Span = tuple[int, int]


class State(IntEnum):
    """The state of a block, or of the whole file: four letters, far from each other and from 0."""

    PENDING = int.from_bytes(b"PEND", "little")
    WRITING = int.from_bytes(b"WRIT", "little")
    DONE = int.from_bytes(b"DONE", "little")


class DamageError(Exception):
    """A checksum does not fit."""


def ledger_size(rows: int, spans: int) -> int:
    """Return the bytes of a ledger of that many blocks and parts that change."""
    sizes = rows * ROW.itemsize, spans * _SPAN.itemsize
    return _ALIGNMENT + SUMMARY.itemsize + sum(sizes) + _SEAL.size


def checksum(arrays: Iterable[np.ndarray]) -> int:
    """Return the CRC-32 of arrays, one after the other."""
    crc = 0
    for array in arrays:
        crc = zlib.crc32(flat_bytes(array), crc)
    return crc


def flat_bytes(array: np.ndarray) -> memoryview:
    """Return the bytes of an array in C order, not copied if they are so already."""
    return np.ascontiguousarray(array).reshape(-1).view(np.uint8).data


@contextmanager
def opened(path: Path, flags: int) -> Iterator[int]:
    """Open a file for the block, and yield its descriptor."""
    descriptor = os.open(path, flags, 0o666)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


@dataclass(eq=False)
class Ledger:
    """The ledger of a file that is open as `descriptor`.

    Attributes
    ----------
    descriptor, start, duration : int
        Of the file; places of the ledger and of the attribute ``duration`` in it.
    rows : ndarray of dtype ``ROW``, shape (blocks,)
        As they were read last, and what was entered since.
    summary : ndarray of dtype ``SUMMARY``, shape ()
    """

    descriptor: int
    start: int
    duration: int
    rows: np.ndarray
    summary: Any

    @classmethod
    def read(cls, descriptor: int) -> Ledger | None:
        """Find the ledger of a file, and compare the file, without its blocks, with its checksum.

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
        end_in_tail = tail.rfind(_MAGIC) + len(_MAGIC)
        if end_in_tail < _SEAL.size:
            return None
        end = max(size - _TAIL, 0) + end_in_tail
        seal = tail[end_in_tail - _SEAL.size : end_in_tail]
        n_rows, n_spans, rest, seal_crc, _ = _SEAL.unpack(seal)
        start = end - ledger_size(n_rows, n_spans) + _ALIGNMENT
        spans_at = start + SUMMARY.itemsize + n_rows * ROW.itemsize
        if start < 0 or n_spans < 2:
            raise DamageError
        spans = os.pread(descriptor, n_spans * _SPAN.itemsize, spans_at)
        if zlib.crc32(spans + _SEAL.pack(n_rows, n_spans, rest, 0, _MAGIC)) != seal_crc:
            raise DamageError
        changing = np.frombuffer(spans, _SPAN).tolist()
        if _checksum_without(descriptor, changing) != rest:
            raise DamageError
        rows, summary = np.zeros(n_rows, ROW), np.zeros((), SUMMARY)
        ledger = cls(descriptor, start, changing[0][0], rows, summary)
        ledger.reread()
        return ledger

    def reread(self) -> None:
        """Read the summary and the rows, which another process may have changed.

        Raises
        ------
        DamageError
            If the summary has another check, or the attribute ``duration`` another value.
        """
        if not (self._summary_read() or self._summary_read()):  # it may just have been written
            raise DamageError
        data = os.pread(self.descriptor, self.rows.nbytes, self.start + SUMMARY.itemsize)
        self.rows = np.frombuffer(data, ROW).copy()

    def _summary_read(self) -> bool:
        """Read the summary; return whether it and the attribute ``duration`` are as written."""
        duration = os.pread(self.descriptor, 8, self.duration)
        data = os.pread(self.descriptor, SUMMARY.itemsize, self.start)
        self.summary = np.frombuffer(data, SUMMARY)[0]
        # A loss of power may leave some bytes of the one and some of the other.
        values = self.summary["seconds"].tobytes(), self.summary["before"].tobytes()
        duration_fits = all(byte in pair for byte, *pair in zip(duration, *values, strict=True))
        return duration_fits and summary_of(self.summary).tobytes() == data

    def tobytes(self) -> bytes:
        """Return the summary and the rows as they are written."""
        return bytes(self.summary.tobytes()) + self.rows.tobytes()

    @property
    def complete(self) -> bool:
        """Whether the file is in its final form."""
        return bool(self.summary["state"] == State.DONE)

    def are(self, state: State) -> np.ndarray:
        """Return which blocks have a valid row with a state."""
        return (self.rows["state"] == state) & self.valid()

    def valid(self) -> np.ndarray:
        """Return which blocks have a row that is as it was written."""
        rows = self.rows
        has_state = np.isin(rows["state"], list(State))
        return has_state & (rows["check"] == _row_check(rows, np.arange(len(rows))))

    def enter(self, index: int, state: State, crc: int, samples: int = 0) -> None:
        """Write the row of a block."""
        self.rows[index] = (state, crc, samples, 0)
        self.rows["check"][index] = _row_check(self.rows[index], np.int64(index))
        at = self.start + SUMMARY.itemsize + index * ROW.itemsize
        write_all(self.descriptor, self.rows[index].tobytes(), at)

    def summarize(self, state: State, seconds: float) -> None:
        """Write the state of the file and the duration, also as the attribute.

        A kill in between leaves an attribute with the duration of before, which the summary holds.
        """
        for before in (self.summary["seconds"], seconds):
            self.summary = summary_of((state, 0, seconds, before, 0))
            write_all(self.descriptor, self.summary.tobytes(), self.start)
            sync(self.descriptor)
            write_all(self.descriptor, np.float64(seconds).tobytes(), self.duration)
            sync(self.descriptor)


def seal(
    descriptor: int, ledger: Span, rows: np.ndarray, changing: Sequence[Span], duration: int
) -> None:
    """Write the ledger of a file that is laid out otherwise, and make the file last.

    Parameters
    ----------
    descriptor : int
    ledger : tuple of int
        Start and size of its place, from `ledger_size` with two spans more than `changing`.
    rows : ndarray of dtype ``ROW``, shape (blocks,)
        Without their checks.
    changing : sequence of Span
        Start and size of the data of the variables.
    duration : int
        The place of the attribute ``duration``.
    """
    rows = rows.copy()
    rows["check"] = _row_check(rows, np.arange(len(rows)))
    end = sum(ledger)
    n_spans = len(changing) + 2
    aligned = (end - ledger_size(len(rows), n_spans) + _ALIGNMENT) // _ALIGNMENT * _ALIGNMENT
    # What alignment leaves free lies before the ledger and, being no part of it, in the rest.
    start, end = aligned, aligned + ledger_size(len(rows), n_spans) - _ALIGNMENT
    spans = np.array([(duration, 8), (start, end - start), *changing], _SPAN)
    summary = summary_of((State.PENDING, 0, np.nan, np.nan, 0))
    write_all(descriptor, np.float64(np.nan).tobytes(), duration)
    write_all(descriptor, summary.tobytes() + rows.tobytes() + spans.tobytes(), start)
    rest = _checksum_without(descriptor, spans.tolist())
    seal_crc = zlib.crc32(spans.tobytes() + _SEAL.pack(len(rows), n_spans, rest, 0, _MAGIC))
    write_all(descriptor, _SEAL.pack(len(rows), n_spans, rest, seal_crc, _MAGIC), end - _SEAL.size)
    os.fsync(descriptor)


def summary_of(summary: Any) -> Any:
    """Return a summary with its check."""
    summary = np.array(summary, SUMMARY)
    summary["check"] = 0
    summary["check"] = zlib.crc32(summary.tobytes())
    return summary


def _row_check(rows: Any, index: Any) -> Any:
    """Return the check of rows, of which no change of one field is unseen.

    For the odd factors map the integers mod 2^32 one to one.
    """
    fields = np.stack([rows["state"], rows["crc"], rows["samples"], index]).astype(np.uint64)
    return (_FACTORS @ fields).astype(np.uint32)


def write_all(descriptor: int, data: bytes | memoryview, start: int) -> None:
    """Write `data` at `start`, all of it."""
    view = memoryview(data).cast("B")
    while view:
        written = os.pwrite(descriptor, view, start)
        view, start = view[written:], start + written


def sync(descriptor: int) -> None:
    """Make the data of a file last, whose size does not change."""
    getattr(os, "fdatasync", os.fsync)(descriptor)


def _checksum_without(descriptor: int, changing: Iterable[Span]) -> int:
    """Return the CRC-32 of a file without the parts that change."""
    crc = at = 0
    for start, size in [*sorted(map(tuple, changing)), (os.fstat(descriptor).st_size, 0)]:
        for place in range(at, start, _CHUNK):
            crc = zlib.crc32(os.pread(descriptor, min(_CHUNK, start - place), place), crc)
        at = max(at, start + size)
    return crc
