"""`SweepWriter`, the only writer: lock, resumption, blocks, complete file."""

from __future__ import annotations

import os
import re
import stat
import time
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from filelock import BaseFileLock, FileLock, SoftFileLock, Timeout

from sweeps.errors import Failed, StoreError
from sweeps.grid import Block, box_shape
from sweeps.store.complete_file import schema_of, write_file
from sweeps.store.parts import ABOUT, SAMPLES, Entry, Parts
from sweeps.store.paths import (
    BLOCK,
    DRAFT,
    LOCK,
    NO_LOCKS,
    OR_OVERWRITE,
    SCHEMA,
    Content,
    check_output,
    check_parts,
    content,
    parts_path,
)
from sweeps.store.replacing import (
    Identity,
    check_path,
    draft_of,
    has_name,
    identity,
    reason,
    remove_leftovers,
    replacing,
    sync_names,
)
from sweeps.store.schema import Schema
from sweeps.store.variables import TRAJECTORIES, VARIABLES

#: Time after which the names of blocks are put on the disk, too [s]; for each it would be slow.
_SYNC = 1.0
#: More bytes than a lock has, also one of filelock, with the names of a host and of a container.
_MOST_TEXT = 1024
#: Valid contents of a lock: this program's text, the text that filelock writes on systems without
#: locks, nothing if the writer was killed early, or zeros, which a loss of power may leave.
_LOCK_TEXT = re.compile(rb"vibroimpact lock of process \d+\n|\d+\n\S+\n(?:\d+\n)?|\0{,99}")


@contextmanager
def sweep_writer(
    path: Path, *, overwrite: bool = False, resume: bool = False
) -> Iterator[SweepWriter]:
    """Hold the lock ``<path>.lock`` in the block, and yield the only writer of the sweep.

    However the process dies, the system releases the lock. The file left behind is then unlocked,
    and the next writer takes it over. Readers need no lock. Once the lock is held, the folder of
    the blocks is made, so that nobody else can make it before the first block is computed; it is
    removed if it stays empty. Raises StoreError if another process holds the lock, if the file
    cannot be created, or as `check_output` does, and Failed if the folder cannot be made.
    """
    check_path(path, "output")
    real = Path(os.path.realpath(path))  # the file that is checked, also if a link changes
    lock_file, folder = real.with_name(f"{real.name}{LOCK}"), parts_path(real)
    try:
        lock, lock_status = _acquired(lock_file)
    except Timeout:
        if not os.path.lexists(lock_file):
            raise StoreError(
                f"no file can be made in the folder {real.parent} of the output {path.name}"
            ) from None
        raise StoreError(f"{path} is being written by {_holder(lock_file)}") from None
    except OSError as error:
        raise StoreError(f"{str(path)!r} cannot be locked for writing: {reason(error)}") from None
    try:
        writer = SweepWriter(path, real, resume)
        check_output(path, overwrite=overwrite, resume=resume)
        with _failure(path, "created"):
            folder.mkdir(mode=0o755, exist_ok=True)  # no other user may write there
        check_parts(real, overwrite)  # another user may have made it meanwhile
        try:
            yield writer
        finally:
            with suppress(OSError):  # an earlier error matters more; a complete sweep has no folder
                sync_names(folder)
            with suppress(OSError):  # it has blocks
                folder.rmdir()
    finally:
        with suppress(OSError):  # on Windows a locked file cannot be removed
            if lock_status and has_name(lock_file, lock_status):
                lock_file.unlink()
        lock.release()


class SweepWriter:
    """Begins a sweep, writes it block by block, and completes it; made by `sweep_writer`.

    Every method raises Failed if a block or the file cannot be written, for example on a full
    disk, or if another program has removed or changed the blocks.
    """

    def __init__(self, typed: Path, path: Path, resume: bool) -> None:
        self._typed, self._path, self._resume = typed, path, resume
        #: The files that are replaced or removed; others may appear from now on, and stay.
        self._files: dict[Path, Identity] = {}
        with _failure(typed, "written"):
            for file in (path, *parts_path(path).glob("*")):
                if file.is_file() and not file.is_symlink():
                    self._files[file] = identity(file) or ()

    def begin(self, schema: Schema) -> list[Block] | None:
        """Begin the sweep, or resume it; return the blocks to write, None if it is complete.

        A resumed sweep keeps its own blocks, and those that are damaged, `damaged` in number, are
        to be written again. Raises StoreError if it is another one or is damaged, and Failed if the
        schema cannot be written; an old sweep is then unchanged.
        """
        path, folder = self._path, parts_path(self._path)
        incomplete = identity(folder / SCHEMA) is not None
        with _failure(self._typed, "written"):
            remove_leftovers(path)  # drafts may be large
            if incomplete:
                self._remove_files(DRAFT)
        if self._resume and (incomplete or content(path) not in (None, Content.NOTHING)):
            old = schema_of(folder / SCHEMA if incomplete else path)
            if differing := schema.differences(old):
                named = parts_path(self._typed) if incomplete else self._typed
                raise StoreError(
                    f"{named} cannot be resumed: {'; '.join(differing)}; {OR_OVERWRITE}"
                )
            if not incomplete:
                self._remove()  # a run was killed while it did so
                return None
        else:
            with _failure(self._typed, "created"):
                folder.mkdir(exist_ok=True)
                # Once the schema is replaced, no old block belongs to the sweep.
                with replacing(folder / SCHEMA, files=self._files) as new:
                    write_file(new, schema, None)
                sync_names(folder)
                sync_names(folder.parent)
                self._remove_files(f"{BLOCK}|{DRAFT}")
        with _failure(self._typed, "written"):
            self._parts = parts = Parts(folder)
            self._refuse_loss()
            for number, entry in parts.entries.items():
                if entry.file != self._files.get(file := parts.files[number]):
                    raise Failed(f"{file} was written by another program, and is not used")
        self._began = time.monotonic() - parts.seconds  # as if computed without a pause
        self._synced = time.monotonic()
        self.damaged = parts.damaged
        return [block for i, block in enumerate(parts.schema.blocks) if i not in parts.entries]

    def write(self, block: Block, results: Mapping[str, np.ndarray]) -> None:
        """Write the results of one block; no kill of the process can then lose them.

        `results` must have an array of shape (points of the block, ...) in C order for every
        variable of the file, and for a column of the trajectories an array for each point, of any
        length. Variables that the file does not hold are ignored.
        """
        parts, schema = self._parts, self._parts.schema
        number = schema.blocks.index(block)
        points = np.empty(box_shape(block), parts.points)
        arrays: dict[str, Any] = {"about": np.zeros((), ABOUT), "points": points}
        longest = 0
        for name in schema.variables:
            array, shape = results[name], tuple(schema.sizes(name, block).values())
            if name in TRAJECTORIES:
                lengths = np.array([len(samples) for samples in array], np.int64)
                arrays[name], arrays[SAMPLES], longest = array, lengths, int(lengths.max())
            elif VARIABLES[name].dimension is None:
                points[name] = np.reshape(array, shape)
            else:
                arrays[name] = np.asarray(array, VARIABLES[name].dtype).reshape(shape)
        seconds = time.monotonic() - self._began
        arrays["about"][()] = parts.sweep, number, longest, seconds
        with _failure(self._typed, "written"):
            self._refuse_loss()
            file = parts.files[number]
            with replacing(file, files=self._files) as new, zipfile.ZipFile(new, "w") as members:
                for name, array in arrays.items():
                    with members.open(f"{name}.npy", "w", force_zip64=True) as member:
                        whole = np.concatenate(array) if name in TRAJECTORIES else array
                        np.lib.format.write_array(member, whole, allow_pickle=False)
            parts.entries[number] = Entry(longest, seconds, self._files[file])
            if time.monotonic() > self._synced + _SYNC:
                sync_names(parts.folder)
                self._synced = time.monotonic()

    def finish(self, *, compressed: bool = False) -> None:
        """Write the complete file and remove the blocks, all of which must be written."""
        parts = self._parts
        with _failure(self._typed, "completed"):
            self._refuse_loss()
            with replacing(self._path, files=self._files) as new:
                pieces = parts.pieces()
                write_file(new, parts.file_schema, pieces, self._began, compressed=compressed)
            sync_names(self._path.parent)
        self._remove()

    def _refuse_loss(self) -> None:
        """Raise Failed if another program has removed or replaced the schema."""
        schema = self._parts.folder / SCHEMA
        if (now := identity(schema)) != self._files.get(schema):
            loss = "removed" if now is None else "replaced"
            raise Failed(f"{self._parts.folder} was {loss} by another program while it was written")

    def _remove(self) -> None:
        """Remove the files of the sweep from its folder, and the folder if empty."""
        folder = parts_path(self._path)
        schema, last = folder / SCHEMA, draft_of(folder / SCHEMA)
        with suppress(OSError):  # on Windows, another process is reading it; there are other files
            if (about := self._files.pop(schema, None)) == identity(schema) and about:
                os.replace(schema, last)  # so that `check_output` knows what a kill left
                self._files[last] = about
                sync_names(folder)  # a loss of power leaves no schema without its blocks
            self._remove_files(BLOCK)
            sync_names(folder)
            self._remove_files(DRAFT)
            folder.rmdir()

    def _remove_files(self, names: str) -> None:
        """Remove the known files of the folder whose names match a pattern."""
        for path, about in list(self._files.items()):
            if path != self._path and re.fullmatch(names, path.name) and identity(path) == about:
                path.unlink()
                del self._files[path]


@contextmanager
def _failure(path: Path, action: str) -> Iterator[None]:
    """Raise Failed for any error of a file whose path was accepted."""
    try:
        yield
    except StoreError as error:
        raise Failed(str(error)) from error
    except (OSError, RuntimeError, ValueError, OverflowError) as error:
        raise Failed(f"{path} cannot be {action}: {reason(error)}") from error


# The lock


def _acquired(name: Path) -> tuple[BaseFileLock, os.stat_result | None]:
    """Return the held lock of a file, which names this process, and the status of that file.

    It is a lock of the system, or the file itself where there are no locks; then there is no
    status, as the lock removes its file. A killed process leaves such a file, which a process of
    the same machine, outside containers or in the same one, then takes over.
    """
    _, before = _lock(name)  # refuses another file of that name
    lock: BaseFileLock = FileLock(name, fallback_to_soft=False)
    try:
        lock.acquire(blocking=False)
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
        if not (before or _lock(name)[0]):
            name.unlink(missing_ok=True)
        lock = SoftFileLock(name)  # it writes a text of its own
        lock.acquire(blocking=False)
        return lock, None
    try:
        return lock, _lock(name, b"vibroimpact lock of process %d\n" % os.getpid())[1]
    except BaseException:
        if before is None:
            name.unlink(missing_ok=True)
        lock.release()
        raise


def _holder(name: Path) -> str:
    """Name the process that holds a lock, and say what the user can do."""
    text = _lock(name)[0].decode(errors="replace")
    match = re.search(r"(\d+)\n?(.*)", text)
    number, host = match.groups() if match else ("of an unknown number", "")
    process = f"process {number}{f' on {host}' if host else ''}"
    ended = f"if it has ended, remove {name}, " if host else ""
    return f"{process}; wait for it, stop it with Ctrl-C or kill, {ended}or give another output"


def _lock(name: Path, new: bytes = b"") -> tuple[bytes, os.stat_result | None]:
    """Return content and status of a lock, and write a new content; refuse another file there."""
    text, about = b"", None
    with suppress(FileNotFoundError, PermissionError):  # of a lock held by others on Windows
        about = os.lstat(name)
        if not stat.S_ISREG(about.st_mode):
            text = b"another"
        else:  # follows no link and waits for no FIFO put there
            flags = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
            descriptor = os.open(name, flags | (os.O_RDWR if new else os.O_RDONLY))
            try:
                about, text = os.fstat(descriptor), os.read(descriptor, _MOST_TEXT)
                if new and _LOCK_TEXT.fullmatch(text):
                    if text:
                        os.ftruncate(descriptor, 0)
                        os.lseek(descriptor, 0, os.SEEK_SET)
                    os.write(descriptor, new)
            finally:
                os.close(descriptor)
    if not _LOCK_TEXT.fullmatch(text):
        raise StoreError(
            f"{name} is needed as a lock, but something else has that name; move it, or give "
            "another output"
        )
    return text, about
