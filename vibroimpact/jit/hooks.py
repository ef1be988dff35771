"""Private parts of numba that make the start and the kernel faster.

``way.py`` decides whether they are used; otherwise this file is not imported. What each part is
worth, in processor time, with AVX-512:

- a function is optimised once, with all that it calls: the first run compiles in 60 % of the time;
- called functions are internal: exact impacts 8 % faster, chatter 13 %;
- functions are linked once, and passes that change nothing here are left out: a tenth less again;
- a function is compiled once, and not again for each constant among its arguments: an eighth less;
- the types of operators, indices, max and min are found once, and passes are not timed: a sixth
  less;
- so are those of attributes, and lifetimes that nothing reads are not found: about a tenth less;
- code is read from disk without all that numba can compile (``overloads.py``): a run starts in
  0.4 s, not in 0.65.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import cache
from typing import Any

import numba
from llvmlite.binding import Linkage, parse_assembly
from numba.core.cgutils import normalize_ir_text
from numba.core.codegen import CodeLibrary, JITCodeLibrary
from numba.core.compiler import Compiler, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager, _pass_registry
from numba.core.cpu import CPUContext
from numba.core.errors import TypingError
from numba.core.event import trigger_event
from numba.core.ir_utils import build_definitions, check_and_legalize_ir
from numba.core.ssa import reconstruct_ssa
from numba.core.transforms import canonicalize_cfg
from numba.core.typed_passes import PreLowerStripPhis
from numba.core.types import Function, unliteral
from numba.core.typing import Context

from vibroimpact.jit.cache import cache_folder
from vibroimpact.jit.overloads import CompiledCode

#: Passes for what this project does not use: generators, lifted loops, closures, raised exceptions
#: that are computed, literal loops, overloads to merge, array expressions; and for what only a
#: reader needs.
_UNUSED_PASSES = {
    "IRProcessing",
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
_PIPELINES: list[Any] = []  # made once


def dispatcher(function: Callable, options: dict[str, Any]) -> Any:
    """Compile `function` together with all that it calls for Python, and alone for its callers."""
    whole: Any = numba.njit(function, pipeline_class=WholeCompiler, **options)
    whole._cache = CompiledCode(function, cache_folder("private"))
    whole.compile = whole._cache.releasing(whole.compile)

    alone: Any = {**options, "no_cpython_wrapper": True}

    @cache
    def merged() -> Any:
        made: Any = numba.njit(function, pipeline_class=_MergingCompiler, **alone)

        def compile_(signature: Any) -> None:
            """Compile as numba does, without its timers: each would hear all calls of LLVM."""
            if signature not in made.overloads:
                made.add_overload(made._compiler.compile(signature, None))

        made.compile = compile_
        return made

    whole.get_call_template = lambda args, kws: merged().get_call_template(
        tuple(map(unliteral, args)), kws
    )
    whole.get_overload = lambda signature: merged().get_overload(signature)
    return whole


class _MergedLibrary(JITCodeLibrary):
    """The code of a function for its compiled callers, which optimise it and generate machine code.

    By default numba does both for every function, together with all that it calls, so an innermost
    function is optimised eight times. Only a function that Python calls needs machine code. Without
    the others the first run compiles in half the time. Until then the code is a text.
    """

    def __init__(self, codegen: Any, name: str) -> None:
        CodeLibrary.__init__(self, codegen, name)
        self._linking_libraries: list[Any] = []

    def add_ir_module(self, ir_module: Any) -> None:
        """Keep the text, which several callers may link."""
        for function in ir_module.functions:
            if not (function.is_declaration or function.linkage):
                function.linkage = "linkonce_odr"
        self.text = normalize_ir_text(str(ir_module))

    def add_linking_library(self, library: Any) -> None:
        self._linking_libraries.append(library)

    def finalize(self) -> None:
        """Let callers link this function, which stays without those that it calls."""
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

    def _optimize_functions(self, ll_module: Any) -> None:
        """Do nothing: all functions are optimised once, together."""
        ll_module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        """Link every function once, after its callers: LLVM leaves out what nothing calls yet."""
        called: dict[Any, None] = {}
        for library in self._linking_libraries:
            _add_callees(library, called)
        self._linking_libraries = []
        for library in reversed(called):
            if isinstance(library, _MergedLibrary):
                module = parse_assembly(library.text)
                self._optimize_functions(module)
                self._final_module.link_in(module)
            else:
                self._linking_libraries.append(library)
        super().finalize()

    def _get_module_for_linking(self) -> Any:
        """Return only names, for the file of the machine code: no library links this one."""
        module, hidden = self._final_module, (Linkage.internal, Linkage.private)
        known = [*module.functions, *module.global_variables]
        names = [one.name for one in known if not one.is_declaration and one.linkage not in hidden]
        return parse_assembly("\n".join(f'@"{name}" = global i8 0' for name in names))

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if function.linkage == Linkage.linkonce_odr:
                function.linkage = Linkage.internal
        if not hasattr(self._codegen, "_pass_builder"):  # before numba 0.62
            super()._optimize_final_module()
            return
        manager, builder = self._codegen._module_pass_manager()
        manager.run(self._final_module, builder)


def _add_callees(library: Any, called: dict[Any, None]) -> None:
    """Add a library to `called`, after all that it calls."""
    if library not in called:
        if isinstance(library, _MergedLibrary):
            for callee in library._linking_libraries:
                _add_callees(callee, called)
        called[library] = None


#: Functions that are called often with the same types.
_KNOWN = {one for one in vars(operator).values() if callable(one)} | {bool, max, min, range}


@cache
def _remembering(function: Any) -> Any:
    """Return the type of a function as it is, except that it finds each of its signatures once."""
    ours: Any = object.__new__(Function)
    ours.__dict__.update(function.__dict__)
    known: dict[Any, Any] = {}

    def get_call_type(context: Any, args: Any, kws: Any) -> Any:
        key = tuple(args), tuple(kws.items())  # its hash takes time
        found = known.get(key)
        if found is None:
            try:
                found = function.get_call_type(context, args, kws)
            except TypingError as error:  # numba tries constants first, and mostly in vain
                found = error
            known[key] = found
        if isinstance(found, TypingError):
            raise found.with_traceback(None)
        return found

    ours.get_call_type = get_call_type
    return ours


@cache
def _ours(kind: Any, theirs: Any) -> Any:
    """Return the one object of a kind of this file that stands for an object of numba."""
    return kind(theirs)


_ATTRIBUTES: dict[tuple[Any, str], Any] = {}


class _Typing(Context):
    """Numba's knowledge of types; its functions and attributes are found once for each type."""

    def __init__(self, context: Any) -> None:
        self.__dict__ = context.__dict__  # what one of them learns, the other knows

    def refresh(self) -> None:
        """Do nothing: `CompiledCode` has looked for new declarations."""

    def resolve_value_type(self, value: Any) -> Any:
        found = super().resolve_value_type(value)
        known = type(found) is Function and found.typing_key in _KNOWN
        return _remembering(found) if known else found

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        if func is operator.getitem:  # for an index, numba does not ask for its type first
            func = self.resolve_value_type(func)
        return super().resolve_function_type(func, args, kws)

    def find_matching_getattr_template(self, typ: Any, attr: str) -> Any:
        if (found := _ATTRIBUTES.get((typ, attr))) is None:
            found = _ATTRIBUTES[typ, attr] = super().find_matching_getattr_template(typ, attr)
        return found


class _Target(CPUContext):
    """Numba's knowledge of the processor, with `_Typing`; it remembers the sizes of types."""

    def __init__(self, context: Any) -> None:
        self.__dict__ = context.__dict__

    @property
    def typing_context(self) -> Any:
        return _ours(_Typing, self.__dict__["typing_context"])

    def refresh(self) -> None:
        """Do nothing: `CompiledCode` has looked for new declarations."""

    def get_abi_sizeof(self, type_: Any) -> Any:
        return _size(self._internal_codegen, type_)  # numba lets LLVM parse a module for it


@cache
def _size(codegen: Any, type_: Any) -> Any:
    """Return the size of a type in memory."""
    return type_.get_abi_size(codegen.target_data)


def _to_single_assignments(state: Any) -> None:
    """Do what ``ReconstructSSA`` does, without the lifetimes of variables, which nothing reads."""
    state.func_ir = reconstruct_ssa(state.func_ir)
    state.func_ir._definitions = build_definitions(state.func_ir.blocks)


def _strip_phis(state: Any) -> None:
    """Do what ``PreLowerStripPhis`` does, without the lifetimes, which the next pass finds anew."""
    state.func_ir = PreLowerStripPhis()._strip_phi_nodes(state.func_ir)
    state.func_ir._definitions = build_definitions(state.func_ir.blocks)


def _legalize(state: Any) -> None:
    """Do what ``IRLegalization`` does: mark where variables end, if references are counted."""
    if state.flags.nrt:
        check_and_legalize_ir(state.func_ir, flags=state.flags)
    else:
        state.func_ir.generator_info = None


_IN_PLACE_OF = {
    "ReconstructSSA": _to_single_assignments,
    "PreLowerStripPhis": _strip_phis,
    "IRLegalization": _legalize,
}


class _LeanManager(PassManager):
    """Runs passes without checks between them, and without numba's timers and descriptions."""

    def run(self, state: Any) -> None:
        for one, _ in self.passes:
            kept = _pass_registry.get(one)
            kept.pass_inst.analysis = self._analysis
            told = {"name": one.name(), "qualname": state.func_id.func_qualname}
            with trigger_event("numba:run_pass", data=told):
                _IN_PLACE_OF.get(one.__name__, kept.pass_inst.run_pass)(state)
            if kept.mutates_CFG:
                state.func_ir.blocks = canonicalize_cfg(state.func_ir.blocks)


class _LeanCompiler(Compiler):
    """Compiles with the passes that this project needs."""

    def __init__(
        self, typing: Any, target: Any, library: Any, args: Any, result: Any, flags: Any, types: Any
    ) -> None:
        typing, target = _ours(_Typing, typing), _ours(_Target, target)
        super().__init__(typing, target, library, args, result, flags, types)

    def define_pipelines(self) -> list[Any]:
        """Return numba's own passes, without those that change nothing here."""
        if not _PIPELINES:
            manager = _LeanManager("lean")
            passes = DefaultPassBuilder.define_nopython_pipeline(self.state).passes
            manager.passes = [one for one in passes if one[0].__name__ not in _UNUSED_PASSES]
            manager.finalize()
            _PIPELINES.append(manager)
        return _PIPELINES


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
