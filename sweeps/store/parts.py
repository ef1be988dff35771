"""`Parts`: the folder ``OUT.h5.parts`` of an incomplete sweep: its schema and blocks.

``schema.h5`` is a complete file without data. ``block-NNNNNN.npz``, which `numpy.load` reads, holds
a block: an array for each variable with a record dimension, and ``points``, a structured array with
the single values of each point. The trajectories of the points follow each other in one array, and
``samples`` has their lengths. `SweepWriter` writes them: each file is on the disk before it gets
its name, so a kill or a loss of power leaves it whole or not at all. The checksums of ZIP reveal a
block that was damaged later; it counts as not computed, like a block that belongs to another sweep.
"""

from __future__ import annotations

import errno
import io
import math
import os
import sys
import zipfile
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sweeps.errors import StoreError
from sweeps.grid import Block, block_points, box_shape
from sweeps.interrupts import check
from sweeps.store.complete_file import schema_in_parts
from sweeps.store.paths import SCHEMA, open_regular, parts_path
from sweeps.store.replacing import UnreadableError, identity_of
from sweeps.store.schema import Schema
from sweeps.store.variables import TRAJECTORIES, VARIABLES

#: Array of a block file: checksum of the schema, number of the block, samples of its trajectories,
#: duration of the run so far [s].
ABOUT = np.dtype([("sweep", "u4"), ("number", "u4"), ("samples", "u8"), ("seconds", "f8")])
#: Array of a block file: the number of samples of each trajectory.
SAMPLES = "samples"
#: Most bytes of blocks that are joined.
_JOINED = 1 << 26
#: Most bytes of trajectories that are filled up with NaN at a time, besides the first point.
_PIECE = 1 << 26
#: What to do with a block that the disk cannot read any more.
_LOST = "delete that file, and the run computes its points again"
#: What else may have happened to a block that a reader does not find.
_GONE = "its sweep was completed or begun anew; open the sweep again"


class Entry(NamedTuple):
    """A finished block: its samples, the duration so far, and the `identity` of its file."""

    samples: int
    seconds: float
    file: object


class Parts:
    """The finished blocks of an incomplete sweep, for readers and for the only writer of the sweep.

    `entries` maps the number of a block to its entry; `damaged` counts the blocks that are damaged
    or belong to another sweep. `files` has the path of every block, `points` the type of its single
    values, and `sweep` is the checksum of the schema. With `verify`, all data are compared with
    their checksums. Raises UnreadableError if the schema or a block cannot be read now.
    """

    def __init__(self, folder: Path, *, verify: bool = True) -> None:
        self.folder = folder
        try:
            self.schema, self.sweep = schema, _ = schema_in_parts(folder / SCHEMA)
            files = set(os.listdir(folder))
        except OSError as error:
            raise UnreadableError(folder, error) from error
        self._single = [name for name in schema.variables if VARIABLES[name].dimension is None]
        self.points = np.dtype([(name, VARIABLES[name].dtype) for name in self._single])
        self.entries: dict[int, Entry] = {}
        self.damaged = 0
        self.files = [folder / f"block-{i:06}.npz" for i in range(len(schema.blocks))]
        for number, file in enumerate(self.files):
            if file.name not in files:
                continue
            if verify:  # without it, a sweep is also read after an interrupt, for the report
                check()
            try:
                self.entries[number] = self._entry(number, verify)
            except UnreadableError as error:
                error.args = (f"{error}; if that stays so, {_LOST}",)
                raise
            except StoreError:
                self.damaged += 1
        self.seconds = max((entry.seconds for entry in self.entries.values()), default=0.0)

    @property
    def file_schema(self) -> Schema:
        """The schema of a complete file of these blocks: as wide as the longest trajectory."""
        records = dict(self.schema.records)
        if "sample" in records:
            longest = max((entry.samples for entry in self.entries.values()), default=1)
            records["sample"] = np.arange(longest)
        return replace(self.schema, records=records)

    def values(
        self, box: Block, names: Collection[str], numbers: Iterable[int]
    ) -> dict[str, np.ndarray]:
        """Return variables in a box of points, of shape (box..., record), from these blocks.

        Points of no such block have the fill value. Raises StoreError as `read` does.
        """
        schema = self.file_schema
        shapes = {name: tuple(schema.sizes(name, box).values()) for name in names}
        arrays = {name: np.full(shapes[name], VARIABLES[name].fill_value) for name in names}
        for number in numbers:
            pairs = [*zip(box, schema.blocks[number], strict=True)]
            if all(a.start < b.stop and b.start < a.stop for a, b in pairs):
                target = tuple(slice(max(0, b.start - a.start), b.stop - a.start) for a, b in pairs)
                cut = tuple(slice(max(0, a.start - b.start), a.stop - b.start) for a, b in pairs)
                for name, array in self.read(number, names).items():
                    record = (slice(width) for width in array.shape[len(box) :])
                    arrays[name][(*target, *record)] = array[cut]
        return arrays

    def read(self, number: int, names: Collection[str]) -> dict[str, np.ndarray]:
        """Return variables of a block, of shape (box..., record); trajectories may be shorter.

        Raises StoreError if they are damaged, or if the file is gone or another one.
        """
        arrays: dict[str, np.ndarray] = {}
        with self._open(number) as (file, _):
            for name in names:
                if name in TRAJECTORIES:
                    columns = self._columns(file, number, name)
                    ((_, arrays[name]),) = _padded(self.schema.blocks[number], *columns)
                elif name not in self._single:
                    arrays[name] = self._array(file, number, name)
                elif name not in arrays:
                    points = self._array(file, number, "points")
                    arrays |= {each: points[each] for each in names if each in self._single}
        return arrays

    def pieces(self) -> Iterator[tuple[str, Block, np.ndarray]]:
        """Yield all results for the complete file: a variable, a box of points, and an array.

        The arrays have the shape (box..., record), but trajectories may be shorter; these come in
        boxes that need little memory. Small blocks are joined, as each call of HDF5 costs, and so
        that the chunks of a variable lie side by side. Raises StoreError as `read` does.
        """
        names = [name for name in self.schema.variables if name not in TRAJECTORIES]
        columns = [name for name in self.schema.variables if name in TRAJECTORIES]
        size = sum(array.nbytes for array in self.read(0, names).values())
        room = _JOINED * block_points(self.schema.blocks[0]) // size
        for box, numbers in _joined(self.schema.blocks, room):
            for name, array in self.values(box, names, numbers).items():
                yield name, box, array
        for number, block in enumerate(self.schema.blocks):
            for name in columns:
                with self._open(number) as (file, _):
                    lengths, samples = self._columns(file, number, name)
                room = 1 + _PIECE // (samples.itemsize * max(1, self.entries[number].samples))
                for box, array in _padded(block, lengths, samples, room):
                    yield name, box, array

    @contextmanager
    def _open(self, number: int) -> Iterator[tuple[zipfile.ZipFile, object]]:
        """Open the file of a block, that of its entry if it has one; also return its `identity`.

        Any error is a StoreError. An OSError is no damage, unless damage led to a place that no
        file has (EINVAL).
        """
        path = self.files[number]
        try:
            with open_regular(path) as file, zipfile.ZipFile(file) as archive:
                current = identity_of(os.fstat(file.fileno()))
                if number in self.entries and current != self.entries[number].file:
                    raise StoreError(f"{path} was replaced by another program, or {_GONE}")
                yield archive, current
        except StoreError:
            raise
        except FileNotFoundError:
            raise StoreError(f"{path} was removed by another program, or {_GONE}") from None
        except Exception as error:  # zipfile and NumPy have many for damaged files
            lacking = isinstance(error, OSError) and error.errno != errno.EINVAL
            if lacking or isinstance(error, MemoryError):
                raise UnreadableError(path, error) from error
            raise StoreError(f"{path} is damaged, or cannot be read: {error}") from error

    def _array(
        self, file: zipfile.ZipFile, number: int, name: str, size: int | None = None
    ) -> np.ndarray:
        """Return an array of a block, all of whose bytes have been compared with their checksum.

        Another form than that of the schema counts as damage; compressed data, which are never
        written, could be of any size. `size` is the number of samples of a column.
        """
        block = self.schema.blocks[number]
        shape = box_shape(block) if name == "points" else (block_points(block),)
        dtype: Any = {"about": ABOUT, "points": self.points, SAMPLES: np.int64}.get(name, "f8")
        if name in VARIABLES:
            shape, dtype = (*self.schema.sizes(name, block).values(),), VARIABLES[name].dtype
        shape = () if name == "about" else shape if size is None else (size,)
        member = file.getinfo(f"{name}.npy")
        if member.compress_type != zipfile.ZIP_STORED:
            raise ValueError("it is compressed")
        data = io.BytesIO(file.read(member))
        np.lib.format.read_magic(data)
        form = np.lib.format.read_array_header_1_0(data)
        if form[0] != shape or form[2] != dtype:
            raise ValueError(f"{name} has another shape or type")
        array = np.frombuffer(data.getbuffer(), form[2], math.prod(shape), data.tell())
        return array.reshape(shape, order="F" if form[1] else "C")

    def _columns(
        self, file: zipfile.ZipFile, number: int, name: str
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the lengths of the trajectories of a block, and a column of all their samples."""
        lengths = self._array(file, number, SAMPLES)
        return lengths, self._array(file, number, name, int(lengths.sum()))

    def _entry(self, number: int, verify: bool) -> Entry:
        """Return the entry of a block; refuse the block of another sweep, or a damaged one."""
        with self._open(number) as (file, current):
            about = self._array(file, number, "about")
            if (about["sweep"], about["number"]) != (self.sweep, number):
                raise StoreError(f"{self.files[number]} belongs to another sweep")
            columns = set(TRAJECTORIES).intersection(self.schema.variables)
            lengths = self._array(file, number, SAMPLES) if columns else np.zeros(1)
            if lengths.min() < 0 or lengths.max() != about["samples"]:
                raise ValueError("it has other samples than it says")
            names = {"points", *self.schema.variables}.difference(self._single)
            for name in names if verify else ():
                (self._columns if name in columns else self._array)(file, number, name)
        return Entry(int(about["samples"]), float(about["seconds"]), current)


def _joined(blocks: Sequence[Block], room: int) -> list[tuple[Block, list[int]]]:
    """Join each block to those before it, if all form one box of at most `room` points."""
    joined: list[tuple[Block, list[int]]] = []
    for number, block in enumerate(blocks):
        box, numbers = joined[-1] if joined else (block, [])
        pairs = zip(box, block, strict=True)
        both = tuple(slice(min(a.start, b.start), max(a.stop, b.stop)) for a, b in pairs)
        if numbers and block_points(box) + block_points(block) == block_points(both) <= room:
            numbers.append(number)
            joined[-1] = both, numbers
        else:
            joined.append((block, [number]))
    return joined


def _padded(
    box: Block, lengths: np.ndarray, samples: np.ndarray, most: int = sys.maxsize
) -> Iterator[tuple[Block, np.ndarray]]:
    """Yield boxes of at most `most` points and their samples; shorter trajectories end in NaN."""
    if len(lengths) > most:
        axis = next(axis for axis, n in enumerate(box_shape(box)) if n > 1)
        middle = (box[axis].start + box[axis].stop) // 2
        for cut in (slice(box[axis].start, middle), slice(middle, box[axis].stop)):
            half = (*box[:axis], cut, *box[axis + 1 :])
            half_lengths, lengths = np.split(lengths, [block_points(half)])
            column, samples = np.split(samples, [half_lengths.sum()])
            yield from _padded(half, half_lengths, column, most)
    else:
        array = np.full((len(lengths), lengths.max(initial=0)), np.nan)
        array[np.arange(array.shape[1]) < lengths[:, None]] = samples
        yield box, array.reshape(*box_shape(box), -1)


def finished_points(path: Path) -> tuple[int, int] | None:
    """Return the number of finished points and of all points; None without an incomplete sweep."""
    try:
        parts = Parts(parts_path(path), verify=False)
    except UnreadableError:
        raise
    except StoreError:
        return None
    blocks = parts.schema.blocks
    finished = sum(block_points(blocks[number]) for number in parts.entries)
    return finished, sum(map(block_points, blocks))
