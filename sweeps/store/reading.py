"""Read a sweep: its complete file, or its blocks while it is incomplete; statuses are counted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from sweeps.errors import StoreError
from sweeps.store.complete_file import check_file, open_despite_locks, open_unchanged, schema_of
from sweeps.store.parts import Parts
from sweeps.store.paths import (
    SCHEMA,
    Content,
    content,
    identity,
    parts_path,
    reason,
    refuse_parts,
)
from sweeps.store.schema import schema_in
from vibroimpact.status import Status

if TYPE_CHECKING:
    import xarray as xr
    from xarray.backends import CachingFileManager

    from sweeps.store.lazy_dataset import Key


def read_sweep(path: Path, verify: bool) -> xr.Dataset:
    """Return the Dataset of `open_sweep`, whose arrays are read each time they are used."""
    try:
        refuse_parts(path)
        if _is_missing(path) and identity(parts_path(path) / SCHEMA):
            from sweeps.store.incomplete_dataset import open_parts

            try:
                folder = parts_path(path)
                parts = Parts(folder, schema_of(folder / SCHEMA), verify=verify)
                if _is_missing(path):  # otherwise a run has just completed the file
                    return open_parts(parts)
            except StoreError:
                if _is_missing(path):
                    raise
        digest = check_file(path, verify=verify)
        return open_despite_locks(lambda options: _open_file(path, digest, options))
    except (OSError, ValueError) as error:
        raise StoreError(f"{str(path)!r} cannot be read: {reason(error)}") from error


def _open_file(path: Path, digest: str, options: dict[str, Any]) -> xr.Dataset:
    """Open a complete file for the arrays of the Dataset, and again if xarray has closed it."""
    from xarray.backends import CachingFileManager  # slow to import

    from sweeps.store.lazy_dataset import lazy_dataset

    manager = CachingFileManager(open_unchanged, path.absolute(), digest, mode="r", kwargs=options)
    file = manager.acquire()
    schema, duration = schema_in(file), float(file.attrs["duration"])
    chunks = {name: file[name].chunks or schema.shape_of(name) for name in schema.variables}
    dataset = lazy_dataset(schema, duration, partial(_selected, manager), chunks)
    dataset.set_close(manager.close)
    dataset.encoding["digest"] = digest
    return dataset


def _selected(manager: CachingFileManager, name: str, key: Key) -> np.ndarray:
    """Return the values of a variable that a key selects."""
    values: np.ndarray = manager.acquire()[name][key]
    return values


def _is_missing(path: Path) -> bool:
    return content(path) in (None, Content.NOTHING)


def per_point(path: Path, names: Iterable[str]) -> tuple[dict[str, np.ndarray], float]:
    """Return those of the variables, with a single value per point, that the file has.

    Also returns the duration of the run [s].
    """
    check_file(path, verify=False)
    with open_despite_locks(lambda options: h5py.File(path, "r", **options)) as file:
        held = {name: file[name][()] for name in names if name in file}
        return held, float(file.attrs["duration"])


def status_counts(variables: Mapping[Any, Any]) -> dict[Status, int]:
    """Count the points of a sweep with each outcome, including the outcomes without points."""
    values = np.asarray(variables["status"])
    return {status: int(np.count_nonzero(values == status)) for status in Status}
