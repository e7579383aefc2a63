"""The decorators of all compiled kernels, which are compiled on first use; see cache.py."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from featherfx.jit.cache import KernelCache
from featherfx.jit.parts import (
    ApartCompiler,
    Dispatcher,
    EntryCompiler,
    Part,
    PartCompiler,
    Shared,
)

# No "nnan" or "ninf": the solver's checks for values that are not finite must keep their meaning.
FAST_MATH = {"contract", "reassoc", "nsz", "arcp"}


class Kernel(Dispatcher):
    """A compiled function as Python calls it. linked: Part or Shared, what other kernels call."""

    linked: Any

    def get_call_template(self, args: Any, kws: Any) -> Any:
        return self.linked.get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        return self.linked.get_overload(sig)


# kernels allocate nothing, so counting references to arrays would only cost time
OPTIONS = {
    "nopython": True,
    "nogil": True,
    "_nrt": False,
    "error_model": "numpy",
    "fastmath": FAST_MATH,
    "no_cfunc_wrapper": True,
}
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


def shared_kernel(function: Callable[..., Any]) -> Any:
    """As kernel, for large ones that several others call: they call its own machine code."""
    shared = Shared(function, targetoptions=PART_OPTIONS)
    shared.entry = _entry(function, shared)
    return shared.entry


def _entry(function: Callable[..., Any], linked: Part | Shared) -> Any:
    entry: Any = Kernel(function, targetoptions=OPTIONS, pipeline_class=EntryCompiler)
    entry.linked, entry._cache = linked, KernelCache(function)
    return entry
