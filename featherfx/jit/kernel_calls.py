"""Calls of machine code: arguments become words, and words become a result.

Machine code is made for types of arguments. A call finds it by its form, which is cheap to read.
A text of the types is the same in every run and names what is stored.
"""

from __future__ import annotations

import ctypes
import functools
import importlib
import re
import struct
from array import array
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

# flags of an array (ndarray.h): contiguous in C's and in Fortran's order, aligned, writable
_LAYOUT_FLAGS = 0x1 | 0x2 | 0x100 | 0x400
_FLOAT = struct.Struct("=d")
_WORD = struct.Struct("=q")
_ENTRY = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p)
_NUMBERS = {"none": None, "bool": False, "int64": 0, "float64": 0.0, "float32": np.float32(0.0)}
# parts of a text of types: where a tuple begins, with its class or none; an array or number; an end
_PART = re.compile(r"(kind )?\((?:([^:()]+:[^ :()]+)[^:()]*)?: |([^(), ]+)|(\))")
# `returns` of kernels that are linked into their callers
INLINED: Any = object()
# by the types of items of an argument
_FORMS: dict[tuple[Any, ...], object] = {}
# modules of intrinsics
_INTRINSIC_MODULES: list[str] = []


class Intrinsic:
    """A function for kernels whose module needs numba; imported when a kernel is compiled."""

    def __init__(self, module: str, name: str) -> None:
        self._module, self._name = module, name
        if module not in _INTRINSIC_MODULES:
            _INTRINSIC_MODULES.append(module)

    @property
    def _numba_type_(self) -> Any:
        from numba.core.registry import cpu_target

        meant = getattr(importlib.import_module(self._module), self._name)
        return cpu_target.typing_context.resolve_value_type(meant)


def import_intrinsics() -> None:
    """Import all modules of intrinsics, before anything is compiled."""
    for each in _INTRINSIC_MODULES:
        importlib.import_module(each)


def find_kernel(name: str) -> Any:
    """The kernel of a module and name."""
    module, _, own = name.rpartition(".")
    return getattr(importlib.import_module(module), own)


class TupleKind:
    """The type of a tuple of arrays as an argument of a kernel.

    like: such a tuple with empty arrays.
    """

    def __init__(self, like: Any) -> None:
        self.like = like


class Encoded:
    """An argument of calls that follow each other, encoded once. The layouts of its arrays stay.

    form: stands for the types of its items.
    """

    __slots__ = ("form", "value", "words")

    def __init__(self, value: Any) -> None:
        form, self.words = encode_arguments((value,))
        self.form, self.value = _FORMS.setdefault(tuple(form), object()), value


def encode_arguments(arguments: tuple[Any, ...]) -> tuple[list[Any], list[int]]:
    """Form and words of arguments, which must live as long as the words. Raises TypeError.

    form: types, hashable item by item. words: a number as its bits, an array as the address of its
    header, which holds data, shape and strides.
    """
    form: list[Any] = []
    words: list[int] = []
    _encode(arguments, form, words)
    return form, words


def _encode(values: tuple[Any, ...], form: list[Any], words: list[int]) -> None:
    for value in values:
        kind = type(value)
        if kind is np.ndarray:
            form += (value.dtype, value.ndim, value.flags.num & _LAYOUT_FLAGS)
            words.append(id(value))
        elif kind is float or kind is np.float64 or kind is np.float32:
            form.append(np.float32 if kind is np.float32 else float)
            words.append(_WORD.unpack(_FLOAT.pack(value))[0])
        elif kind is int or kind is np.int64:
            form.append(int)
            words.append(int(value))
        elif isinstance(value, tuple):
            form += (kind, len(value))
            _encode(value, form, words)
        elif kind is Encoded:
            form.append(value.form)
            words += value.words
        elif value is None or kind is TupleKind:
            form.append(value)
        elif kind is bool or kind is np.bool_:
            form.append(bool)
            words.append(int(value))
        else:
            raise TypeError(f"Kernels take numbers, arrays and tuples of them, no {kind.__name__}.")


def describe_arguments(arguments: Iterable[Any]) -> str:
    """Text of the types of arguments. Raises TypeError."""
    return ", ".join(map(describe_argument, arguments))


def describe_argument(value: Any) -> str:
    """Text of an argument's type, with the names of fields. Raises TypeError."""
    if isinstance(value, np.ndarray):
        flags = value.flags
        layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        return describe_array(value.dtype, value.ndim, layout, flags.writeable, flags.aligned)
    if isinstance(value, tuple):
        return describe_tuple(type(value), map(describe_argument, value))
    if isinstance(value, Encoded):
        return describe_argument(value.value)
    if isinstance(value, TupleKind):
        return f"kind {describe_argument(value.like)}"
    form = encode_arguments((value,))[0][0]
    return {None: "none", bool: "bool", int: "int64", float: "float64"}.get(form, "float32")


def describe_array(dtype: Any, axes: int, layout: str, writable: bool, aligned: bool) -> str:
    """Text of an array's type; numba counts records as not aligned."""
    item = dtype.str if dtype.names is None else str(dtype.descr)
    aligned = aligned and dtype.names is None
    return f"{item}:{axes}{layout}{'' if writable else 'r'}{'' if aligned else 'u'}"


def describe_tuple(kind: Any, parts: Iterable[str]) -> str:
    """Text of the type of a tuple, named or not."""
    fields = getattr(kind, "_fields", None)
    name = f"{kind.__module__}:{kind.__qualname__} {' '.join(fields)}" if fields else ""
    return f"({name}: {', '.join(parts)})"


def make_arguments(text: str) -> tuple[Any, ...]:
    """Arguments of the types that a text of `describe_arguments` tells, with empty arrays.

    Raises ImportError or AttributeError for a tuple that there is no more, TypeError for another
    number of fields. It must have no arrays of records.
    """
    outer: list[tuple[str, str, list[Any]]] = []
    parts: list[Any] = []
    for kind, name, leaf, end in _PART.findall(text):
        if leaf:
            parts.append(_make_argument(leaf))
        elif not end:
            outer.append((kind, name, parts))
            parts = []
        else:
            kind, name, before = outer.pop()
            made = _find_tuple_class(name)._make(parts) if name else tuple(parts)
            parts = [*before, TupleKind(made) if kind else made]
    return tuple(parts)


def _make_argument(text: str) -> Any:
    """An array or a number of a type."""
    if ":" not in text:
        return _NUMBERS[text]
    dtype, _, form = text.partition(":")
    axes, layout = int(form[0]), form[1]
    whole = np.empty((4,) * axes, np.dtype(dtype), "F" if layout == "F" else "C")
    made = whole[..., ::2] if layout == "A" else whole
    made.flags.writeable = "r" not in form
    return made


class ReturnType(NamedTuple):
    """The type that a kernel returns.

    kind: "q" or "d" as struct has them, "?", or "" for nothing; of a tuple its module and name,
    empty where it has none. parts: of a tuple.
    """

    kind: str
    parts: tuple[ReturnType, ...] | None = None


class KernelLink(NamedTuple):
    """A shared kernel that machine code calls.

    symbol: its name in machine code. name: module and name. text: of its arguments.
    """

    symbol: str
    name: str
    text: str


class StoredKernel(NamedTuple):
    """Machine code of a kernel for some types of arguments.

    machine: an object file. entry: symbol of the function that reads words. own: symbol of the
    function that other kernels call.
    """

    machine: bytes
    entry: str
    own: str
    returns: ReturnType
    links: tuple[KernelLink, ...]


class LoadedKernel:
    """Machine code in memory. own: address of the function that other kernels call."""

    def __init__(self, entry: int, own: int, returns: ReturnType) -> None:
        self.own, self._entry, self._returns = own, _ENTRY(entry), returns
        self._layout = struct.Struct(f"={''.join(_list_numbers(returns))}")

    def __call__(self, words: list[int]) -> Any:
        """Call it with words of arguments, which must live as long."""
        line, result = array("q", words), array("q", bytes(self._layout.size))
        status = self._entry(line.buffer_info()[0], result.buffer_info()[0])
        if status:
            raise RuntimeError(f"A kernel ended with status {status}.")
        return _rebuild(self._returns, iter(self._layout.unpack(result))) if result else None


def _list_numbers(returns: ReturnType) -> Iterator[str]:
    """Formats of the numbers in a result, in their order."""
    if returns.parts is not None:
        for each in returns.parts:
            yield from _list_numbers(each)
    else:
        yield returns.kind.replace("?", "q")


def _rebuild(returns: ReturnType, numbers: Iterator[Any]) -> Any:
    """Make a result of its numbers."""
    if returns.parts is None:
        number = next(numbers) if returns.kind else None
        return bool(number) if returns.kind == "?" else number
    parts = tuple(_rebuild(each, numbers) for each in returns.parts)
    return _find_tuple_class(returns.kind)(*parts) if returns.kind else parts


@functools.cache
def _find_tuple_class(name: str) -> Any:
    module, _, own = name.partition(":")
    return getattr(importlib.import_module(module), own)
