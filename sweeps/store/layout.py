"""The layout of a sweep's file: axes, records, variables, blocks and attributes, without data."""

from __future__ import annotations

import math
import platform
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib import metadata
from typing import Any, Self

import numpy as np

from sweeps.grid import Block, Grid, block_points
from sweeps.store.ledger import ROW
from sweeps.store.variables import DIRECTION, FIXED_WIDTHS, VARIABLES, held_variables

FORMAT = "vibroimpact-sweep"
FORMAT_VERSION = 3

#: The attribute of a refined sweep that counts the points added to its grid.
ADDED = "points_added"

#: The attribute that names the parameters that are not swept: coordinates for xarray (CF 5).
COORDINATES = "coordinates"

#: Where the file says in which blocks it is written; not at the root, where xarray would see it.
BLOCKS = "store/blocks"


@dataclass(frozen=True)
class Layout:
    """What the file of a sweep holds, except its data.

    Attributes
    ----------
    axes : mapping of str to ndarray
        The leading dimensions of every result: the swept axes, and before them ``direction``
        where one was followed up and down.
    fixed : mapping of str to float
        The value of every parameter that is not swept.
    records : mapping of str to ndarray
        The record dimensions and their coordinates. ``sample`` may prove too short.
    variables : tuple of str
        Those of ``VARIABLES`` that there are, in that order.
    blocks : sequence of Block
        In which the points are written, each whole or not at all.
    attributes : mapping of str to str or int
        Of the file, the configuration among them.
    """

    axes: Mapping[str, np.ndarray]
    fixed: Mapping[str, float]
    records: Mapping[str, np.ndarray]
    variables: tuple[str, ...]
    blocks: Sequence[Block]
    attributes: Mapping[str, Any]

    @classmethod
    def of(
        cls,
        grid: Grid,
        blocks: Iterable[Block],
        *,
        attributes: Mapping[str, Any],
        widths: Mapping[str, int],
        first_section: int,
        diagnostics: Collection[str] = (),
        directions: Sequence[str] = (),
    ) -> Self:
        """Lay out a new sweep.

        Parameters
        ----------
        grid : Grid
        blocks : iterable of Block
            Of the grid, covering every point once; all directions of a point are in one.
        attributes : mapping of str to str or int
            ``name``, ``configuration`` (as YAML), ``numerics`` (names the code that computes the
            data), if wanted ``length_unit`` and ``time_unit`` (names of the units) and what else
            the file is to keep. Format, versions and date are added.
        widths : mapping of str to int
            Width of the record dimensions ``section``, ``impact`` and ``sample``; 0 leaves the
            variables of one out. ``sample`` is a guess.
        first_section : int
            The number of the forcing period of the first section; the others follow.
        diagnostics : collection of str
            The diagnostics whose variables there are.
        directions : sequence of str
            In which an axis is followed; of two, the data have a leading dimension.
        """
        recorded = held_variables(widths, diagnostics)
        records = {
            record: np.arange({**widths, **FIXED_WIDTHS}[record])
            for record in dict.fromkeys(v.record for v in recorded.values() if v.record)
        }
        if "section" in records:
            records["section"] += first_section
        attributes = {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            **attributes,
            "vibroimpact_version": _version("vibroimpact"),
            "numba_version": _version("numba"),
            "numpy_version": np.__version__,
            "h5py_version": _version("h5py"),
            "platform": platform.platform(),
            "started": datetime.now(UTC).isoformat(timespec="seconds"),
        }
        axes = dict(grid.axes)
        if len(directions) > 1:
            axes = {DIRECTION: np.array(directions, object), **axes}
            blocks = ((slice(0, len(directions)), *block) for block in blocks)
        return cls(axes, grid.fixed, records, tuple(recorded), tuple(blocks), attributes)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values along each axis."""
        return tuple(len(values) for values in self.axes.values())

    @property
    def units(self) -> dict[str, str]:
        """What the units of length and time are called."""
        return {key: str(self.attributes.get(f"{key}_unit", key)) for key in ("length", "time")}

    @property
    def refined(self) -> bool:
        """Whether points were added to the grid."""
        return ADDED in self.attributes

    def shape_of(self, name: str, box: tuple[int, ...] | None = None) -> tuple[int, ...]:
        """Return the shape of a variable, in a box of that shape or in the whole file."""
        record = VARIABLES[name].record
        width = (len(self.records[record]),) if record else ()
        return (self.shape if box is None else box) + width

    def fill_values(self, box: tuple[int, ...]) -> dict[str, np.ndarray]:
        """Return what the file holds of a box that is not computed yet.

        Returns
        -------
        dict of str to ndarray
            Of every variable, a read-only array of shape (box..., record).
        """
        return {
            name: np.broadcast_to(VARIABLES[name].fill_value, self.shape_of(name, box))
            for name in self.variables
        }

    @property
    def size(self) -> int:
        """Bytes that a file takes at most, compressed or not."""
        data = sum(
            math.prod(self.shape_of(name)) * np.dtype(VARIABLES[name].dtype).itemsize
            for name in self.variables
        )
        coordinates = 8 * sum(map(len, (*self.axes.values(), *self.records.values())))
        texts = sum(len(str(text)) for text in self.attributes.values())
        each_block = 16 * len(self.axes) + ROW.itemsize
        # Incompressible data grow by less than 1 %; HDF5 takes about 20 kB, and more for chunks.
        return (
            data * 102 // 100 + coordinates + 2 * texts + each_block * len(self.blocks) + (1 << 17)
        )

    def with_points(self, values: np.ndarray) -> Self:
        """Return the same with further values of its only axis, counted in an attribute."""
        (axis,) = self.axes
        all_values = np.union1d(self.axes[axis], values)
        size = max(block_points(block) for block in self.blocks)
        return replace(
            self,
            axes={axis: all_values},
            blocks=tuple(Grid({axis: all_values}, {}).blocks(size)),
            attributes={**self.attributes, ADDED: len(all_values) - len(self.axes[axis])},
        )

    def with_samples(self, width: int) -> Self:
        """Return the same with another width of the trajectories, if there are any."""
        if "sample" not in self.records:
            return self
        return replace(self, records={**self.records, "sample": np.arange(width)})


def _version(package: str) -> str:
    """Return the version of an installed package."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"  # run from a checkout that was not installed
