"""The types of a kernel's arguments as text, as forms.py tells it of values."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from numba.core import types as numba_types
from numba.np.numpy_support import as_dtype

from featherfx.jit.forms import array_text, tuple_text
from featherfx.jit.struct_pointer import HeldType, Tuples
from featherfx.jit.view_types import KindType


def text_of_types(types: Iterable[Any]) -> str:
    """As forms.text_of, of types."""
    return ", ".join(map(_text, types))


def _text(kind: Any) -> str:
    if isinstance(kind, numba_types.Array):
        held = as_dtype(kind.dtype)
        return array_text(held, kind.ndim, kind.layout, kind.mutable, kind.aligned)
    if isinstance(kind, HeldType):
        return _text(kind.like)
    if isinstance(kind, Tuples):
        return tuple_text(getattr(kind, "instance_class", tuple), map(_text, kind.types))
    if isinstance(kind, KindType):
        return f"kind {_text(kind.types[0])}"
    return str(numba_types.unliteral(kind))
