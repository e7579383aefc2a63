"""How kernels call kernels: each is turned into machine code where Python calls it, and only there.

On its own numba optimises a function and turns it into machine code before it links it to those
that call it, at every level of calls anew. Here a function that others call gives them its
intermediate code alone (Part), function by function simplified, and the whole of what an entry
calls is optimised once.

A shared kernel is large and called from several entries. It is not linked to them: they call its
machine code by a symbol (Shared). The symbol's name is the same in every run, and its address is
made known before code that uses it is loaded, also from the cache: what machine code needs is
stored with it (stored.py). Until then other processes may compile it (crew.py): those that call it
need only what it returns, which is declared.
"""

from __future__ import annotations

import hashlib
import importlib
import itertools
from functools import cache
from typing import Any, NamedTuple, get_type_hints

from llvmlite import binding
from numba.core import sigutils, types, typing
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase
from numba.core.compiler_lock import global_compiler_lock
from numba.core.funcdesc import ExternalFunctionDescriptor
from numba.core.imputils import user_function
from numba.core.registry import CPUDispatcher

from featherfx.jit.compile_workers import Need, crew, is_helper
from featherfx.jit.entry import WRAPPER, EntryLowering
from featherfx.jit.lowering import KernelLowering, pipeline_of
from featherfx.jit.plain import OPTIONS as PLAIN_OPTIONS
from featherfx.jit.struct_pointer import HeldType, held, keep, room
from featherfx.jit.type_text import text_of_types

Types = tuple[Any, ...]
# untyped: dispatchers bind like methods, which their attributes in a class are not meant to
Dispatcher: Any = CPUDispatcher


# kernels allocate nothing, so counting references to arrays would only cost time
OPTIONS = PLAIN_OPTIONS | {"nopython": True, "_nrt": False, "no_cfunc_wrapper": True}
PART_OPTIONS = OPTIONS | {"no_cpython_wrapper": True}
# parts are finished after those that they call
_NUMBERS = itertools.count()
# Loops along barbs have 4 to 16 turns: processors with vectors of eight numbers are better off with
# four, for there is less of a rest that is done one by one.
VECTORS = '"prefer-vector-width"="256"'


class Library(JITCodeLibrary):
    """Functions that LLVM vectorises as short loops want it."""

    def add_ir_module(self, ir_module: Any) -> None:
        for function in ir_module.functions:
            set.add(function.attributes, VECTORS)  # not one of those that llvmlite knows
        super().add_ir_module(ir_module)


class PartLibrary(Library):
    """Intermediate code of one function, for others to link; no machine code is made of it."""

    def finalize(self) -> None:
        self._raise_if_finalized()
        self._final_module.verify()
        self._finalized = True
        self.number = next(_NUMBERS)

    def closure(self) -> list[Any]:
        """This library and all that it needs, each once."""
        return list(dict.fromkeys([self, *self._linking_libraries]))


class EntryLibrary(Library):
    """Machine code of an entry."""

    def add_ir_module(self, ir_module: Any) -> None:
        # a thousand fields of arrays, each read once in a call: nothing to optimise
        for function in ir_module.functions if ir_module.name == WRAPPER else ():
            if not function.is_declaration:
                function.attributes.add("noinline")
                function.attributes.add("optnone")
        super().add_ir_module(ir_module)

    def finalize(self) -> None:
        # LLVM leaves out what nothing calls yet when it is linked, so callers come first. A part
        # may list what its own simplified code no longer calls, so the order of lists will not do.
        self._linking_libraries.sort(key=lambda each: -getattr(each, "number", -1))
        super().finalize()

    def _finalize_final_module(self) -> None:
        for need in needs_of(self):
            load(need)
        super()._finalize_final_module()


class EntryCompiler(CompilerBase):
    """Numba's own way, with parts linked in their order."""

    def define_pipelines(self) -> list[Any]:
        state = self.state
        state.library = EntryLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return [pipeline_of(state, EntryLowering)]


class PartCompiler(CompilerBase):
    """Types and lowers a function, and stops there."""

    apart = False

    def define_pipelines(self) -> list[Any]:
        state = self.state
        state.flags.no_compile = True
        state.flags.noalias = state.flags.forceinline = self.apart
        state.library = PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        return [pipeline_of(state, KernelLowering)]


class ApartCompiler(PartCompiler):
    """As PartCompiler. LLVM is told that no two of the function's arrays overlap, and always puts
    it into its callers, where that is still known."""

    apart = True


class Called(Dispatcher):
    """A function as kernels see it that call it. A number that stands in the caller is no type of
    its own, which would make a version of the function for every such number."""

    def get_call_template(self, args: Any, kws: Any) -> Any:
        return super().get_call_template(tuple(map(types.unliteral, args)), kws)


class Part(Called):
    """A function whose intermediate code is linked to its callers."""

    @global_compiler_lock
    def compile(self, sig: Any) -> Any:
        args, _ = sigutils.normalize_signature(sig)
        if tuple(args) not in self.overloads:
            result: Any = self._compiler.compile(args, None)
            # what numba finds the code by, which has no entry point
            key = object()
            self.targetctx.insert_user_function(key, result.fndesc, result.library.closure())
            self.overloads[tuple(args)] = result._replace(entry_point=key)
        return self.overloads[tuple(args)].entry_point


class Declared(NamedTuple):
    """A shared kernel for some types, as numba asks for it where it is called."""

    signature: Any
    entry_point: Any
    objectmode: bool = False


class Shared(Called):
    """A kernel as others see it that call its machine code; entry: the kernel for Python."""

    entry: Any

    @global_compiler_lock
    def compile(self, sig: Any) -> Any:
        args = tuple(sigutils.normalize_signature(sig)[0])
        if args not in self.overloads:
            taken = tuple(map(held, args))
            need = Need(self.py_func.__module__, self.py_func.__name__, taken)
            if not self.entry.is_there(text_of_types(taken)):
                crew().ask(need)
            returned = declared_type(self.entry.returns)
            described = ExternalFunctionDescriptor(symbol_of(need), returned, taken)
            key = object()
            call = _calling(user_function(described, ()), need, args)
            self.targetctx.insert_func_defn([(call, key, call.signature)])
            self.overloads[args] = Declared(typing.signature(returned, *args), key)
        return self.overloads[args].entry_point


def declared_type(returned: Any) -> Any:
    """What a shared kernel returns, as numba has it."""
    plain = {None: types.none, bool: types.boolean, int: types.int64, float: types.float64}
    if returned in plain:
        return plain[returned]
    fields = get_type_hints(returned).values()
    return types.NamedTuple(tuple(map(declared_type, fields)), returned)


def kernel_of(need: Need) -> Any:
    """A shared kernel, for Python."""
    return getattr(importlib.import_module(need.module), need.name)


@cache
def load(need: Need) -> None:
    """Make the machine code of a shared kernel known to what is about to be loaded."""
    entry = kernel_of(need)
    if is_helper():
        binding.add_symbol(symbol_of(need), id(entry))  # never called here
        return
    binding.add_symbol(symbol_of(need), entry.for_types(text_of_types(need.args), need.args).own)


def symbol_of(need: Need) -> str:
    """By what machine code calls a shared kernel."""
    digest = hashlib.sha256(repr(need.args).encode()).hexdigest()[:16]
    return f"{need.module}.{need.name}.{digest}"


def needs_of(library: Any) -> set[Need]:
    """The shared kernels that a library and the parts linked to it call."""
    libraries = (library, *library._linking_libraries)
    return {need for each in libraries for need in vars(each).get("needs", ())}


def _calling(implementation: Any, need: Need, own: Types) -> Any:
    """The implementation of a call with arguments of its own types that notes in the calling code's
    library what it needs, and holds what the kernel takes as held."""

    def call(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vars(context.active_code_library).setdefault("needs", set()).add(need)
        given = []
        for kind, taken, value in zip(sig.args, need.args, args, strict=True):
            line = value
            if isinstance(taken, HeldType) and not isinstance(kind, HeldType):
                line = room(builder, taken)
                keep(context, builder, kind, value, line)
            given.append(line)
        return implementation(context, builder, sig, given)

    described: Any = call
    described.signature, described.libs = own, ()
    return described
