"""`Schema`: the attributes and axes of a sweep file without the data; which keys differ.

`write_schema` writes it and `schema_in` reads it, both in a complete file and in the ``schema.h5``
of an incomplete sweep, which has no data.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np
import yaml

from sweeps.errors import StoreError
from sweeps.grid import TABLE, Block, Sweep, box_shape, table_values
from sweeps.store.paths import FORMAT, FORMAT_VERSION
from sweeps.store.replacing import reason
from sweeps.store.variables import (
    COLUMN_NAMES,
    DIRECTION,
    RECORDS,
    VARIABLES,
    attributes_of,
    record_widths,
)
from sweeps.yaml_text import yaml_mapping
from vibroimpact import __version__
from vibroimpact.oscillator import PARAMETERS

#: Attribute that names the fixed parameters and the columns: coordinates for xarray (CF 5).
_COORDINATES = "coordinates"
#: Dataset of the blocks; only the schema of an incomplete sweep has it.
_BLOCKS = "blocks"
#: Most values in one chunk of a variable.
_CHUNK_VALUES = 1 << 17


@dataclass(frozen=True)
class Schema:
    """The content of a sweep file, except its data."""

    #: The leading dimensions of every result: the swept axes, preceded by ``direction`` if one of
    #: them was followed up and down; or only ``TABLE``, a structured array.
    axes: Mapping[str, np.ndarray]
    fixed: Mapping[str, float]  # the value of every parameter that is not swept
    #: Coordinates of the record dimensions; the width of ``sample`` is final in a complete file.
    records: Mapping[str, np.ndarray]
    variables: tuple[str, ...]  # those of ``VARIABLES`` that the file holds, in that order
    blocks: Sequence[Block]  # in which points are computed and stored; none in a complete file
    attributes: Mapping[str, Any]  # of the file, including the configuration
    column_units: Mapping[str, str]  # of columns of the table; those without one have the unit 1

    @classmethod
    def of(
        cls,
        sweep: Sweep,
        size: int,
        name: str,
        configuration: str,
        units: Mapping[str, str],
        column_units: Mapping[str, str],
    ) -> Self:
        """Return the schema of a new sweep, in blocks of about `size` points.

        `configuration` is YAML. `units` has the names of the units, as of ``length``, and
        `column_units` the units of columns of the table, if they have one.
        """
        import numba  # takes half a second, and files are also opened without it

        from vibroimpact.jit import NUMERICS, WAY

        grid, spec = sweep.grid, sweep.spec
        columns = (TABLE in grid.axes and grid.axes[TABLE].dtype.names) or ()
        held = record_widths(spec)
        widths = {VARIABLES[variable].dimension: width for variable, width in held.items()}
        records = {record: np.arange(width) for record, width in widths.items() if record}
        records["section"] += spec.transient + 1
        computation = {**asdict(spec), "fixed": dict(grid.fixed)}
        attributes = {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "name": name,
            "configuration": configuration,
            **{f"{key}_unit": unit for key, unit in units.items() if unit != key},
            "computation": yaml.safe_dump(computation, sort_keys=False),
            "numerics": NUMERICS,  # identifies the code that computes the data
            **({"scaled_along": "f"} if spec.scaled else {}),
            **({COLUMN_NAMES: " ".join(columns)} if columns else {}),
            "vibroimpact_version": __version__,
            "numba_version": numba.__version__,
            "numba_way": str(WAY),
            "numpy_version": np.__version__,
            "h5py_version": h5py.__version__,
            "platform": platform.platform(),
            "started": datetime.now(UTC).isoformat(timespec="seconds"),
        }
        axes = {
            axis: values if axis == TABLE else values.astype(float)
            for axis, values in grid.axes.items()
        }
        # All values of f share one computation, if they are scaled.
        shared = spec.scaled and len(grid.axes.get("f", "")) in range(1, size + 1)
        blocks = grid.blocks(size, "f" if shared else spec.followed)
        if len(spec.directions) > 1:
            axes = {DIRECTION: np.array(spec.directions, object), **axes}
            blocks = ((slice(0, len(spec.directions)), *block) for block in blocks)
        return cls(axes, grid.fixed, records, tuple(held), tuple(blocks), attributes, column_units)

    def sizes(self, name: str, box: Block | None = None) -> dict[str, int]:
        """Return the length of each dimension of a variable, in a box of points or in the file."""
        lengths = map(len, self.axes.values()) if box is None else box_shape(box)
        sizes = dict(zip(self.axes, lengths, strict=True))
        if dimension := VARIABLES[name].dimension:
            sizes[dimension] = len(self.records[dimension])
        return sizes

    def coordinates(self) -> dict[str, tuple[tuple[str, ...], Any]]:
        """Return dimensions and values of each axis, column, parameter and record of the file."""
        result: dict[str, tuple[tuple[str, ...], Any]] = {}
        for axis, values in self.axes.items():
            result[axis] = (axis,), 1 + np.arange(len(values)) if axis == TABLE else values
            for column in (axis == TABLE and values.dtype.names) or ():
                result[column] = (axis,), values[column]
        result |= {name: ((), float(value)) for name, value in self.fixed.items()}
        return result | {record: ((record,), numbers) for record, numbers in self.records.items()}

    def differences(self, old: Schema) -> list[str]:
        """Say what makes this sweep, or the code that computes it, another one than an old one."""
        was, now = old.attributes, self.attributes
        keys = differing_keys(str(was["configuration"]), str(now["configuration"]))
        same_code = was["numerics"] == now["numerics"]
        # The computation follows from these two, and other code may name its parts differently.
        if not keys and same_code:
            keys = differing_keys(was["computation"], now["computation"])
        problems = [f"{key} was {before} and is {after}" for key, (before, after) in keys.items()]
        problems += [] if same_code else ["the code that computes is another version"]
        same = list(old.axes) == list(self.axes) and all(
            _same(old.axes[axis], self.axes[axis]) for axis in self.axes
        )
        if not problems and not same:
            problems.append("the points have other values or another order")
        return problems


def refuse_columns(names: Iterable[str]) -> None:
    """Refuse columns of a table whose names the file needs itself."""
    for name in names:
        if name in (TABLE, DIRECTION, _BLOCKS, *RECORDS, *VARIABLES, "lyapunov_1", "lyapunov_2"):
            problem = "has the name of a result; expected: another name"
            raise StoreError(f"points: the column {name} {problem}")


def write_schema(file: h5py.File, schema: Schema, *, compressed: bool, with_blocks: bool) -> None:
    """Write the attributes and coordinates of a schema, and create its variables without data."""
    file.attrs.update(schema.attributes)
    columns = str(schema.attributes.get(COLUMN_NAMES, "")).split()
    file.attrs[_COORDINATES] = " ".join([*schema.fixed, *columns])
    datasets: dict[str, h5py.Dataset] = {}
    for name, (dimensions, values) in schema.coordinates().items():
        dtype = h5py.string_dtype() if np.asarray(values).dtype == object else None
        dataset = datasets[name] = file.create_dataset(name, data=values, dtype=dtype)
        dataset.attrs.update(attributes_of(name, schema.attributes, schema.column_units))
        if dimensions == (name,):
            dataset.make_scale(name)
        elif dimensions:
            dataset.dims[0].attach_scale(datasets[dimensions[0]])
    for name in schema.variables:
        sizes, dtype = schema.sizes(name), VARIABLES[name].dtype
        storage = _storage(schema, name, compressed)
        dataset = file.create_dataset(name, tuple(sizes.values()), dtype, **storage)
        dataset.attrs.update(attributes_of(name, schema.attributes))
        for dimension, axis in zip(dataset.dims, sizes, strict=True):
            dimension.attach_scale(datasets[axis])
    if with_blocks:
        bounds = [[(cut.start, cut.stop) for cut in block] for block in schema.blocks]
        file[_BLOCKS] = np.array(bounds, np.int64).reshape(len(bounds), len(schema.axes), 2)


@contextmanager
def of_this_form(path: Path) -> Iterator[None]:
    """Refuse a file whose checksums are right, but not its form, as another program can make it."""
    try:
        yield
    except (StoreError, MemoryError):
        raise
    except Exception as error:  # h5py, NumPy and xarray have many
        raise StoreError(
            f"{path} does not have the form of a sweep, and cannot be trusted: {reason(error)}"
        ) from error


def _dataset_in(file: h5py.File, name: str) -> h5py.Dataset:
    """Return a dataset with this name, whose data are in this file."""
    is_inside = "/" not in name and isinstance(file.get(name, getlink=True), h5py.HardLink)
    data = file[name] if is_inside else None
    if not isinstance(data, h5py.Dataset) or data.external or data.is_virtual:
        raise ValueError(f"{name} is not in it")
    return data


def _values(file: h5py.File, name: str) -> np.ndarray:
    """Return the values of a dataset that is as large as the file says."""
    data = _dataset_in(file, name)
    if data.nbytes > data.id.get_storage_size():
        raise ValueError(f"{name} lacks values")
    return data.asstr()[()] if h5py.check_string_dtype(data.dtype) else data[()]


def _check_form(file: h5py.File, schema: Schema) -> None:
    """Raise an error unless attributes, variables and blocks are as the axes require."""
    texts = "name", "configuration", "computation", "numerics"
    if {type(schema.attributes[key]) for key in texts} != {str}:
        raise TypeError("an attribute is no text")
    variables = [VARIABLES[name] for name in ("poincare_x", *schema.variables)]
    kinds = {(variable.dimension, variable.diagnostic) for variable in variables}
    for name, variable in VARIABLES.items():
        if (variable.dimension, variable.diagnostic) in kinds:  # of which a file has all
            data, shape = _dataset_in(file, name), (*schema.sizes(name).values(),)
            if (data.shape, data.dtype) != (shape, variable.dtype):
                raise ValueError(f"{name} has another shape or type")
    if any(
        each.dtype.kind != "i" or (np.diff(each) != 1).any() for each in schema.records.values()
    ):
        raise ValueError("a record has other numbers")
    rows = schema.axes.get(TABLE, np.empty(0))
    columns = {name: rows[name] for name in rows.dtype.names or () if name in PARAMETERS}
    parameters: dict[str, Any] = {**columns, **schema.fixed, **schema.axes}
    required = {name for name, each in PARAMETERS.items() if each.default is None}
    for name in sorted((parameters.keys() | required) - {TABLE, DIRECTION}):
        bounds, values = PARAMETERS.get(name), np.ravel(parameters.get(name, np.nan))
        once = name not in schema.axes or len({*values.tolist()}) == values.size
        if not bounds or not bounds.accepts(values).all() or not once:
            raise ValueError(f"{name} is no parameter, or has other values than a parameter")
    lengths = [*map(len, schema.axes.values())]
    for block in schema.blocks:
        if any(not 0 <= a.start < a.stop <= n for a, n in zip(block, lengths, strict=True)):
            raise ValueError("a block is not inside the axes")


def schema_in(file: h5py.File) -> Schema:
    """Read the schema that `write_schema` has written."""
    variables = tuple(name for name in VARIABLES if name in file)
    records = dict.fromkeys(VARIABLES[name].dimension for name in variables)
    axes = [scale.name.strip("/") for dim in file["status"].dims for scale in dim.values()]
    values = {name: _values(file, name) for name in [*axes, *str(file.attrs[_COORDINATES]).split()]}
    columns = file.attrs[COLUMN_NAMES].split() if TABLE in axes else ()
    if columns:
        values[TABLE] = table_values({name: values[name] for name in columns})
    blocks = _values(file, _BLOCKS).tolist() if _BLOCKS in file else ()
    schema = Schema(
        {axis: values.pop(axis) for axis in axes},
        {name: float(value) for name, value in values.items() if name not in columns},
        {record: _values(file, record) for record in records if record},
        variables,
        [tuple(slice(*cut) for cut in block) for block in blocks],
        {k: v for k, v in file.attrs.items() if k not in ("duration", _COORDINATES)},
        {name: str(file[name].attrs.get("units", "1")) for name in columns},
    )
    _check_form(file, schema)
    return schema


def _storage(schema: Schema, name: str, compressed: bool) -> dict[str, Any]:
    """Return the HDF5 storage options of a variable, with chunks that never span two blocks.

    Along the axis that is split, all blocks but the last have the same length; a chunk has that
    length, or an exact fraction of it. All other dimensions may be split anywhere.
    """
    shape, fill_value = [*schema.sizes(name).values()], VARIABLES[name].fill_value
    if 0 in shape or not shape:
        return {}  # a single value has no chunks
    chunk = [*schema.sizes(name, schema.blocks[0]).values()]
    for i, length in enumerate(chunk):
        while math.prod(chunk) > _CHUNK_VALUES and chunk[i] > 1:
            if chunk[i] % 2 and length < shape[i]:
                break
            chunk[i] = (chunk[i] + 1) // 2
    gzip = {"shuffle": True, "compression": "gzip", "compression_opts": 1} if compressed else {}
    return {"chunks": tuple(chunk), "fletcher32": True, "fillvalue": fill_value, **gzip}


def differing_keys(old: str, new: str) -> dict[str, tuple[object, object]]:
    """Return the dotted keys in which two configurations differ, with both values.

    Neither the name nor the compression of the complete file makes another sweep.
    """
    if old == new:
        return {}
    was, now = (_flat(yaml_mapping(text, "the configuration of a sweep")) for text in (old, new))
    return {
        key: (was.get(key, "not given"), now.get(key, "not given"))
        for key in sorted({*was, *now} - {"name", "compression"})
        if was.get(key) != now.get(key)
    }


def _flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    """Return the leaves of a tree by their dotted keys."""
    leaves: dict[str, object] = {}
    for key, value in tree.items():
        deeper = isinstance(value, dict)
        leaves |= _flat(value, f"{prefix}{key}.") if deeper else {f"{prefix}{key}": value}
    return leaves


def _same(old: np.ndarray, new: np.ndarray) -> bool:
    """Return whether the values of an axis, or the columns of a table, are the same."""
    if old.dtype.names is None or old.dtype.names != new.dtype.names:
        return old.dtype.names == new.dtype.names and np.array_equal(old, new)
    columns = [(old[name], new[name]) for name in old.dtype.names]
    return all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in columns)
