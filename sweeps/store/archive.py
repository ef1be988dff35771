"""The file of a block: an archive of arrays, which `numpy.load` reads."""

from __future__ import annotations

import errno
import math
import os
import sys
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from sweeps.errors import StoreError
from sweeps.grid import Block, block_points, box_shape
from sweeps.store.paths import UnreadableError, identity_of, open_regular

#: What else may have happened to a block that a reader does not find.
GONE = "its sweep was completed or begun anew; open the sweep again"


@contextmanager
def opened_archive(path: Path) -> Iterator[tuple[zipfile.ZipFile, object]]:
    """Open the file of a block, and return it with its `identity`; any error is a StoreError.

    An OSError is no damage, unless damage led to a place that no file has (EINVAL).
    """
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as held:
            yield held, identity_of(os.fstat(file.fileno()))
    except StoreError:
        raise
    except FileNotFoundError:
        raise StoreError(f"{path} was removed by another program, or {GONE}") from None
    except Exception as error:  # zipfile has many for damaged files
        if isinstance(error, OSError) and error.errno != errno.EINVAL:
            raise UnreadableError(path, error) from error
        raise StoreError(f"{path} is damaged, or cannot be read: {error}") from error


def write_arrays(file: zipfile.ZipFile, name: str, arrays: Sequence[np.ndarray]) -> None:
    """Write an array, or several one after the other, as `numpy.savez` does, but without a copy."""
    header = np.lib.format.header_data_from_array_1_0(arrays[0])
    if len(arrays) > 1:
        header["shape"] = (sum(map(len, arrays)),)
    with file.open(f"{name}.npy", "w", force_zip64=True) as member:
        np.lib.format.write_array_header_1_0(member, header)
        for array in arrays:
            member.write(array.reshape(-1).view(np.uint8).data)


def padded(
    box: Block, lengths: np.ndarray, samples: np.ndarray, most: int = sys.maxsize
) -> Iterator[tuple[Block, np.ndarray]]:
    """Yield boxes of at most `most` points and their samples; shorter trajectories end in NaN."""
    if len(lengths) > most:
        axis = next(axis for axis, n in enumerate(box_shape(box)) if n > 1)
        middle = (box[axis].start + box[axis].stop) // 2
        for cut in (slice(box[axis].start, middle), slice(middle, box[axis].stop)):
            half = (*box[:axis], cut, *box[axis + 1 :])
            here, lengths = np.split(lengths, [block_points(half)])
            own, samples = np.split(samples, [here.sum()])
            yield from padded(half, here, own, most)
    else:
        array = np.full((len(lengths), lengths.max(initial=0)), np.nan)
        array[np.arange(array.shape[1]) < lengths[:, None]] = samples
        yield box, array.reshape(*box_shape(box), -1)


def array_in(file: zipfile.ZipFile, name: str, dtype: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return an array of a block file; its header only repeats what the schema says."""
    data = file.read(f"{name}.npy")  # ZIP compares the checksum
    start = len(data) - math.prod(shape) * np.dtype(dtype).itemsize
    if start < 0:  # zeros are the checksum of nothing
        raise ValueError(f"{name} is incomplete")
    return np.ndarray(shape, dtype, data, start)
