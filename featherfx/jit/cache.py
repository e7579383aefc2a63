"""Where the machine code of kernels is kept between runs.

Kernels are cached in a folder whose name holds a hash of their file and of all files of this
program that it imports, because numba on its own only watches the file of the function that it was
asked for, not those of the functions that it calls. Nothing else about a file counts: installed
anew elsewhere, it finds its machine code. These folders are in $FEATHERFX_CACHE, else in the
system's own folder for caches of a user (on Linux $XDG_CACHE_HOME/featherfx, else
~/.cache/featherfx), else in one of its temporary ones.
"""

from __future__ import annotations

import ast
import hashlib
import importlib
import os
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numba
import platformdirs
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile

from featherfx.jit.parts import needs_of

ROOT = Path(__file__).resolve().parents[1]
# how kernels are compiled, and what is stored of them
COMPILER = tuple(ROOT / "jit" / name for name in ("cache.py", "compiled.py", "parts.py"))


@cache
def _imported(source: Path) -> frozenset[Path]:
    """Files of this program that a kernel file imports, itself included: constants and the fields
    of named tuples are in its code, too."""
    found = {source}
    for node in ast.parse(source.read_bytes()).body:
        module = node.module or "" if isinstance(node, ast.ImportFrom) else ""
        if module.startswith("featherfx."):
            name = module.removeprefix("featherfx.").replace(".", "/")
            found |= _imported(ROOT / f"{name}.py")
    return frozenset(found)


def _digest(source: Path) -> str:
    """Short name of all that the machine code of a source file depends on."""
    digest = hashlib.sha256(numba.__version__.encode())
    for part in (*COMPILER, *sorted(_imported(source))):
        digest.update(part.read_bytes())
    return digest.hexdigest()[:16]


def _candidates() -> Iterator[Path]:
    """Folders that may hold the caches of all sources, in order."""
    asked = os.environ.get("FEATHERFX_CACHE")
    if asked:
        yield Path(asked)
    yield platformdirs.user_cache_path("featherfx", appauthor=False)
    yield Path(tempfile.gettempdir()) / "featherfx"


def _is_usable(folder: Path) -> bool:
    """Whether machine code may be loaded from a folder, made if need be, and stored there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


@cache
def _private_folder() -> Path:
    """A folder for this process, where no other can be used."""
    return Path(tempfile.mkdtemp(prefix="featherfx-"))


@cache
def cache_folder(source: Path) -> Path:
    """Folder of the compiled kernels of a source file; made if it is not there."""
    name = _digest(source)
    folders = (candidate / name for candidate in _candidates())
    found = next((folder for folder in folders if _is_usable(folder)), None)
    return _private_folder() / name if found is None else found


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


class Stored(CompileResultCacheImpl):
    """A kernel's machine code as it is stored, with the shared kernels that it needs."""

    _locator_classes: Any = (Locator,)

    def reduce(self, result: Any) -> Any:
        return needs_of(result.library), super().reduce(result)

    def rebuild(self, target: Any, stored: Any) -> Any:
        needs, code = stored
        for module, name, args in needs:
            getattr(importlib.import_module(module), name).linked.compile(args)
        return super().rebuild(target, code)


class _Index(IndexDataCacheFile):
    """The types that there is machine code for. Those who call a kernel define some of them: where
    another version did so in a module that is here no longer, the index starts afresh."""

    def _load_index(self) -> Any:
        try:
            return super()._load_index()
        except (AttributeError, ImportError):
            return {}


class KernelCache(FunctionCache):
    """The stored machine code of one kernel, by types and by the names of their fields."""

    _impl_class = Stored

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        stamp = self._impl.locator.get_source_stamp()
        self._cache_file = _Index(self._cache_path, self._impl.filename_base, stamp)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return (*super()._index_key(sig, codegen), tuple(_fields(each) for each in sig))


def _fields(kind: Any) -> tuple[Any, ...]:
    """Names of a named tuple's fields, at all levels: code reaches them by their place."""
    inner = tuple(_fields(each) for each in getattr(kind, "types", ()))
    return (*getattr(kind, "fields", ()), *(each for each in inner if each))
