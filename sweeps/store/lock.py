"""One writer per file: a lock that dies with its process."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sweeps.errors import StoreError


@contextmanager
def only_writer(path: Path) -> Iterator[None]:
    """Hold the lock ``<path>.lock``, a file that names this process, and remove it at the end.

    The kernel lets go of the lock when the process dies, however it dies. What a dead process
    leaves is a file that nobody has locked, and the next writer takes it over. Readers need none.

    Raises
    ------
    StoreError
        If another process has it, or there can be no such file.
    """
    try:
        real = path.resolve()
        name = real.with_name(f"{real.name}.lock")
        lock = _locked(name)
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
        reason = getattr(error, "strerror", None) or error
        raise StoreError(f"{str(path)!r} cannot be locked for writing: {reason}") from None
    try:
        os.ftruncate(lock, 0)
        os.pwrite(lock, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        name.unlink(missing_ok=True)
        os.close(lock)


def _locked(name: Path) -> int:
    while True:
        lock = os.open(name, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(lock).st_ino == os.stat(name).st_ino:
                return lock
        except FileNotFoundError:
            pass
        except OSError:
            os.close(lock)
            raise
        os.close(lock)  # its holder removed the file before letting go of it


def _holder(name: Path) -> str:
    try:
        return name.read_text().strip() or "of an unknown number"
    except OSError:
        return "of an unknown number"
