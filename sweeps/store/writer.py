"""Write the results of a sweep to its file, block by block.

A trajectory has samples at its impacts, too, so its length is not known before it is computed.
Where a trajectory does not fit, the file is copied into a wider one, and at the end into one of the
right width. A file that is to be compressed or refined is copied as well. The copy takes the place
of the file when the copy is complete.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from sweeps.grid import Block
from sweeps.interrupts import check
from sweeps.messages import Failed, StoreError
from sweeps.store.blocks import BlockFile
from sweeps.store.creation import create, pack
from sweeps.store.insertion import merged
from sweeps.store.layout import Layout
from sweeps.store.ledger import ROW, State, checksum
from sweeps.store.output import check_output, reason
from sweeps.store.reader import sweep_file
from sweeps.store.replacing import remove_leftovers, replacing
from sweeps.store.resuming import refuse_other
from sweeps.store.variables import VARIABLES


@contextmanager
def sweep_writer(
    path: str | Path, layout: Layout, *, overwrite: bool = False, resume: bool = False
) -> Iterator[SweepWriter]:
    """Create the file of a sweep, or go on with it; to be called by its `only_writer`.

    Parameters
    ----------
    path : str or Path
    layout : Layout
        Of the sweep; a file that is resumed keeps its own blocks.
    overwrite : bool
        Whether an existing file may be replaced. It stays until the new one is laid out.
    resume : bool
        Whether to go on with an existing file. Its damaged blocks are pending again.

    Yields
    ------
    SweepWriter

    Raises
    ------
    StoreError
        If `path` is refused by `check_output`, or is not of this sweep.
    Failed
        If it cannot be created. No file is left behind, and an old one is untouched.
    """
    user_path, path = Path(path), Path(path).resolve()
    check_output(user_path, overwrite=overwrite, resume=resume)
    remove_leftovers(path)
    damaged = np.zeros(0, int)
    damage = ""
    if resume and path.exists() and path.stat().st_size > 0:
        with sweep_file(user_path) as sweep:
            refuse_other(sweep, layout)
            damaged = np.flatnonzero(sweep.damaged())
            if damaged.size:
                damage = sweep.named(damaged)
        if damaged.size and sweep.layout.refined:
            raise StoreError(
                f"{user_path} is damaged: {damage}; points that were added to its grid cannot be "
                "computed again one by one: give --overwrite to begin anew"
            )
    else:
        with _failure(user_path, "created"), replacing(path) as new:
            create(new, layout)
    with _failure(user_path, "written"):
        writer = SweepWriter(BlockFile.opened(path), user_path, damage)
    try:
        if damaged.size:
            writer.mend(damaged)
        yield writer
    except StoreError as error:  # the file was accepted, and is not what it was
        with suppress(Failed):
            writer.close()
        raise Failed(str(error)) from error
    except BaseException:
        with suppress(Failed):  # the first failure is the one to tell
            writer.close()
        raise
    writer.close()


class SweepWriter:
    """Fills the file of a sweep block by block; from `sweep_writer`.

    Until a block is written its points read as NaN with status ``PENDING``.

    Parameters
    ----------
    file : BlockFile
    user_path : Path
        The name of the file for messages.
    damage : str
        The blocks that are damaged, in words.

    Attributes
    ----------
    damage : str
        The blocks that were damaged and are pending again; empty if none.
    """

    def __init__(self, file: BlockFile, user_path: Path, damage: str = "") -> None:
        self._file = file
        self._user_path = user_path
        self.damage = damage
        self._began = time.monotonic()
        self._spent = 0.0 if math.isnan(file.ledger.seconds) else file.ledger.seconds
        self._changed = False
        self._complete = file.ledger.complete
        self._numbers = {_corners(block): i for i, block in enumerate(file.layout.blocks)}

    @property
    def layout(self) -> Layout:
        """Of the file as it is."""
        return self._file.layout

    def pending(self) -> list[Block]:
        """Return the blocks that are not in the file."""
        return [self.layout.blocks[i] for i in self._file.pending().tolist()]

    def mend(self, damaged: np.ndarray) -> None:
        """Make damaged blocks pending again.

        Parameters
        ----------
        damaged : ndarray of int
            The numbers of the blocks.

        Raises
        ------
        Failed
            As from `write`.
        """
        self._complete, self._changed = False, True
        with _failure(self._user_path, "mended"):
            if not self._file.places:  # a compressed file has no places to write to
                self._copy_into(self.layout, without=damaged)
                return
            self._file.ledger.summarize(State.PENDING, self._spent)
            for index in damaged.tolist():
                self._file.erase(index)

    def write(self, block: Block, results: Mapping[str, np.ndarray]) -> None:
        """Write the results of one block.

        Parameters
        ----------
        block : Block
            One of the layout's.
        results : mapping of str to ndarray
            For every variable of the file, an array of shape (points of the block, ...) in C
            order. A trajectory may have any number of samples. Variables that this file leaves
            out are ignored.

        Raises
        ------
        KeyError
            If a variable of the file is missing, or there is no such block.
        ValueError
            If an array has the wrong shape, or a name is not in ``VARIABLES``.
        Failed
            If the file cannot be written, say on a full disk, or was removed or changed.
        """
        index = self._numbers[_corners(block)]
        arrays = self._checked(block, results)
        samples = max((np.shape(a)[-1] for n, a in arrays.items() if _sampled(n)), default=0)
        with _failure(self._user_path, "written"):
            self._file.refuse_loss(self._user_path)
            self._changed = True
            if samples > self._samples:
                wider = self.layout.with_samples(max(samples, self._samples * 5 // 4))
                self._copy_into(wider)
            self._file.write(index, _fitted(arrays, self._samples), samples)
            self._file.refuse_loss(self._user_path)

    def finish(self, *, compressed: bool = False) -> None:
        """Give a complete file its final form: trajectories cut to the longest, compression.

        Parameters
        ----------
        compressed : bool
            Whether to compress it, if it is not.

        Raises
        ------
        Failed
            As from `write`.
        """
        longest = int(self._file.ledger.rows["samples"].max(initial=0))
        if longest < self._samples or (compressed and self._file.places):
            with _failure(self._user_path, "completed"):
                self._copy_into(self.layout.with_samples(longest), compressed=compressed)
        self._changed |= not self._complete
        self._complete = True

    def insert(self, axis: str, points: Mapping[float, Mapping[str, np.ndarray]]) -> None:
        """Replace a complete file along one axis by one with further points in it.

        Parameters
        ----------
        axis : str
            The only axis, with its values in increasing order.
        points : mapping of float to mapping
            By the value of the axis, the results of one point. They also replace those of a value
            that is there already.

        Raises
        ------
        Failed
            As from `write`.
        """
        layout = self.layout.with_points(axis, np.array(list(points)))
        self._file.refuse_loss(self._user_path, thoroughly=True)
        with _failure(self._user_path, "refined"), sweep_file(self._file.path) as sweep:
            sweep.refuse_damage()

            def merged_block(index: int) -> dict[str, np.ndarray]:
                """Return the results of a block of the new layout."""
                return merged(sweep, axis, layout.axes[axis][layout.blocks[index][0]], points)

            longest = int(self._file.ledger.rows["samples"].max(initial=0))
            samples = dict.fromkeys(range(len(layout.blocks)), longest)
            self._replace(lambda new: _copy(new, layout, merged_block, samples))

    def close(self) -> None:
        """Write the duration, if anything else was written, and close the file.

        Raises
        ------
        Failed
            As from `write`.
        """
        try:
            with _failure(self._user_path, "written"):
                self._file.refuse_loss(self._user_path)
                if self._changed:
                    state = State.DONE if self._complete else State.PENDING
                    self._file.ledger.summarize(state, self._seconds())
                    self._file.refuse_loss(self._user_path, thoroughly=True)
        finally:
            os.close(self._file.descriptor)

    def _seconds(self) -> float:
        return self._spent + time.monotonic() - self._began

    @property
    def _samples(self) -> int:
        return len(self.layout.records.get("sample", ()))

    def _checked(self, block: Block, results: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Give the arrays of shape (points, ...) the shape (box..., ...)."""
        unknown = sorted(set(results) - set(VARIABLES))
        if unknown:
            raise ValueError(f"the store has no variable {', '.join(unknown)}")
        box = tuple(cut.stop - cut.start for cut in block)
        arrays = {}
        for name in self.layout.variables:
            shape = np.shape(results[name])
            record = self.layout.shape_of(name)[len(box) :]
            expected = (math.prod(box), *(shape[-1:] if _sampled(name) else record))
            if shape != expected:
                raise ValueError(f"{name} has the shape {shape} instead of {expected}")
            array = np.asarray(results[name], VARIABLES[name].dtype)
            arrays[name] = array.reshape((*box, *expected[1:]))
        return arrays

    def _copy_into(
        self, layout: Layout, *, compressed: bool = False, without: np.ndarray | None = None
    ) -> None:
        """Replace the file by one of another layout with the same blocks in it."""
        self._file.refuse_loss(self._user_path, thoroughly=True)
        width = len(layout.records.get("sample", ()))
        rows = self._file.ledger.rows
        finished = np.flatnonzero(self._file.ledger.are(State.DONE))
        finished = np.setdiff1d(finished, [] if without is None else without)
        with sweep_file(self._file.path) as sweep:

            def undamaged(index: int) -> dict[str, np.ndarray]:
                """Return the results of a block in the new width."""
                arrays = sweep.read(layout.blocks[index])
                if checksum(arrays.values()) != rows["crc"][index]:
                    raise Failed(f"{self._user_path} was damaged while it was written")
                return _fitted(arrays, width)

            if compressed:
                new_rows = np.zeros(len(rows), ROW)
                new_rows["state"], new_rows["samples"] = State.DONE, rows["samples"]
                for index in range(len(rows)):
                    check()
                    new_rows["crc"][index] = checksum(undamaged(index).values())
                self._replace(
                    lambda new: pack(new, layout, new_rows, lambda name, cut: sweep.file[name][cut])
                )
            else:
                samples = {i: int(rows["samples"][i]) for i in finished.tolist()}
                self._replace(lambda new: _copy(new, layout, undamaged, samples))

    def _replace(self, write: Callable[[Path], None]) -> None:
        """Replace the file by another one, which is written into an empty file."""
        with replacing(self._file.path) as new:
            write(new)
            file = BlockFile.opened(new)
            try:
                file.ledger.summarize(State.PENDING, self._seconds())
                os.fsync(file.descriptor)
            finally:
                os.close(file.descriptor)
            self._file.refuse_loss(self._user_path)
        os.close(self._file.descriptor)
        self._file = BlockFile.opened(self._file.path)
        self._changed = True


def _copy(
    path: Path,
    layout: Layout,
    read: Callable[[int], Mapping[str, np.ndarray]],
    samples: Mapping[int, int],
) -> None:
    """Create a file with these blocks in it, each with its samples."""
    create(path, layout)
    file = BlockFile.opened(path)
    try:
        for index in samples:
            check()
            file.write(index, read(index), samples[index], lasting=False)
    finally:
        os.close(file.descriptor)


def _corners(block: Block) -> tuple[tuple[int, int], ...]:
    return tuple((cut.start, cut.stop) for cut in block)


def _sampled(name: str) -> bool:
    return VARIABLES[name].record == "sample"


def _fitted(arrays: Mapping[str, np.ndarray], width: int) -> dict[str, np.ndarray]:
    """Cut or pad the trajectories to a width."""

    def cut_or_padded(array: np.ndarray) -> np.ndarray:
        """Return an array of that width along its last axis."""
        missing = [(0, 0)] * (array.ndim - 1) + [(0, max(0, width - array.shape[-1]))]
        return np.pad(array[..., :width], missing, constant_values=math.nan)

    return {
        name: cut_or_padded(array) if _sampled(name) else array for name, array in arrays.items()
    }


@contextmanager
def _failure(path: Path, action: str) -> Iterator[None]:
    """Turn what goes wrong with an accepted file into a failure."""
    try:
        yield
    except StoreError as error:
        raise Failed(str(error)) from error
    except (OSError, RuntimeError, ValueError, OverflowError) as error:
        raise Failed(f"{path} cannot be {action}: {reason(error)}") from error
