"""Write blocks into the file of a sweep, each whole or not at all.

A block is written in four steps: its row in the ledger, which says that the block is being written;
its data; its status; its row again, which says that the block is done. Each step is on the disk
before the next begins. So a block whose row says "done" is complete after a kill and after a loss
of power, and the status alone says the same to readers that do not know the ledger. (After a kill
the operating system still writes what it was given; fsync is needed for a loss of power alone.)
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np

from sweeps.errors import Failed
from sweeps.grid import Block, box_shape
from sweeps.store.creation import places
from sweeps.store.layout import Layout
from sweeps.store.ledger import DamageError, Ledger, State, checksum, flat_bytes, sync, write_all
from sweeps.store.reader import sweep_file


class Lost(Failed):
    """The file was removed, replaced or changed by another program while it was written."""


@dataclass(frozen=True, eq=False)
class BlockFile:
    """A file that is open for writing blocks, from `BlockFile.opened`; its size does not change.

    Attributes
    ----------
    path, user_path : Path
        Of the file itself, and as the user wrote it, which may be a link: for messages.
    places : mapping of str to int
        Where each variable starts; empty for a compressed file, to which nothing is written.
    """

    path: Path
    user_path: Path
    descriptor: int
    size: int
    layout: Layout
    ledger: Ledger
    places: Mapping[str, int]

    @classmethod
    def opened(cls, path: Path, user_path: Path) -> Self:
        """Open a file that `sweep_file` accepts."""
        with sweep_file(path) as sweep:
            descriptor = os.open(path, os.O_RDWR)
            ledger = replace(sweep.ledger, descriptor=descriptor)
            size = os.fstat(descriptor).st_size
            where = places(sweep.file)
            return cls(path, user_path, descriptor, size, sweep.layout, ledger, where)

    def close(self) -> None:
        """Close the file."""
        os.close(self.descriptor)

    def pending(self) -> np.ndarray:
        """Return the numbers of the blocks that are not done."""
        return np.flatnonzero(~self.ledger.are(State.DONE))

    def write(
        self, index: int, arrays: Mapping[str, np.ndarray], samples: int, *, lasting: bool = True
    ) -> None:
        """Write a block.

        Parameters
        ----------
        index : int
        arrays : mapping of str to ndarray
            Of every variable, in the order of the file and the shape (box..., record).
        samples : int
            Of its longest trajectory.
        lasting : bool
            Whether it is safe from a loss of power afterwards. A file that takes the place of
            another one when it is complete is made to last as a whole.
        """
        make_last = sync if lasting else lambda _: None
        block, crc = self.layout.blocks[index], checksum(arrays.values())
        self.ledger.enter(index, State.WRITING, crc, samples)
        make_last(self.descriptor)
        self._put(block, {name: array for name, array in arrays.items() if name != "status"})
        make_last(self.descriptor)
        self._put(block, {"status": arrays["status"]})
        make_last(self.descriptor)
        # This is made to last with the next block: without it the block is written again.
        self.ledger.enter(index, State.DONE, crc, samples)

    def erase(self, index: int) -> None:
        """Make a block pending again, with the values that it was laid out with."""
        arrays = self.layout.fill_values(box_shape(self.layout.blocks[index]))
        self.ledger.enter(index, State.WRITING, 0)
        sync(self.descriptor)
        self._put(self.layout.blocks[index], arrays)
        sync(self.descriptor)
        self.ledger.enter(index, State.PENDING, checksum(arrays.values()))

    def _put(self, block: Block, arrays: Mapping[str, np.ndarray]) -> None:
        """Write the data of a block to their places."""
        for name, array in arrays.items():
            data = flat_bytes(array)
            width = math.prod(array.shape[len(block) :]) * array.itemsize
            at = 0
            for first, count in _runs(block, self.layout.shape):
                place = self.places[name] + first * width
                write_all(self.descriptor, data[at : at + count * width], place)
                at += count * width

    def refuse_loss(self, *, thoroughly: bool = False) -> None:
        """Refuse to go on where another program has removed, replaced or changed the file.

        Parameters
        ----------
        thoroughly : bool
            Whether to read the ledger, and to compare what is outside of the blocks, too.

        Raises
        ------
        Lost
        """
        loss = ""
        here = os.fstat(self.descriptor)
        try:
            there = os.stat(self.path)
            if (there.st_dev, there.st_ino) != (here.st_dev, here.st_ino):
                loss = "replaced"
        except OSError:
            loss = "removed"
        if not loss and here.st_size != self.size:
            loss = "truncated" if here.st_size < self.size else "changed"
        if not loss and thoroughly and not self._is_intact():
            loss = "changed"
        if loss:
            raise Lost(
                f"{self.user_path} was {loss} by another program while it was written, and what "
                "was computed is lost"
            )

    def _is_intact(self) -> bool:
        """Return whether the ledger, and all outside of the blocks, are as they were written."""
        try:
            ledger = Ledger.read(self.descriptor)
        except DamageError:
            return False
        return ledger is not None and ledger.tobytes() == self.ledger.tobytes()


def _runs(block: Block, shape: tuple[int, ...]) -> Iterator[tuple[int, int]]:
    """Yield the first point and the number of points of each stretch of a block, in C order."""
    split = len(shape)
    while split > 1 and block[split - 1] == slice(0, shape[split - 1]):
        split -= 1
    inner = math.prod(shape[split:])  # along the last axes, which the block spans
    *outer, cut = block[:split] or (slice(0, 1),)
    for corner in itertools.product(*(range(c.start, c.stop) for c in outer)):
        first = 0
        for index, size in zip((*corner, cut.start), shape[:split] or (1,), strict=True):
            first = first * size + index
        yield first * inner, (cut.stop - cut.start) * inner
