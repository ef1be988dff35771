"""Compiled code on disk: kept where no other user can write, and never needed.

What lies in a cache is executed. So its folder must belong to this user alone, and every file opens
with a checksum of the rest. A folder or a file that cannot be used costs a compilation, and one
warning where nothing can be kept; it never ends a program.
"""

from __future__ import annotations

import ast
import contextlib
import hashlib
import os
import stat
import tempfile
import warnings
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numba
import platformdirs

#: What has a docstring.
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
_DIGEST = hashlib.sha256().digest_size


def _root() -> Path:
    config: Any = numba.config  # its settings are made at run time, unseen by a type checker
    return Path(config.CACHE_DIR or platformdirs.user_cache_dir("vibroimpact", appauthor=False))


def syntax(source: bytes) -> str:
    """Return the syntax tree of a source in words, without docstrings and places.

    Empty fields are left out, since newer versions of Python add some: so the text does not depend
    on the version, as that of ``ast.dump`` does.
    """
    return _words(ast.parse(source))


def _words(part: object) -> str:
    """Return a node, a list of nodes or a constant in words."""
    if isinstance(part, list):
        return f"[{', '.join(map(_words, part))}]"
    if not isinstance(part, ast.AST):
        return repr(part)
    fields = dict(ast.iter_fields(part))
    if isinstance(part, _DOCUMENTED) and ast.get_docstring(part, clean=False) is not None:
        fields["body"] = part.body[1:]
    shown = (f"{name}={_words(value)}" for name, value in fields.items() if value not in (None, []))
    return f"{type(part).__name__}({', '.join(shown)})"


def name_of(sources: Mapping[str, bytes], *others: str) -> str:
    """Return a digest of the code of `sources`, by their paths, and of the names of `others`."""
    trees = {path: syntax(source) for path, source in sources.items()}
    return hashlib.sha256(repr((others, trees)).encode()).hexdigest()[:16]


def numerics_of(package: Path) -> str:
    """Return the name of all code of a package, and of numba's version.

    It is kept on disk by the bytes of the sources, since parsing them takes a fifth of a short run.
    """
    paths = sorted(package.rglob("*.py"))
    sources = {path.relative_to(package).as_posix(): path.read_bytes() for path in paths}
    digest = hashlib.sha256(repr((numba.__version__, sources)).encode()).hexdigest()
    kept = _root() / "numerics" / digest[:24]
    if (known := read(kept)) is not None:
        return known.decode()
    name = name_of(sources, numba.__version__)
    with contextlib.suppress(OSError):
        write(kept, name.encode())
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


def make_folder(folder: Path) -> None:
    """Make a folder of this user alone; OSError if it cannot be, or is there and unsafe."""
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


def read(path: Path) -> bytes | None:
    """Return what `write` wrote; None where it is not there, damaged, or of another user."""
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


def write(path: Path, data: bytes) -> None:
    """Put a file in its place whole, beside other processes; OSError if it cannot be written."""
    make_folder(path.parent)
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
def warn_once(folder: Path, what: str, reason: str) -> None:
    """Warn, once in a process, that every process will compile anew."""
    warnings.warn(
        f"the compiled code cannot be {what} in {folder} ({reason}), so that every command "
        "compiles it anew; set NUMBA_CACHE_DIR to a folder of your own with room",
        CacheWarning,
        stacklevel=2,
    )


#: Names the code that computes.
NUMERICS = numerics_of(Path(__file__).parents[1])
