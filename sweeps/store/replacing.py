"""Replace a file by a new one once the new one is complete, and refuse what is not to be replaced.

Every file that the program writes as a whole is written here.
"""

from __future__ import annotations

import os
import re
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sweeps.errors import Failed, StoreError
from sweeps.text import shortened

#: Letters of a file's name that the name of a draft repeats, so that it is not too long.
_REPEATED = 50


def check_target(path: Path, what: str) -> bool:
    """Refuse a path that no file can be written to; return whether a file is there already.

    Parameters
    ----------
    path : Path
    what : str
        What is to be written, in a word for the message.

    Raises
    ------
    StoreError
        If the path is in no folder, is too long, or is anything else than a regular file, such as
        a directory, a FIFO or a device; or is a link that another user has put there.
    """
    try:
        target = _followed(path)
        if not target.parent.is_dir():
            link = "" if target is path else f", a link to {target},"
            raise StoreError(
                f"the folder {target.parent} of the {what} {path.name}{link} does not exist"
            )
        mode = os.stat(target).st_mode
    except FileNotFoundError:
        return False
    except (OSError, ValueError) as error:  # too long a name, a null byte, links in a loop
        reason = getattr(error, "strerror", None) or error
        name = shortened(repr(str(path)), 300)
        raise StoreError(f"the {what} {name} cannot be used: {reason}") from None
    if stat.S_ISDIR(mode):
        raise StoreError(f"{path} is a directory; give the {what} the name of a file")
    if not stat.S_ISREG(mode):
        raise StoreError(
            f"{path} is {kind(mode)} and will not be replaced; give the {what} another name"
        )
    return True


def kind(mode: int) -> str:
    """Name what is no regular file."""
    if stat.S_ISDIR(mode):
        return "a directory"
    kinds = {
        stat.S_IFIFO: "a FIFO",
        stat.S_IFSOCK: "a socket",
        stat.S_IFCHR: "a device",
        stat.S_IFBLK: "a device",
    }
    return f"{kinds.get(stat.S_IFMT(mode), 'something else')}, not a regular file,"


def _followed(path: Path) -> Path:
    """Return the path itself or, if it is a link of this user, the path that the link leads to.

    Where others may write, the kernel follows no link of theirs when it opens a file. A link that
    is resolved here is not opened, so its owner has to be compared.
    """
    try:
        status = path.lstat()
    except FileNotFoundError:
        return path
    if not stat.S_ISLNK(status.st_mode):
        return path
    if hasattr(os, "geteuid") and status.st_uid not in (os.geteuid(), 0):  # Windows has no owners
        raise StoreError(f"{path} is a link of another user and is not followed; remove it")
    return Path(os.path.realpath(path))


@contextmanager
def writing(path: Path, what: str) -> Iterator[Path]:
    """Check a path, and replace it as `replacing` does; a failure names it.

    Raises
    ------
    StoreError
        As from `check_target`.
    Failed
        If the ``with`` block or the replacement raises OSError.
    """
    check_target(path, what)
    try:
        with replacing(path) as new:
            yield new
    except OSError as error:
        raise Failed(f"{path} cannot be written: {error.strerror or error}") from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield the name of a new, empty file, a draft, which replaces `path` at the end.

    A link at `path` stays, and the file that it leads to is replaced. If the ``with`` block raises,
    that file stays as it was, and the draft is removed. A draft that a killed process has left is
    removed by the next that replaces the same file.
    """
    target = _followed(path)
    remove_leftovers(target)
    name = f".{target.name[:_REPEATED]}.{os.getpid()}-{secrets.token_hex(4)}.new"
    new = target.with_name(name)
    new.open("xb").close()  # a new name: nothing that another user has put there is opened
    try:
        yield new
        with new.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(new, target)
        _sync_names(target.parent)
    finally:
        new.unlink(missing_ok=True)


def _sync_names(folder: Path) -> None:
    """Wait until the names in a folder are on the disk; Windows, which opens no folder, does so."""
    with suppress(PermissionError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def remove_leftovers(path: Path) -> None:
    """Remove the drafts of `path` whose processes were killed, and no other file."""
    draft = re.compile(rf"\.{re.escape(path.name[:_REPEATED])}\.(\d+)-[0-9a-f]{{8}}\.new")
    for entry in path.parent.iterdir():
        if match := draft.fullmatch(entry.name):
            with suppress(OSError):  # of another user, or removed by another process
                if _ended(int(match[1]), entry.lstat().st_mtime):
                    entry.unlink()


def _ended(process: int, time: float) -> bool:
    """Whether a process that ran at a time [s] has ended; its number may be that of a newer one."""
    import psutil  # whose import takes a while, and there is seldom a draft

    try:
        began: float = psutil.Process(process).create_time()
    except psutil.NoSuchProcess:
        return True
    except psutil.Error:  # of another user, and hidden
        return False
    return began > time
