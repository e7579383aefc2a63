"""Where the machine code of kernels is kept between runs.

Kernels are cached in a folder whose name holds a hash of their file and of all files of this
program that it imports, because numba on its own only watches the file of the function that it was
asked for, not those of the functions that it calls. Nothing else about a file counts: installed
anew elsewhere, it finds its machine code. These folders are in $FEATHERFX_CACHE, else in the
system's own folder for caches of a user (on Linux $XDG_CACHE_HOME/featherfx, else
~/.cache/featherfx), else in one that is removed when the process ends. Folders that others can
write to are not used (files/trust.py), unless $FEATHERFX_TRUSTED_CACHE names them.

Every entry is a file of its own: a checksum, then the key that it is of and the machine code. What
is damaged, of another key, or of types that are gone counts as missing, and is compiled anew.
"""

from __future__ import annotations

import ast
import atexit
import hashlib
import os
import pickle
import shutil
import tempfile
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.serialize import dumps

from featherfx.errors import InputWarning
from featherfx.files.cache_folder import doubt, wanted_folder
from featherfx.files.whole import write_whole
from featherfx.jit.parts import load, needs_of

ROOT = Path(__file__).resolve().parents[1]
# how kernels are compiled, and what is stored of them
COMPILER = tuple(ROOT / "jit" / name for name in ("cache.py", "compiled.py", "parts.py"))
_CHECKSUM_BYTES = hashlib.sha256().digest_size


@cache
def _imported(source: Path) -> frozenset[Path]:
    """Files of this program that a kernel file imports, itself included: constants and the fields
    of named tuples are in its code, too."""
    found = {source}
    for node in ast.parse(source.read_bytes()).body:
        module = node.module or "" if isinstance(node, ast.ImportFrom) else ""
        # COMPILER stands for how kernels are compiled
        if module.startswith("featherfx.") and not module.startswith("featherfx.jit."):
            name = module.removeprefix("featherfx.").replace(".", "/")
            found |= _imported(ROOT / f"{name}.py")
    return frozenset(found)


def _digest(source: Path) -> str:
    """Short name of all that the machine code of a source file depends on."""
    digest = hashlib.sha256(numba.__version__.encode())
    for part in (*COMPILER, *sorted(_imported(source))):
        digest.update(part.read_bytes())
    return digest.hexdigest()[:16]


@cache
def _fault(folder: Path) -> str:
    """Why a folder, made if need be, cannot hold machine code; empty if it can."""
    try:
        if fault := doubt(folder):
            return fault
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        return f"{folder}: {error.strerror or error}"
    return "" if os.access(folder, os.W_OK) else f"no permission to write to {folder}"


@cache
def root_folder() -> Path:
    """Folder that holds the caches of all sources: the one asked for, else the user's own, else one
    for this process, with a warning that says why."""
    wanted = wanted_folder()
    fault = _fault(wanted)
    if not fault:
        return wanted
    folder = Path(tempfile.mkdtemp(prefix="featherfx-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    warnings.warn(
        f"machine code is not kept, and is compiled anew by every run: {fault}",
        InputWarning,
        stacklevel=2,
    )
    return folder


@cache
def cache_folder(source: Path) -> Path:
    """Folder of the compiled kernels of a source file."""
    return root_folder() / _digest(source)


@cache
def _warn_once(message: str) -> None:
    warnings.warn(message, InputWarning, stacklevel=3)


class Entries:
    """The stored machine code of one kernel: a file per key."""

    def __init__(self, folder: Path, name: str) -> None:
        self._folder, self._name = folder, name

    def load(self, key: Any) -> Any:
        """What was saved under a key; None where nothing sound was."""
        try:
            stored = self._file(key).read_bytes()
        except OSError:
            return None
        checksum, content = stored[:_CHECKSUM_BYTES], stored[_CHECKSUM_BYTES:]
        if hashlib.sha256(content).digest() != checksum:
            return None
        try:
            of, data = pickle.loads(content)
        except (AttributeError, ImportError):
            return None  # of types that another version had elsewhere
        return data if of == key else None

    def holds(self, key: Any) -> bool:
        """Whether something was saved under a key."""
        return self._file(key).is_file()

    def save(self, key: Any, data: Any) -> None:
        """Store under a key. Raises OSError, which names the file."""
        content = dumps((key, data))
        whole = hashlib.sha256(content).digest() + content
        self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        write_whole(self._file(key), lambda file: file.write(whole))

    def flush(self) -> None:
        """Remove what was stored."""
        for file in self._folder.glob(f"{self._name}.*.code"):
            file.unlink(missing_ok=True)

    def _file(self, key: Any) -> Path:
        return (
            self._folder
            / f"{self._name}.{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}.code"
        )


class Locator:
    """Tells numba where a kernel's machine code is; the folder's name says all that it is of."""

    def __init__(self, function: Any, source: str) -> None:
        self._py_file, self._line = source, function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, function: Any, source: str) -> Locator:
        return cls(function, source)

    def ensure_cache_path(self) -> None:
        """Entries make the folder when there is something to store."""

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
        for need in needs:
            load(need)
        return super().rebuild(target, code)


class KernelCache(FunctionCache):
    """The stored machine code of one kernel, by types and by the names of their fields."""

    _impl_class = Stored

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._cache_file: Any = Entries(Path(self._cache_path), self._impl.filename_base)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store compiled code; the work goes on where it cannot be stored."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            reason = error.strerror or str(error)
            _warn_once(f"machine code is not kept in {root_folder()} ({reason})")

    def holds(self, sig: Any, target: Any) -> bool:
        """Whether there is code for some types."""
        return bool(self._cache_file.holds(self._index_key(sig, target.codegen())))

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return (*super()._index_key(sig, codegen), tuple(_fields(each) for each in sig))


def _fields(kind: Any) -> tuple[Any, ...]:
    """Names of a named tuple's fields, at all levels: code reaches them by their place."""
    inner = tuple(_fields(each) for each in getattr(kind, "types", ()))
    return (*getattr(kind, "fields", ()), *(each for each in inner if each))
