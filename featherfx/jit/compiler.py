"""The compiler of kernels that are not stored: numba's passes, linked in another way.

Numba on its own optimises a function and makes machine code of it before it links it to those that
call it, at every level of calls anew. Here a function gives its callers intermediate code alone
(InlinedKernel), and the whole of what an entry calls is optimised once. A shared kernel is large
and called from several entries. These call its machine code by a symbol (SharedKernel), which is
the same in every run. Stored code names the symbols that it needs. Workers may compile shared
kernels meanwhile (compile_workers.py): callers need only the declared type that they return.
"""

from __future__ import annotations

import hashlib
import itertools
from functools import cache
from types import SimpleNamespace
from typing import Any, get_type_hints

from llvmlite import binding, ir
from numba import typeof
from numba.core import sigutils, types, typing
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.funcdesc import ExternalFunctionDescriptor
from numba.core.imputils import user_function
from numba.core.lowering import Lower
from numba.core.registry import CPUDispatcher, cpu_target
from numba.core.typed_passes import NativeLowering
from numba.np.numpy_support import as_dtype

from featherfx.files.process import seldom_collected
from featherfx.jit.compile_workers import PROGRESS, KernelRequest, compile_pool, is_worker
from featherfx.jit.kernel_calls import (
    INLINED,
    KernelLink,
    LoadedKernel,
    ReturnType,
    StoredKernel,
    describe_array,
    describe_tuple,
    find_kernel,
    import_intrinsics,
)
from featherfx.jit.kernel_types import (
    WORDS,
    KindType,
    StructPointer,
    Tuples,
    allocate_words,
    as_argument,
    decode_arguments,
    encode_result,
    step,
    write_words,
)

# No "nnan" or "ninf": the solver's checks for values that are not finite must keep their meaning.
# Kernels allocate nothing, so counting references to arrays would only cost time.
_OPTIONS: dict[str, Any] = {
    "nogil": True,
    "nopython": True,
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "nsz", "arcp"},
    "_nrt": False,
    "no_cfunc_wrapper": True,
}
_INLINED_OPTIONS = _OPTIONS | {"no_cpython_wrapper": True}
# untyped: dispatchers bind like methods, which their attributes in a class are not meant to
_Dispatcher: Any = CPUDispatcher
# Loops along barbs have 4 to 16 turns. On processors with vectors of eight numbers, vectors of four
# leave a smaller rest that is done one by one.
_VECTOR_WIDTH = '"prefer-vector-width"="256"'
# name of the module of what Python calls
_WRAPPER = "wrapper"
_STATUS = ir.IntType(32)
# libraries are finished after those that they call
_NUMBERS = itertools.count()


class _EntryLower(Lower):
    """Lowering with a function that Python calls, which reads words and headers of arrays.

    numba's own takes Python's objects by functions of numba's libraries. Places in headers are
    part of numpy's ABI, so stored code needs neither numba nor LLVM to run.
    """

    def create_cpython_wrapper(self, release_gil: bool = False) -> None:
        context, described = self.context, self.fndesc
        module = context.create_module(_WRAPPER)
        kind = context.call_conv.get_function_type(described.restype, described.argtypes)
        own = ir.Function(module, kind, described.llvm_func_name)
        kind = ir.FunctionType(_STATUS, (WORDS, WORDS))
        entry = ir.Function(module, kind, described.llvm_cpython_wrapper_name)
        builder = ir.IRBuilder(entry.append_basic_block())
        words = (builder.load(step(builder, entry.args[0], k)) for k in itertools.count())
        given = decode_arguments(context, builder, described.argtypes, words)
        status, value = context.call_conv.call_function(
            builder, own, described.restype, described.argtypes, given, attrs=("noinline",)
        )
        with builder.if_then(status.is_ok):
            for k, number in enumerate(encode_result(builder, described.restype, value)):
                builder.store(number, step(builder, entry.args[1], k))
        # a kernel that returns nothing has a status of its own for that
        builder.ret(builder.select(status.is_ok, ir.Constant(_STATUS, 0), status.code))
        self.library.add_ir_module(module)


@register_pass(mutates_CFG=True, analysis_only=False)
class _EntryLowering(NativeLowering):
    """Numba's pass to intermediate code, with the lowering of an entry."""

    _name = "featherfx_entry_lowering"
    lowering_class = property(lambda _: _EntryLower)


def _make_pipeline(state: Any, lowering: Any = NativeLowering) -> list[Any]:
    """Numba's own passes, with another one to intermediate code."""
    manager = PassManager("nopython")
    for each, text in DefaultPassBuilder.define_nopython_pipeline(state).passes:
        manager.passes.append((lowering if each is NativeLowering else each, text))
    manager.finalize()
    return [manager]


class _Library(JITCodeLibrary):
    """Functions with the width of vectors that short loops want."""

    def add_ir_module(self, ir_module: Any) -> None:
        for function in ir_module.functions:
            set.add(function.attributes, _VECTOR_WIDTH)  # llvmlite does not know this one
            if ir_module.name == _WRAPPER and not function.is_declaration:
                # a thousand fields of arrays, each read once in a call: nothing to optimise
                function.attributes.add("noinline")
                function.attributes.add("optnone")
        super().add_ir_module(ir_module)


class _InlinedLibrary(_Library):
    """Intermediate code of one function, for others to link; it becomes no machine code."""

    def finalize(self) -> None:
        self._raise_if_finalized()
        self._final_module.verify()
        self._finalized = True
        self.number = next(_NUMBERS)


class _EntryLibrary(_Library):
    """Machine code of an entry."""

    def finalize(self) -> None:
        # LLVM drops what nothing calls yet when it is linked, so callers come first. A library may
        # list what its own simplified code no longer calls, so the order of lists will not do.
        self._linking_libraries.sort(key=lambda each: -getattr(each, "number", -1))
        super().finalize()

    def _finalize_final_module(self) -> None:
        for request in _find_requests(self):
            _make_known(request)
        super()._finalize_final_module()


class _EntryCompiler(CompilerBase):
    """A compiler of a kernel that Python or other machine code calls."""

    def define_pipelines(self) -> list[Any]:
        state = self.state
        state.library = _EntryLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return _make_pipeline(state, _EntryLowering)


class _InlinedCompiler(CompilerBase):
    """A compiler that stops at intermediate code.

    LLVM always inlines functions of which no two arrays overlap, where their callers still know
    that.
    """

    def define_pipelines(self) -> list[Any]:
        state = self.state
        state.flags.no_compile = True
        state.flags.noalias = state.flags.forceinline = vars(state.func_id.func).get("apart", False)
        state.library = _InlinedLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        return _make_pipeline(state)


class _Callee(_Dispatcher):
    """A kernel as other kernels call it, with literal numbers as numbers.

    numba would make a version of the kernel for every number that a caller writes.
    """

    def get_call_template(self, args: Any, kws: Any) -> Any:
        return super().get_call_template(tuple(map(types.unliteral, args)), kws)

    @global_compiler_lock
    def compile(self, sig: Any) -> Any:
        args = tuple(sigutils.normalize_signature(sig)[0])
        if args not in self.overloads:
            self.overloads[args] = self._make(args)
        return self.overloads[args].entry_point


class InlinedKernel(_Callee):
    """A kernel whose intermediate code is linked to its callers."""

    def _make(self, args: tuple[Any, ...]) -> Any:
        result: Any = self._compiler.compile(args, None)
        library = result.library
        closure = list(dict.fromkeys([library, *library._linking_libraries]))
        # numba finds the code by this key; there is no entry point
        key = object()
        self.targetctx.insert_user_function(key, result.fndesc, closure)
        return result._replace(entry_point=key)


class SharedKernel(_Callee):
    """A kernel whose machine code others call. kernel: as Python calls it."""

    kernel: Any

    def _make(self, args: tuple[Any, ...]) -> Any:
        taken = tuple(map(as_argument, args))
        request = KernelRequest(self.kernel.name, taken)
        if not self.kernel.is_there(describe_types(taken)):
            compile_pool().submit(request)
        returned = _declare_return(self.kernel.returns)
        described = ExternalFunctionDescriptor(_name_symbol(request), returned, taken)
        key = object()
        call = _make_call(user_function(described, ()), request, args)
        self.targetctx.insert_func_defn([(call, key, call.signature)])
        # numba asks for these where the kernel is called
        made = typing.signature(returned, *args)
        return SimpleNamespace(signature=made, entry_point=key, objectmode=False)


def make_callee(kernel: Any) -> InlinedKernel | SharedKernel:
    """Make what other kernels call of a kernel."""
    if kernel.returns is INLINED:
        return InlinedKernel(
            kernel.py_func, targetoptions=_INLINED_OPTIONS, pipeline_class=_InlinedCompiler
        )
    shared = SharedKernel(kernel.py_func, targetoptions=_INLINED_OPTIONS)
    shared.kernel = kernel
    return shared


def _make_call(implementation: Any, request: KernelRequest, own: tuple[Any, ...]) -> Any:
    """The implementation of a call with arguments of its own types.

    It notes the request in the library of the calling code, and writes tuples to words.
    """

    def call(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vars(context.active_code_library).setdefault("requests", set()).add(request)
        given = []
        for kind, taken, value in zip(sig.args, request.args, args, strict=True):
            line = value
            if isinstance(taken, StructPointer) and not isinstance(kind, StructPointer):
                line = allocate_words(builder, taken)
                write_words(context, builder, kind, value, line)
            given.append(line)
        return implementation(context, builder, sig, given)

    described: Any = call
    described.signature, described.libs = own, ()
    return described


def _find_requests(library: Any) -> set[KernelRequest]:
    """The shared kernels that a library calls."""
    libraries = (library, *library._linking_libraries)
    return {each for own in libraries for each in vars(own).get("requests", ())}


@cache
def _make_known(request: KernelRequest) -> None:
    """Give LLVM the address of a shared kernel, before code that calls it is loaded."""
    kernel = find_kernel(request.name)
    if is_worker():
        binding.add_symbol(_name_symbol(request), id(kernel))  # never called there
        return
    code = kernel.find_loaded(text := describe_types(request.args))
    code = code or kernel.compile_for(text, request.args)
    binding.add_symbol(_name_symbol(request), code.own)


def _name_symbol(request: KernelRequest) -> str:
    digest = hashlib.sha256(repr(request.args).encode()).hexdigest()[:16]
    return f"{request.name}.{digest}"


def compile_entry(kernel: Any, types: tuple[Any, ...]) -> tuple[StoredKernel, LoadedKernel]:
    """Compile a kernel for numba's types, and load it."""
    import_intrinsics()
    entry = _Dispatcher(kernel.py_func, targetoptions=_OPTIONS, pipeline_class=_EntryCompiler)
    with PROGRESS.compiling(kernel.name), global_compiler_lock, seldom_collected():
        entry.compile(types)
    result = entry.overloads[types]
    returned = result.signature.return_type
    if kernel.returns is not INLINED and returned != (wanted := _declare_return(kernel.returns)):
        raise TypeError(f"{kernel.name} returns {returned}, declared: {wanted}")
    library, described = result.library, result.fndesc
    names = described.llvm_cpython_wrapper_name, described.llvm_func_name
    links = []
    for each in sorted(_find_requests(library), key=_name_symbol):
        links.append(KernelLink(_name_symbol(each), each.name, describe_types(each.args)))
    machine, returns = library._get_compiled_object(), _describe_return(returned)
    entry_at, own_at = map(library.get_pointer_to_function, names)
    stored = StoredKernel(machine, *names, returns, tuple(links))
    return stored, LoadedKernel(entry_at, own_at, returns)


def compile_request(request: KernelRequest) -> None:
    """Compile a shared kernel unless it is stored."""
    kernel, text = find_kernel(request.name), describe_types(request.args)
    if not kernel.is_there(text):
        kernel.compile_for(text, request.args)


def load_by_llvm(code: StoredKernel, links: dict[str, int]) -> dict[str, int]:
    """Addresses by name of the functions of machine code, by LLVM's own loader."""
    import_intrinsics()  # these may name functions of the system
    for symbol, address in links.items():
        binding.add_symbol(symbol, address)
    engine = cpu_target.target_context.codegen()._engine._ee
    engine.add_object_file(binding.ObjectFileRef.from_data(code.machine))
    engine.finalize_object()
    return {name: engine.get_function_address(name) for name in (code.entry, code.own)}


def find_types(arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    """Numba's types of arguments."""
    import_intrinsics()
    return tuple(as_argument(typeof(each)) for each in arguments)


def describe_types(kinds: tuple[Any, ...]) -> str:
    """Text of types, as kernel_calls.describe_arguments of values."""
    return ", ".join(map(_describe_type, kinds))


def _describe_type(kind: Any) -> str:
    if isinstance(kind, types.Array):
        item = as_dtype(kind.dtype)
        return describe_array(item, kind.ndim, kind.layout, kind.mutable, kind.aligned)
    if isinstance(kind, StructPointer):
        return _describe_type(kind.like)
    if isinstance(kind, Tuples):
        return describe_tuple(
            getattr(kind, "instance_class", tuple), map(_describe_type, kind.types)
        )
    if isinstance(kind, KindType):
        return f"kind {_describe_type(kind.like)}"
    return str(types.unliteral(kind))


def _declare_return(returned: Any) -> Any:
    """Numba's type of what a shared kernel declares to return."""
    plain = {None: types.none, bool: types.boolean, int: types.int64, float: types.float64}
    if returned in plain:
        return plain[returned]
    fields = get_type_hints(returned).values()
    return types.NamedTuple(tuple(map(_declare_return, fields)), returned)


def _describe_return(kind: Any) -> ReturnType:
    if isinstance(kind, Tuples):
        named = getattr(kind, "instance_class", None)
        name = "" if named is None else f"{named.__module__}:{named.__qualname__}"
        return ReturnType(name, tuple(map(_describe_return, kind.types)))
    kinds = {types.none: "", types.boolean: "?", types.int64: "q", types.float64: "d"}
    return ReturnType(kinds[types.unliteral(kind)])
