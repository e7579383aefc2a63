"""What a kernel is called with: as words that its machine code reads, and as the text of its types.

Machine code is for types of arguments. Every call tells them by a form, which costs little to find;
text is the same in every run, and names what is stored.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np

# of an array's flags (ndarray.h): contiguous in C's and in Fortran's order, aligned, writable
_LAID_OUT = 0x1 | 0x2 | 0x100 | 0x400
_BITS = struct.Struct("=d")
_WORD = struct.Struct("=q")


class Kind:
    """Tells kernels the type of a tuple of arrays, and nothing else of it.

    like: such a tuple, whose arrays hold nothing.
    """

    def __init__(self, like: Any) -> None:
        self.like = like


class Call(NamedTuple):
    """A call of a kernel: its form, and a word a number or array. A word of an array is the address
    of its header, which holds data, shape and strides."""

    form: list[Any]
    words: list[int]


def call_of(arguments: tuple[Any, ...]) -> Call:
    """Form and words of arguments, which must live as long as the words. Raises TypeError."""
    call = Call([], [])
    _read(arguments, *call)
    return call


def _read(values: tuple[Any, ...], form: list[Any], words: list[int]) -> None:
    for value in values:
        kind = type(value)
        if kind is np.ndarray:
            form += (value.dtype, value.ndim, value.flags.num & _LAID_OUT)
            words.append(id(value))
        elif kind is float:
            form.append(float)
            words.append(_WORD.unpack(_BITS.pack(value))[0])
        elif kind is int:
            form.append(int)
            words.append(value)
        elif isinstance(value, tuple):
            form += (kind, len(value))
            _read(value, form, words)
        else:
            _read_other(value, form, words)


def _read_other(value: Any, form: list[Any], words: list[int]) -> None:
    if value is None:
        form.append(None)
    elif isinstance(value, Kind):
        form.append(value)
    elif isinstance(value, bool | np.bool_):
        form.append(bool)
        words.append(int(value))
    elif isinstance(value, np.integer) and value.dtype == np.int64:
        form.append(int)
        words.append(int(value))
    elif isinstance(value, np.float32 | np.float64):
        form.append(float if isinstance(value, np.float64) else np.float32)
        words.append(_WORD.unpack(_BITS.pack(float(value)))[0])
    else:
        raise TypeError(f"kernels take no {type(value).__name__}")


def text_of(value: Any) -> str:
    """The type of an argument of a kernel in words, with the names of fields, by whose places code
    reaches them. Raises TypeError."""
    if isinstance(value, np.ndarray):
        flags = value.flags
        layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        return array_text(value.dtype, value.ndim, layout, flags.writeable, flags.aligned)
    if isinstance(value, tuple):
        return tuple_text(type(value), map(text_of, value))
    if isinstance(value, Kind):
        return f"kind {text_of(value.like)}"
    form = call_of((value,)).form[0]
    return {None: "none", bool: "bool", int: "int64", float: "float64"}.get(form, "float32")


def array_text(dtype: Any, axes: int, layout: str, writable: bool, aligned: bool) -> str:
    """Text of an array's type; records count as not aligned, as numba has it."""
    held = dtype.str if dtype.names is None else str(dtype.descr)
    aligned = aligned and dtype.names is None
    return f"{held}:{axes}{layout}{'' if writable else 'r'}{'' if aligned else 'u'}"


def tuple_text(kind: Any, parts: Any) -> str:
    """Text of the type of a tuple, named or not."""
    fields = getattr(kind, "_fields", None)
    name = "" if fields is None else f"{kind.__name__} {' '.join(fields)}"
    return f"({name}: {', '.join(parts)})"
