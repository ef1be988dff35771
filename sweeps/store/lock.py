"""The lock of the only writer of a sweep, ``OUT.h5.lock``."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from filelock import BaseFileLock, FileLock, SoftFileLock, Timeout

from sweeps.errors import Failed, StoreError
from sweeps.store.paths import (
    LOCK,
    NO_LOCKS,
    check_output,
    check_parts,
    identity,
    parts_path,
    reason,
)
from sweeps.store.replacing import check_place

#: More bytes than a lock has, also one of filelock, with the names of a host and of a container.
_MOST_TEXT = 1024
#: Valid contents of a lock: this program's text, the text that filelock writes on systems without
#: locks, nothing if the writer was killed early, or zeros, which a loss of power may leave.
_LOCK_TEXT = re.compile(rb"vibroimpact lock of process \d+\n|\d+\n\S+\n(?:\d+\n)?|\0{,99}")


class HeldOutput(NamedTuple):
    """An output that this process alone may write."""

    path: Path  #: Without links, so that everything works on the file that was checked.
    before: object  #: The `identity` of the file that was checked, which may be replaced.


@contextmanager
def only_writer(
    path: Path, *, overwrite: bool = False, resume: bool = False
) -> Iterator[HeldOutput]:
    """Hold the lock ``<path>.lock``, a file that names this process, and remove it at the end.

    However the process dies, the system releases the lock. The file left behind is then unlocked,
    and the next writer takes it over. Readers need no lock. Once the lock is held, the folder of
    the blocks is made, so that nobody else can make it before the first block is computed; it is
    removed if it stays empty. Raises StoreError if another process holds the lock, if the file
    cannot be created, or as `check_output` does, and Failed if the folder cannot be made.
    """
    check_place(path, "output")
    real = path.resolve()
    name = real.with_name(f"{real.name}{LOCK}")
    try:
        _lock_text(name)  # refuses another file of that name
        lock = _acquired(name)
    except Timeout:
        if not os.path.lexists(name):
            raise StoreError(
                f"no file can be made in the folder {real.parent} of the output {path.name}"
            ) from None
        raise StoreError(f"{path} is being written by {_holder(name)}") from None
    except OSError as error:
        raise StoreError(f"{str(path)!r} cannot be locked for writing: {reason(error)}") from None
    try:
        before = identity(real)  # what appears from now on is not replaced
        check_output(path, overwrite=overwrite, resume=resume)
        try:
            parts_path(real).mkdir(exist_ok=True)
            check_parts(parts_path(real), overwrite)  # another user may have made it meanwhile
        except OSError as error:
            raise Failed(f"{path} cannot be created: {reason(error)}") from error
        try:
            yield HeldOutput(real, before)
        finally:
            with suppress(OSError):  # it has blocks, or the file is complete
                parts_path(real).rmdir()
    finally:
        with suppress(PermissionError):  # on Windows a locked file cannot be removed
            if not isinstance(lock, SoftFileLock):  # which removes the file itself
                name.unlink(missing_ok=True)
        lock.release()


def _acquired(name: Path) -> BaseFileLock:
    """Return the held lock of a file, which names this process.

    It is a lock of the system, or the file itself where there are no locks. A killed process leaves
    such a file, which a process of the same machine, outside containers or in the same one, then
    takes over.
    """
    was_there = os.path.lexists(name)
    lock: BaseFileLock = FileLock(name, fallback_to_soft=False)
    try:
        lock.acquire(blocking=False)
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
        if not was_there:
            name.unlink(missing_ok=True)
        lock = SoftFileLock(name)  # it writes a text of its own
        lock.acquire(blocking=False)
        return lock
    flags = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    with suppress(PermissionError):  # on Windows a locked file cannot be written
        descriptor = os.open(name, os.O_WRONLY | os.O_TRUNC | flags)  # follows no link put there
        try:
            os.write(descriptor, b"vibroimpact lock of process %d\n" % os.getpid())
        finally:
            os.close(descriptor)
    return lock


def _holder(name: Path) -> str:
    """Name the process that holds a lock, and say what the user can do."""
    text = _lock_text(name).decode(errors="replace")
    found = re.search(r"(\d+)\n?(.*)", text)
    number, host = found.groups() if found else ("of an unknown number", "")
    process = f"process {number}{f' on {host}' if host else ''}"
    ended = f"if it has ended, remove {name}, " if host else ""
    return f"{process}; wait for it, stop it with Ctrl-C or kill, {ended}or give another output"


def _lock_text(name: Path) -> bytes:
    """Return the content of a lock, if it can be read; refuse another file of its name."""
    text = b""
    with suppress(FileNotFoundError, PermissionError):
        if stat.S_ISREG(os.lstat(name).st_mode):
            with name.open("rb") as file:
                text = file.read(_MOST_TEXT)
        else:
            text = b"another"
    if not _LOCK_TEXT.fullmatch(text):
        raise StoreError(
            f"{name} is needed as a lock, but something else has that name; move it, or give "
            "another output"
        )
    return text
