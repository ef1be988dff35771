"""The writer of a sweep's file: blocks, each in the file whole or not at all.

The data of a block are written and made to last with fsync; only then its status and its row in
the ledger, which are made to last in their turn. A block that has both is complete whatever
happened, and the status alone says the same to any other reader. A kill leaves what was written;
only a loss of power needs the fsync, and gets what fsync promises.

Trajectories are as long as their impacts make them. Where one does not fit, the file is copied into
a wider one, and at the end into one that fits; so is a file with damaged blocks, without
them, and one that is to be compressed. The copy takes the place of the file when it is complete.
"""

from __future__ import annotations

import itertools
import math
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from sweeps.errors import Failed, StoreError
from sweeps.grid import Block
from sweeps.store.creation import create, pack, places, write_duration
from sweeps.store.insertion import merged
from sweeps.store.layout import ADDED, Layout
from sweeps.store.ledger import Ledger, checksum, flat_bytes, sync_folder, write_all
from sweeps.store.reader import SweepFile, check_output, reason, sweep_file
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
        Whether to go on with an existing file.

    Raises
    ------
    StoreError
        If `path` is refused by `check_output`, or is not of this sweep.
    Failed
        If it cannot be created. No file is left behind, and an old one is untouched.
    """
    given, path = Path(path), Path(path).resolve()
    check_output(given, overwrite=overwrite, resume=resume)
    _temporary(path).unlink(missing_ok=True)  # of a process that was killed
    if resume and path.exists():
        with sweep_file(given) as sweep:
            _refuse_other(sweep, layout)
    else:
        with _failure(given, "created"), _replacing(path) as new:
            create(new, layout)
    writer = SweepWriter(path, given)
    try:
        yield writer
    except BaseException:
        with suppress(Failed):  # the first failure is the one to tell
            writer.close()
        raise
    writer.close()


class SweepWriter:
    """Fills the file of a sweep block by block; from `sweep_writer`.

    Until a block is written its points read as NaN with status ``PENDING``.

    Attributes
    ----------
    layout : Layout
        Of the file as it is.
    damage : str
        The blocks that were found damaged and are pending again; empty if none.
    """

    def __init__(self, path: Path, given: Path) -> None:
        self._path = path
        self._given = given
        self._started = time.monotonic()
        self._changed = False
        self.damage = ""
        self._open()
        with sweep_file(path) as sweep:
            damaged = sweep.damaged()
            if damaged.any():
                self.damage = sweep.named(np.flatnonzero(damaged))
                if ADDED in sweep.layout.attributes:
                    os.close(self._descriptor)
                    raise StoreError(
                        f"{given} is damaged: {self.damage}; points that were added to its grid "
                        "cannot be computed again one by one: give --overwrite to begin anew"
                    )
        if damaged.any():
            self._present &= ~damaged
            with _failure(given, "mended"):
                self._rewrite(self.layout)

    def _open(self) -> None:
        self._descriptor = os.open(self._path, os.O_RDWR)
        with sweep_file(self._path) as sweep:
            self.layout = sweep.layout
            self._present = sweep.present()
            self._ledger = Ledger(
                self._descriptor, sweep.ledger.start, sweep.ledger.rows, sweep.ledger.filled
            )
        self._places = places(self._path)
        self._numbers = {_corners(block): i for i, block in enumerate(self.layout.blocks)}
        (spent,) = np.frombuffer(os.pread(self._descriptor, 8, self._ledger.filled[0][0]))
        self._spent = 0.0 if math.isnan(spent) else float(spent)

    def pending(self) -> list[Block]:
        """Return the blocks that are not in the file."""
        return [self.layout.blocks[i] for i in np.flatnonzero(~self._present).tolist()]

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
            If the file cannot be written, say on a full disk.
        """
        index = self._numbers[_corners(block)]
        arrays = self._checked(block, results)
        samples = max((np.shape(a)[-1] for n, a in arrays.items() if _sampled(n)), default=0)
        with _failure(self._given, "written"):
            if samples > self._samples:
                self._rewrite(self.layout.with_samples(max(samples, self._samples * 5 // 4)))
            arrays = _fitted(arrays, self._samples)
            status = {"status": arrays.pop("status")}
            self._put(block, arrays)
            os.fsync(self._descriptor)
            self._put(block, status)
            self._enter(index, {**arrays, **status}, samples)
            os.fsync(self._descriptor)

    def finish(self, *, compressed: bool = False) -> None:
        """Give a complete file its final form: trajectories cut to the longest, compression.

        Raises
        ------
        Failed
            As from `write`.
        """
        longest = int(self._ledger.rows["samples"].max(initial=0))
        if longest < self._samples or (compressed and self._places):
            with _failure(self._given, "completed"):
                self._rewrite(self.layout.with_samples(longest), compressed=compressed)

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
        with (
            _failure(self._given, "refined"),
            sweep_file(self._path) as sweep,
            _replacing(self._path) as new,
        ):
            create(new, layout)
            copy = SweepWriter(new, self._given)
            for block in layout.blocks:
                copy.write(block, merged(sweep, axis, layout.axes[axis][block[0]], points))
            copy.close()
        self._reopen()

    @property
    def refined(self) -> bool:
        """Whether points were added to the file's grid."""
        return ADDED in self.layout.attributes

    def close(self) -> None:
        """Write the duration, if anything else was written, and close the file.

        Raises
        ------
        Failed
            As from `write`.
        """
        spent = self._spent + time.monotonic() - self._started
        try:
            if self._changed:
                with _failure(self._given, "written"):
                    write_duration(self._descriptor, self._ledger.filled[0][0], spent)
                    os.fsync(self._descriptor)
        finally:
            os.close(self._descriptor)

    def _reopen(self) -> None:
        """Go on with the file that has replaced this one."""
        os.close(self._descriptor)
        spent = self._spent
        self._open()
        self._spent, self._changed = spent, True

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
            given = np.shape(results[name])
            record = self.layout.shape_of(name)[len(box) :]
            expected = (math.prod(box), *(given[-1:] if _sampled(name) else record))
            if given != expected:
                raise ValueError(f"{name} has the shape {given} instead of {expected}")
            array = np.asarray(results[name], VARIABLES[name].dtype)
            arrays[name] = array.reshape((*box, *expected[1:]))
        return arrays

    def _put(self, block: Block, arrays: Mapping[str, np.ndarray]) -> None:
        """Write the data of a block to their places."""
        for name, array in arrays.items():
            data = flat_bytes(array)
            width = math.prod(array.shape[len(block) :]) * array.itemsize
            at = 0
            for first, count in _runs(block, self.layout.shape):
                write_all(
                    self._descriptor,
                    data[at : at + count * width],
                    self._places[name] + first * width,
                )
                at += count * width

    def _enter(self, index: int, arrays: Mapping[str, np.ndarray], samples: int) -> None:
        self._ledger.enter(index, checksum(arrays.values()), samples)
        self._present[index] = True
        self._changed = True

    def _rewrite(self, layout: Layout, *, compressed: bool = False) -> None:
        """Replace the file by one of another layout with the same blocks in it."""
        width = len(layout.records.get("sample", ()))
        samples = self._ledger.rows["samples"].tolist()
        with sweep_file(self._path) as sweep, _replacing(self._path) as new:

            def read(index: int) -> dict[str, np.ndarray]:
                arrays = sweep.read(layout.blocks[index])
                if checksum(arrays.values()) != self._ledger.rows["crc"][index]:
                    raise Failed(f"{self._given} was damaged while it was written")
                return _fitted(arrays, width)

            if compressed:
                pack(new, layout, read, samples)
            else:
                create(new, layout)
                copy = SweepWriter(new, self._given)
                for index in np.flatnonzero(self._present).tolist():
                    arrays = read(index)
                    copy._put(layout.blocks[index], arrays)
                    copy._enter(index, arrays, samples[index])
                copy.close()
        self._reopen()


def _corners(block: Block) -> tuple[tuple[int, int], ...]:
    return tuple((cut.start, cut.stop) for cut in block)


def _sampled(name: str) -> bool:
    return VARIABLES[name].record == "sample"


def _fitted(arrays: Mapping[str, np.ndarray], width: int) -> dict[str, np.ndarray]:
    """Cut or pad the trajectories to a width."""

    def fitted(array: np.ndarray) -> np.ndarray:
        missing = [(0, 0)] * (array.ndim - 1) + [(0, max(0, width - array.shape[-1]))]
        return np.pad(array[..., :width], missing, constant_values=math.nan)

    return {name: fitted(array) if _sampled(name) else array for name, array in arrays.items()}


def _runs(block: Block, shape: tuple[int, ...]) -> Iterator[tuple[int, int]]:
    """Yield the first point and the number of points of each stretch of a block, in C order."""
    split = len(shape)
    while split > 0 and block[split - 1] == slice(0, shape[split - 1]):
        split -= 1
    inner = math.prod(shape[split:])
    outer, cut = block[: max(split - 1, 0)], block[split - 1] if split else slice(0, 1)
    for corner in itertools.product(*(range(c.start, c.stop) for c in outer)):
        row = 0
        for index, length in zip(corner, shape, strict=False):
            row = row * length + index
        first = row * (shape[split - 1] if split else 1) + cut.start
        yield first * inner, (cut.stop - cut.start) * inner


def _refuse_other(sweep: SweepFile, layout: Layout) -> None:
    """Refuse to go on with a file that another sweep began."""
    old, new = sweep.layout, layout
    differing = [
        f"{key} was {was} and is {now}"
        for key, was, now in _differences(
            str(old.attributes["configuration"]), str(new.attributes["configuration"])
        )
    ]
    if old.attributes["numerics"] != new.attributes["numerics"]:
        differing.append("the code that computes is another version")
    same_grid = _same_grid(old.axes, new.axes) or ADDED in old.attributes
    if not differing and not same_grid:
        differing.append("the axes have other values or another order")
    if differing:
        raise StoreError(
            f"{sweep.path} cannot be resumed: {'; '.join(differing)}; give --overwrite to replace "
            "it, or -o for another file"
        )


def _differences(old: str, new: str) -> Iterator[tuple[str, object, object]]:
    """Yield the keys in which two configurations differ, and their values; not the name."""
    if old == new:
        return
    was, now = _flat(yaml.safe_load(old)), _flat(yaml.safe_load(new))
    for key in sorted({*was, *now} - {"name"}):
        if was.get(key) != now.get(key):
            yield key, was.get(key, "not given"), now.get(key, "not given")


def _flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    leaves: dict[str, object] = {}
    for key, value in tree.items():
        deeper = isinstance(value, dict)
        leaves |= _flat(value, f"{prefix}{key}.") if deeper else {f"{prefix}{key}": value}
    return leaves


def _same_grid(old: Mapping[str, np.ndarray], new: Mapping[str, np.ndarray]) -> bool:
    return list(old) == list(new) and all(np.array_equal(old[axis], new[axis]) for axis in old)


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """Yield the name of a new file, which replaces `path` at the end."""
    new = _temporary(path)
    try:
        yield new
        os.replace(new, path)
        sync_folder(path)
    finally:
        new.unlink(missing_ok=True)


def _temporary(path: Path) -> Path:
    return path.with_name(f".{path.name}.new")


@contextmanager
def _failure(path: Path, what: str) -> Iterator[None]:
    """Turn the errors of the disk and of HDF5 into a Failed."""
    try:
        yield
    except (OSError, RuntimeError, ValueError, OverflowError) as error:
        raise Failed(f"{path} cannot be {what}: {reason(error)}") from error
