"""Replaces a file by a complete draft if its `identity` is unchanged; checks its path.

Every file that the program writes as a whole is written with these functions.
"""

from __future__ import annotations

import errno
import os
import re
import secrets
import stat
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from io import BufferedRandom
from pathlib import Path

from sweeps.errors import Failed, StoreError
from sweeps.text import of_shell, shortened

#: Characters that no name of a file has on Windows, where a backslash separates folders.
_NOT_IN_NAMES = re.compile(r'[\x01-\x1f<>:"|?*\\]')
#: Names that Windows keeps for devices, with every ending.
_DEVICES = re.compile(
    r"(CON|PRN|AUX|NUL|CONIN\$|CONOUT\$|COM[1-9¹²³]|LPT[1-9¹²³]) *(\..*)?", re.IGNORECASE
)
#: Number of characters of a file's name in the name of its draft, which must not be too long.
_REPEATED = 50
#: The last bytes of the complete file of a sweep: a name and the format version.
TRAILER = b"\x89VIBRO5\n"
#: Age of a draft that no process writes any more [s].
_DAY = 86400.0
#: Windows has no such flag; it replaces no open file, and renames to free names only.
_WINDOWS = not hasattr(os, "O_NOFOLLOW")
#: What changes when a file is replaced or written: device, number, size, time of the last change.
Identity = tuple[int, ...]


class UnreadableError(StoreError):
    """The system does not let a file be read now, so nothing is known about what it holds."""

    def __init__(self, path: Path, error: Exception) -> None:
        super().__init__(f"{str(path)!r} cannot be read: {reason(error)}")


def identity_of(about: os.stat_result) -> Identity:
    """Return the identity of a file of this status."""
    return about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns


def identity(file: Path) -> Identity | None:
    """Return the identity of what has a name; None if nothing has it."""
    try:
        return identity_of(os.stat(file, follow_symlinks=False))
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError) as error:
        raise UnreadableError(file, error) from error


def reason(error: Exception) -> str:
    """Return the message of an error, without the buffer addresses and line breaks of HDF5."""
    number = error_number(error)
    return os.strerror(number) if number else (str(error) or type(error).__name__).splitlines()[0]


def error_number(error: Exception) -> int | None:
    """Return the number of an error of the system, which HDF5 only writes into its message."""
    match = re.search(r"errno = (\d+)", str(error))
    return getattr(error, "errno", None) or (int(match[1]) if match else None)


def check_target(path: Path, what: str, *, only_new: bool = False) -> Path:
    """Do as `check_path`, and refuse to replace a complete sweep, or with `only_new` any file."""
    target, end = check_path(path, what), b""
    if only_new and target.exists():
        raise StoreError(f"{path} exists, and is not replaced; remove it, or rename it")
    with suppress(OSError), target.open("rb") as file:
        file.seek(max(0, os.fstat(file.fileno()).st_size - len(TRAILER)))
        end = file.read()
    if end.startswith(TRAILER[:-2]):  # of any version
        raise StoreError(
            f"{path} is the file of a sweep and will not be replaced; give the {what} another name"
        )
    return target


def check_path(path: Path, what: str) -> Path:
    """Return the path of the file to write, for a link its target; refuse what cannot be written.

    `what` is the word for the file in messages, such as "output". In a folder where others may
    write, the kernel follows no link of theirs when a file is opened; a link that is resolved here
    is not opened.
    """
    name = shortened(repr(str(path)), 300)
    if problem := _unportable(path.name):
        raise StoreError(
            f"the {what} {name} cannot be used: on Windows no file {problem}; give the {what} "
            "another name"
        )
    target, mode = path, stat.S_IFREG  # as of a file that is made
    absolute(path)
    try:
        with suppress(FileNotFoundError):
            status = path.lstat()
            if stat.S_ISLNK(status.st_mode):
                if of_another_user(status):
                    raise StoreError(
                        f"{path} is a link of another user and is not followed; remove it"
                    )
                target = Path(os.path.realpath(path))
        if not target.parent.is_dir():
            link = "" if target is path else f", a link to {target},"
            raise StoreError(
                f"the folder {target.parent} of the {what} {path.name}{link} does not exist"
                f"{of_shell(path)}"
            )
        with suppress(FileNotFoundError):
            mode = os.stat(target).st_mode
    except (OSError, ValueError) as error:  # a name too long, a null byte, a loop of links
        raise StoreError(f"the {what} {name} cannot be used: {reason(error)}") from None
    if stat.S_ISDIR(mode):
        raise StoreError(f"{path} is a directory; give the {what} the name of a file")
    if not stat.S_ISREG(mode):
        raise StoreError(
            f"{path} is {not_regular(mode)} and will not be replaced; give the {what} another name"
        )
    folder = absolute(target.parent)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise StoreError(f"no file can be made in the folder {folder} of the {what} {path.name}")
    return target


def absolute(path: Path) -> Path:
    """Return a path that no change of the working folder changes; refuse one that was removed."""
    try:
        return path.absolute()
    except FileNotFoundError:
        raise StoreError("the working folder was removed; change to one that exists") from None
    except OSError as error:
        raise StoreError(f"the working folder cannot be used: {error.strerror}") from None


def _unportable(name: str) -> str:
    """Say why Windows cannot hold a file of this name, so that no copy of it fails there."""
    if odd := _NOT_IN_NAMES.search(name):
        return f"has the character {odd[0] if odd[0].isprintable() else repr(odd[0])} in its name"
    if name.endswith((".", " ")):
        return f"has a name that ends in a {'dot' if name.endswith('.') else 'space'}"
    device = _DEVICES.fullmatch(name)
    return f"can be named {device[1]}, with any ending" if device else ""


def not_regular(mode: int) -> str:
    """Return the words for something that is not a regular file."""
    kinds = {
        stat.S_IFDIR: "a directory",
        stat.S_IFIFO: "a FIFO",
        stat.S_IFSOCK: "a socket",
        stat.S_IFCHR: "a device",
        stat.S_IFBLK: "a device",
    }
    return f"{kinds.get(stat.S_IFMT(mode), 'something else')}, not a regular file,"


def of_another_user(status: os.stat_result) -> bool:
    """Whether a file belongs neither to this user nor to root; Windows has no owners."""
    return hasattr(os, "geteuid") and status.st_uid not in (os.geteuid(), 0)


@contextmanager
def writing(path: Path, what: str, *, only_new: bool = False) -> Iterator[BufferedRandom]:
    """Check a path as `check_target` does, and replace its file as `replacing` does.

    If `path` is a link, its target is replaced and the link stays. With `only_new` no file is
    replaced, not even one that was made meanwhile. The draft of a killed process is removed by a
    process that replaces the same file a day later. An OSError becomes Failed with the path.
    """
    check = partial(check_target, path, what, only_new=only_new)
    target = check()
    try:
        remove_leftovers(target, _DAY)
        with replacing(target, check, {} if only_new else None) as new:
            yield new
        sync_names(target.parent)
    except OSError as error:
        raise Failed(f"{path} cannot be written: {error.strerror or error}") from error


@contextmanager
def replacing(
    path: Path,
    refuse: Callable[[], object] = lambda: None,
    files: dict[Path, Identity] | None = None,
) -> Iterator[BufferedRandom]:
    """Yield a draft, a new and empty file open for writing and reading, which replaces `path`.

    When the draft is complete and on the disk, `refuse` may raise an error; then it does not
    replace the file. If the ``with`` block raises, the file stays as it was and the draft is
    removed. A loss of power may still lose the new name, until `sync_names` is called.

    Others may write to the folder, and put files and links in the place of the draft or of `path`,
    which must not be a link itself. Therefore the draft is never opened by its name again, and it
    stays open: the system could give the number of a closed file to theirs. With `files`, only the
    file that has this identity there is replaced, or a free name taken; the new identity is noted
    there. Only between the last look at the file and its replacement, one put there is lost.
    """
    new = draft_of(path)
    with new.open("x+b") as file:  # creates the file, so that no file of another user is opened
        status = os.fstat(file.fileno())
        try:
            yield file
            file.flush()
            os.fsync(file.fileno())
            refuse()
            if _WINDOWS:
                file.close()
            about = os.lstat(new)
            if not os.path.samestat(about, status):
                raise Failed(f"{new} was replaced by another program while it was written")
            if files is None:
                os.replace(new, path)
            else:
                _put(new, path, status, files.get(path))
                files[path] = identity_of(about)
        finally:
            if _WINDOWS:
                file.close()
            if has_name(new, status):
                new.unlink()


def _put(new: Path, path: Path, status: os.stat_result, before: Identity | None) -> None:
    """Give a draft the name of the file that was there before, or a free name, and no other."""
    if before and identity(path) == before:
        os.replace(new, path)
    else:
        _take(new, path)
    if not has_name(path, status):
        if has_name(new, os.lstat(path)):  # it was no draft that got the name
            path.unlink()
        raise Failed(f"{path} or its draft was replaced by another program")


def _take(new: Path, path: Path) -> None:
    """Give a file another name, which must be free, besides its own or, if need be, instead."""
    if not _WINDOWS:
        with suppress(OSError):  # not every file system has several names for a file
            return os.link(new, path, follow_symlinks=False)
    if os.path.lexists(path):
        raise Failed(
            f"{path} was written by another program meanwhile, and is not replaced; move it"
        )
    os.rename(new, path)


def has_name(path: Path, about: os.stat_result) -> bool:
    """Whether the file of this status has the name."""
    with suppress(FileNotFoundError):
        return os.path.samestat(about, os.lstat(path))
    return False


def draft_of(path: Path) -> Path:
    """Return the path of a new draft of a file; only its last digits are random."""
    crc = zlib.crc32(os.fsencode(path.name))
    return path.with_name(f".{path.name[:_REPEATED]}.{crc:08x}-{secrets.token_hex(4)}.new")


def sync_names(folder: Path) -> None:
    """Wait until the names in a folder are on the disk."""
    with suppress(PermissionError):  # Windows opens no folder
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        except OSError as error:
            if error.errno != errno.EINVAL:  # as of a file system that synchronizes none
                raise
        finally:
            os.close(descriptor)


def remove_leftovers(path: Path, age: float = 0.0) -> None:
    """Remove the drafts of `path` that were last written `age` [s] ago, and no other file.

    At age 0 these are all of them: the caller must hold the lock of `path`. Otherwise only the age
    tells a leftover, as a living writer may be on another machine or in another container.
    """
    start = draft_of(path).name.removesuffix(".new")[:-8]
    draft = re.compile(rf"{re.escape(start)}[0-9a-f]{{8}}\.new")
    for entry in path.parent.iterdir():
        if draft.fullmatch(entry.name):
            with suppress(OSError):  # another user's, or removed by another process
                if not age or entry.lstat().st_mtime < time.time() - age:
                    entry.unlink()
