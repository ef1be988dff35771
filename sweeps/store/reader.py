"""Read the file of a sweep as an ``xarray.Dataset``, after its checksums were verified."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from sweeps.errors import StoreError
from sweeps.grid import Block
from sweeps.interrupts import check
from sweeps.store.layout import BLOCKS, COORDINATES, FORMAT_VERSION, Layout
from sweeps.store.ledger import DamageError, Ledger, State, checksum
from sweeps.store.path_checks import open_regular, reason, refuse_version, refuse_without_ledger
from sweeps.store.variables import VARIABLES
from vibroimpact.status import Status

if TYPE_CHECKING:
    import xarray as xr

#: Attributes of a file that its layout does not keep among the others.
_NOT_LAID_OUT = ("duration", COORDINATES)


def open_sweep(path: str | Path, *, verify: bool = True) -> xr.Dataset:
    """Open the file of a sweep; its arrays are read when they are used.

    A file that is being written can be opened, too; points that are not in it yet have the status
    ``PENDING``, and those of a block that was being written when the run was killed.

    Parameters
    ----------
    path : str or Path
    verify : bool
        Whether to compare every block with its checksum, which reads the whole file once.
        Everything else is compared with its own in any case.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    StoreError
        If there is no such file, it is not a readable sweep of this format, or it is damaged.
    """
    import xarray as xr  # which a short run would wait for

    path = Path(path)
    try:
        with sweep_file(path) as sweep:
            if verify:
                sweep.refuse_damage()
            unfinished = np.flatnonzero(sweep.ledger.are(State.WRITING)).tolist()
        dataset = xr.open_dataset(path, engine="h5netcdf")
        if unfinished:  # pending, whatever is in the file
            status = dataset["status"].load()
            for block in [sweep.layout.blocks[i] for i in unfinished]:
                status[block] = Status.PENDING
        return dataset
    except OSError as error:
        raise StoreError(f"{path} cannot be read: {reason(error)}") from error


@dataclass(frozen=True)
class SweepFile:
    """A file of a sweep, opened for reading, whose structure is sound."""

    path: Path
    file: h5py.File
    ledger: Ledger
    layout: Layout

    def read(self, block: Block) -> dict[str, np.ndarray]:
        """Return the data of a block, of every variable in the order of the checksum."""
        return {name: self.file[name][block] for name in self.layout.variables}

    def merged(
        self, values: np.ndarray, points: Mapping[float, Mapping[str, np.ndarray]]
    ) -> dict[str, np.ndarray]:
        """Return the results at values of the only axis: of `points`, or else of the file.

        Parameters
        ----------
        values : ndarray, shape (n,)
            In increasing order, as those of the file.
        points : mapping of float to mapping
            By the value of the axis, the results of one point.

        Returns
        -------
        dict of str to ndarray
            Arrays of shape (n, ...).
        """
        (old,) = self.layout.axes.values()
        at = np.minimum(np.searchsorted(old, values), len(old) - 1)
        stored = self.read((slice(int(at[0]), int(at[-1]) + 1),))
        results = {name: array[at - at[0]] for name, array in stored.items()}
        for i in np.flatnonzero(np.isin(values, list(points))):
            for name, array in results.items():
                array[i] = points[float(values[i])][name]
        return results

    def damaged(self) -> np.ndarray:
        """Return which blocks are not as they were written.

        Returns
        -------
        ndarray of bool, shape (blocks,)
            A block that is being written, or was when the run was killed, is not damaged.
        """
        damaged = np.zeros(len(self.layout.blocks), bool)
        suspects = np.arange(len(damaged))
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            while suspects.size:
                rows, valid = self.ledger.rows, self.ledger.valid()
                fits = np.fromiter(pool.map(self._fits, suspects.tolist()), bool, suspects.size)
                unfit = suspects[~(fits & valid[suspects])]
                if not unfit.size:
                    break
                with suppress(DamageError):
                    self.ledger.reread()  # the run may go on meanwhile
                unchanged = self.ledger.rows[unfit] == rows[unfit]
                damaged[unfit[unchanged]] = True
                suspects = unfit[~unchanged]
        return damaged

    def _fits(self, index: int) -> bool:
        """Return whether a block has the checksum of its row."""
        check()
        row = self.ledger.rows[index]
        if self.ledger.complete and row["state"] != State.DONE:
            return False
        if row["state"] == State.WRITING:
            return True
        try:
            arrays = self.read(self.layout.blocks[index])
        except OSError:  # a compressed chunk has HDF5's checksum, too
            return False
        pending = arrays["status"] == Status.PENDING
        if not (pending.all() if row["state"] == State.PENDING else not pending.any()):
            return False
        return bool(checksum(arrays.values()) == row["crc"])

    def refuse_damage(self) -> None:
        """Raise a StoreError that names the damaged blocks, if there are any."""
        indices = np.flatnonzero(self.damaged())
        if indices.size:
            # Added points are not computed again by a resumed run.
            refined = self.layout.refined
            how = "overwrite" if refined else "resume to compute what is lost, and nothing else"
            raise StoreError(
                f"{self.path} is damaged: {self.named(indices)}; run its configuration again "
                f"with --{how}"
            )

    def named(self, indices: Iterable[int]) -> str:
        """Name blocks by their number and the part of the grid that they cover; "" if none."""
        texts = [f"block {i}{self._range_text(self.layout.blocks[i])}" for i in indices]
        more = f" and {len(texts) - 3} more" if len(texts) > 3 else ""
        return f"{', '.join(texts[:3])}{more} of {len(self.layout.blocks)}" if texts else ""

    def _range_text(self, block: Block) -> str:
        """Return as text the part of the grid a block covers; "" if it is the whole grid."""
        ends = [
            f"{name} {values[cut][0]:g} to {values[cut][-1]:g}"
            for cut, (name, values) in zip(block, self.layout.axes.items(), strict=True)
            if cut.stop - cut.start < len(values)
        ]
        return f" ({', '.join(ends)})" if ends else ""


@contextmanager
def sweep_file(path: Path) -> Iterator[SweepFile]:
    """Open a file whose structure, coordinates and attributes fit their checksum, or refuse it."""
    with ExitStack() as stack:
        yield _opened(path, stack)


def _opened(path: Path, stack: ExitStack) -> SweepFile:
    """Open a file until `stack` ends, and check all of it but the blocks."""
    descriptor = open_regular(path)
    stack.callback(os.close, descriptor)
    try:
        ledger = Ledger.read(descriptor)
        if ledger is None:
            refuse_without_ledger(path, descriptor)
        # Not by its name, which a run may give to its final file at this moment.
        file = stack.enter_context(h5py.File(f"/dev/fd/{descriptor}", "r"))
        version = file.attrs.get("format_version")
        if str(version) != str(FORMAT_VERSION):
            refuse_version(path, version)
        return SweepFile(path, file, ledger, _layout(file))
    except DamageError:
        raise StoreError(
            f"{path} is damaged outside its results, truncated, or changed by another program: "
            "what is in it cannot be trusted; run its configuration again with --overwrite"
        ) from None
    except OSError as error:
        if os.fstat(descriptor).st_nlink == 0:  # a run has just replaced it, and HDF5 wants a name
            return _opened(path, stack)
        raise StoreError(f"{path} cannot be read, it may be truncated: {reason(error)}") from error


def _layout(file: h5py.File) -> Layout:
    """Read what a file holds from its datasets and their scales."""
    variables = tuple(name for name in VARIABLES if name in file)
    record_names = dict.fromkeys(VARIABLES[name].record for name in variables)
    axes = [scale for dimension in file["status"].dims for scale in dimension.values()]
    return Layout(
        {scale.name.strip("/"): _values(scale) for scale in axes},
        {name: float(file[name][()]) for name in str(file.attrs[COORDINATES]).split()},
        {record: file[record][()] for record in record_names if record},
        variables,
        [tuple(slice(*cut) for cut in block) for block in file[BLOCKS][()].tolist()],
        {name: value for name, value in file.attrs.items() if name not in _NOT_LAID_OUT},
    )


def _values(scale: h5py.Dataset) -> np.ndarray:
    return scale.asstr()[()] if h5py.check_string_dtype(scale.dtype) else scale[()]


def per_point(path: Path, names: Iterable[str]) -> tuple[dict[str, np.ndarray], float]:
    """Read variables with one value for each point, and the duration of the run [s]."""
    with sweep_file(path) as sweep:
        values = {name: sweep.file[name][()] for name in names}
        return values, float(sweep.file.attrs["duration"])


def status_counts(variables: Mapping[Any, Any]) -> dict[Status, int]:
    """Count the points of a sweep by outcome, also where there is no such point.

    Parameters
    ----------
    variables : mapping of str to array_like
        The ``status`` among them: an opened sweep, say.
    """
    values = np.asarray(variables["status"])
    return {status: int(np.count_nonzero(values == status)) for status in Status}
