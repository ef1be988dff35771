"""Create the HDF5 file of a sweep: every byte has its place before a point is computed.

HDF5 writes the file once, with contiguous variables at their full size, and never opens it for
writing again: a kill while HDF5 has a file open for writing leaves a file that cannot be opened.
``blocks.py`` then writes the bytes of blocks to their known places, without HDF5. A compressed file
is made from a complete one, in a copy. The README of this package gives the reasons and the costs.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from sweeps.grid import box_shape
from sweeps.interrupts import check
from sweeps.store.layout import BLOCKS, COORDINATES, Layout
from sweeps.store.ledger import ROW, Span, State, checksum, ledger_size, opened, seal, write_all
from sweeps.store.variables import DIRECTION, DIRECTION_MEANING, RECORDS, VARIABLES
from sweeps.text import in_units
from vibroimpact.oscillator import PARAMETERS
from vibroimpact.status import Status

_LEDGER = "store/ledger"

#: Values in one chunk of a compressed variable, at most.
_CHUNK_VALUES = 1 << 17
#: Bytes of the chunks of a variable that HDF5 keeps in memory, and compresses when it closes the
#: file: one chunk.
_CACHE = 8 * _CHUNK_VALUES
#: Bytes written between two calls of fsync, so that none keeps an interrupt waiting for long.
_SYNC_BYTES = 1 << 26

#: Written as the duration to find its place: a NaN that nothing else has.
_DURATION_MARK = np.uint64(0x7FF8_7669_6272_6F21).view(np.float64)


def create(path: Path, layout: Layout) -> None:
    """Write a file without data: NaN everywhere, and ``PENDING`` in integers.

    Parameters
    ----------
    path : Path
        Of an empty file, or of none.
    layout : Layout

    Raises
    ------
    OSError, RuntimeError, ValueError
        If the disk is full, or HDF5 cannot do it.
    """
    _lay_out(path, layout, lambda _: {"dcpl": _reserved()})
    _add_ledger(path, layout)
    _reserve(path, path.stat().st_size)
    rows = np.zeros(len(layout.blocks), ROW)
    rows["state"] = State.PENDING
    rows["crc"] = _fill_checksums(layout)
    with h5py.File(path, "r") as file:
        starts = places(file)
    with opened(path, os.O_RDWR) as descriptor:
        for name, start in starts.items():
            _fill(descriptor, start, math.prod(layout.shape_of(name)), VARIABLES[name].fill_value)
    _seal(path, rows)


def pack(
    path: Path,
    layout: Layout,
    rows: np.ndarray,
    read: Callable[[str, tuple[slice, ...]], np.ndarray],
) -> None:
    """Write a compressed file, chunk by chunk, so that an interrupt need not wait for more.

    Parameters
    ----------
    path : Path
        Of an empty file, or of none.
    layout : Layout
    rows : ndarray of dtype ``ROW``, shape (blocks,)
        Of the ledger, with the checksums of the blocks.
    read : callable
        Returns the data of a part of a variable.

    Raises
    ------
    OSError, RuntimeError, ValueError
        As from `create`.
    """
    _lay_out(path, layout, lambda name: _filters(layout.shape_of(name)))
    _reserve(path, layout.size)  # what is not needed is given back when the file is closed
    with h5py.File(path, "r+", libver="earliest", rdcc_nbytes=_CACHE) as file:
        for name in layout.variables:
            dataset = file[name]
            for part in dataset.iter_chunks() if dataset.chunks else [()]:
                check()
                dataset[part] = read(name, part)
    _add_ledger(path, layout)
    _seal(path, rows)


def _lay_out(path: Path, layout: Layout, storage: Callable[[str], dict[str, Any]]) -> None:
    """Write all but the data and the ledger, each variable with a storage of HDF5."""
    _reserve(path, layout.size)
    with h5py.File(path, "w", libver="earliest") as file:
        _describe(file, layout)
        for name in layout.variables:
            _add_variable(file, layout, name, **storage(name))


def _fill_checksums(layout: Layout) -> list[int]:
    """Return the checksum of each block as it is laid out: one for each shape that blocks have."""
    boxes = [box_shape(block) for block in layout.blocks]
    by_shape = {box: checksum(layout.fill_values(box).values()) for box in set(boxes)}
    return [by_shape[box] for box in boxes]


def _reserve(path: Path, size: int) -> None:
    """Take the room for a file of that size.

    HDF5 must not meet a full disk: it then kills the process when it closes the file.
    """
    if hasattr(os, "posix_fallocate"):
        with opened(path, os.O_RDWR | os.O_CREAT) as descriptor:
            os.posix_fallocate(descriptor, 0, size)


def _describe(file: h5py.File, layout: Layout) -> None:
    """Write the attributes, the coordinates and the blocks."""
    file.attrs.update(layout.attributes)
    file.attrs["duration"] = _DURATION_MARK
    for axis, values in layout.axes.items():
        if axis == DIRECTION:
            _add_scale(file, axis, values.astype(h5py.string_dtype()), DIRECTION_MEANING)
            continue
        about = PARAMETERS[axis]
        unit = in_units(about.unit, layout.units)
        _add_scale(file, axis, values.astype(float), about.meaning, unit, about.symbol)
    file.attrs[COORDINATES] = " ".join(layout.fixed)
    for name, value in layout.fixed.items():
        about = PARAMETERS[name]
        coordinate = file.create_dataset(name, data=float(value))
        _about(coordinate, about.meaning, in_units(about.unit, layout.units), about.symbol)
    for record, numbers in layout.records.items():
        _add_scale(file, record, numbers, RECORDS[record])
    bounds = [[(cut.start, cut.stop) for cut in block] for block in layout.blocks]
    shape = (len(layout.blocks), len(layout.axes), 2)
    file.create_dataset(BLOCKS, data=np.array(bounds, np.int64).reshape(shape))


def _add_scale(
    file: h5py.File,
    name: str,
    values: np.ndarray,
    long_name: str,
    unit: str = "1",
    symbol: str = "",
) -> None:
    """Add the coordinate of a dimension."""
    scale = file.create_dataset(name, data=values)
    _about(scale, long_name, unit, symbol)
    scale.make_scale(name)


def _about(dataset: h5py.Dataset, long_name: str, unit: str, symbol: str) -> None:
    dataset.attrs.update({"long_name": long_name, "units": unit, "symbol": symbol})


def _add_variable(file: h5py.File, layout: Layout, name: str, **storage: Any) -> None:
    """Add a variable of the layout, with the scales of its dimensions."""
    variable = VARIABLES[name]
    dataset = file.create_dataset(name, layout.shape_of(name), variable.dtype, **storage)
    if dataset.shape == ():
        dataset[()] = 0  # gives it its place; h5py does not pass the properties of a single value
    _about(dataset, variable.long_name, in_units(variable.unit, layout.units), variable.symbol)
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
        "fletcher32": True,  # some bits of a compressed chunk change nothing in the data
    }


def _add_ledger(path: Path, layout: Layout) -> None:
    """Make room for the ledger at the end of the file, where HDF5 puts what is added later."""
    with h5py.File(path, "r+", libver="earliest") as file:
        spans = 2 + sum(len(_spans(file[name])) for name in layout.variables)
        size = ledger_size(len(layout.blocks), spans)
        ledger = file.create_dataset(_LEDGER, size, np.uint8, dcpl=_reserved())
        ledger.attrs["long_name"] = "checksums of blocks and rest, see sweeps/store/ledger.py"


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


def _seal(path: Path, rows: np.ndarray) -> None:
    """Write the ledger of a file that is laid out otherwise, and make the file last."""
    with h5py.File(path, "r") as file:
        data = [span for name in VARIABLES if name in file for span in _spans(file[name])]
        (ledger,) = _spans(file[_LEDGER])
    with opened(path, os.O_RDWR) as descriptor:
        head = os.pread(descriptor, 1 << 20, 0)
        seal(descriptor, ledger, rows, data, head.index(_DURATION_MARK.tobytes()))


def places(file: h5py.File) -> dict[str, int]:
    """Return the place of the first byte of each variable, or none where they are compressed."""
    names = [name for name in VARIABLES if name in file]
    if any(file[name].chunks for name in names):
        return {}
    return {name: file[name].id.get_offset() for name in names}


def _fill(descriptor: int, start: int, count: int, value: np.generic) -> None:
    """Write a value many times, from a place on."""
    size = count * value.itemsize
    piece = np.full(min(count, (1 << 23) // value.itemsize), value).tobytes()
    for at in range(0, size, len(piece)):
        check()
        write_all(descriptor, piece[: size - at], start + at)
        if (at // len(piece) + 1) % (_SYNC_BYTES // (1 << 23)) == 0:
            os.fsync(descriptor)
