"""Loads or compiles a function for each type of arguments, in place of numba's cache.

Like ``hooks.py``, which imports it, this file uses private parts of numba.
"""

from __future__ import annotations

import hashlib
import inspect
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba.core.compiler import CompileResult
from numba.core.runtime import rtsys
from numba.core.serialize import dumps

from vibroimpact.jit.cache import claimed, read, released, syntax, warn_once, write
from vibroimpact.jit.watching import COMPILING, tell


class CompiledCode:
    """The compiled forms of a Python function, with the interface of numba's dispatchers."""

    def __init__(self, function: Callable, folder: Path) -> None:
        self.cache_path = str(folder)
        self._function = function
        self._folder = folder
        self._claim: Any = None

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return the form for a signature, or None if no usable form is stored.

        If another process is compiling it, this one waits for it. Afterwards the form is this
        process's to compile, until `release`.
        """
        stored = self._loaded(signature, context)
        if stored is None:
            self._claim = claimed(self._path(self._key(signature, context.codegen())))
            stored = self._loaded(signature, context)
            if stored is None:
                context.refresh()
            tell("" if stored else COMPILING, self._function.__name__)
        return stored

    def release(self) -> None:
        """Give up the form that this process has claimed, if any."""
        claim, self._claim = self._claim, None
        released(claim)
        tell("")

    def releasing(self, compile_: Callable) -> Callable:
        """Let `compile_` give up the claim when it ends, however it ends."""

        def compiling(signature: Any) -> Any:
            try:
                return compile_(signature)
            finally:
                self.release()

        return compiling

    def _loaded(self, signature: Any, context: Any) -> Any:
        """Return the form for a signature, or None if no usable form is stored.

        Numba's own cache first refreshes `context`, which imports SciPy and all that numba can
        compile: half the time of a short run. Code on disk needs only the memory of arrays.
        """
        key = self._key(signature, context.codegen())
        data = read(self._path(key))
        if data is None:
            return None
        try:
            stored_key, stored = pickle.loads(data)
            if stored_key != key:
                return None
            rtsys.initialize(context)
            return CompileResult._rebuild(context, *stored)
        except MemoryError:  # to compile takes more of it
            raise
        except Exception as error:  # although the file is intact, and of this code and Python
            warn_once(self._folder, "read", f"{type(error).__name__}: {error}")
            return None

    def save_overload(self, signature: Any, result: Any) -> None:
        """Store the form for a signature, or warn once that nothing can be stored."""
        if result.library.has_dynamic_globals or any(not part.can_cache for part in result.lifted):
            return
        key = self._key(signature, result.library.codegen)
        try:
            write(self._path(key), dumps((key, result._reduce())))
        except OSError as error:
            warn_once(self._folder, "kept", error.strerror or type(error).__name__)
        self.release()

    def flush(self) -> None:
        """Do nothing: recompiled code overwrites its file."""

    def _key(self, signature: Any, codegen: Any) -> tuple[Any, ...]:
        """Return what the compiled form depends on, besides the package that names the folder."""
        cells = tuple(cell.cell_contents for cell in self._function.__closure__ or ())
        source = syntax(Path(inspect.getfile(self._function)).read_bytes()).encode()
        parts = (source, self._function.__code__.co_code, dumps(cells) if cells else b"")
        digests = tuple(hashlib.sha256(part).hexdigest() for part in parts)
        return (signature, codegen.magic_tuple(), *digests)

    def _path(self, key: tuple[Any, ...]) -> Path:
        digest = hashlib.sha256(repr(key).encode()).hexdigest()[:24]
        return self._folder / f"{self._function.__name__}-{digest}"
