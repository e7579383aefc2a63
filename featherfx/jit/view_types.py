"""How kernels see views of arrays and of named tuples of them (views.py)."""

from __future__ import annotations

from typing import Any

from numba import typeof
from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.extending import (
    NativeValue,
    intrinsic,
    models,
    register_model,
    typeof_impl,
    unbox,
)
from numba.np import arrayobj

from featherfx.jit.forms import Kind


class KindType(types.Type):
    """How kernels see a Kind. types: of the tuple."""

    def __init__(self, like: Any) -> None:
        super().__init__(name=f"Kind({like})")
        self.types = (like,)


register_model(KindType)(models.OpaqueModel)


@typeof_impl.register(Kind)
def _typeof_kind(value: Any, context: Any) -> Any:
    return KindType(typeof(value.like))


@unbox(KindType)
def _unbox_kind(kind: Any, value: Any, context: Any) -> Any:
    """For kernels that are compiled by numba's own ways (plain.py)."""
    return NativeValue(context.context.get_dummy_value())


@intrinsic
def viewed(typing_context: Any, kind: Any, words: Any, line: Any) -> Any:
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
    data = builder.inttoptr(word(), context.get_data_type(kind.dtype).as_pointer())
    return _array(context, builder, kind, data, [word() for _ in range(kind.ndim)])


def _array(context: Any, builder: Any, kind: Any, data: Any, shape: list[Any]) -> Any:
    """An array whose numbers are in order."""
    array = arrayobj.make_array(kind)(context, builder)
    item = context.get_data_type(kind.dtype)
    size = context.get_constant(types.intp, context.get_abi_sizeof(item))
    strides, step = [size], size
    for length in reversed(shape[1:]):
        step = builder.mul(step, length)
        strides.insert(0, step)
    arrayobj.populate_array(
        array, data=data, shape=shape, strides=strides, itemsize=size, meminfo=None
    )
    return array._getvalue()


@intrinsic
def shaped(typing_context: Any, array: Any, shape: Any) -> Any:
    """The numbers of an array in order, in another shape of as many."""
    if array.layout != "C":
        raise TypingError(f"only arrays in order can have another shape, not {array}")
    kind = array.copy(ndim=len(shape))

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        whole = context.make_array(array)(context, builder, arguments[0])
        lengths = cgutils.unpack_tuple(builder, arguments[1])
        return _array(context, builder, kind, whole.data, lengths)

    return kind(array, shape), code
