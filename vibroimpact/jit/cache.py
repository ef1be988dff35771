"""Keeps compiled code on disk, named by a digest of its source, safe from other users.

Code in a cache is executed. So the folder of the cache must belong to this user alone, and every
file begins with a checksum of the rest. If a folder or file cannot be used, the code is compiled
again; if nothing can be stored, there is one warning. The cache never ends a program.

Of processes that need the same code at once, one compiles it, and the others wait. Watchers are
told of both.
"""

from __future__ import annotations

import ast
import contextlib
import errno
import hashlib
import os
import stat
import time
import warnings
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numba
import platformdirs

from vibroimpact.jit.watching import tell

#: The kinds of nodes that may have a docstring.
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
_DIGEST = hashlib.sha256().digest_size
#: Windows has no owners; there the cache is in the profile of the user.
_OWNERS = hasattr(os, "geteuid") and os.open in os.supports_dir_fd
#: A link is not followed, and for the writer of a pipe nothing waits.
_AS_IT_IS = (os.O_NOFOLLOW | os.O_NONBLOCK) if _OWNERS else 0

#: Longest wait for another process [s], many times that of a compilation: it may be stopped.
LONGEST_WAIT = 120.0
_INTERVAL = 0.05  # between two attempts [s]


def root() -> Path:
    """Return the folder of all that is kept from one process to the next."""
    config: Any = numba.config  # its settings are made at run time, unseen by a type checker
    if config.CACHE_DIR:
        return Path(config.CACHE_DIR)
    try:
        return Path(platformdirs.user_cache_dir("vibroimpact", appauthor=False))
    except RuntimeError:  # there is no home folder; older versions return such a path
        return Path("~/.cache/vibroimpact")


def syntax(source: bytes) -> str:
    """Return the syntax tree of a source as text, without docstrings and positions.

    Unlike the text of ``ast.dump``, it does not depend on the version of Python: newer versions add
    fields, so empty fields are left out.
    """
    return _dump(ast.parse(source))


def _dump(part: object) -> str:
    """Return the text of a node, a list of nodes or a constant."""
    if isinstance(part, list):
        return f"[{', '.join(map(_dump, part))}]"
    if not isinstance(part, ast.AST):
        return repr(part)
    fields = dict(ast.iter_fields(part))
    if isinstance(part, _DOCUMENTED) and ast.get_docstring(part, clean=False) is not None:
        fields["body"] = part.body[1:]
    shown = (f"{name}={_dump(value)}" for name, value in fields.items() if value not in (None, []))
    return f"{type(part).__name__}({', '.join(shown)})"


def name_of(sources: Mapping[str, bytes], *others: str) -> str:
    """Return a digest of the code of `sources`, a mapping from path to source, and of `others`."""
    trees = {path: syntax(source) for path, source in sources.items()}
    return hashlib.sha256(repr((others, trees)).encode()).hexdigest()[:16]


def numerics_of(package: Path) -> str:
    """Return the digest of all code of a package, and of numba's version."""
    paths = sorted(package.rglob("*.py"))
    sources = {path.relative_to(package).as_posix(): path.read_bytes() for path in paths}
    # To parse the sources takes a fifth of a short run, so it is done once for the same bytes.
    digest = hashlib.sha256(repr((numba.__version__, sources)).encode()).hexdigest()
    kept = root() / "numerics" / digest[:24]
    if (known := read(kept)) is not None:
        return known.decode()
    name = name_of(sources, numba.__version__)
    with contextlib.suppress(OSError):
        write(kept, name.encode())
    return name


def cache_folder(way: str) -> Path:
    """Return the folder of compiled code, named after its source and the way of compiling it.

    A cache that looks only at the file of a function would return a stale kernel after an edit of a
    helper in another file; a name made from all sources cannot. The folder lies outside the
    package: on uninstall pip would leave such files, and their folder would shadow the next
    version.
    """
    return root() / f"compiled-{NUMERICS}-{way}"


class CacheWarning(UserWarning):
    """Compiled code cannot be stored; the text is one line for the user."""


def make_folder(folder: Path) -> None:
    """Make a folder that belongs to this user alone; OSError if it cannot be made, or is unsafe."""
    if not folder.is_absolute():  # for example "~/.cache" if there is no home folder
        raise OSError(0, "its path is not absolute")
    folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    with _opened(folder):
        pass


@contextlib.contextmanager
def _opened(folder: Path) -> Iterator[tuple[Path, int | None]]:
    """Open a folder that only this user may change; OSError if others may.

    Another user may exchange what a name stands for after any look at it. So the open folder itself
    is judged, and its files are reached through it: by the path and the descriptor of its folder
    that this yields.
    """
    if not _OWNERS:
        if not folder.is_dir():
            raise OSError(0, "it is not a folder")
        yield folder, None
        return
    with contextlib.ExitStack() as stack:
        above = os.open(folder.parent, os.O_DIRECTORY)
        stack.callback(os.close, above)
        mode = os.fstat(above).st_mode
        if mode & 0o022 and not mode & stat.S_ISVTX:
            raise OSError(0, "other users may write to the folder above it, and replace it")
        try:
            here = os.open(folder.name, os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=above)
        except OSError as error:
            linked = error.errno in (errno.ENOTDIR, errno.ELOOP)
            raise OSError(0, "it is not a folder") if linked else error from None
        stack.callback(os.close, here)
        if reason := _foreign(os.fstat(here)):
            raise OSError(0, reason)
        yield Path(), here


def _foreign(status: os.stat_result) -> str | None:
    """Return why another user may have made or may change something; None if nobody else may."""
    if not _OWNERS:
        return None
    if status.st_uid != os.geteuid():
        return "it belongs to another user"
    return "other users may write to it" if status.st_mode & 0o022 else None


def read(path: Path) -> bytes | None:
    """Return the data that `write` stored; None if missing, damaged, or open to other users."""
    with contextlib.suppress(OSError), _opened(path.parent) as (folder, at):

        def opened(name: str, flags: int) -> int:
            return os.open(name, flags | _AS_IT_IS, dir_fd=at)

        with open(folder / path.name, "rb", opener=opened) as file:
            status = os.fstat(file.fileno())
            if stat.S_ISREG(status.st_mode) and _foreign(status) is None:
                data = file.read()
                if hashlib.sha256(data[_DIGEST:]).digest() == data[:_DIGEST]:
                    return data[_DIGEST:]
    return None


def write(path: Path, data: bytes, most: int | None = None) -> None:
    """Write a file whole or not at all, safe beside other processes; OSError if that fails.

    If the folder then has more than `most` files, the oldest go.
    """
    make_folder(path.parent)
    with _opened(path.parent) as (folder, at):
        draft = folder / os.urandom(8).hex()

        def made(name: str, flags: int) -> int:
            return os.open(name, flags, 0o600, dir_fd=at)

        try:
            with open(draft, "xb", opener=made) as file:
                file.write(hashlib.sha256(data).digest() + data)
            os.replace(draft, folder / path.name, src_dir_fd=at, dst_dir_fd=at)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(draft, dir_fd=at)
            raise
        if most is not None:
            with contextlib.suppress(OSError):
                files = [folder / name for name in os.listdir(folder if at is None else at)]
                files.sort(key=lambda path: os.stat(path, dir_fd=at).st_mtime)
                for oldest in files[:-most]:
                    os.unlink(oldest, dir_fd=at)


@cache
def warn_once(folder: Path, what: str, reason: str) -> None:
    """Warn, once per process, that every process will compile again."""
    warnings.warn(
        f"the compiled code cannot be {what} in {folder} ({reason}), so that every command "
        "compiles it anew; set NUMBA_CACHE_DIR to a folder of your own with room",
        CacheWarning,
        stacklevel=2,
    )


def claimed(path: Path) -> Any:
    """Wait until no other process compiles the code of the file `path`; return a lock.

    It is None if there is no lock to be had, or only after too long a wait. Then this process works
    without one: the same code is compiled twice, and the file is written whole in any case.
    """
    from filelock import FileLock, Timeout  # takes longer to import than code to load

    last = time.monotonic() + LONGEST_WAIT
    try:
        make_folder(path.parent)
        lock = FileLock(path.with_suffix(".lock"))
        while True:
            with contextlib.suppress(Timeout):
                return lock.acquire(blocking=False).lock
            if time.monotonic() > last:
                return None
            tell("waiting for another process, which compiles the same")
            time.sleep(_INTERVAL)
    except (OSError, NotImplementedError):
        return None


def released(lock: Any) -> None:
    """Let other processes go on."""
    if lock is not None:
        with contextlib.suppress(OSError):  # on Windows an open file cannot be removed
            Path(lock.lock_file).unlink(missing_ok=True)
        lock.release()


#: Digest of the code that computes.
NUMERICS = numerics_of(Path(__file__).parents[1])
