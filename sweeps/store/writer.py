"""Write a sweep: its blocks, and the complete file from them; refuse to resume another sweep."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from sweeps.errors import Failed, StoreError
from sweeps.grid import Block, block_points
from sweeps.store.complete_file import schema_of, write_file
from sweeps.store.parts import Parts, create, remove, remove_files
from sweeps.store.paths import (
    DRAFT,
    SCHEMA,
    Content,
    content,
    identity,
    parts_path,
    reason,
)
from sweeps.store.replacing import remove_leftovers, replacing, sync_names
from sweeps.store.schema import Schema
from sweeps.store.variables import TRAJECTORIES, VARIABLES


@contextmanager
def sweep_writer(
    path: str | Path, schema: Schema, *, resume: bool = False, before: object = None
) -> Iterator[SweepWriter | None]:
    """Start the sweep at `path`, or continue it; call this inside `only_writer`.

    `before` is the `identity` of the file at `path` that may be replaced, None if there was none.
    Yields None if the file is complete. An existing incomplete sweep is replaced at once; with
    `resume` it keeps its blocks, and damaged blocks become pending again. Raises StoreError if the
    resumed sweep is another one or is damaged, and Failed if the folder of the blocks cannot be
    created; in that case no new one is left behind, and an old one is unchanged.
    """
    # Follow a link only once, so that everything works on the file that was checked and locked.
    path = Path(path).resolve()
    folder = parts_path(path)
    with _failure(path, "written"):
        remove_leftovers(path)  # drafts may be large
    schema_file = identity(folder / SCHEMA)
    if resume and schema_file is not None:
        with _failure(path, "written"):
            remove_files(folder, DRAFT)
        old = schema_of(folder / SCHEMA)
        _refuse_other(folder, old, schema)
        schema = old  # its blocks may be others
    elif resume and content(path) not in (None, Content.NOTHING):
        _refuse_other(path, schema_of(path), schema)
        remove(folder)  # a run was killed while it did so
        yield None
        return
    else:
        with _failure(path, "created"):
            create(folder, schema)
    with _failure(path, "written"):
        parts = Parts(folder, schema)
    try:
        yield SweepWriter(path, parts, before)
    except StoreError as error:  # a block has changed since it passed its checks
        raise Failed(str(error)) from error
    finally:
        with suppress(OSError):  # an earlier error matters more; a completed sweep has no folder
            sync_names(folder)


class SweepWriter:
    """Writes a sweep block by block, and completes it; made by `sweep_writer`.

    Every method raises Failed if a block or the file cannot be written, for example on a full
    disk, or if another program has removed or changed the blocks.
    """

    def __init__(self, path: Path, parts: Parts, before: object) -> None:
        self._path, self._parts, self._before = path, parts, before
        self._began = time.monotonic() - parts.seconds  # as if computed without a pause
        self.damaged = parts.damaged  #: Blocks that are pending again.

    def pending(self) -> list[Block]:
        """Return the blocks that are not written yet."""
        there = self._parts.entries
        return [block for i, block in enumerate(self._parts.schema.blocks) if i not in there]

    def write(self, block: Block, results: Mapping[str, np.ndarray]) -> None:
        """Write the results of one block; no kill of the process can then lose them.

        `results` must have an array of shape (points of the block, ...) in C order for every
        variable of the file, and for a column of the trajectories an array for each point, of any
        length; otherwise KeyError or ValueError is raised. Variables that the file does not hold
        are ignored.
        """
        schema = self._parts.schema
        number = schema.blocks.index(block)
        if unknown := sorted(set(results) - set(VARIABLES)):
            raise ValueError(f"the store has no variable {', '.join(unknown)}")
        arrays = {}
        for name in schema.variables:
            array, ragged = results[name], name in TRAJECTORIES
            shape = tuple(schema.sizes(name, block).values())
            expected = (block_points(block), *(() if ragged else shape[len(block) :]))
            given = np.shape(array)[: len(expected)]
            if given != expected:
                raise ValueError(f"{name} has the shape {given} instead of {expected}")
            dtype = VARIABLES[name].dtype
            arrays[name] = array if ragged else np.asarray(array, dtype).reshape(shape)
        with _failure(self._path, "written"):
            self._parts.write(number, arrays, time.monotonic() - self._began)

    def finish(self, *, compressed: bool = False) -> None:
        """Write the complete file and remove the blocks, all of which must be written."""
        parts = self._parts
        parts.refuse_loss()
        with _failure(self._path, "completed"):
            with replacing(self._path, self._refuse_other_file) as new:
                pieces = parts.pieces()
                write_file(new, parts.file_schema, pieces, self._began, compressed=compressed)
            sync_names(self._path.parent)
        remove(parts.folder)

    def _refuse_other_file(self) -> None:
        """Refuse to replace a file that another program has written in the meantime."""
        now = identity(self._path)
        if now is not None and now != self._before:
            raise Failed(
                f"{self._path} was written by another program while the sweep was computed, "
                "and is not replaced; move it, and resume the run"
            )


def _refuse_other(path: Path, old: Schema, new: Schema) -> None:
    """Refuse to resume a file of another sweep or other code; the error names what differs."""
    was, now = (schema.attributes for schema in (old, new))
    differing = _differences(str(was["configuration"]), str(now["configuration"]))
    if was["numerics"] != now["numerics"]:
        differing.append("the code that computes is another version")
    # The computation follows from these two, and other code may name its parts differently.
    if not differing:
        differing = _differences(*(str(of.get("computation", "{}")) for of in (was, now)))
    if not differing and not _has_grid(old, new):
        differing.append("the points have other values or another order")
    if differing:
        raise StoreError(
            f"{path} cannot be resumed: {'; '.join(differing)}; overwrite it, or give "
            "another output"
        )


def _differences(old: str, new: str) -> list[str]:
    """List the keys in which two configurations differ, with both values.

    Neither the name nor the compression of the complete file makes another sweep.
    """
    if old == new:
        return []
    was, now = _flat(yaml.safe_load(old)), _flat(yaml.safe_load(new))
    return [
        f"{key} was {was.get(key, 'not given')} and is {now.get(key, 'not given')}"
        for key in sorted({*was, *now} - {"name", "compression"})
        if was.get(key) != now.get(key)
    ]


def _flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    """Return the leaves of a tree by their dotted keys."""
    leaves: dict[str, object] = {}
    for key, value in tree.items():
        deeper = isinstance(value, dict)
        leaves |= _flat(value, f"{prefix}{key}.") if deeper else {f"{prefix}{key}": value}
    return leaves


def _has_grid(old: Schema, new: Schema) -> bool:
    """Return whether two grids are equal."""
    if list(old.axes) != list(new.axes):
        return False
    return all(_same(old.axes[axis], new.axes[axis]) for axis in new.axes)


def _same(old: np.ndarray, new: np.ndarray) -> bool:
    """Return whether the values of an axis, or the columns of a table, are the same."""
    if old.dtype.names is None or old.dtype.names != new.dtype.names:
        return old.dtype.names == new.dtype.names and np.array_equal(old, new)
    columns = [(old[name], new[name]) for name in old.dtype.names]
    return all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in columns)


@contextmanager
def _failure(path: Path, action: str) -> Iterator[None]:
    """Raise Failed for any error of a file whose path was accepted."""
    try:
        yield
    except StoreError as error:
        raise Failed(str(error)) from error
    except (OSError, RuntimeError, ValueError, OverflowError) as error:
        raise Failed(f"{path} cannot be {action}: {reason(error)}") from error
