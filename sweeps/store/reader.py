"""The file of a sweep as its readers see it: an ``xarray.Dataset``, once its checksums fit."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import h5py
import numpy as np
import xarray as xr

from sweeps.errors import StoreError
from sweeps.grid import Block
from sweeps.store.layout import ADDED, BLOCKS, FORMAT, FORMAT_VERSION, Layout
from sweeps.store.ledger import DamageError, Ledger, checksum
from sweeps.store.variables import VARIABLES
from sweeps.text import shown_bytes
from vibroimpact.status import Status

#: Endings that name another kind of file, which a slip would give to the data.
_OTHER_ENDINGS = (".png", ".svg", ".pdf", ".yaml", ".yml", ".txt")


def check_output(
    path: str | Path, *, overwrite: bool = False, resume: bool = False, size: int = 0
) -> None:
    """Refuse a path that a sweep of `size` bytes cannot be written to.

    Raises
    ------
    StoreError
        If `path` is a directory or in none, has the ending of another kind of file, exists and
        is neither to be overwritten nor resumed or is not a file that a sweep can have written,
        or if there is no room for the sweep.
    """
    path = Path(path)
    if path.suffix.lower() in _OTHER_ENDINGS:
        raise StoreError(
            f"the output {path} is to be an HDF5 file, whose name does not end in {path.suffix}; "
            f"did you mean {path.with_suffix('.h5')}?"
        )
    try:
        os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError) as error:  # too long a name, a null byte
        raise StoreError(f"the output {str(path)!r} cannot be used: {reason(error)}") from None
    if not path.parent.is_dir():
        raise StoreError(f"the folder {path.parent} of the output {path.name} does not exist")
    if path.is_dir():
        raise StoreError(f"{path} is a directory; give -o the name of a file")
    if path.exists():
        if not (overwrite or resume):
            raise StoreError(
                f"{path} exists; give --resume to go on with it, --overwrite to replace it, or "
                "-o for another file"
            )
        if path.stat().st_size > 0 and not h5py.is_hdf5(path):
            raise StoreError(
                f"{path} is not an HDF5 file and will not be replaced; give -o another"
            )
        if resume:
            return
    free = shutil.disk_usage(path.parent).free
    if size > free:
        also = ", delete the old file first" if path.exists() else ""
        raise StoreError(
            f"the sweep takes about {shown_bytes(size)}, and the disk of {path} has only "
            f"{shown_bytes(free)} left; record less{also}, or give -o a file elsewhere"
        )


def open_sweep(path: str | Path, *, verify: bool = True) -> xr.Dataset:
    """Open the file of a sweep; its arrays are read when they are used.

    A file that is being written can be opened, too; points that are not in it yet have the status
    ``PENDING``.

    Parameters
    ----------
    path : str or Path
    verify : bool
        Whether to hold every block against its checksum, which reads the whole file once.
        Everything else is held against its own in any case.

    Raises
    ------
    StoreError
        If there is no such file, it is not a readable sweep of this format, or it is damaged.
    """
    path = Path(path)
    try:
        with sweep_file(path) as sweep:
            if verify:
                sweep.refuse_damage()
        return xr.open_dataset(path, engine="h5netcdf")
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

    def present(self) -> np.ndarray:
        """Return which blocks were written to the end."""
        status = self.file["status"][()]
        done = [not np.any(status[block] == Status.PENDING) for block in self.layout.blocks]
        return self.ledger.entered() & np.array(done, bool)

    def damaged(self) -> np.ndarray:
        """Return which blocks are not as they were written."""
        indices = np.flatnonzero(self.present()).tolist()

        def fits(index: int) -> bool:
            try:
                arrays = self.read(self.layout.blocks[index])
            except OSError:  # a compressed chunk has HDF5's checksum, too
                return False
            return checksum(arrays.values()) == self.ledger.rows["crc"][index]

        damaged = np.zeros(len(self.layout.blocks), bool)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            damaged[indices] = ~np.fromiter(pool.map(fits, indices), bool, len(indices))
        return damaged

    def refuse_damage(self) -> None:
        """Raise a StoreError that names the damaged blocks, if there are any."""
        indices = np.flatnonzero(self.damaged())
        if indices.size:
            added = ADDED in self.layout.attributes  # points that no resumed run computes
            how = "overwrite" if added else "resume to compute what is lost, and nothing else"
            raise StoreError(
                f"{self.path} is damaged: {self.named(indices)}; run its configuration again "
                f"with --{how}"
            )

    def named(self, indices: Iterable[int]) -> str:
        """Name blocks by their number and the part of the grid that they cover."""
        texts = [f"block {i}{self._covered(self.layout.blocks[i])}" for i in indices]
        more = f" and {len(texts) - 3} more" if len(texts) > 3 else ""
        return ", ".join(texts[:3]) + f"{more} of {len(self.layout.blocks)}"

    def _covered(self, block: Block) -> str:
        ends = [
            f"{name} {values[cut][0]:g} to {values[cut][-1]:g}"
            for cut, (name, values) in zip(block, self.layout.axes.items(), strict=True)
            if cut.stop - cut.start < len(values)
        ]
        return f" ({', '.join(ends)})" if ends else ""


@contextmanager
def sweep_file(path: Path) -> Iterator[SweepFile]:
    """Open a file whose structure, coordinates and attributes fit their checksum.

    Raises
    ------
    StoreError
        As from `open_sweep`.
    """
    with ExitStack() as stack:
        yield _opened(path, stack)


def _opened(path: Path, stack: ExitStack) -> SweepFile:
    try:
        if path.is_dir():
            raise StoreError(f"{path} is a directory, not the file of a sweep")
        descriptor = os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        raise StoreError(f"{path} does not exist") from None
    except (OSError, ValueError) as error:
        raise StoreError(f"{str(path)!r} cannot be read: {reason(error)}") from None
    stack.callback(os.close, descriptor)
    try:
        ledger = Ledger.read(descriptor)
        if ledger is None:
            _refuse_foreign(path)
        file = stack.enter_context(h5py.File(path, "r"))
        _check_format(path, file.attrs)
        return SweepFile(path, file, ledger, _layout(file))
    except DamageError:
        raise StoreError(
            f"{path} is damaged outside its results, truncated, or changed by another program: "
            "what is in it cannot be trusted; run its configuration again with --overwrite"
        ) from None
    except OSError as error:
        raise StoreError(f"{path} cannot be read, it may be truncated: {reason(error)}") from error


def _layout(file: h5py.File) -> Layout:
    """Read what a file holds from its datasets and their scales."""
    variables = tuple(name for name in VARIABLES if name in file)
    held = dict.fromkeys(VARIABLES[name].record for name in variables)
    axes = [scale for dimension in file["status"].dims for scale in dimension.values()]
    return Layout(
        {scale.name.strip("/"): _values(scale) for scale in axes},
        {record: file[record][()] for record in held if record},
        variables,
        [tuple(slice(*cut) for cut in block) for block in file[BLOCKS][()].tolist()],
        {name: value for name, value in file.attrs.items() if name != "duration"},
    )


def _values(scale: h5py.Dataset) -> np.ndarray:
    return scale.asstr()[()] if h5py.check_string_dtype(scale.dtype) else scale[()]


def _refuse_foreign(path: Path) -> NoReturn:
    """Say what a file is that has no ledger."""
    if not h5py.is_hdf5(path):
        raise StoreError(f"{path} is not an HDF5 file")
    with h5py.File(path, "r") as file:
        _check_format(path, file.attrs)
    raise DamageError


def _check_format(path: Path, attributes: Mapping[str, object]) -> None:
    if str(attributes.get("format")) != FORMAT:
        raise StoreError(f"{path} is an HDF5 file, but not one that vibroimpact wrote")
    version = attributes.get("format_version")
    if str(version) != str(FORMAT_VERSION):
        raise StoreError(
            f"{path} has the format version {version}, and this version of vibroimpact reads "
            f"only {FORMAT_VERSION}; open it with the version that wrote it"
        )


def reason(error: Exception) -> str:
    """Say what went wrong, without HDF5's buffer addresses and line breaks."""
    told = re.search(r"errno = (\d+)", str(error))
    number = getattr(error, "errno", None) or (told and int(told[1]))
    return os.strerror(number) if number else str(error).splitlines()[0]


def status_counts(dataset: xr.Dataset) -> dict[Status, int]:
    """Count the points of an opened sweep by outcome.

    Returns
    -------
    dict of Status to int
        Every status, also where there is no such point.
    """
    values = dataset["status"].values
    return {status: int(np.count_nonzero(values == status)) for status in Status}
