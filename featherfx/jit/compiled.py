"""The decorators of all compiled kernels, and where their machine code is kept.

Kernels are compiled on first use and cached in a folder whose name holds a hash of their file and
of all kernel files that it imports, because numba on its own only watches the file of the function
that it was asked for, not those of the functions that it calls. Nothing else about a file counts:
installed anew elsewhere, it finds its machine code. The folder is in $FEATHERFX_CACHE, else in
$XDG_CACHE_HOME/featherfx, else in ~/.cache/featherfx, else in one of the system's temporary ones.
"""

from __future__ import annotations

import ast
import hashlib
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache

from featherfx.jit.parts import (
    ApartCompiler,
    Dispatcher,
    EntryCompiler,
    Part,
    PartCompiler,
    Shared,
    Stored,
)

ROOT = Path(__file__).resolve().parents[1]
# how kernels are compiled
COMPILER = (ROOT / "jit/compiled.py", ROOT / "jit/parts.py")
# No "nnan" or "ninf": the solver's checks for values that are not finite must keep their meaning.
FAST_MATH = {"contract", "reassoc", "nsz", "arcp"}


@cache
def _imported(source: Path) -> frozenset[Path]:
    """Kernel files that a kernel file imports, itself included."""
    found = {source}
    for node in ast.parse(source.read_bytes()).body:
        module = node.module or "" if isinstance(node, ast.ImportFrom) else ""
        if module.startswith("featherfx.") and module.endswith("_kernels"):
            name = module.removeprefix("featherfx.").replace(".", "/")
            found |= _imported(ROOT / f"{name}.py")
    return frozenset(found)


@cache
def cache_folder(source: Path) -> Path:
    """Folder of the compiled kernels of a source file; made if it is not there."""
    digest = hashlib.sha256(numba.__version__.encode())
    for part in (*COMPILER, *sorted(_imported(source))):
        digest.update(part.read_bytes())
    name = digest.hexdigest()[:16]
    candidates = [
        os.environ.get("FEATHERFX_CACHE"),
        Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "featherfx",
        Path(tempfile.gettempdir()) / "featherfx",
    ]
    for candidate in candidates:
        if not candidate:
            continue
        folder = Path(candidate) / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.mkdtemp(prefix="featherfx-"))


class Locator:
    """Tells numba where a kernel's machine code is; the folder's name says all that it is of."""

    def __init__(self, function: Any, source: str) -> None:
        self._py_file, self._line = source, function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, function: Any, source: str) -> Locator:
        return cls(function, source)

    def ensure_cache_path(self) -> None:
        Path(self.get_cache_path()).mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        return str(cache_folder(Path(self._py_file).resolve()))

    def get_source_stamp(self) -> str:
        return ""

    def get_disambiguator(self) -> str:
        return str(self._line)


class Found(Stored):
    """A kernel's machine code where Locator says that it is."""

    _locator_classes: Any = (Locator,)


class KernelCache(FunctionCache):
    """The stored machine code of one kernel, by types and by the names of their fields."""

    _impl_class = Found

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return (*super()._index_key(sig, codegen), tuple(_fields(each) for each in sig))


def _fields(kind: Any) -> tuple[Any, ...]:
    """Names of a named tuple's fields, at all levels: code reaches them by their place."""
    inner = tuple(_fields(each) for each in getattr(kind, "types", ()))
    return (*getattr(kind, "fields", ()), *(each for each in inner if each))


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
    config: Any = numba.config
    if config.DISABLE_JIT:
        return function
    entry: Any = Kernel(function, targetoptions=OPTIONS, pipeline_class=EntryCompiler)
    entry.linked, entry._cache = linked, KernelCache(function)
    return entry
