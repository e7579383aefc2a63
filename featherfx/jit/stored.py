"""What is stored of kernels, and what of it is loaded again.

Every entry is a file of its own: a checksum, then the key that it is of and the machine code. What
is damaged, of another key, or of types that are gone counts as missing, and is compiled anew. What
is not in the user's folder may have come with the program (shipped.py).
"""

from __future__ import annotations

import hashlib
import pickle
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from featherfx.files.atomic_write import write_whole
from featherfx.files.trust import distrust
from featherfx.jit import processor, shipped
from featherfx.jit.cache import cache_folder, root_folder, warn_once

_CHECKSUM_BYTES = hashlib.sha256().digest_size


class Link(NamedTuple):
    """A shared kernel that machine code calls. symbol: by which; text: of its arguments; types:
    they themselves, pickled, for the compiler."""

    symbol: str
    module: str
    name: str
    text: str
    types: bytes


class Code(NamedTuple):
    """Machine code of a kernel for some types.

    machine: object file; entry: symbol of what reads words (forms.py); own: symbol of what other
    kernels call; returns: what the entry writes, as returned.py has it.
    """

    machine: bytes
    entry: str
    own: str
    returns: Any
    links: tuple[Link, ...]


class Entries:
    """The stored machine code of one kernel: a file per key."""

    def __init__(self, folder: Path, name: str) -> None:
        self._folder, self._name = folder, name

    def load(self, key: Any) -> Code | None:
        """What was saved under a key; None where nothing sound was."""
        try:
            stored = self.file(key).read_bytes()
        except OSError:
            return None
        checksum, content = stored[:_CHECKSUM_BYTES], stored[_CHECKSUM_BYTES:]
        if hashlib.sha256(content).digest() != checksum:
            return None
        try:
            of, code = pickle.loads(content)
        except (AttributeError, ImportError):
            return None  # of another version of this file
        return code if of == key else None

    def holds(self, key: Any) -> bool:
        """Whether something was saved under a key."""
        return self.file(key).is_file()

    def save(self, key: Any, code: Code) -> None:
        """Store under a key. Raises OSError, which names the file."""
        content = pickle.dumps((key, code))
        whole = hashlib.sha256(content).digest() + content
        self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        write_whole(self.file(key), lambda file: file.write(whole))

    def file(self, key: Any) -> Path:
        """Where it is, or would be."""
        digest = hashlib.sha256(repr(key).encode()).hexdigest()[:16]
        return self._folder / f"{self._name}.{digest}.code"


class Kept:
    """The machine code of one kernel: what this user has compiled, and what came with the
    program. Keys: text of all arguments, and the processor."""

    def __init__(self, function: Any) -> None:
        code = function.__code__
        source = Path(code.co_filename).resolve()
        python = f"py{sys.version_info.major}{sys.version_info.minor}"
        own = function.__qualname__.replace("<locals>", "locals")
        name = f"{source.stem}.{own}-{code.co_firstlineno}.{python}"
        folder = cache_folder(source)
        self._own = Entries(folder, name)
        self._shipped = Entries(shipped.FOLDER / folder.name, name)

    def load(self, text: str) -> Iterator[Code]:
        """What is stored for arguments of a text."""
        if (code := self._own.load(_key(text))) is not None:
            yield code
        for key in self._shipped_keys(text):
            if (code := self._shipped.load(key)) is not None:
                yield code

    def _shipped_keys(self, text: str) -> Iterator[Any]:
        """Keys of what came with the program and fits this machine."""
        for each in shipped.fitting():
            key = text, processor.named(each.name)
            if not self._shipped.holds(key):
                continue
            if distrust(self._shipped.file(key)):
                warn_once(f"others can write to machine code in {shipped.FOLDER}: not used")
            else:
                yield key

    def save(self, text: str, code: Code) -> None:
        """Store compiled code; the work goes on where it cannot be stored."""
        try:
            self._own.save(_key(text), code)
        except OSError as error:
            reason = error.strerror or str(error)
            warn_once(f"machine code is not kept in {root_folder()} ({reason})")

    def holds(self, text: str) -> bool:
        """Whether there is code for arguments of a text."""
        return self._own.holds(_key(text)) or any(True for _ in self._shipped_keys(text))


def _key(text: str) -> tuple[str, str]:
    """Key of what is compiled here."""
    return text, processor.asked_for() or processor.this_one()
