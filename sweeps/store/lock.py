"""Lock a file for a single writer; the lock ends with the process that holds it."""

from __future__ import annotations

import fcntl
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sweeps.errors import StoreError
from sweeps.store.path_checks import reason

#: What a lock file holds: nothing where its writer was killed before it wrote this.
_TEXT = re.compile(rb"(?:vibroimpact lock of process (\d+)\n)?")


@contextmanager
def only_writer(path: Path) -> Iterator[None]:
    """Hold the lock ``<path>.lock``, a file that names this process, and remove it at the end.

    The kernel lets go of the lock when the process dies, however it dies. What a dead process
    leaves is a file that nobody has locked, and the next writer takes it over. Readers need none.

    Parameters
    ----------
    path : Path
        Of the file to write.

    Raises
    ------
    StoreError
        If another process has it, there can be no such file, or there is another file of its name.
    """
    try:
        real = path.resolve()
        name = real.with_name(f"{real.name}.lock")
        lock, created = _locked(name)
    except BlockingIOError:
        raise StoreError(
            f"{path} is being written by process {_holder(name)}; wait for it, stop it with "
            "Ctrl-C or kill, or give -o another file"
        ) from None
    except FileNotFoundError:
        raise StoreError(
            f"the folder {path.parent} of the output {path.name} does not exist"
        ) from None
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        raise StoreError(f"{str(path)!r} cannot be locked for writing: {reason(error)}") from None
    try:
        if not _TEXT.fullmatch(os.pread(lock, 100, 0)):
            raise StoreError(_taken(name))
        # An empty file may be the user's own.
        ours = created or os.fstat(lock).st_size > 0
        os.ftruncate(lock, 0)
        os.pwrite(lock, b"vibroimpact lock of process %d\n" % os.getpid(), 0)
        try:
            yield
        finally:
            if ours:
                name.unlink(missing_ok=True)
            else:
                os.ftruncate(lock, 0)
    finally:
        os.close(lock)


def _locked(name: Path) -> tuple[int, bool]:
    """Open and lock a file; return its descriptor, and whether it was created."""
    while True:
        try:
            lock, created = os.open(name, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o644), True
        except FileExistsError:
            try:
                if not stat.S_ISREG(os.lstat(name).st_mode):
                    raise StoreError(_taken(name)) from None
                lock, created = os.open(name, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK), False
            except FileNotFoundError:
                continue  # its holder has just removed it
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(lock), os.stat(name)):
                return lock, created
        except FileNotFoundError:
            pass
        except OSError:
            os.close(lock)
            raise
        os.close(lock)  # its holder removed the file before letting go of it


def _taken(name: Path) -> str:
    """Say that something else has the name of the lock."""
    return (
        f"{name} is needed as a lock, and there is something else of that name; move it, or give "
        "-o another file"
    )


def _holder(name: Path) -> str:
    """Return the number of the process that holds a lock."""
    try:
        match = _TEXT.fullmatch(name.read_bytes()[:100])
    except OSError:
        match = None
    return match[1].decode() if match and match[1] else "of an unknown number"
