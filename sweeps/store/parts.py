"""The folder of an incomplete sweep, ``OUT.h5.parts``: its schema, and a file for each block done.

``schema.h5`` is a complete file without data. ``block-NNNNNN.npz``, which `numpy.load` reads, holds
a block: an array for each variable with a record dimension, and ``points``, a structured array with
the single values of each point. The trajectories of the points follow each other in one array, and
``samples`` has their lengths. Each file is on the disk before it gets its name, so a kill or a
loss of power leaves it whole or not at all. The checksums of ZIP reveal a block that was damaged
later; it counts as not computed, like a block that belongs to another sweep.
"""

from __future__ import annotations

import io
import os
import re
import stat
import time
import zipfile
import zlib
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from sweeps.errors import Failed, StoreError
from sweeps.grid import Block, block_points, box_shape
from sweeps.interrupts import check
from sweeps.store.archive import GONE, array_in, opened_archive, padded, write_arrays
from sweeps.store.complete_file import add_table, schema_of
from sweeps.store.paths import (
    BLOCK,
    DRAFT,
    SCHEMA,
    UnreadableError,
    identity,
    parts_path,
)
from sweeps.store.replacing import draft_of, drafted, replacing, sync_names
from sweeps.store.schema import Schema, add_blocks, write_schema
from sweeps.store.variables import VARIABLES, is_sampled

#: Array of a block file: checksum of the schema, number of the block, samples of its trajectories,
#: duration of the run so far [s].
_ABOUT = np.dtype([("sweep", "u4"), ("number", "u4"), ("samples", "u8"), ("seconds", "f8")])
#: Time after which the names of blocks are put on the disk, too [s]; for each it would be slow.
_SYNC = 1.0
#: Array of a block file: the number of samples of each trajectory.
_SAMPLES = "samples"
#: Most bytes of trajectories that are filled up with NaN at a time, besides the first point.
_PIECE = 1 << 26
#: What to do with a block that the disk cannot read any more.
_LOST = "delete that file, and the run computes its points again"


class Entry(NamedTuple):
    """A finished block: its samples, the duration so far, and the `identity` of its file."""

    samples: int
    seconds: float
    file: object


def create(folder: Path, schema: Schema) -> None:
    """Begin a sweep in a folder, and remove the blocks of another one."""
    folder.mkdir(exist_ok=True)
    with replacing(folder / SCHEMA) as new:  # from here on, no old block belongs to the sweep
        image = io.BytesIO()
        with h5py.File(image, "w", libver="earliest") as file:
            write_schema(file, schema)
            add_blocks(file, schema)
        new.write(image.getvalue())
        add_table(new)
    sync_names(folder.parent)
    _remove(folder, f"{BLOCK}|{DRAFT}")


def remove(folder: Path) -> None:
    """Remove the files of a sweep from its folder, and the folder if empty.

    The schema becomes a draft, which goes last: so `check_output` knows what a kill left.
    """
    with suppress(OSError):  # on Windows, another process is reading it; there are other files
        with suppress(FileNotFoundError):
            os.replace(folder / SCHEMA, draft_of(folder / SCHEMA))
            sync_names(folder)  # a loss of power leaves no schema without its blocks
        _remove(folder, BLOCK)
        sync_names(folder)
        _remove(folder, DRAFT)
        folder.rmdir()


def remove_drafts(folder: Path) -> None:
    """Remove the drafts that killed writers left in a folder."""
    _remove(folder, DRAFT)


def _remove(folder: Path, names: str) -> None:
    for path in folder.iterdir():
        if re.fullmatch(names, path.name) and not stat.S_ISDIR(path.lstat().st_mode):
            path.unlink()


class Parts:
    """The folder of an incomplete sweep, for reading or for the only writer of the sweep.

    `entries` maps the number of a block to its entry; `damaged` counts the blocks that are damaged
    or belong to another sweep. With `verify`, all data are compared with their checksums. Raises
    UnreadableError if the schema or a block cannot be read now.
    """

    def __init__(self, folder: Path, schema: Schema, *, verify: bool = True) -> None:
        self.folder, self.schema = folder, schema
        self._identity = identity(folder / SCHEMA)
        try:
            self._sweep = zlib.crc32((folder / SCHEMA).read_bytes())
            files = set(os.listdir(folder))
        except OSError as error:
            raise UnreadableError(folder, error) from error
        single = [name for name in schema.variables if VARIABLES[name].dimension is None]
        self._points = np.dtype([(name, VARIABLES[name].dtype) for name in single])
        self._synced = time.monotonic()
        self.entries: dict[int, Entry] = {}
        self.damaged = 0
        for number in range(len(self.schema.blocks)):
            if self._file(number).name not in files:
                continue
            if verify:  # without it, a sweep is also read after an interrupt, for the report
                check()
            try:
                self.entries[number] = self._entry(number)
                if verify:
                    self._verify(number)
            except UnreadableError as error:
                error.args = (f"{error}; if that stays so, {_LOST}",)
                raise
            except StoreError:
                self.entries.pop(number, None)
                self.damaged += 1

    @property
    def samples(self) -> int:
        """Number of samples of the longest trajectory."""
        return max((entry.samples for entry in self.entries.values()), default=1)

    @property
    def seconds(self) -> float:
        """Duration of the run [s] when its last block was written."""
        return max((entry.seconds for entry in self.entries.values()), default=0.0)

    def box(self, number: int, name: str) -> Block:
        """Return the part of a variable that a block holds; its trajectories may be shorter."""
        block, dimension = self.schema.blocks[number], VARIABLES[name].dimension
        if dimension is None:
            return block
        width = len(self.schema.records[dimension])
        samples = self.entries[number].samples
        return (*block, slice(0, samples if dimension == "sample" else width))

    def read(self, number: int, names: Collection[str]) -> dict[str, np.ndarray]:
        """Return variables of a block, each of shape (box..., record).

        Raises StoreError if they are damaged, or if the file is gone or another one.
        """
        block, single, found = self.schema.blocks[number], set(self._points.names or ()), {}
        with self._same(number) as file:
            if single.intersection(names):
                points = array_in(file, "points", self._points, box_shape(block))
                found = {name: points[name] for name in single.intersection(names)}
            for name in set(names) - single:
                if is_sampled(name):
                    ((_, found[name]),) = padded(block, *self._samples(file, number, name))
                else:
                    shape = self.schema.shape_of(name, box_shape(block))
                    found[name] = array_in(file, name, VARIABLES[name].dtype, shape)
        return found

    def pieces(self, number: int, name: str) -> Iterator[tuple[str, Block, np.ndarray]]:
        """Yield the trajectories of a block in boxes of points that need little memory.

        Raises StoreError as `read` does.
        """
        with self._same(number) as file:
            lengths, samples = self._samples(file, number, name)
        room = 1 + _PIECE // (samples.itemsize * max(1, self.entries[number].samples))
        for box, array in padded(self.schema.blocks[number], lengths, samples, room):
            yield name, box, array

    def write(self, number: int, arrays: Mapping[str, Any], seconds: float) -> None:
        """Write a block, given by contiguous arrays; a loss of power may still lose its name.

        A column of the trajectories is given by an array for each point.
        """
        self.refuse_loss()
        points = np.empty(box_shape(self.schema.blocks[number]), self._points)
        for name in self._points.names or ():
            points[name] = arrays[name]
        records = {
            name: array if is_sampled(name) else [array]
            for name, array in arrays.items()
            if name not in (self._points.names or ())
        }
        longest = 0
        for name in [name for name in records if is_sampled(name)][:1]:
            lengths = np.array([len(samples) for samples in arrays[name]])
            records[_SAMPLES], longest = [lengths], int(lengths.max())
        about = np.array((self._sweep, number, longest, seconds), _ABOUT)
        with drafted(self._file(number)) as new:
            with zipfile.ZipFile(new, "w") as file:
                for name, some in {"about": [about], "points": [points], **records}.items():
                    write_arrays(file, name, some)
        self.entries[number] = Entry(longest, seconds, identity(self._file(number)))
        if time.monotonic() > self._synced + _SYNC:
            self.sync()

    def sync(self) -> None:
        """Wait until the names of all blocks are on the disk."""
        sync_names(self.folder)
        self._synced = time.monotonic()

    def refuse_loss(self) -> None:
        """Raise Failed if another program has removed or replaced the schema."""
        now = identity(self.folder / SCHEMA)
        if now != self._identity:
            loss = "removed" if now is None else "replaced"
            raise Failed(f"{self.folder} was {loss} by another program while it was written")

    def _file(self, number: int) -> Path:
        """Return the path of the file of a block."""
        return self.folder / f"block-{number:06}.npz"

    @contextmanager
    def _same(self, number: int) -> Iterator[zipfile.ZipFile]:
        """Open the file of a block, if it is that of its entry."""
        with opened_archive(self._file(number)) as (file, now):
            if now != self.entries[number].file:
                raise StoreError(f"{self._file(number)} was replaced by another program, or {GONE}")
            yield file

    def _samples(
        self, file: zipfile.ZipFile, number: int, name: str
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the lengths of the trajectories of a block, and a column of all of them."""
        lengths = array_in(file, _SAMPLES, np.int64, (block_points(self.schema.blocks[number]),))
        return lengths, array_in(file, name, VARIABLES[name].dtype, (int(lengths.sum()),))

    def _verify(self, number: int) -> None:
        """Compare a block with its checksums; raise StoreError as `read` does."""
        self.read(number, [name for name in self.schema.variables if not is_sampled(name)])
        with self._same(number) as file:
            for name in filter(is_sampled, self.schema.variables):
                self._samples(file, number, name)

    def _entry(self, number: int) -> Entry:
        """Return the entry of a block; refuse the block of another sweep."""
        with opened_archive(self._file(number)) as (file, now):
            about = array_in(file, "about", _ABOUT, ())
        if (about["sweep"], about["number"]) != (self._sweep, number):
            raise StoreError(f"{self._file(number)} belongs to another sweep")
        return Entry(int(about["samples"]), float(about["seconds"]), now)


def kept_points(path: Path) -> tuple[int, int] | None:
    """Return the number of finished points and of all points; None without an incomplete sweep.

    Raises UnreadableError as `Parts` does.
    """
    try:
        folder = parts_path(path)
        parts = Parts(folder, schema_of(folder / SCHEMA), verify=False)
    except UnreadableError:
        raise
    except StoreError:
        return None
    blocks = parts.schema.blocks
    done = sum(block_points(blocks[number]) for number in parts.entries)
    return done, sum(map(block_points, blocks))
