"""The decorators of kernels that share machine code and keep it: parts.py, stored.py."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core import sigutils
from numba.core.compiler_lock import global_compiler_lock

from featherfx.files.collecting import seldom_collected
from featherfx.jit.crew import Need, crew
from featherfx.jit.parts import (
    ApartCompiler,
    Dispatcher,
    EntryCompiler,
    Part,
    PartCompiler,
    Shared,
    kernel_of,
)
from featherfx.jit.plain import OPTIONS as PLAIN_OPTIONS
from featherfx.jit.stored import KernelCache


class Kernel(Dispatcher):
    """A compiled function as Python calls it. linked: Part or Shared, what other kernels call."""

    linked: Any

    def is_there(self, args: Any) -> bool:
        """Whether there is machine code for some types, loaded or stored."""
        return args in self.overloads or self._cache.holds(args, self.targetctx)

    def compile(self, sig: Any) -> Any:
        args = tuple(sigutils.normalize_signature(sig)[0])
        if isinstance(self.linked, Shared) and not self.is_there(args):
            need = Need(self.py_func.__module__, self.py_func.__name__, args)
            crew().wait_for(need, lambda other: kernel_of(other).compile(other.args))
        with global_compiler_lock, seldom_collected():
            return super().compile(sig)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        return self.linked.get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        return self.linked.get_overload(sig)


# kernels allocate nothing, so counting references to arrays would only cost time
OPTIONS = PLAIN_OPTIONS | {"nopython": True, "_nrt": False, "no_cfunc_wrapper": True}
PART_OPTIONS = OPTIONS | {"no_cpython_wrapper": True}


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function of arrays and scalars without Python objects, cached between runs.

    Kernels that call it get its code linked in.
    """
    part = Part(function, targetoptions=PART_OPTIONS, pipeline_class=PartCompiler)
    return _entry(function, part)


def loop_kernel(function: Callable[..., Any]) -> Any:
    """As kernel, for short loops over arrays of which none that is written overlaps another.

    Else every such loop would begin with tests whether they do.
    """
    part = Part(function, targetoptions=PART_OPTIONS, pipeline_class=ApartCompiler)
    return _entry(function, part)


def shared_kernel(returns: Any) -> Callable[[Callable[..., Any]], Any]:
    """As kernel, for large ones that several others call: they call its own machine code.

    returns: None, bool, int, float or a NamedTuple of these.
    """

    def declared(function: Callable[..., Any]) -> Any:
        shared = Shared(function, targetoptions=PART_OPTIONS)
        shared.entry, shared.returns = _entry(function, shared), returns
        return shared.entry

    return declared


def compile_ahead(shared: Any, *arguments: Any) -> None:
    """Have a shared kernel compiled by others that will be called with such arguments."""
    shared.linked.compile(tuple(map(shared.typeof_pyval, arguments)))


def is_asked_for(shared: Any) -> bool:
    """Whether others know a shared kernel already, for whatever types: called or compiled ahead."""
    return bool(shared.linked.overloads)


def _entry(function: Callable[..., Any], linked: Part | Shared) -> Any:
    entry: Any = Kernel(function, targetoptions=OPTIONS, pipeline_class=EntryCompiler)
    entry.linked, entry._cache = linked, KernelCache(function)
    return entry
