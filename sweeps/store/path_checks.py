"""Check a path before HDF5 opens it: whether a sweep can be written to it or read from it."""

from __future__ import annotations

import os
import re
import shutil
import stat
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from sweeps.errors import StoreError
from sweeps.store.layout import FORMAT, FORMAT_VERSION
from sweeps.store.ledger import DamageError
from sweeps.store.replacing import check_target, kind
from sweeps.text import shown_bytes

#: Endings that name another kind of file, which a slip would give to the data.
_OTHER_ENDINGS = (".png", ".svg", ".pdf", ".yaml", ".yml", ".txt")
#: How a file of this format ends, in format version 2 and since.
_LEDGERS = re.compile(rb"\x89VIBRO[L3]\n")
_HDF5 = b"\x89HDF\r\n\x1a\n"
#: Bytes at either end of a file in which its name of the format and its ledger are looked for.
_ENDS = 1 << 16


def check_output(
    path: str | Path, *, overwrite: bool = False, resume: bool = False, size: int = 0
) -> None:
    """Refuse a path that a sweep of `size` bytes cannot be written to.

    Parameters
    ----------
    path : str or Path
    overwrite, resume : bool
        Whether an existing file may be replaced, or is to be completed.
    size : int
        Bytes that the file takes.

    Raises
    ------
    StoreError
        If `path` is a directory or in none, has the ending of another kind of file, exists and
        is neither to be overwritten nor resumed, or is anything else than the file of a sweep or
        an empty one, or if there is no room for the sweep.
    """
    path = Path(path)
    exists = check_target(path, "output")
    if path.suffix.lower() in _OTHER_ENDINGS:
        raise StoreError(
            f"the output {path} is to be an HDF5 file, whose name does not end in {path.suffix}; "
            f"did you mean {path.with_suffix('.h5')}?"
        )
    try:
        real = os.path.realpath(path)
        with suppress(FileNotFoundError):
            os.lstat(f"{real}.lock")  # whose name may be too long
        if exists:
            if not (overwrite or resume):
                raise StoreError(
                    f"{path} exists; give --resume to go on with it, --overwrite to replace it, or "
                    "-o for another file"
                )
            _refuse_other_files(path)
            if resume:
                return
    except OSError as error:
        raise StoreError(f"the output {str(path)!r} cannot be used: {reason(error)}") from None
    free = shutil.disk_usage(os.path.dirname(real)).free
    if size > free:
        also = ", delete the old file first" if exists else ""
        raise StoreError(
            f"the sweep takes about {shown_bytes(size)}, and the disk of {path} has only "
            f"{shown_bytes(free)} left; record less{also}, or give -o a file elsewhere"
        )


def open_regular(path: Path) -> int:
    """Return the descriptor of a regular file, opened to be read; refuse all else at once."""
    try:
        mode = os.stat(path).st_mode
        if stat.S_ISREG(mode):
            return os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except FileNotFoundError:
        raise StoreError(f"{path} does not exist") from None
    except (OSError, ValueError) as error:
        raise StoreError(f"{str(path)!r} cannot be read: {reason(error)}") from None
    raise StoreError(f"{path} is {kind(mode)} and so not the file of a sweep")


def _refuse_other_files(path: Path) -> None:
    """Refuse to replace what is neither empty nor the file of a sweep, damaged or not."""
    descriptor = open_regular(path)
    try:
        head, tail = _ends(descriptor)
    finally:
        os.close(descriptor)
    if not head or _LEDGERS.search(tail):
        return
    if not head.startswith(_HDF5):
        raise StoreError(f"{path} is not an HDF5 file and will not be replaced; give -o another")
    if FORMAT.encode() not in head:
        raise StoreError(
            f"{path} is an HDF5 file that vibroimpact did not write, and will not be replaced; "
            "give -o another"
        )


def refuse_without_ledger(path: Path, descriptor: int) -> NoReturn:
    """Say what a file is that has no ledger of this format version.

    HDF5 is not asked: what it does with a damaged file is not known.

    Raises
    ------
    StoreError
        If the file is of another kind, or of another version.
    DamageError
        If it is a damaged file of a sweep.
    """
    head, tail = _ends(descriptor)
    if not head.startswith(_HDF5):
        raise StoreError(f"{path} is not an HDF5 file")
    if FORMAT.encode() not in head:
        raise StoreError(
            f"{path} is an HDF5 file, but not one that vibroimpact wrote, or truncated"
        )
    if _LEDGERS.search(tail):
        refuse_version(path, "2")
    raise DamageError


def _ends(descriptor: int) -> tuple[bytes, bytes]:
    """Return both ends of a file."""
    size = os.fstat(descriptor).st_size
    return os.pread(descriptor, _ENDS, 0), os.pread(descriptor, _ENDS, max(0, size - _ENDS))


def refuse_version(path: Path, version: object) -> NoReturn:
    """Refuse a file of another format version."""
    raise StoreError(
        f"{path} has the format version {version}, and this version of vibroimpact reads "
        f"only {FORMAT_VERSION}; open it with the version that wrote it"
    )


def reason(error: Exception) -> str:
    """Say what went wrong, without HDF5's buffer addresses and line breaks."""
    errno = re.search(r"errno = (\d+)", str(error))
    number = getattr(error, "errno", None) or (errno and int(errno[1]))
    return os.strerror(number) if number else str(error).splitlines()[0]
