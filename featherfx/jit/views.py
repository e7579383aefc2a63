"""Named tuples of arrays by address: one kernel reaches batches of many shapes through a table.

A compiled function is made for the types of its arguments, and a list of batches would be a type
of its own for every number of them. Here each batch is a line of numbers: address and shape of
every array in it. Inside a kernel `viewed` makes the named tuple of a line again, without copying.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.jit.compiled import kernel
from featherfx.jit.forms import Kind
from featherfx.jit.lazy_import import Late


class Views(NamedTuple):
    """Tuples of one kind whose arrays have any shapes; words: (N, W) each as a line of numbers."""

    kind: Kind
    words: NDArray[np.int64]


class Held(NamedTuple):
    """Views, and the tuples whose memory they point to: these must live as long as the views."""

    views: Views
    tuples: tuple[Any, ...]


def views_of(tuples: Sequence[Any]) -> Held:
    """Views of named tuples of arrays, nested or not; arrays that are not contiguous are copied."""
    kept = tuple(_contiguous(each) for each in tuples)
    lines = [[word for array in _arrays(each) for word in _words(array)] for each in kept]
    return Held(Views(_kind_of(kept[0]), np.array(lines, dtype=np.int64)), kept)


_KINDS: dict[Any, Kind] = {}


def _kind_of(value: Any) -> Kind:
    """The one kind of all tuples of a type, of whose arrays it takes long to tell."""
    form = _form(value)
    if form not in _KINDS:
        _KINDS[form] = Kind(_like(value))
    return _KINDS[form]


def _like(value: Any) -> Any:
    """A tuple of the same type, which holds nothing."""
    if isinstance(value, np.ndarray):
        return np.empty((0,) * value.ndim, dtype=value.dtype)
    parts = [_like(each) for each in value]
    return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)


def _form(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.dtype, value.ndim
    return type(value), tuple(_form(each) for each in value)


def _contiguous(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        # np.require tells the same in eight times as long
        return value if value.flags.carray else np.require(value, requirements=("C", "W"))
    parts = [_contiguous(each) for each in value]
    return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)


def _arrays(value: Any) -> Iterator[NDArray[Any]]:
    if isinstance(value, np.ndarray):
        yield value
        return
    for each in value:
        yield from _arrays(each)


def _words(array: NDArray[Any]) -> tuple[int, ...]:
    return (array.ctypes.data, *array.shape)


_viewed = Late("featherfx.jit.view_types", "viewed")
# an array in order (its numbers) in another shape of as many (a tuple)
shaped = Late("featherfx.jit.view_types", "shaped")


@kernel
def viewed(views, line):
    """The named tuple of a line of views."""
    return _viewed(views.kind, views.words, line)
