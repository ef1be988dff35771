"""The making of a sweep's HDF5 file: every byte has its place before a point is computed.

Every swept axis and every record dimension is an HDF5 dimension scale, so that
``xarray.open_dataset(path, engine="h5netcdf")`` opens the file with its coordinates.

While HDF5 has a file open for writing, it rewrites its own structures at times of its choosing
(opening and closing alone write the superblock twice), and a kill between two of these
writes leaves a file that cannot be opened. So HDF5 lays the file out whole, contiguous, at its full
size, and never has it open for writing again: blocks go to the known places of their bytes
(see ``writer.py``). A reader can open the file at any time, a full disk is found before the
first step is computed, and nothing has to be joined at the end. A file per block would be as safe,
but needs the disk twice at the end, when a full one hurts most, and cannot be read in part.
Chunks with HDF5's own checksums would be refused by every reader where a kill tore one. The price
is that everything is filled with NaN first: 2 to 3 % of a run of 200 + 100 forcing periods, 10 %
where there is no transient.

A compressed chunk has no place before it is compressed, so a file is compressed when it is
complete, into a copy that takes its place; its room is reserved first, since HDF5 kills the
process when it closes a file on a full disk. Measured with shuffle and gzip at level 1: 3 % of the
size for periodic attractors, 34 % for a bifurcation diagram, 62 % for chaos, at 12 to 24 % of the
time of computing them, and three to ten times the time of reading; level 9 takes four times as long
for 1 % less. So it is off by default.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from sweeps.store.layout import BLOCKS, Layout
from sweeps.store.ledger import ROW, Ledger, Span, checksum, ledger_size, row_of, write_all
from sweeps.store.variables import DIRECTION, DIRECTION_MEANING, RECORDS, VARIABLES
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status

_LEDGER = "store/ledger"

#: Values in one chunk of a compressed variable, at most.
_CHUNK_VALUES = 1 << 17
#: Bytes of chunks kept in memory while they are filled by blocks.
_CACHE = 1 << 27
#: Bytes written between two calls of fsync, so that none keeps an interrupt waiting for long.
_SYNC_BYTES = 1 << 26

#: Written as the duration to find its place: a NaN that nothing else has.
_DURATION_MARK = np.uint64(0x7FF8_7669_6272_6F21).view(np.float64)


def create(path: Path, layout: Layout) -> None:
    """Write a file without data: NaN everywhere, and ``PENDING`` in integers.

    Raises
    ------
    OSError, RuntimeError, ValueError
        If the disk is full, or HDF5 cannot do it.
    """
    _reserve(path, layout.size)
    with h5py.File(path, "w", libver="earliest") as file:
        _describe(file, layout)
        for name in layout.variables:
            _add_variable(file, layout, name, dcpl=_reserved())
    _add_ledger(path, layout)
    _reserve(path, path.stat().st_size)
    descriptor = os.open(path, os.O_RDWR)
    try:
        for name, start in places(path).items():
            dtype = np.dtype(VARIABLES[name].dtype)
            _fill(descriptor, start, math.prod(layout.shape_of(name)), _fill_value(dtype), dtype)
        _seal(path, descriptor, np.zeros(len(layout.blocks), ROW))
    finally:
        os.close(descriptor)


def pack(
    path: Path,
    layout: Layout,
    read: Callable[[int], Mapping[str, np.ndarray]],
    samples: Sequence[int],
) -> None:
    """Write a compressed file; `read` returns the data of each block, `samples` their samples.

    Raises
    ------
    OSError, RuntimeError, ValueError
        As from `create`.
    """
    rows = np.zeros(len(layout.blocks), ROW)
    _reserve(path, layout.size)
    with h5py.File(path, "w", libver="earliest") as file:
        _describe(file, layout)
        for name in layout.variables:
            _add_variable(file, layout, name, **_filters(layout.shape_of(name)))
    _reserve(path, layout.size)  # what is not needed is given back when the file is closed
    with h5py.File(path, "r+", libver="earliest", rdcc_nbytes=_CACHE) as file:
        for index, block in enumerate(layout.blocks):
            arrays = read(index)
            for name, array in arrays.items():
                file[name][block] = array
            rows[index] = row_of(checksum(arrays.values()), samples[index])
    _add_ledger(path, layout)
    descriptor = os.open(path, os.O_RDWR)
    try:
        _seal(path, descriptor, rows)
    finally:
        os.close(descriptor)


def _reserve(path: Path, size: int) -> None:
    """Take the room for a file of that size.

    HDF5 must not meet a full disk: it then kills the process when it closes the file.
    """
    if hasattr(os, "posix_fallocate"):
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            os.posix_fallocate(descriptor, 0, size)
        finally:
            os.close(descriptor)


def _describe(file: h5py.File, layout: Layout) -> None:
    """Write the attributes, the coordinates and the blocks."""
    file.attrs.update(layout.attributes)
    file.attrs["duration"] = _DURATION_MARK
    for axis, values in layout.axes.items():
        if axis == DIRECTION:
            _add_scale(file, axis, values.astype(h5py.string_dtype()), DIRECTION_MEANING, "1", "")
            continue
        about = PARAMETERS[axis]
        _add_scale(file, axis, values.astype(float), about.meaning, about.unit, about.symbol)
    for record, numbers in layout.records.items():
        _add_scale(file, record, numbers, RECORDS[record], "1", "")
    bounds = [[(cut.start, cut.stop) for cut in block] for block in layout.blocks]
    shape = (len(layout.blocks), len(layout.axes), 2)
    file.create_dataset(BLOCKS, data=np.array(bounds, np.int64).reshape(shape))


def _add_scale(
    file: h5py.File, name: str, values: np.ndarray, long_name: str, unit: str, symbol: str
) -> None:
    scale = file.create_dataset(name, data=values)
    scale.attrs.update({"long_name": long_name, "units": unit, "symbol": symbol})
    scale.make_scale(name)


def _add_variable(file: h5py.File, layout: Layout, name: str, **storage: Any) -> None:
    variable = VARIABLES[name]
    dataset = file.create_dataset(name, layout.shape_of(name), variable.dtype, **storage)
    if dataset.shape == ():
        dataset[()] = 0  # gives it its place; h5py does not pass the properties of a single value
    dataset.attrs.update(
        {"long_name": variable.long_name, "units": variable.unit, "symbol": variable.symbol}
    )
    if name == "status":
        dataset.attrs["flag_values"] = np.array(list(Status), dtype=variable.dtype)
        dataset.attrs["flag_meanings"] = " ".join(status.name.lower() for status in Status)
    dimensions = (*layout.axes, variable.record) if variable.record else tuple(layout.axes)
    for index, dimension in enumerate(dimensions):
        dataset.dims[index].attach_scale(file[dimension])


def _reserved() -> Any:
    """Return the properties of a dataset that has its place from the start, unwritten."""
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_layout(h5py.h5d.CONTIGUOUS)
    properties.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    properties.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    return properties


def _filters(shape: tuple[int, ...]) -> dict[str, Any]:
    """Return the storage of a compressed dataset: chunks that span its last axes first."""
    if not shape:
        return {}  # a single value has no chunks
    room, chunk = _CHUNK_VALUES, []
    for length in reversed(shape):
        chunk.append(max(1, min(length, room)))
        room //= chunk[-1]
    return {
        "chunks": tuple(reversed(chunk)),
        "shuffle": True,
        "compression": "gzip",
        "compression_opts": 1,
    }


def _add_ledger(path: Path, layout: Layout) -> None:
    """Make room for the ledger at the end of the file, where HDF5 puts what is added later."""
    with h5py.File(path, "r+", libver="earliest") as file:
        spans = 2 + sum(len(_spans(file[name])) for name in layout.variables)
        size = ledger_size(len(layout.blocks), spans)
        ledger = file.create_dataset(_LEDGER, size, np.uint8, dcpl=_reserved())
        ledger.attrs["long_name"] = "checksums of the blocks and of the rest, see sweeps/ledger.py"


def _spans(dataset: h5py.Dataset) -> list[Span]:
    """Return where the data of a variable are in the file."""
    if dataset.chunks is None:
        return [(dataset.id.get_offset(), dataset.nbytes)]
    chunks: list[Span] = []
    dataset.id.chunk_iter(lambda chunk: chunks.append((chunk.byte_offset, chunk.size)))
    runs: list[Span] = []
    for start, size in sorted(chunks):
        if runs and sum(runs[-1]) == start:
            runs[-1] = (runs[-1][0], runs[-1][1] + size)
        else:
            runs.append((start, size))
    return runs


def _seal(path: Path, descriptor: int, rows: np.ndarray) -> None:
    """Write the ledger of a file that is complete otherwise, and make the file last."""
    with h5py.File(path, "r") as file:
        data = [span for name in VARIABLES if name in file for span in _spans(file[name])]
        (ledger,) = _spans(file[_LEDGER])
    head = os.pread(descriptor, 1 << 20, 0)
    duration = (head.find(_DURATION_MARK.tobytes()), 8)
    # The duration comes first, where the writer finds it again.
    Ledger.seal(descriptor, ledger[0], rows, [duration, ledger, *data])
    write_duration(descriptor, duration[0], math.nan)
    os.fsync(descriptor)


def write_duration(descriptor: int, start: int, seconds: float) -> None:
    """Overwrite the attribute ``duration``, which has no checksum and keeps its place."""
    write_all(descriptor, np.float64(seconds).tobytes(), start)


def places(path: Path) -> dict[str, int]:
    """Return where each variable starts in a file that is not compressed; else nothing."""
    with h5py.File(path, "r") as file:
        held = [name for name in VARIABLES if name in file]
        if any(file[name].chunks for name in held):
            return {}
        return {name: file[name].id.get_offset() for name in held}


def _fill(descriptor: int, start: int, count: int, value: float, dtype: np.dtype) -> None:
    piece = np.full(min(count, (1 << 23) // dtype.itemsize), value, dtype).tobytes()
    unsynced = 0
    for at in range(0, count * dtype.itemsize, len(piece)):
        size = min(len(piece), count * dtype.itemsize - at)
        write_all(descriptor, piece[:size], start + at)
        unsynced += size
        if unsynced >= _SYNC_BYTES:
            os.fsync(descriptor)
            unsynced = 0


def _fill_value(dtype: np.dtype) -> float:
    return math.nan if dtype.kind == "f" else int(Status.PENDING)
