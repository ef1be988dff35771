"""Replace a file by a new one when that is complete."""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield the name of a new, empty file, which replaces `path` at the end.

    Where the block raises, `path` is as it was, and the new file is removed.
    """
    new = path.with_name(f".{path.name}.{secrets.token_hex(4)}.new")
    os.close(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o666))
    try:
        yield new
        os.replace(new, path)
        _sync_folder(path)
    finally:
        new.unlink(missing_ok=True)


def remove_leftovers(path: Path) -> None:
    """Remove the new files that killed writers of `path` have left, and none of another name."""
    leftover = re.compile(rf"\.{re.escape(path.name)}\.[0-9a-f]{{8}}\.new")
    for entry in path.parent.iterdir():
        if leftover.fullmatch(entry.name):
            entry.unlink(missing_ok=True)


def _sync_folder(path: Path) -> None:
    """Make the names in the folder of `path` last."""
    descriptor = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
