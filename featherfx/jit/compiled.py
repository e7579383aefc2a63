"""The decorators of compiled kernels, which are compiled at their first call.

Stored machine code is loaded without numba and LLVM, which take 70 MiB and a quarter of a second
of a process. `compiler` compiles what is not stored. Python names kernels by their modules
(KernelModule), which are imported only to compile them.
"""

from __future__ import annotations

import contextlib
import functools
import json
import os
import sys
import threading
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from featherfx.errors import InputError, Problem
from featherfx.jit.code_cache import ROOT, CannotBeLoadedError, KernelStore, load_object
from featherfx.jit.kernel_calls import (
    INLINED,
    Encoded,
    LoadedKernel,
    StoredKernel,
    describe_arguments,
    encode_arguments,
    find_kernel,
    make_arguments,
)

if os.environ.get("NUMBA_DISABLE_JIT", "").strip() not in ("", "0"):
    _DISABLED = "is set, but the solver works only as machine code; unset it"
    raise InputError(Problem("NUMBA_DISABLE_JIT", "", _DISABLED))

# by work: kernels that Python calls in it, and the text of types of arguments of each
ARGUMENTS = Path(__file__).with_name("arguments.json")
# threads load one kernel after another, each with all that it calls
_LOADING = threading.RLock()


class KernelEntry:
    """A kernel as Python calls it. Stored machine code is loaded without the kernel's module.

    name: module and name.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._by_form: dict[tuple[Any, ...], LoadedKernel] = {}
        self._by_text: dict[str, LoadedKernel] = {}

    def __call__(self, *arguments: Any) -> Any:
        form, words = encode_arguments(arguments)
        code = self._by_form.get(key := tuple(form))
        if code is None:
            arguments = tuple(a.value if isinstance(a, Encoded) else a for a in arguments)
            text = describe_arguments(arguments)
            code = self.find_loaded(text)
            if code is None:
                from featherfx.jit.compiler import find_types

                code = self._compile(text, find_types(arguments))
            self._by_form[key] = code
        return code(words)

    def _compile(self, text: str, types: tuple[Any, ...]) -> LoadedKernel:
        code: LoadedKernel = find_kernel(self.name).compile_for(text, types)
        return code

    @functools.cached_property
    def store(self) -> KernelStore:
        """Its stored machine code."""
        module, _, own = self.name.rpartition(".")
        source = ROOT.parent.joinpath(*module.split(".")).with_suffix(".py")
        if module in sys.modules or not source.is_file():
            source = Path(import_module(module).__file__ or "")
        return KernelStore(source, own)

    def request(self, text: str, later: bool = False) -> None:
        """Let a worker compile it for types of arguments, told by a text, unless that is stored.

        later: after what is waited for. A text with tuples that are no more asks for nothing.
        """
        if not self.is_there(text):
            from featherfx.jit.compile_workers import KernelRequest, compile_pool
            from featherfx.jit.compiler import find_types

            with contextlib.suppress(ImportError, AttributeError, TypeError):
                types = find_types(make_arguments(text))
                compile_pool().submit(KernelRequest(self.name, types), later)

    def is_there(self, text: str) -> bool:
        """Return whether there is machine code for types of arguments, loaded or stored."""
        return text in self._by_text or self.store.holds(text)

    def find_loaded(self, text: str) -> LoadedKernel | None:
        """Loaded machine code, from the store if need be; None where there is none."""
        with _LOADING:
            if text not in self._by_text:
                for code in self.store.load(text):
                    if (found := _load(self.name, code)) is not None:
                        self._by_text[text] = found
                        break
            return self._by_text.get(text)


class Kernel(KernelEntry):
    """A compiled function.

    returns: None, bool, int, float or a NamedTuple of these for a shared kernel, else INLINED.
    compiled: number of types that this process compiled it for.
    """

    def __init__(self, function: Callable[..., Any], returns: Any = INLINED) -> None:
        super().__init__(f"{function.__module__}.{function.__qualname__}")
        functools.update_wrapper(self, function)
        self.py_func, self.returns, self.compiled = function, returns, 0

    @functools.cached_property
    def store(self) -> KernelStore:
        """Its stored machine code."""
        return KernelStore(Path(self.py_func.__code__.co_filename), self.py_func.__qualname__)

    @functools.cached_property
    def linked(self) -> Any:
        """The dispatcher that numba calls in other kernels."""
        from featherfx.jit.compiler import make_callee

        return make_callee(self)

    @property
    def _numba_type_(self) -> Any:
        return self.linked._numba_type_

    def compile_for(self, text: str, types: tuple[Any, ...]) -> LoadedKernel:
        """Compile it for numba's types and store it, unless another thread or process has."""
        from featherfx.jit.compile_workers import KernelRequest, compile_pool
        from featherfx.jit.compiler import compile_entry, compile_request

        compile_pool().wait_for(KernelRequest(self.name, types), compile_request)
        with _LOADING:
            if (found := self.find_loaded(text)) is None:
                code, found = compile_entry(self, types)
                self.compiled += 1
                self.store.save(text, code)
                self._by_text[text] = found
        return found

    _compile = compile_for


class KernelModule:
    """The kernels of a module, by its name, as attributes."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, own: str) -> KernelEntry:
        return kernel_entry(f"{self._name}.{own}")


@functools.cache
def kernel_entry(name: str) -> KernelEntry:
    """The kernel of a module and name, as "featherfx.algebra.element_kernels.multiply_rows"."""
    return KernelEntry(name)


@functools.cache
def request_expected(*works: str, package: str = "", later: bool = False) -> None:
    """Let workers compile the kernels of a package that some works will call, unless stored.

    works: names in arguments.json (`featherfx lab measure calls`). later: as of request.
    """
    table = json.loads(ARGUMENTS.read_text(encoding="utf-8"))
    for work in works:
        for name, text in table.get(work, {}).items():
            if name.startswith(package):
                kernel_entry(name).request(text, later)


def _load(name: str, code: StoredKernel) -> LoadedKernel | None:
    """Load machine code of a kernel with all that it calls; None where that is not all stored."""
    links: dict[str, int] = {}
    for link in code.links:
        if (found := kernel_entry(link.name).find_loaded(link.text)) is None:
            return None
        links[link.symbol] = found.own
    try:
        places = load_object(code.machine, links)
    except CannotBeLoadedError:
        from featherfx.jit.compiler import load_by_llvm

        find_kernel(name)  # its module names the intrinsics that it needs
        places = load_by_llvm(code, links)
    return LoadedKernel(places[code.entry], places[code.own], code.returns)


# untyped: mypy would see a Kernel where kernels call each other with lanes, numbers or tuples
def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function of arrays and scalars without Python objects.

    Kernels that call it get its code linked in.
    """
    return Kernel(function)


def loop_kernel(function: Callable[..., Any]) -> Any:
    """As kernel, for short loops over arrays of which none that is written overlaps another.

    Other kernels test before every such loop whether arrays overlap.
    """
    vars(function)["apart"] = True  # for compiler.py
    return Kernel(function)


def shared_kernel(returns: Any) -> Callable[[Callable[..., Any]], Any]:
    """As kernel, for large ones that several others call: they call its own machine code.

    returns: None, bool, int, float or a NamedTuple of these.
    """
    return lambda function: Kernel(function, returns)
