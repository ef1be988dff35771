"""The journal of an incomplete sweep: its blocks, in the order in which they were computed.

It begins with a header: the size and the checksum of the schema, then the schema as an HDF5 file
without data. An entry for each block follows. Its head has the number of the block, a checksum of
the head and one of each array; then come the arrays, in the order of the schema. An entry is on the
disk before the next one is started, so a kill or a loss of power can damage only the last entry.
The checksums reveal a damaged entry, and its block counts as not computed. If the head of an entry
is damaged, all later entries are lost too, because it tells where they start.
"""

from __future__ import annotations

import io
import math
import os
import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, Self

import h5py
import numpy as np

from sweeps.errors import Failed, StoreError
from sweeps.grid import Block, block_points, box_shape
from sweeps.interrupts import check
from sweeps.store.paths import (
    FORMAT_VERSION,
    JOURNAL,
    journal_path,
    open_regular,
    refuse_version,
)
from sweeps.store.schema import Schema, add_blocks, describe, schema_in
from sweeps.store.variables import VARIABLES

#: Start of the header: magic, format version, checksum and size of the rest of the header.
_HEADER = struct.Struct("<8sIIQ")
#: Head of an entry: its checksum, number of the block, samples of its trajectories, duration of the
#: run so far [s]; the checksums of the arrays follow.
_HEAD = [("check", "<u4"), ("number", "<u4"), ("samples", "<u8"), ("seconds", "<f8")]


class Entry(NamedTuple):
    """A block in a journal: the position of its arrays, `start` to `end`, and their checksums."""

    number: int
    samples: int
    seconds: float
    checksums: Mapping[str, int]
    start: int
    end: int


def create(path: Path, schema: Schema) -> None:
    """Write the journal of a sweep, without any block, to an empty file."""
    image = io.BytesIO()
    with h5py.File(image, "w", libver="earliest") as file:
        describe(file, schema)
        add_blocks(file, schema)
    header = image.getvalue()
    start = _HEADER.pack(JOURNAL, FORMAT_VERSION, zlib.crc32(header), len(header))
    path.write_bytes(start + header)


class Journal:
    """An open journal, for reading or for the only writer of the sweep.

    `entries` maps the number of a block to its entry, if the entry is sound; `damaged` counts the
    damaged entries, except the last one. With `verify` all entries are compared with their
    checksums, which reads the whole journal; otherwise only the last one is. If `writable`, the
    bytes after the last sound entry are cut off. Raises FileNotFoundError, or StoreError if the
    file is not a journal of this format version or its header is damaged.
    """

    def __init__(self, path: Path, *, verify: bool = True, writable: bool = False) -> None:
        self.path = path
        self._file: Any = path.open("r+b") if writable else open_regular(path)
        try:
            self.schema, self._end = self._header()
            self._head = np.dtype([*_HEAD, ("checksums", "<u4", len(self.schema.variables))])
            self._find_entries(verify)
            if writable:
                self._file.truncate(self._end)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @property
    def samples(self) -> int:
        """Number of samples of the longest trajectory in the journal."""
        return max((entry.samples for entry in self.entries.values()), default=1)

    @property
    def seconds(self) -> float:
        """Duration of the run [s] when its last block was written."""
        return max((entry.seconds for entry in self.entries.values()), default=0.0)

    def box(self, entry: Entry, name: str) -> Block:
        """Return the part of a variable that an entry holds; its trajectories may be shorter."""
        block, dimension = self.schema.blocks[entry.number], VARIABLES[name].dimension
        if dimension is None:
            return block
        width = len(self.schema.records[dimension])
        return (*block, slice(0, entry.samples if dimension == "sample" else width))

    def read(self, entry: Entry, name: str) -> np.ndarray:
        """Return the results of a block, of shape (box..., record); StoreError if damaged."""
        start = entry.start
        for other in self.schema.variables[: self.schema.variables.index(name)]:
            start += self._size(entry, other)
        array = np.empty(box_shape(self.box(entry, name)), VARIABLES[name].dtype)
        self._file.seek(start)
        self._file.readinto(_bytes(array))
        if zlib.crc32(_bytes(array)) != entry.checksums[name]:
            raise StoreError(f"{name} of a block of {self.path} was changed by another program")
        return array

    def append(
        self, number: int, arrays: Mapping[str, np.ndarray], samples: int, seconds: float
    ) -> None:
        """Append a block, given by contiguous arrays in the schema's order; it is then on disk."""
        self.refuse_loss()
        checksums = {name: zlib.crc32(_bytes(array)) for name, array in arrays.items()}
        head = np.array((0, number, samples, seconds, [*checksums.values()]), self._head)
        head["check"] = zlib.crc32(head.tobytes())
        self._file.seek(self._end)
        self._file.write(head.tobytes())
        for array in arrays.values():
            self._file.write(_bytes(array))
        self._file.flush()
        os.fsync(self._file.fileno())
        start, self._end = self._end + self._head.itemsize, self._file.tell()
        self.entries[number] = Entry(number, samples, seconds, checksums, start, self._end)

    def refuse_loss(self) -> None:
        """Raise Failed if another program has removed, replaced or changed the journal."""
        here = os.fstat(self._file.fileno())
        try:
            loss = "" if os.path.samestat(here, os.stat(self.path)) else "replaced"
        except OSError:
            loss = "removed"
        if not loss and here.st_size != self._end:
            loss = "truncated" if here.st_size < self._end else "changed"
        if loss:
            raise Failed(f"{self.path} was {loss} by another program while it was written")

    def remove(self) -> None:
        """Close and remove the journal, unless another file has taken its name."""
        here = os.fstat(self._file.fileno())
        self.close()
        if self.path.exists() and os.path.samestat(here, os.stat(self.path)):
            self.path.unlink()

    def _header(self) -> tuple[Schema, int]:
        """Read the header; return the schema and the position of the first entry."""
        start = self._file.read(_HEADER.size)
        if len(start) < _HEADER.size or not start.startswith(JOURNAL):
            raise StoreError(f"{self.path} is not the journal of a sweep")
        _, version, crc, size = _HEADER.unpack(start)
        if version != FORMAT_VERSION:
            refuse_version(self.path)
        header = self._file.read(min(size, os.fstat(self._file.fileno()).st_size))
        if zlib.crc32(header) != crc:
            raise StoreError(
                f"{self.path} is damaged at its beginning, or truncated; run its configuration "
                "again, and overwrite it"
            )
        with h5py.File(io.BytesIO(header), "r") as file:
            return schema_in(file), _HEADER.size + size

    def _find_entries(self, verify: bool) -> None:
        """Find the sound entries, and the end of the last one."""
        self.entries: dict[int, Entry] = {}
        self.damaged = 0
        found = list(self._heads())
        for entry in found:
            if verify:  # without it, a journal is also read after an interrupt, for the report
                check()
            last = entry is found[-1]
            if (verify or last) and not self._is_sound(entry):
                self.damaged += not last
                continue
            self.entries[entry.number] = entry
            self._end = entry.end

    def _heads(self) -> Iterator[Entry]:
        """Yield the entries up to the first one that is cut off or whose head is damaged."""
        at, size = self._end, os.fstat(self._file.fileno()).st_size
        while at + self._head.itemsize <= size:
            self._file.seek(at)
            head = np.frombuffer(self._file.read(self._head.itemsize), self._head)[0].copy()
            crc, head["check"] = int(head["check"]), 0
            if zlib.crc32(head.tobytes()) != crc:
                return
            checksums = dict(zip(self.schema.variables, head["checksums"].tolist(), strict=True))
            numbers = int(head["number"]), int(head["samples"]), float(head["seconds"])
            entry = Entry(*numbers, checksums, at + self._head.itemsize, 0)
            at = entry.start + sum(self._size(entry, name) for name in self.schema.variables)
            if at > size:
                return
            yield entry._replace(end=at)

    def _size(self, entry: Entry, name: str) -> int:
        """Return the size in bytes of an array."""
        return (
            math.prod(box_shape(self.box(entry, name))) * np.dtype(VARIABLES[name].dtype).itemsize
        )

    def _is_sound(self, entry: Entry) -> bool:
        """Return whether the arrays of an entry match their checksums."""
        try:
            for name in self.schema.variables:
                self.read(entry, name)
        except StoreError:
            return False
        return True


def _bytes(array: np.ndarray) -> memoryview:
    """Return the bytes of a contiguous array without copying them."""
    return array.reshape(-1).view(np.uint8).data


def kept_points(path: Path) -> tuple[int, int] | None:
    """Return the number of points in the journal and of all points; None without a journal."""
    try:
        with Journal(journal_path(path), verify=False) as journal:
            blocks = journal.schema.blocks
            done = sum(block_points(blocks[number]) for number in journal.entries)
            return done, sum(map(block_points, blocks))
    except (FileNotFoundError, StoreError):
        return None
