"""The paths of a sweep's files: what exists there, what may be written, and the lock of the writer.

While a sweep runs, it has a folder for its blocks, ``OUT.h5.parts``, and a lock, ``OUT.h5.lock``.
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
FORMAT_VERSION = 5
#: Ending of the folder of an incomplete sweep, and the name of the schema in it.
PARTS = ".parts"
SCHEMA = "schema.h5"
#: The last bytes of a complete file.
TRAILER = b"\x89VIBRO5\n"
#: The last bytes of files with the format versions 2 to 4.
_OLDER = re.compile(rb"\x89VIBRO[L34]\n")
_HDF5 = b"\x89HDF\r\n\x1a\n"
#: Number of bytes at each end of a file that are searched for its format and its trailer.
_ENDS = 1 << 16

#: Endings of other kinds of files, refused for an output because they are surely a mistake.
_OTHER_ENDINGS = (".png", ".svg", ".pdf", ".yaml", ".yml", ".txt")
#: Valid contents of a lock: this program's text, the text that filelock writes on systems without
#: locks, nothing if the writer was killed early, or zeros, which a loss of power may leave.
_LOCK_TEXT = re.compile(rb"vibroimpact lock of process \d+\n|\d+\n\S+\n(?:\d+\n)?|\0{,99}")


def parts_path(path: Path) -> Path:
    """Return the folder of an incomplete sweep; for a link, it lies beside the link's target."""
    path = path.resolve() if os.path.islink(path) else path
    return path.with_name(f"{path.name}{PARTS}")


def identity(path: Path) -> tuple[int, ...] | None:
    """Return a value that changes when the file is replaced or written; None without a file."""
    try:
        return identity_of(path.stat())
    except (OSError, ValueError):
        return None


def identity_of(about: os.stat_result) -> tuple[int, ...]:
    """Return the `identity` of a file from its status."""
    return about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns


def reason(error: Exception) -> str:
    """Return the message of an error, without the buffer addresses and line breaks of HDF5."""
    errno = re.search(r"errno = (\d+)", str(error))
    number = getattr(error, "errno", None) or (errno and int(errno[1]))
    return os.strerror(number) if number else str(error).splitlines()[0]


# What may be written, and what can be read


class Content(Enum):
    """The kind of a file, judged by its first and last bytes; the value is its name in messages."""

    NOTHING = "empty"
    SWEEP = "the file of a sweep"
    OLDER = "the file of a sweep in an older format"
    HDF5 = "an HDF5 file, but not one that vibroimpact wrote, or truncated"
    OTHER = "not an HDF5 file"


def content(path: Path) -> Content | None:
    """Return the kind of the file at a path, None without one; refuse all but regular files.

    This does not use HDF5, which a damaged file can crash.
    """
    try:
        with open_regular(path) as file:
            head = file.read(_ENDS)
            file.seek(max(0, os.fstat(file.fileno()).st_size - _ENDS))
            tail = file.read()
    except (FileNotFoundError, NotADirectoryError):
        return None
    if not head:
        return Content.NOTHING
    hdf5 = head.startswith(_HDF5)
    if TRAILER in tail or (hdf5 and FORMAT.encode() in head):
        return Content.OLDER if _OLDER.search(tail) else Content.SWEEP
    return Content.HDF5 if hdf5 else Content.OTHER


def open_regular(path: Path) -> io.BufferedReader:
    """Open a regular file for reading; refuse anything else, such as a FIFO, which would block."""
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
    """Return whether the path has an HDF5 file, of a sweep or not, or an incomplete sweep."""
    try:
        found = content(path) or content(parts_path(path) / SCHEMA)
    except StoreError:
        return False  # reading it as YAML reports the error
    return found in (Content.SWEEP, Content.OLDER, Content.HDF5)


def refuse_version(path: Path) -> NoReturn:
    """Refuse a file of another format version."""
    raise StoreError(
        f"{path} has another format version than {FORMAT_VERSION}, the only one that this version "
        "of vibroimpact reads; open it with the version that wrote it"
    )


def check_output(path: str | Path, *, overwrite: bool = False, resume: bool = False) -> None:
    """Raise StoreError if a sweep cannot be written to a path.

    The folder must exist, and the ending must not belong to another kind of file. An existing file
    or incomplete sweep must be overwritten or resumed.
    """
    path = Path(path)
    check_target(path, "output")
    if path.suffix.lower() in _OTHER_ENDINGS:
        raise StoreError(
            f"the output {path} must be an HDF5 file, whose name does not end in {path.suffix}; "
            f"did you mean {path.with_suffix('.h5')}?"
        )
    parts = parts_path(path)
    try:
        is_folder = stat.S_ISDIR(os.lstat(parts).st_mode)
    except FileNotFoundError:
        is_folder = True
    except OSError as error:  # a name too long
        raise StoreError(
            f"the output {path} cannot be used: {parts.name}: {reason(error)}"
        ) from None
    if not is_folder:
        raise StoreError(
            f"{parts} is needed as a folder, but something else has that name; move it, or give "
            "another output"
        )
    for file, named in ((path, path), (parts / SCHEMA, parts)):
        found = content(file)
        if found is None:
            continue
        if not (overwrite or resume):
            raise StoreError(f"{named} exists; resume it, overwrite it, or give another output")
        if found not in (Content.NOTHING, Content.SWEEP, Content.OLDER):
            raise StoreError(
                f"{file} is {found.value} and will not be replaced; give another output"
            )


def check_room(path: Path, size: int, *, resume: bool = False) -> None:
    """Refuse a sweep if the disk lacks `size` bytes, for its blocks and its file together."""
    parts = parts_path(path)
    existing = parts.exists() or path.exists()
    if resume and existing:  # the blocks already take part of the room, a complete file all
        taken = sum(about[2] for file in parts.glob("*") if (about := identity(file)))
        size = size - taken if parts.exists() else 0
    free = shutil.disk_usage(parts.parent).free
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

    However the process dies, the system releases the lock. The file left behind is then unlocked,
    and the next writer takes it over. Readers need no lock. Raises StoreError if another process
    holds the lock, if the file cannot be created, or as `check_output` does.
    """
    check_target(path, "output")
    real = path.resolve()
    try:
        name = real.with_name(f"{real.name}.lock")
        _lock_text(name)  # refuses another file of that name
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
    is_soft = isinstance(lock, SoftFileLock)  # it writes and removes the file itself
    try:
        with suppress(PermissionError):  # on Windows a locked file cannot be written
            if not is_soft:
                name.write_bytes(b"vibroimpact lock of process %d\n" % os.getpid())
        check_output(path, overwrite=overwrite, resume=resume)
        yield
    finally:
        with suppress(PermissionError):
            if not is_soft:
                name.unlink(missing_ok=True)
        lock.release()


def _lock_text(name: Path) -> bytes:
    """Return the content of a lock, if it can be read; refuse another file of its name."""
    text = b""
    with suppress(FileNotFoundError, PermissionError):
        if stat.S_ISREG(os.lstat(name).st_mode):
            with name.open("rb") as file:
                text = file.read(100)
        else:
            text = b"another"
    if not _LOCK_TEXT.fullmatch(text):
        raise StoreError(
            f"{name} is needed as a lock, but something else has that name; move it, or give "
            "another output"
        )
    return text
