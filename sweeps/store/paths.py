"""Names the files of a sweep; tells their `Content`; refuses outputs, and disks without room.

While a sweep runs, it has a folder for its blocks, ``OUT.h5.parts``, and a lock, ``OUT.h5.lock``.
"""

from __future__ import annotations

import errno
import io
import os
import re
import shutil
import stat
from enum import Enum
from pathlib import Path

from sweeps.errors import StoreError
from sweeps.interrupts import without_waiting
from sweeps.store.replacing import (
    TRAILER,
    UnreadableError,
    absolute,
    check_path,
    identity,
    not_regular,
    of_another_user,
    reason,
)
from sweeps.text import shown_bytes

#: The attributes ``format`` and ``format_version`` of a file.
FORMAT = "vibroimpact-sweep"
FORMAT_VERSION = 5
#: Ending of the folder of an incomplete sweep, and the names of the files in it.
PARTS = ".parts"
LOCK = ".lock"
SCHEMA = "schema.h5"
BLOCK = r"block-\d+\.npz"
DRAFT = r"\.(schema\.h5|block-\d+\.npz)\.[0-9a-f]+-[0-9a-f]{8}\.new"
_HDF5 = b"\x89HDF\r\n\x1a\n"
#: Number of bytes at each end of a file that are searched for its format and its trailer.
_SEARCH_SIZE = 1 << 16

#: Endings of other kinds of files, refused for an output because they are surely a mistake: of
#: pictures and films, tables, texts, arrays and archives.
_OTHER_ENDINGS = frozenset(
    "avif bmp eps gif jpeg jpg pdf pgf png ps raw rgba svg svgz tif tiff webp avi mkv mov mp4 webm "
    "csv feather ods parquet tsv xls xlsx cfg db htm html ini ipynb json log md py rst sqlite tex "
    "toml txt xml yaml yml joblib mat npy npz pickle pkl rds zarr 7z bz2 gz tar tgz xz zip zst"
    .split()
)  # fmt: skip
#: What a user can do instead of resuming, with the options of the command and the arguments.
OR_OVERWRITE = (
    "overwrite it, or give another output (--overwrite or -o; in Python overwrite or output)"
)
#: The errors of a file system that has no locks.
NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOTSUP)


def parts_path(path: Path) -> Path:
    """Return the folder of an incomplete sweep; for a link, it lies beside the link's target.

    Refuse the path of such a folder, or of a file in it, and name the path to give.
    """
    whole = absolute(path)
    for folder, as_typed in ((whole, path), (whole.parent, path.parent)):
        if folder.name.endswith(PARTS) and identity(folder / SCHEMA):
            output = str(as_typed if as_typed.name else folder).removesuffix(PARTS)
            raise StoreError(f"{path} belongs to a sweep that is not complete; give {output}")
    path = Path(os.path.realpath(path)) if os.path.islink(path) else path  # also of a loop
    return path.parent / f"{path.name}{PARTS}"  # `with_name` fails for . and /


# What may be written, and what can be read


class Content(Enum):
    """The kind of a file, judged by its first and last bytes; the value is its name in messages."""

    NOTHING = "empty"
    SWEEP = "the file of a sweep"
    HDF5 = "an HDF5 file, but not one that vibroimpact wrote, or truncated"
    OTHER = "not an HDF5 file"


def content(path: Path) -> Content | None:
    """Return the kind of the file at a path, None without one; refuse all but regular files.

    This does not use HDF5, which a damaged file can crash.
    """
    try:
        with open_regular(path) as file:
            head = file.read(_SEARCH_SIZE)
            file.seek(max(0, os.fstat(file.fileno()).st_size - _SEARCH_SIZE))
            tail = file.read()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise UnreadableError(path, error) from error
    if not head:
        return Content.NOTHING
    hdf5 = head.startswith(_HDF5)
    copy = b"_NCProperties" in head + tail  # by xarray
    if TRAILER[:-2] in tail or (hdf5 and FORMAT.encode() in head and not copy):  # of any version
        return Content.SWEEP
    return Content.HDF5 if hdf5 else Content.OTHER


def open_regular(path: Path) -> io.BufferedReader:
    """Open a regular file for reading; refuse anything else, such as a FIFO, which would block."""
    try:
        mode = os.stat(path).st_mode
        if stat.S_ISREG(mode):
            file = open(path, "rb", opener=without_waiting)
            mode = os.fstat(file.fileno()).st_mode  # another file may have the name by now
            if stat.S_ISREG(mode):
                return file
            file.close()
    except (FileNotFoundError, NotADirectoryError):
        raise
    except (OSError, ValueError) as error:  # too long a name, a null byte
        raise UnreadableError(path, error) from None
    raise StoreError(f"{path} is {not_regular(mode)} and so not the file of a sweep")


def has_file(path: Path) -> bool:
    """Whether there is a file that is not empty; blocks are read only without one."""
    return content(path) not in (None, Content.NOTHING)


def is_sweep(path: Path) -> bool:
    """Return whether the path has an HDF5 file, of a sweep or not, or an incomplete sweep."""
    try:
        kind = content(path if has_file(path) else parts_path(path) / SCHEMA)
    except StoreError:
        return False  # reading it as YAML reports the error
    return kind in (Content.SWEEP, Content.HDF5)


def refuse_both(*, overwrite: bool, resume: bool) -> None:
    """Refuse to resume and to overwrite at the same time."""
    if overwrite and resume:
        raise StoreError(
            "--resume and --overwrite (resume and overwrite in Python) exclude each other"
        )


def check_output(path: str | Path, *, overwrite: bool = False, resume: bool = False) -> None:
    """Refuse a path where a sweep cannot be written, or may not replace what is there."""
    refuse_both(overwrite=overwrite, resume=resume)
    path = Path(path)
    check_path(path, "output")
    parts = parts_path(path)
    if path.suffix.lower() in (PARTS, LOCK):
        raise StoreError(
            f"the output {path} must not end in {path.suffix}, like the files beside an output "
            f"while it is written; did you mean {path.with_suffix('')}?"
        )
    if path.suffix.lower()[1:] in _OTHER_ENDINGS:
        raise StoreError(
            f"the output {path} must be an HDF5 file, whose name does not end in {path.suffix}; "
            f"did you mean {str(path.with_suffix('')).removesuffix('.h5')}.h5?"
        )
    check_parts(path, overwrite)
    for file, named in ((path, path), (parts / SCHEMA, parts)):
        old = content(file)
        if old is None:
            continue
        if not (overwrite or resume):
            raise StoreError(
                f"{named} exists; resume it, overwrite it, or give another output (--resume, "
                "--overwrite or -o; in Python resume, overwrite or output)"
            )
        if old not in (Content.NOTHING, Content.SWEEP):
            raise StoreError(f"{file} is {old.value} and will not be replaced; give another output")


def check_parts(path: Path, overwrite: bool) -> None:
    """Refuse what has the name of the folder of its blocks, if no blocks can be written there.

    Blocks without their schema are an incomplete copy, and are only overwritten. A killed removal
    leaves a draft of the schema beside them, as it first renames the schema and removes it last.
    """
    parts = parts_path(path)
    try:
        status = os.lstat(parts)
    except FileNotFoundError:
        return
    except OSError as error:  # a name too long
        raise StoreError(
            f"the output {path} cannot be used: {parts.name}: {reason(error)}"
        ) from None
    if not stat.S_ISDIR(status.st_mode):
        raise StoreError(
            f"{parts} is needed as a folder, but something else has that name; move it, or give "
            "another output"
        )
    if of_another_user(status):
        raise StoreError(
            f"{parts} belongs to another user, who could change what is written; give another "
            "output"
        )
    try:
        files = list(os.scandir(parts))
        blocks = [file for file in files if re.fullmatch(BLOCK, file.name)]
        folders = [file.path for file in blocks if file.is_dir()]
    except OSError as error:
        raise UnreadableError(parts, error) from error
    if folders:
        raise StoreError(
            f"{folders[0]} is a directory in the place of a block; move it, or give another output"
        )
    schemas = [file for file in files if SCHEMA in file.name]
    schema = any(re.fullmatch(rf"{SCHEMA}|{DRAFT}", file.name) for file in schemas)
    if blocks and not schema and not overwrite:
        raise StoreError(
            f"{parts} has blocks but no {SCHEMA}, like a copy that was cut short; copy it again, "
            f"{OR_OVERWRITE}"
        )


def check_room(path: Path, size: int, *, resume: bool = False) -> None:
    """Refuse a sweep if the disk lacks `size` bytes, for its blocks and its file together."""
    parts = parts_path(path)
    incomplete = identity(parts / SCHEMA) is not None
    existing = incomplete or path.exists()
    if resume and existing:  # the blocks already take part of the room, a complete file all
        used_bytes = sum(about[2] for file in parts.glob("*") if (about := identity(file)))
        size = size - used_bytes if incomplete else 0
    free = shutil.disk_usage(parts.parent).free
    if size > free:
        also = ", delete the old file first" if existing else ""
        raise StoreError(
            f"the sweep takes about {shown_bytes(size)} while it is written, and the disk of "
            f"{path} has only {shown_bytes(free)} left; record less{also}, or give an output "
            "elsewhere"
        )


def identities(path: Path) -> tuple[object, object]:
    """Return the `identity` of the file of a sweep and of the schema of its blocks."""
    return identity(Path(os.path.realpath(path))), identity(parts_path(path) / SCHEMA)
