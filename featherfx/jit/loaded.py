"""Machine code in this process, as Python calls it: it reads words (forms.py) and writes words."""

from __future__ import annotations

import ctypes
import functools
import importlib
import struct
from array import array
from collections.abc import Iterator
from typing import Any, NamedTuple

_ENTRY = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p)
# what kernels declare to return that are not shared
OWN: Any = object()


class Returned(NamedTuple):
    """What a kernel returns. kind: "q" or "d" as struct has them, "?", or "" for nothing; of a
    tuple module and name, if it has one, and parts."""

    kind: str
    parts: tuple[Returned, ...] | None = None


def numbers_of(returned: Returned) -> Iterator[str]:
    """Kinds of the numbers in what is returned, in their order."""
    if returned.parts is not None:
        for each in returned.parts:
            yield from numbers_of(each)
    elif returned.kind:
        yield returned.kind


def _rebuilt(returned: Returned, numbers: Iterator[Any]) -> Any:
    """What is returned, of its numbers."""
    if returned.parts is None:
        if not returned.kind:
            return None
        number = next(numbers)
        return bool(number) if returned.kind == "?" else number
    parts = tuple(_rebuilt(each, numbers) for each in returned.parts)
    return _tuple_kind(returned.kind)(*parts) if returned.kind else parts


@functools.cache
def _tuple_kind(name: str) -> Any:
    module, _, own = name.partition(":")
    return getattr(importlib.import_module(module), own)


class Loaded:
    """Machine code that can be called. own: address of what other kernels call."""

    def __init__(self, entry: int, own: int, returned: Returned) -> None:
        self.own, self._entry, self._returned = own, _ENTRY(entry), returned
        kinds = "".join(numbers_of(returned)).replace("?", "q")
        self._layout = struct.Struct(f"={kinds}")

    def __call__(self, words: list[int]) -> Any:
        """Call it with words of arguments, which must live as long."""
        line, result = array("q", words), array("q", bytes(self._layout.size))
        status = self._entry(line.buffer_info()[0], result.buffer_info()[0])
        if status:
            raise RuntimeError(f"a kernel ended with status {status}")
        if not result:
            return None
        return _rebuilt(self._returned, iter(self._layout.unpack(result)))
