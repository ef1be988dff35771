"""Private parts of numba that make the start and the kernel faster, and change no result.

``way.py`` decides whether they are used; otherwise this file is not imported. What each part is
worth, in processor time, with AVX-512:

- a function is optimised once, with all that it calls: the first run compiles in 60 % of the time;
- called functions are internal: exact impacts 8 % faster, chatter 13 %;
- functions are linked once, and passes that change nothing here are left out: a tenth less again;
- a function is compiled once, and not again for each constant among its arguments: an eighth less;
- code is read from disk without all that numba can compile: a run starts in 0.4 s, not in 0.65.
"""

from __future__ import annotations

import hashlib
import inspect
import pickle
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from llvmlite.binding import Linkage
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager
from numba.core.runtime import rtsys
from numba.core.serialize import dumps
from numba.core.types import unliteral

from vibroimpact.jit.cache import cache_folder, read, syntax, warn_once, write
from vibroimpact.jit.sharing import claimed, released, tell

#: Passes for what this project does not use: lifted loops, closures, raised exceptions that are
#: computed, literal loops, overloads to merge, array expressions; and for what only a reader needs.
_UNUSED_PASSES = {
    "WithLifting",
    "InlineClosureLikes",
    "RewriteDynamicRaises",
    "MakeFunctionToJitFunction",
    "FindLiterallyCalls",
    "LiteralUnroll",
    "LiteralPropagationSubPipelinePass",
    "InlineOverloads",
    "NopythonRewrites",
    "AnnotateTypes",
    "DumpParforDiagnostics",
}


def dispatcher(function: Callable, options: dict[str, Any]) -> Any:
    """Compile `function` together with all that it calls for Python, and alone for its callers."""
    whole: Any = numba.njit(function, pipeline_class=WholeCompiler, **options)
    whole._cache = CompiledCode(function, cache_folder("private"))
    whole.compile = _shared(whole.compile, whole._cache)

    alone: Any = {**options, "no_cpython_wrapper": True}

    @cache
    def merged() -> Any:
        return numba.njit(function, pipeline_class=_MergingCompiler, **alone)

    whole.get_call_template = lambda args, kws: merged().get_call_template(
        tuple(map(unliteral, args)), kws
    )
    whole.get_overload = lambda signature: merged().get_overload(signature)
    return whole


def _shared(compile_: Callable, code: CompiledCode) -> Callable:
    """Let go of the claim on the code when its compilation ends, however it ends."""

    def compiling(signature: Any) -> Any:
        try:
            return compile_(signature)
        finally:
            code.release()

    return compiling


class _MergedLibrary(JITCodeLibrary):
    """The code of a function for its compiled callers, which optimise it and generate machine code.

    By default numba does both for every function, together with all that it calls, so an innermost
    function is optimised eight times. Only a function that Python calls needs machine code. Without
    the others the first run compiles in half the time.
    """

    def finalize(self) -> None:
        """Let callers link this function, which stays without those that it calls."""
        for function in self._final_module.functions:
            if function.linkage == Linkage.external and not function.is_declaration:
                function.linkage = Linkage.linkonce_odr
        self._shared_module = self._final_module
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        return 0  # there is no machine code

    @property
    def codegen(self) -> Any:
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: only code that raises exceptions or calls Python needs an environment."""


class _WholeLibrary(JITCodeLibrary):
    """The code of a function that Python calls, together with all functions that it calls.

    No other library needs these functions. If they are marked as internal, LLVM passes them only
    those parts of their arguments that they use: of an array the address, not the seven numbers
    that describe it.
    """

    def finalize(self) -> None:
        """Link every function once, after its callers: LLVM leaves out what nothing calls yet."""
        called: dict[Any, None] = {}
        for library in self._linking_libraries:
            _add_callees(library, called)
        self._linking_libraries = list(reversed(called))
        super().finalize()

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if function.linkage == Linkage.linkonce_odr:
                function.linkage = Linkage.internal
        super()._optimize_final_module()


def _add_callees(library: Any, called: dict[Any, None]) -> None:
    """Add a library to `called`, after all that it calls."""
    if library not in called:
        if isinstance(library, _MergedLibrary):
            for callee in library._linking_libraries:
                _add_callees(callee, called)
        called[library] = None


class _LeanCompiler(Compiler):
    """Compiles with the passes that this project needs."""

    def define_pipelines(self) -> list[Any]:
        """Return numba's own passes, without those that change nothing here."""
        manager = PassManager("lean")
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state).passes
        manager.passes = [one for one in passes if one[0].__name__ not in _UNUSED_PASSES]
        manager.finalize()
        return [manager]


class _MergingCompiler(_LeanCompiler):
    """Compiles a function for its callers in compiled code."""

    def __init__(self, typing: Any, target: Any, library: None, *arguments: Any) -> None:
        super().__init__(typing, target, _MergedLibrary(target.codegen(), "merged"), *arguments)


class WholeCompiler(_LeanCompiler):
    """Compiles a function for Python."""

    def __init__(self, typing: Any, target: Any, library: None, *arguments: Any) -> None:
        whole = _WholeLibrary(target.codegen(), "whole")
        whole.enable_object_caching()
        super().__init__(typing, target, whole, *arguments)


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
        kept = self._loaded(signature, context)
        if kept is None:
            self._claim = claimed(self._path(self._key(signature, context.codegen())))
            kept = self._loaded(signature, context)
            tell("" if kept else "compiling, which takes some ten seconds, once on this machine")
        return kept

    def release(self) -> None:
        """Give up the form that this process has claimed, if any."""
        claim, self._claim = self._claim, None
        released(claim)
        tell("")

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
            kept_key, kept = pickle.loads(data)
            if kept_key != key:
                return None
            rtsys.initialize(context)
            return CompileResult._rebuild(context, *kept)
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
