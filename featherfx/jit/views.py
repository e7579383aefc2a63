"""Named tuples of arrays by address: one kernel reaches batches of many shapes through a table.

A compiled function is made for the types of its arguments, and a list of batches would be a type
of its own for every number of them. Here each batch is a line of numbers: address and shape of
every array in it. Inside a kernel `viewed` makes the named tuple of a line again, without copying.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import typeof
from numba.core import types
from numba.extending import NativeValue, intrinsic, models, register_model, typeof_impl, unbox
from numba.np import arrayobj
from numpy.typing import NDArray

from featherfx.jit.compiled import kernel


class Kind:
    """Tells kernels the type of a tuple of arrays, and nothing else of it. like: such a tuple."""

    def __init__(self, like: Any) -> None:
        self.type = KindType(typeof(like))


class KindType(types.Type):
    """How kernels see a Kind. types: of the tuple."""

    def __init__(self, like: Any) -> None:
        super().__init__(name=f"Kind({like})")
        self.types = (like,)


register_model(KindType)(models.OpaqueModel)


@typeof_impl.register(Kind)
def _typeof_kind(value: Any, context: Any) -> Any:
    return value.type


@unbox(KindType)
def _unbox_kind(kind: Any, value: Any, context: Any) -> Any:
    return NativeValue(context.context.get_dummy_value())


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
        _KINDS[form] = Kind(value)
    return _KINDS[form]


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


@intrinsic
def _viewed(typing_context: Any, kind: Any, words: Any, line: Any) -> Any:
    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        whole = context.make_array(words)(context, builder, arguments[1])
        width = builder.extract_value(whole.shape, 1)
        start = builder.gep(whole.data, [builder.mul(arguments[2], width)])
        places = iter(range(1 << 16))

        def word() -> Any:
            at = context.get_constant(types.intp, next(places))
            return builder.load(builder.gep(start, [at]))

        return _built(context, builder, kind.types[0], word)

    return kind.types[0](kind, words, types.intp), code


def _built(context: Any, builder: Any, kind: Any, word: Any) -> Any:
    """A value of a type from the words that come next."""
    if not isinstance(kind, types.Array):
        parts = [_built(context, builder, each, word) for each in kind.types]
        return context.make_tuple(builder, kind, parts)
    array = arrayobj.make_array(kind)(context, builder)
    item = context.get_data_type(kind.dtype)
    data = builder.inttoptr(word(), item.as_pointer())
    shape = [word() for _ in range(kind.ndim)]
    size = context.get_constant(types.intp, context.get_abi_sizeof(item))
    strides, step = [size], size
    for length in reversed(shape[1:]):
        step = builder.mul(step, length)
        strides.insert(0, step)
    arrayobj.populate_array(
        array, data=data, shape=shape, strides=strides, itemsize=size, meminfo=None
    )
    return array._getvalue()


@kernel
def viewed(views, line):
    """The named tuple of a line of views."""
    return _viewed(views.kind, views.words, line)
