"""Results that were found for a sweep, kept beside its file: ``OUT.h5.exact``.

It is a ZIP of arrays, which `numpy.load` reads, and may be removed at any time. Each result has a
key, which says what it was computed from and what was asked for.
"""

from __future__ import annotations

import io
import os
import re
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from sweeps.errors import Failed, StoreError
from sweeps.store.paths import open_regular
from sweeps.store.replacing import of_another_user, writing

#: Ending of the file, its first entry, which no other program writes, and most results in it.
KEPT = ".exact"
_KEYS = "vibroimpact_keys"
_MOST = 16
#: Valid contents, as far as the beginning shows: a ZIP of that first entry, possibly cut off; or
#: nothing or zeros, which a loss of power may leave.
_OWN = re.compile(rb"PK\x03\x04.{26}vibroimpact_keys\.npy|\0*\Z", re.DOTALL)

Arrays = Mapping[str, np.ndarray]


def kept_path(file: Path) -> Path:
    """Return the path of the results beside a file; for a link, beside its target."""
    target = file.resolve() if os.path.islink(file) else file
    return target.with_name(f"{target.name}{KEPT}")


def read_kept(file: Path, key: str) -> dict[str, np.ndarray] | None:
    """Return the arrays kept for a sweep file under a key, or None.

    A file of another user than this one and the owner of the sweep is not read.
    """
    found = (_entries(file) or {}).get(key)
    return None if found is None else dict(found)


def is_damaged(file: Path) -> bool:
    """Whether the results beside a sweep file were written by `keep` and cannot be read."""
    return _is_own(kept_path(file)) and _entries(file) is None


def keep(file: Path, key: str, arrays: Arrays, same_source: str) -> None:
    """Keep arrays under a key, with the others whose key has the text `same_source`.

    Raises StoreError or Failed if there is another file of that name, or none can be written.
    """
    path = kept_path(file)
    if path.exists() and not _is_own(path):
        raise StoreError(f"{path.name} is another file, and is left alone")
    held = (_entries(file) or {}).items()
    entries = {old: value for old, value in held if same_source in old}
    entries = {**entries, key: arrays}
    entries = dict(list(entries.items())[-_MOST:])
    image = io.BytesIO()
    flat: dict[str, Any] = {_KEYS: np.array(list(entries))}
    flat |= {
        f"{number}/{name}": values
        for number, part in enumerate(entries.values())
        for name, values in part.items()
    }
    np.savez(image, **flat)
    with writing(path, "file of exact orbits") as draft:
        draft.write(image.getbuffer())


def _is_own(path: Path) -> bool:
    """Whether a file was written by `keep`, as far as can be seen."""
    with suppress(OSError, StoreError, Failed):
        with open_regular(path) as file:
            return _OWN.match(file.read()) is not None
    return False


def _entries(file: Path) -> dict[str, Arrays] | None:
    """Return all kept arrays by their keys: none if there are none, None if they are damaged."""
    try:
        with open_regular(kept_path(file)) as opened:
            owner = os.fstat(opened.fileno())
            if of_another_user(owner) and owner.st_uid != file.stat().st_uid:
                return {}
            image = opened.read()
        with zipfile.ZipFile(io.BytesIO(image)) as zipped:
            if zipped.testzip() is not None:  # NumPy does not compare all checksums
                return None
        with np.load(io.BytesIO(image), allow_pickle=False) as held:
            entries: dict[str, dict[str, np.ndarray]] = {}
            for number, key in enumerate(held[_KEYS].tolist()):
                start = f"{number}/"
                entries[key] = {
                    name.removeprefix(start): held[name]
                    for name in held.files
                    if name.startswith(start)
                }
            return dict(entries)
    except Exception:  # a damaged archive raises errors of a dozen kinds
        return None
