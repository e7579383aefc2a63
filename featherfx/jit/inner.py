"""What compiles kernels that share machine code (parts.py), where none is stored."""

from __future__ import annotations

import pickle
from typing import Any

from llvmlite import binding
from numba import typeof
from numba.core import event
from numba.core import types as numba_types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target
from numba.core.serialize import dumps

from featherfx.files.gc_pause import seldom_collected
from featherfx.jit.compile_progress import TELLER
from featherfx.jit.compile_workers import WAITING, Need, crew
from featherfx.jit.lazy_import import import_all
from featherfx.jit.linking import (
    OPTIONS,
    PART_OPTIONS,
    ApartCompiler,
    Dispatcher,
    EntryCompiler,
    Part,
    PartCompiler,
    Shared,
    declared_type,
    kernel_of,
    needs_of,
    symbol_of,
)
from featherfx.jit.loaded import OWN, Loaded, Returned
from featherfx.jit.stored import Code, Link
from featherfx.jit.struct_pointer import Tuples, held
from featherfx.jit.type_text import text_of_types


class _Heard(event.Listener):
    """Tells of what is compiled, as phases of whatever work needs it."""

    def on_start(self, event: Any) -> None:
        TELLER.on_start(event)

    def on_end(self, event: Any) -> None:
        TELLER.on_end(event)


for _kind in ("numba:compile", WAITING):
    event.register(_kind, _Heard())


def linked_of(kernel: Any) -> Part | Shared:
    """What other kernels call of one."""
    if kernel.returns is OWN:
        compiler = ApartCompiler if kernel.apart else PartCompiler
        return Part(kernel.py_func, targetoptions=PART_OPTIONS, pipeline_class=compiler)
    shared = Shared(kernel.py_func, targetoptions=PART_OPTIONS)
    shared.entry = kernel
    return shared


def wait_for(kernel: Any, types: tuple[Any, ...]) -> None:
    """Wait for helpers that are at a shared kernel, which may be stored then."""
    need = Need(kernel.py_func.__module__, kernel.py_func.__name__, types)

    def compile_here(other: Need) -> None:
        kernel_of(other).for_types(text_of_types(other.args), other.args)

    crew().wait_for(need, compile_here)


def compile_entry(kernel: Any, types: tuple[Any, ...]) -> tuple[Code, Loaded]:
    """Compile a kernel for numba's types, and load it."""
    import_all()
    entry: Any = Dispatcher(kernel.py_func, targetoptions=OPTIONS, pipeline_class=EntryCompiler)
    with global_compiler_lock, seldom_collected():
        entry.compile(types)
    result = entry.overloads[types]
    returned = result.signature.return_type
    if kernel.returns is not OWN and returned != (declared := declared_type(kernel.returns)):
        name = f"{kernel.py_func.__module__}.{kernel.py_func.__name__}"
        raise TypeError(f"{name} returns {returned}, declared: {declared}")
    library, described = result.library, result.fndesc
    names = described.llvm_cpython_wrapper_name, described.llvm_func_name
    code = Code(
        library._get_compiled_object(),
        *names,
        _returned(returned),
        tuple(map(_link, sorted(needs_of(library), key=symbol_of))),
    )
    entry_at, own_at = map(library.get_pointer_to_function, names)
    return code, Loaded(entry_at, own_at, code.returns)


def _link(need: Need) -> Link:
    text = text_of_types(need.args)
    return Link(symbol_of(need), need.module, need.name, text, dumps(need.args))


def types_in(link: Link) -> Any:
    """numba's types of a link's arguments; None if they are of classes that are gone."""
    try:
        return pickle.loads(link.types)
    except (AttributeError, ImportError):
        return None


def types_of(arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    """numba's types of arguments."""
    import_all()
    return tuple(held(typeof(each)) for each in arguments)


def _returned(kind: Any) -> Returned:
    if isinstance(kind, Tuples):
        named = getattr(kind, "instance_class", None)
        name = "" if named is None else f"{named.__module__}:{named.__qualname__}"
        return Returned(name, tuple(map(_returned, kind.types)))
    kinds = {
        numba_types.none: "",
        numba_types.boolean: "?",
        numba_types.int64: "q",
        numba_types.float64: "d",
    }
    return Returned(kinds[numba_types.unliteral(kind)])


def loaded_by_llvm(code: Code, links: dict[str, int]) -> dict[str, int]:
    """Addresses by name of what machine code defines, by LLVM's own loader."""
    for symbol, address in links.items():
        binding.add_symbol(symbol, address)
    engine = cpu_target.target_context.codegen()._engine._ee
    engine.add_object_file(binding.ObjectFileRef.from_data(code.machine))
    engine.finalize_object()
    return {name: engine.get_function_address(name) for name in (code.entry, code.own)}
