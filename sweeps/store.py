"""The HDF5 file of a sweep: written block by block, opened as an ``xarray.Dataset``.

Every swept axis and every record dimension is an HDF5 dimension scale, so that
``xarray.open_dataset(path, engine="h5netcdf")`` opens the file with its coordinates.
"""

from __future__ import annotations

import math
import os
import platform
import shutil
import time
from collections.abc import Collection, Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from types import TracebackType
from typing import Self

import h5py
import numpy as np
import xarray as xr

from sweeps.grid import Block, Grid
from sweeps.variables import (
    FIXED_WIDTHS,
    RECORDS,
    VARIABLES,
    Variable,
    bytes_per_point,
    held_variables,
    shown_bytes,
)
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status

FORMAT = "vibroimpact-sweep"
FORMAT_VERSION = 1

#: Samples per chunk of a trajectory: 8 KiB, so a short record wastes little of it.
_SAMPLES_PER_CHUNK = 1024

#: Endings that name another kind of file, which a slip would give to the data.
_OTHER_ENDINGS = (".png", ".svg", ".pdf", ".yaml", ".yml", ".txt")


class StoreError(Exception):
    """A file cannot be used as asked; the text is one paragraph for the user."""


def check_output(path: str | Path, overwrite: bool, size: int = 0) -> None:
    """Refuse a path that a sweep of `size` bytes cannot be written to.

    Raises
    ------
    StoreError
        If `path` is a directory or in none, has the ending of another kind of file, exists and
        `overwrite` is false or it is not a file that a sweep can have written, or if there is
        no room for the sweep.
    """
    path = Path(path)
    if path.suffix.lower() in _OTHER_ENDINGS:
        raise StoreError(
            f"the output {path} is to be an HDF5 file, whose name does not end in {path.suffix}; "
            f"did you mean {path.with_suffix('.h5')}?"
        )
    if not path.parent.is_dir():
        raise StoreError(f"the folder {path.parent} of the output {path.name} does not exist")
    if path.is_dir():
        raise StoreError(f"{path} is a directory; give -o the name of a file")
    if path.exists() and not overwrite:
        raise StoreError(f"{path} exists; give --overwrite to replace it or -o for another file")
    if path.exists() and path.stat().st_size > 0 and not h5py.is_hdf5(path):
        raise StoreError(f"{path} is not an HDF5 file and will not be replaced; give -o another")
    free = shutil.disk_usage(path.parent).free + (path.stat().st_size if path.exists() else 0)
    if size > free:
        raise StoreError(
            f"the sweep takes about {shown_bytes(size)}, and the disk of {path} has only "
            f"{shown_bytes(free)} left; record less, or give -o a file elsewhere"
        )


class SweepWriter:
    """Creates the file of a sweep and fills it block by block.

    Until a block is written its points read as NaN with status ``PENDING``.

    Parameters
    ----------
    path : str or Path
        The file to create.
    grid : Grid
        Its axes become the leading dimensions of every result.
    name : str
        The name of the sweep.
    configuration : str
        The configuration as YAML, kept as it is.
    pilot : str, optional
        How its method was chosen, as YAML, kept as it is.
    widths : mapping of str to int
        Width of the record dimensions ``section``, ``impact`` and ``sample``; 0 leaves the
        variables of one out. ``sample`` is a guess: it grows as the trajectories come.
    first_section : int
        The number of the forcing period of the first section; the others follow.
    diagnostics : collection of str
        The diagnostics whose variables there are.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    StoreError
        If `path` is refused by `check_output` or cannot be created. No file is left behind.
    """

    def __init__(
        self,
        path: str | Path,
        grid: Grid,
        *,
        name: str,
        configuration: str,
        pilot: str | None = None,
        widths: Mapping[str, int],
        first_section: int,
        diagnostics: Collection[str] = (),
        overwrite: bool,
    ) -> None:
        check_output(path, overwrite, grid.size * bytes_per_point(widths, diagnostics))
        self.path = Path(path)
        self._axes = tuple(grid.axes)
        self._shape = grid.shape
        held = held_variables(widths, diagnostics)
        self._records = {
            record: np.arange(0 if record == "sample" else {**widths, **FIXED_WIDTHS}[record])
            for record in dict.fromkeys(v.record for v in held.values() if v.record)
        }
        if "section" in self._records:
            self._records["section"] += first_section
        self._started = time.monotonic()
        try:
            self._file = h5py.File(self.path, "w" if overwrite else "x")
        except (OSError, ValueError) as error:
            raise StoreError(f"{self.path} cannot be created: {_reason(error)}") from error
        try:
            self._describe(name, configuration)
            if pilot is not None:
                self._file.attrs["pilot"] = pilot
            self._scales: dict[str, h5py.Dataset] = {}
            self._lay_out(grid)
            self._variables = {name: self._add_variable(name, v) for name, v in held.items()}
        except BaseException as error:
            self._file.close()
            self.path.unlink(missing_ok=True)
            if isinstance(error, (OSError, RuntimeError, ValueError)):
                raise StoreError(f"{self.path} cannot be created: {_reason(error)}") from error
            raise

    def _lay_out(self, grid: Grid) -> None:
        """Create the dimension scales."""
        for axis, values in grid.axes.items():
            about = PARAMETERS[axis]
            self._add_scale(
                axis, np.asarray(values, float), about.meaning, about.unit, about.symbol
            )
        for record, numbers in self._records.items():
            self._add_scale(record, numbers, RECORDS[record], "1", "")

    def _describe(self, name: str, configuration: str) -> None:
        self._file.attrs.update(
            {
                "format": FORMAT,
                "format_version": FORMAT_VERSION,
                "name": name,
                "configuration": configuration,
                "vibroimpact_version": _version("vibroimpact"),
                "numba_version": _version("numba"),
                "numpy_version": np.__version__,
                "h5py_version": h5py.__version__,
                "platform": platform.platform(),
                "started": datetime.now(UTC).isoformat(timespec="seconds"),
            }
        )

    def _add_scale(
        self, name: str, values: np.ndarray, long_name: str, unit: str, symbol: str
    ) -> None:
        growing = {"maxshape": (None,), "chunks": (_SAMPLES_PER_CHUNK,)} if name == "sample" else {}
        scale = self._file.create_dataset(name, data=values, **growing)
        scale.attrs.update({"long_name": long_name, "units": unit, "symbol": symbol})
        scale.make_scale(name)
        self._scales[name] = scale

    def _add_variable(self, name: str, variable: Variable) -> h5py.Dataset:
        dimensions = self._axes
        shape = self._shape
        layout = {}
        if variable.record is not None:
            dimensions += (variable.record,)
            shape += (len(self._records[variable.record]),)
        if variable.record == "sample":
            layout = {
                "maxshape": (*self._shape, None),
                # A point at a time: reading one trajectory must not read its neighbours'.
                "chunks": (1,) * len(self._shape) + (_SAMPLES_PER_CHUNK,),
            }
        fill = math.nan if np.dtype(variable.dtype).kind == "f" else int(Status.PENDING)
        dataset = self._file.create_dataset(name, shape, variable.dtype, fillvalue=fill, **layout)
        dataset.attrs.update(
            {"long_name": variable.long_name, "units": variable.unit, "symbol": variable.symbol}
        )
        if name == "status":
            dataset.attrs["flag_values"] = np.array(list(Status), dtype=variable.dtype)
            dataset.attrs["flag_meanings"] = " ".join(status.name.lower() for status in Status)
        for index, dimension in enumerate(dimensions):
            dataset.dims[index].attach_scale(self._scales[dimension])
        return dataset

    def write(self, block: Block, results: Mapping[str, np.ndarray]) -> None:
        """Write the results of one block; ``status`` is written last.

        Parameters
        ----------
        block : Block
            One slice per swept axis.
        results : mapping of str to ndarray
            For every variable of the file, an array of shape (points of the block, ...) in C
            order. A trajectory may have any number of samples. Variables that this file leaves
            out are ignored.

        Raises
        ------
        KeyError
            If a variable of the file is missing.
        ValueError
            If an array has the wrong shape, or a name is not in ``VARIABLES``.
        StoreError
            If the file cannot be written, say on a full disk.
        """
        unknown = sorted(set(results) - set(VARIABLES))
        if unknown:
            raise ValueError(f"the store has no variable {', '.join(unknown)}")
        box = tuple(cut.stop - cut.start for cut in block)
        arrays = {name: self._boxed(name, results[name], box) for name in self._variables}
        samples = [a.shape[-1] for n, a in arrays.items() if VARIABLES[n].record == "sample"]
        try:
            self._widen(max(samples, default=0))
            for name, array in arrays.items():
                width = array.shape[-1:] if VARIABLES[name].record else ()
                self._variables[name][(*block, *(slice(0, n) for n in width))] = array
            # HDF5 buffers chunks, and a failure to write them later would pass unseen.
            self._file.flush()
        except (OSError, RuntimeError) as error:
            raise StoreError(f"{self.path} cannot be written: {_reason(error)}") from error

    def _boxed(self, name: str, array: np.ndarray, box: tuple[int, ...]) -> np.ndarray:
        """Give an array of shape (points, ...) the shape (box..., ...)."""
        record = VARIABLES[name].record
        expected: tuple[int, ...] = (math.prod(box),)
        if record is not None:
            width = len(self._records[record]) if record != "sample" else np.shape(array)[-1]
            expected += (width,)
        if np.shape(array) != expected:
            raise ValueError(f"{name} has the shape {np.shape(array)} instead of {expected}")
        return np.reshape(array, (*box, *expected[1:]))

    def _widen(self, width: int) -> None:
        """Make room for `width` samples; HDF5 fills the new ones with NaN."""
        if "sample" not in self._records or width <= len(self._scales["sample"]):
            return
        for name, dataset in self._variables.items():
            if VARIABLES[name].record == "sample":
                dataset.resize(width, axis=dataset.ndim - 1)
        self._scales["sample"].resize(width, axis=0)
        self._scales["sample"][:] = np.arange(width)

    def close(self) -> None:
        """Write the duration and close the file; closing twice is harmless.

        Raises
        ------
        StoreError
            If what is still in memory cannot be written.
        """
        if not self._file:
            return
        try:
            self._file.attrs["duration"] = time.monotonic() - self._started
            self._file.close()
        except (OSError, RuntimeError) as error:
            raise StoreError(f"{self.path} cannot be written: {_reason(error)}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            self.close()
        except StoreError:
            if error is None:  # otherwise the first failure is the one to tell
                raise


def _reason(error: Exception) -> str:
    """Say what went wrong, without HDF5's buffer addresses and line breaks."""
    number = getattr(error, "errno", None)
    return os.strerror(number) if number else str(error).splitlines()[0]


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"  # run from a checkout that was not installed


def open_sweep(path: str | Path) -> xr.Dataset:
    """Open the file of a sweep; its arrays are read when they are used.

    Raises
    ------
    StoreError
        If there is no such file, or it is not a readable sweep of this format.
    """
    path = Path(path)
    if path.is_dir():
        raise StoreError(f"{path} is a directory, not the file of a sweep")
    if not path.exists():
        raise StoreError(f"{path} does not exist")
    try:
        if not h5py.is_hdf5(path):
            raise StoreError(f"{path} is not an HDF5 file")
        with h5py.File(path, "r") as file:
            _check_format(path, file.attrs)
        return xr.open_dataset(path, engine="h5netcdf")
    except BlockingIOError as error:
        raise StoreError(f"{path} is being written by another process") from error
    except OSError as error:
        raise StoreError(f"{path} cannot be read, it may be truncated: {_reason(error)}") from error


def _check_format(path: Path, attributes: Mapping[str, object]) -> None:
    if str(attributes.get("format")) != FORMAT:
        raise StoreError(f"{path} is an HDF5 file, but not one that vibroimpact wrote")
    version = attributes.get("format_version")
    if str(version) != str(FORMAT_VERSION):
        raise StoreError(
            f"{path} has the format version {version}, and this version of vibroimpact reads "
            f"only {FORMAT_VERSION}; open it with the version that wrote it"
        )


def status_counts(dataset: xr.Dataset) -> dict[Status, int]:
    """Count the points of an opened sweep by outcome.

    Returns
    -------
    dict of Status to int
        Every status, also where there is no such point.
    """
    values = dataset["status"].values
    return {status: int(np.count_nonzero(values == status)) for status in Status}
