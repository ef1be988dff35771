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
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path

import numpy as np

from sweeps.errors import Failed, StoreError
from sweeps.grid import Block, block_points, box_shape
from sweeps.interrupts import check
from sweeps.store.blocks import BlockFile
from sweeps.store.creation import create, pack
from sweeps.store.layout import Layout
from sweeps.store.ledger import State, checksum
from sweeps.store.path_checks import check_output, reason
from sweeps.store.reader import sweep_file
from sweeps.store.replacing import remove_leftovers, replacing
from sweeps.store.resuming import refuse_other
from sweeps.store.variables import VARIABLES


@contextmanager
def sweep_writer(
    path: str | Path, layout: Layout, *, overwrite: bool = False, resume: bool = False
) -> Iterator[SweepWriter]:
    """Create the file of a sweep, or go on with it; call it inside `only_writer`.

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
    # A link is followed once: all that follows works on the file that was checked and locked.
    user_path, path = Path(path), Path(path).resolve()
    check_output(user_path, overwrite=overwrite, resume=resume)
    remove_leftovers(path)
    damaged, damage = np.zeros(0, int), ""
    if resume and path.exists() and path.stat().st_size > 0:
        with sweep_file(user_path) as sweep:
            refuse_other(sweep, layout)
            damaged = np.flatnonzero(sweep.damaged())
            damage = sweep.named(damaged)
        if damage and sweep.layout.refined:
            raise StoreError(
                f"{user_path} is damaged: {damage}; points that were added to its grid cannot be "
                "computed again one by one: give --overwrite to begin anew"
            )
    else:
        with _failure(user_path, "created"), replacing(path) as new:
            create(new, layout)
    with _failure(user_path, "written"):
        writer = SweepWriter(BlockFile.opened(path, user_path), damage)
    try:
        if damaged.size:
            writer.mend(damaged)
        yield writer
    except BaseException as error:
        with suppress(Failed):  # the first failure is the one to tell
            writer.close()
        if isinstance(error, StoreError):  # the file passed its checks, and has changed since
            raise Failed(str(error)) from error
        raise
    writer.close()


class SweepWriter:
    """Fills the file of a sweep block by block; from `sweep_writer`.

    Until a block is written its points read as NaN with status ``PENDING``.

    Parameters
    ----------
    file : BlockFile
    damage : str
        The blocks that were damaged and are pending again, in words; empty if none.

    Raises
    ------
    Failed
        From every method, if the file cannot be written, say on a full disk, or was removed or
        changed.
    """

    def __init__(self, file: BlockFile, damage: str) -> None:
        self._file = file
        self.damage = damage
        self._began = time.monotonic()
        self._spent = float(np.nan_to_num(file.ledger.summary["seconds"]))
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
        """
        self._complete, self._changed = False, True
        with _failure(self._file.user_path, "mended"):
            if not self._file.places:  # a compressed file has no places to write to
                self._copy_into(self.layout, without=damaged.tolist())
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
        """
        index = self._numbers[_corners(block)]
        arrays = self._checked(block, results)
        samples = max((np.shape(a)[-1] for n, a in arrays.items() if _sampled(n)), default=0)
        with _failure(self._file.user_path, "written"):
            self._file.refuse_loss()
            self._changed = True
            if samples > self._samples:
                wider = self.layout.with_samples(max(samples, self._samples * 5 // 4))
                self._copy_into(wider)
            self._file.write(index, _fitted(arrays, self._samples), samples)
            self._file.refuse_loss()

    def finish(self, *, compressed: bool = False) -> None:
        """Give a complete file its final form: trajectories cut to the longest, compression.

        Parameters
        ----------
        compressed : bool
            Whether to compress it, if it is not.
        """
        longest = self._longest()
        if longest < self._samples or (compressed and self._file.places):
            with _failure(self._file.user_path, "completed"):
                self._copy_into(self.layout.with_samples(longest), compressed=compressed)
        self._changed |= not self._complete
        self._complete = True

    def insert(self, points: Mapping[float, Mapping[str, np.ndarray]]) -> None:
        """Replace a complete file along one axis by one with further points in it.

        Parameters
        ----------
        points : mapping of float to mapping
            By the value of the axis, whose values increase, the results of one point. They also
            replace those of a value that is there already.
        """
        layout = self.layout.with_points(np.array(list(points)))
        (values,) = layout.axes.values()
        self._file.refuse_loss(thoroughly=True)
        with _failure(self._file.user_path, "refined"), sweep_file(self._file.path) as sweep:
            sweep.refuse_damage()

            def merged_block(index: int) -> dict[str, np.ndarray]:
                """Return the results of a block of the new layout."""
                return sweep.merged(values[layout.blocks[index]], points)

            samples = dict.fromkeys(range(len(layout.blocks)), self._longest())
            self._replace(lambda new: _copy(new, layout, merged_block, samples))

    def close(self) -> None:
        """Write the duration, if anything else was written, and close the file."""
        try:
            with _failure(self._file.user_path, "written"):
                self._file.refuse_loss()
                if self._changed:
                    state = State.DONE if self._complete else State.PENDING
                    self._file.ledger.summarize(state, self._seconds())
                    self._file.refuse_loss(thoroughly=True)
        finally:
            self._file.close()

    def _seconds(self) -> float:
        return self._spent + time.monotonic() - self._began

    def _longest(self) -> int:
        """Return the samples of the longest trajectory so far."""
        return int(self._file.ledger.rows["samples"].max(initial=0))

    @property
    def _samples(self) -> int:
        """The samples that a trajectory of the file has room for."""
        return len(self.layout.records.get("sample", ()))

    def _checked(self, block: Block, results: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Give the arrays of shape (points, ...) the shape (box..., ...)."""
        unknown = sorted(set(results) - set(VARIABLES))
        if unknown:
            raise ValueError(f"the store has no variable {', '.join(unknown)}")
        arrays = {}
        for name in self.layout.variables:
            shape = np.shape(results[name])
            record = shape[-1:] if _sampled(name) else self.layout.shape_of(name, ())
            expected = (block_points(block), *record)
            if shape != expected:
                raise ValueError(f"{name} has the shape {shape} instead of {expected}")
            array = np.asarray(results[name], VARIABLES[name].dtype)
            arrays[name] = array.reshape((*box_shape(block), *record))
        return arrays

    def _copy_into(
        self, layout: Layout, *, compressed: bool = False, without: Sequence[int] = ()
    ) -> None:
        """Replace the file by one of another layout with the same blocks in it."""
        self._file.refuse_loss(thoroughly=True)
        width, ledger = len(layout.records.get("sample", ())), self._file.ledger
        with sweep_file(self._file.path) as sweep:

            def undamaged(index: int) -> dict[str, np.ndarray]:
                """Return the results of a block in the new width."""
                arrays = sweep.read(layout.blocks[index])
                if checksum(arrays.values()) != ledger.rows["crc"][index]:
                    raise Failed(f"{self._file.user_path} was damaged while it was written")
                return _fitted(arrays, width)

            if not compressed:
                kept = np.setdiff1d(np.flatnonzero(ledger.are(State.DONE)), without).tolist()
                samples = {index: int(ledger.rows["samples"][index]) for index in kept}
                self._replace(lambda new: _copy(new, layout, undamaged, samples))
                return
            rows = ledger.rows.copy()  # of a complete file
            for index in range(len(rows)):
                check()
                rows["crc"][index] = checksum(undamaged(index).values())
            self._replace(
                lambda new: pack(new, layout, rows, lambda name, part: sweep.file[name][part])
            )

    def _replace(self, write: Callable[[Path], None]) -> None:
        """Replace the file by another one, which is written into an empty file."""
        with replacing(self._file.path) as new:
            write(new)
            with closing(BlockFile.opened(new, new)) as file:
                file.ledger.summarize(State.PENDING, self._seconds())
                os.fsync(file.descriptor)
            self._file.refuse_loss()
        self._file.close()
        self._file = BlockFile.opened(self._file.path, self._file.user_path)
        self._changed = True


def _copy(
    path: Path,
    layout: Layout,
    read: Callable[[int], Mapping[str, np.ndarray]],
    samples: Mapping[int, int],
) -> None:
    """Create a file with these blocks in it, each with its samples."""
    create(path, layout)
    with closing(BlockFile.opened(path, path)) as file:
        for index in samples:
            check()
            file.write(index, read(index), samples[index], lasting=False)


def _corners(block: Block) -> tuple[tuple[int, int], ...]:
    return tuple((cut.start, cut.stop) for cut in block)


def _sampled(name: str) -> bool:
    return VARIABLES[name].record == "sample"


def _fitted(arrays: Mapping[str, np.ndarray], width: int) -> dict[str, np.ndarray]:
    """Cut or pad the trajectories to a width."""

    def cut_or_padded(array: np.ndarray) -> np.ndarray:
        """Return an array whose last axis has the length `width`."""
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
