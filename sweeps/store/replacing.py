"""Replace a file by a new one once the new one is complete."""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sweeps.store.ledger import opened


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield the name of a new, empty file, which replaces `path` at the end.

    Links in `path` must be resolved: a link at `path` would itself be replaced, not its target. If
    the ``with`` block raises, `path` stays as it was, and the new file is removed.
    """
    new = path.with_name(f".{path.name}.{secrets.token_hex(4)}.new")
    with opened(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW):
        pass
    try:
        yield new
        os.replace(new, path)
        with opened(path.parent, os.O_RDONLY) as folder:
            os.fsync(folder)  # so that the names in it last
    finally:
        new.unlink(missing_ok=True)


def remove_leftovers(path: Path) -> None:
    """Remove the new files that killed writers of `path` have left, and none of another name."""
    leftover = re.compile(rf"\.{re.escape(path.name)}\.[0-9a-f]{{8}}\.new")
    for entry in path.parent.iterdir():
        if leftover.fullmatch(entry.name):
            entry.unlink(missing_ok=True)
