"""Compiled code on disk: kept where no other user can write, and never needed.

What lies in a cache is executed. So its folder must belong to this user alone, and every file opens
with a checksum of the rest. A folder or a file that cannot be used costs a compilation, and one
warning where nothing can be kept; it never ends a program.

Numba's own cache writes beside the sources where its folder is unusable, and raises what a damaged
file or a full disk raises.
"""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import os
import pickle
import stat
import tempfile
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
import platformdirs
from numba.core.compiler import CompileResult
from numba.core.runtime import rtsys
from numba.core.serialize import dumps

from vibroimpact.jit.sources import name_of, syntax

_DIGEST = hashlib.sha256().digest_size


def _root() -> Path:
    config: Any = numba.config  # its settings are made at run time, unseen by a type checker
    return Path(config.CACHE_DIR or platformdirs.user_cache_dir("vibroimpact", appauthor=False))


def numerics_of(package: Path) -> str:
    """Return the name of all code of a package, and of numba's version.

    It is kept on disk by the bytes of the sources, since parsing them takes a fifth of a short run.
    """
    paths = sorted(package.rglob("*.py"))
    sources = {path.relative_to(package).as_posix(): path.read_bytes() for path in paths}
    as_given = hashlib.sha256(repr((numba.__version__, sources)).encode()).hexdigest()
    kept = _root() / "numerics" / as_given[:24]
    if (known := _read(kept)) is not None:
        return known.decode()
    name = name_of(sources, numba.__version__)
    with contextlib.suppress(OSError):
        _write(kept, name.encode())
    return name


def cache_folder() -> Path:
    """Return the folder of compiled code, which is named after the code that it was compiled from.

    A cache that looks only at the file that holds a function would serve a stale kernel after a
    helper in another file was edited; a name made of all sources cannot. The folder lies outside
    the package: pip would not remove such files on uninstall, and the folder left with them would
    shadow the next version.
    """
    return _root() / f"compiled-{NUMERICS}"


class CacheWarning(UserWarning):
    """Compiled code cannot be kept; the text is one line for the user."""


class CompiledCode:
    """The compiled forms of one function, in the interface that numba's dispatchers ask for.

    Parameters
    ----------
    function : callable
        The Python function.
    folder : Path
        Where the files are; it is made when the first is written.
    """

    def __init__(self, function: Callable, folder: Path) -> None:
        self.cache_path = str(folder)
        self._function = function
        self._folder = folder

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return the form for a signature, or None if there is none that can be used.

        Numba's own cache first refreshes `context`, which imports all that numba can compile, and
        SciPy: half the time of a short run. Code on disk needs one part of that:
        the memory of arrays.
        """
        key = self._key(signature, context.codegen())
        data = _read(self._path(key))
        if data is None:
            return None
        try:
            kept_key, kept = pickle.loads(data)
            if kept_key != key:
                return None
            rtsys.initialize(context)
            return CompileResult._rebuild(context, *kept)
        except Exception:  # of another version of Python, say
            return None

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep the form for a signature, or warn once that nothing can be kept."""
        if result.library.has_dynamic_globals or any(not part.can_cache for part in result.lifted):
            return
        key = self._key(signature, result.library.codegen)
        try:
            _write(self._path(key), dumps((key, result._reduce())))
        except OSError as error:
            _warn(self._folder, error.strerror or type(error).__name__)

    def flush(self) -> None:
        """Do nothing: recompiled code overwrites its file."""

    def _key(self, signature: Any, codegen: Any) -> tuple[Any, ...]:
        """Return what the compiled form depends on, beside the package that names the folder."""
        cells = tuple(cell.cell_contents for cell in self._function.__closure__ or ())
        source = syntax(Path(inspect.getfile(self._function)).read_bytes()).encode()
        parts = (source, self._function.__code__.co_code, dumps(cells) if cells else b"")
        digests = tuple(hashlib.sha256(part).hexdigest() for part in parts)
        return (signature, codegen.magic_tuple(), *digests)

    def _path(self, key: tuple[Any, ...]) -> Path:
        digest = hashlib.sha256(repr(key).encode()).hexdigest()[:24]
        return self._folder / f"{self._function.__name__}-{digest}"


def _make(folder: Path) -> None:
    """Make a folder of this user alone.

    Raises
    ------
    OSError
        If it cannot be made, or is there and unsafe.
    """
    if not folder.is_absolute():  # also "~/.cache", where there is no home
        raise OSError(0, "its path is not absolute")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    if reason := _unusable(folder):
        raise OSError(0, reason)


def _unusable(folder: Path) -> str | None:
    """Say why what lies in a folder must not be executed; None if it may be."""
    try:
        status = folder.lstat()
    except OSError as error:
        return error.strerror or type(error).__name__
    return _foreign(status) if stat.S_ISDIR(status.st_mode) else "it is not a folder"


def _foreign(status: os.stat_result) -> str | None:
    """Say why another user may have made something, or may change it; None if none may."""
    if not hasattr(os, "geteuid"):  # Windows has no owners; the folder is in the user's profile
        return None
    if status.st_uid != os.geteuid():
        return "it belongs to another user"
    return "other users may write to it" if status.st_mode & 0o022 else None


def _read(path: Path) -> bytes | None:
    """Return what `_write` wrote; None where it is not there, damaged, or of another user."""
    if _unusable(path.parent) is not None:
        return None
    try:
        status = path.lstat()
        # A FIFO would be waited for; nobody else can put one here after this look.
        if not stat.S_ISREG(status.st_mode) or _foreign(status) is not None:
            return None
        data = path.read_bytes()
    except OSError:
        return None
    intact = hashlib.sha256(data[_DIGEST:]).digest() == data[:_DIGEST]
    return data[_DIGEST:] if intact else None


def _write(path: Path, data: bytes) -> None:
    """Put a file in its place whole, beside other processes that do the same.

    Raises
    ------
    OSError
        If it cannot be written, or its folder is unsafe.
    """
    _make(path.parent)
    descriptor, draft = tempfile.mkstemp(dir=path.parent)
    try:
        with open(descriptor, "wb") as file:
            file.write(hashlib.sha256(data).digest() + data)
        os.replace(draft, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(draft)
        raise


@cache
def _warn(folder: Path, reason: str) -> None:
    """Warn, once in a process, that every process will compile anew."""
    warnings.warn(
        f"the compiled code cannot be kept in {folder} ({reason}), so that every command compiles "
        "it anew; set NUMBA_CACHE_DIR to a folder of your own with room",
        CacheWarning,
        stacklevel=2,
    )


#: Names the code that computes.
NUMERICS = numerics_of(Path(__file__).parents[1])
