"""What is stored of kernels, and what of it is loaded again.

Every entry is a file of its own: a checksum, then the key that it is of and the machine code. What
is damaged, of another key, or of types that are gone counts as missing, and is compiled anew. What
is not in the user's folder may have come with the program (shipped.py).
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.serialize import dumps

from featherfx.files.trust import distrust
from featherfx.files.whole import write_whole
from featherfx.jit import shipped
from featherfx.jit.cache import cache_folder, root_folder, warn_once
from featherfx.jit.parts import load, needs_of

_CHECKSUM_BYTES = hashlib.sha256().digest_size


class Entries:
    """The stored machine code of one kernel: a file per key."""

    def __init__(self, folder: Path, name: str) -> None:
        self._folder, self._name = folder, name

    def load(self, key: Any) -> Any:
        """What was saved under a key; None where nothing sound was."""
        try:
            stored = self.file(key).read_bytes()
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
        return self.file(key).is_file()

    def save(self, key: Any, data: Any) -> None:
        """Store under a key. Raises OSError, which names the file."""
        content = dumps((key, data))
        whole = hashlib.sha256(content).digest() + content
        self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        write_whole(self.file(key), lambda file: file.write(whole))

    def flush(self) -> None:
        """Remove what was stored."""
        for file in self._folder.glob(f"{self._name}.*.code"):
            file.unlink(missing_ok=True)

    def file(self, key: Any) -> Path:
        """Where it is, or would be."""
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
        # a listing of the types of a source's lines is of no use to a run
        return needs_of(result.library), super().reduce(result._replace(type_annotation=""))

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
        own, name = Path(self._cache_path), self._impl.filename_base
        self._cache_file: Any = Entries(own, name)
        self._shipped = Entries(shipped.FOLDER / own.name, name)

    def load_overload(self, sig: Any, target: Any) -> Any:
        """What is stored for some types; None where it has to be compiled."""
        with self._guard_against_spurious_io_errors():
            found = self._load_overload(sig, target)
        if found is None:
            # numba's compiler: machine code that is there needs nothing of it
            target.refresh()
        return found

    def _load_overload(self, sig: Any, target: Any) -> Any:
        if (found := super()._load_overload(sig, target)) is not None:
            return found
        for key in self._shipped_keys(sig):
            if (stored := self._shipped.load(key)) is not None:
                return self._impl.rebuild(target, stored)
        return None

    def _shipped_keys(self, sig: Any) -> Iterator[Any]:
        """Keys of what came with the program and fits this machine."""
        for processor in shipped.fitting():
            key = self._index_key(sig, processor)
            if not self._shipped.holds(key):
                continue
            if distrust(self._shipped.file(key)):
                warn_once(f"others can write to machine code in {shipped.FOLDER}: not used")
            else:
                yield key

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store compiled code; the work goes on where it cannot be stored."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            reason = error.strerror or str(error)
            warn_once(f"machine code is not kept in {root_folder()} ({reason})")

    def holds(self, sig: Any, target: Any) -> bool:
        """Whether there is code for some types."""
        own = self._cache_file.holds(self._index_key(sig, target.codegen()))
        return own or any(True for _ in self._shipped_keys(sig))

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return (*super()._index_key(sig, codegen), tuple(_fields(each) for each in sig))


def _fields(kind: Any) -> tuple[Any, ...]:
    """Names of a named tuple's fields, at all levels: code reaches them by their place."""
    inner = tuple(_fields(each) for each in getattr(kind, "types", ()))
    return (*getattr(kind, "fields", ()), *(each for each in inner if each))
