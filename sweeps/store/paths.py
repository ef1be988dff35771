"""The files of a sweep by their paths: what lies there, what may be written, and by whom.

While a sweep runs, it has a journal, ``OUT.h5.part``, and a lock, ``OUT.h5.lock``.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from enum import Enum
from pathlib import Path
from typing import NoReturn

from filelock import FileLock, SoftFileLock, Timeout

from sweeps.errors import StoreError
from sweeps.store.replacing import check_target, kind
from sweeps.text import shown_bytes

#: The attributes ``format`` and ``format_version`` of a file.
FORMAT = "vibroimpact-sweep"
FORMAT_VERSION = 4
#: How a journal begins, and how a complete file ends.
JOURNAL = b"\x89VIBROJ\n"
TRAILER = b"\x89VIBRO4\n"
#: How files of the format versions 2 and 3 end.
_OLDER = re.compile(rb"\x89VIBRO[L3]\n")
_HDF5 = b"\x89HDF\r\n\x1a\n"
#: Bytes at either end of a file in which its format and its trailer are looked for.
_ENDS = 1 << 16

#: Endings that name another kind of file, which a slip would give to the data.
_OTHER_ENDINGS = (".png", ".svg", ".pdf", ".yaml", ".yml", ".txt")
#: What a lock holds: nothing where its writer was killed before it wrote this, or what filelock
#: writes where the system has no locks.
_LOCK_TEXT = re.compile(rb"(?:vibroimpact lock of process \d+\n|\d+\n\S+\n(?:\d+\n)?)?")


def journal_path(path: Path) -> Path:
    """Return the path of the journal of a sweep, which lies beside the file that a link names."""
    path = path.resolve() if os.path.islink(path) else path
    return path.with_name(f"{path.name}.part")


def identity(path: Path) -> tuple[int, ...] | None:
    """Return what is different after a file was replaced or written; None where there is none."""
    try:
        about = path.stat()
    except (OSError, ValueError):
        return None
    return about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns


def reason(error: Exception) -> str:
    """Say what went wrong, without HDF5's buffer addresses and line breaks."""
    errno = re.search(r"errno = (\d+)", str(error))
    number = getattr(error, "errno", None) or (errno and int(errno[1]))
    return os.strerror(number) if number else str(error).splitlines()[0]


# What may be written, and what can be read


class Content(Enum):
    """What lies at a path, as far as its two ends tell; the value says it in messages."""

    NOTHING = "empty"
    SWEEP = "the file of a sweep"
    OLDER = "the file of a sweep in an older format"
    JOURNAL = "the journal of a sweep"
    HDF5 = "an HDF5 file, but not one that vibroimpact wrote, or truncated"
    OTHER = "not an HDF5 file"


def content(path: Path) -> Content | None:
    """Return what lies at a path, None where nothing does; refuse what is no regular file.

    HDF5 is not asked: what it does with a damaged file is not known.
    """
    try:
        with open_regular(path) as file:
            head = file.read(_ENDS)
            file.seek(max(0, os.fstat(file.fileno()).st_size - _ENDS))
            tail = file.read()
    except (FileNotFoundError, NotADirectoryError):
        return None
    if not head or head.startswith(JOURNAL):
        return Content.JOURNAL if head else Content.NOTHING
    hdf5 = head.startswith(_HDF5)
    if TRAILER in tail or (hdf5 and FORMAT.encode() in head):
        return Content.OLDER if _OLDER.search(tail) else Content.SWEEP
    return Content.HDF5 if hdf5 else Content.OTHER


def open_regular(path: Path) -> io.BufferedReader:
    """Open a regular file to be read; refuse all else at once, as a FIFO, which would wait."""
    try:
        mode = os.stat(path).st_mode
        if stat.S_ISREG(mode):
            return path.open("rb")
    except (FileNotFoundError, NotADirectoryError):
        raise
    except (OSError, ValueError) as error:  # too long a name, a null byte
        raise StoreError(f"{str(path)!r} cannot be read: {reason(error)}") from None
    raise StoreError(f"{path} is {kind(mode)} and so not the file of a sweep")


def is_sweep(path: Path) -> bool:
    """Return whether there is an HDF5 file, of a sweep or not, or the journal of a sweep."""
    try:
        found = content(path) or content(journal_path(path))
    except StoreError:
        return False  # which the YAML's own message says
    return found in (Content.SWEEP, Content.OLDER, Content.HDF5, Content.JOURNAL)


def refuse_version(path: Path) -> NoReturn:
    """Refuse a file of another format version."""
    raise StoreError(
        f"{path} has another format version than {FORMAT_VERSION}, the only one that this version "
        "of vibroimpact reads; open it with the version that wrote it"
    )


def check_output(path: str | Path, *, overwrite: bool = False, resume: bool = False) -> None:
    """Refuse a path that a sweep cannot be written to, with StoreError.

    It may be in no directory, or have the ending of another kind of file; or the file or its
    journal may exist and be neither to be overwritten nor resumed, or be of another kind.
    """
    path = Path(path)
    check_target(path, "output")
    if path.suffix.lower() in _OTHER_ENDINGS:
        raise StoreError(
            f"the output {path} is to be an HDF5 file, whose name does not end in {path.suffix}; "
            f"did you mean {path.with_suffix('.h5')}?"
        )
    journal = journal_path(path)
    check_target(journal, "journal")
    ours = {path: (Content.SWEEP, Content.OLDER), journal: (Content.JOURNAL,)}
    for file in ours:
        found = content(file)
        if found is None:
            continue
        if not (overwrite or resume):
            raise StoreError(
                f"{file} exists; give resume=True to go on with it, overwrite=True to replace it, "
                "or another output"
            )
        if found not in (Content.NOTHING, *ours[file]):
            raise StoreError(
                f"{file} is {found.value} and will not be replaced; give another output"
            )


def check_room(path: Path, size: int, *, resume: bool = False) -> None:
    """Refuse a sweep of `size` bytes, its journal and its file together, that the disk lacks."""
    journal = journal_path(path)
    existing = journal.exists() or path.exists()
    if resume and existing:  # the journal has a part of the room, and a complete file all of it
        size = size - journal.stat().st_size if journal.exists() else 0
    free = shutil.disk_usage(journal.parent).free
    if size > free:
        also = ", delete the old file first" if existing else ""
        raise StoreError(
            f"the sweep takes about {shown_bytes(size)} while it is written, and the disk of "
            f"{path} has only {shown_bytes(free)} left; record less{also}, or give an output "
            "elsewhere"
        )


# The lock


@contextmanager
def only_writer(path: Path, *, overwrite: bool = False, resume: bool = False) -> Iterator[None]:
    """Hold the lock ``<path>.lock``, a file that names this process, and remove it at the end.

    The system lets go of the lock when the process dies, however it dies. What a dead process
    leaves is a file that nobody has locked, and the next writer takes it over. Readers need none.
    Raises StoreError if another process has it, if there can be no such file, or as `check_output`.
    """
    check_target(path, "output")
    real = path.resolve()
    try:
        name = real.with_name(f"{real.name}.lock")
        users = os.path.lexists(name) and not _lock_text(name)  # an empty file, perhaps the user's
        lock = FileLock(name)
        lock.acquire(blocking=False)
    except Timeout:
        if not os.path.lexists(name):
            raise StoreError(
                f"no file can be made in the folder {real.parent} of the output {path.name}"
            ) from None
        number = re.search(rb"\d+", _lock_text(name))
        holder = number[0].decode() if number else "of an unknown number"
        raise StoreError(
            f"{path} is being written by process {holder}; wait for it, stop it with Ctrl-C or "
            "kill, or give another output"
        ) from None
    except OSError as error:
        raise StoreError(f"{str(path)!r} cannot be locked for writing: {reason(error)}") from None
    by_itself = isinstance(lock, SoftFileLock)  # it writes and removes the file
    try:
        with suppress(PermissionError):  # of Windows, where nobody can write to what is locked
            if not by_itself:
                name.write_bytes(b"vibroimpact lock of process %d\n" % os.getpid())
        check_output(path, overwrite=overwrite, resume=resume)
        yield
    finally:
        with suppress(PermissionError):
            if users:
                name.write_bytes(b"")
            elif not by_itself:
                name.unlink(missing_ok=True)
        lock.release()


def _lock_text(name: Path) -> bytes:
    """Return what a lock holds, if it can be read; refuse anything else of its name."""
    text = b""
    with suppress(FileNotFoundError, PermissionError):
        text = name.read_bytes()[:100] if stat.S_ISREG(os.lstat(name).st_mode) else b"another"
    if not _LOCK_TEXT.fullmatch(text):
        raise StoreError(
            f"{name} is needed as a lock, and there is something else of that name; move it, or "
            "give another output"
        )
    return text
