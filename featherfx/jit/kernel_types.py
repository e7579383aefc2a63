"""Types of kernel arguments, lowered in numba: words, struct pointers, views, atomic counters.

numba hands a tuple on field by field, and an array as some ten numbers: a model and a state are a
thousand. A large tuple is a StructPointer here. It is written once to a line of words, where Python
calls or where a kernel that has made one calls a shared kernel: an array as its address, shape and
strides, a number as itself, tuples part by part. Code that reads a field reads these words. They
stay as they are for as long as a kernel runs, which LLVM is told.
"""

from __future__ import annotations

import operator
from collections.abc import Iterator
from typing import Any

from llvmlite import ir
from numba import typeof
from numba.core import cgutils, types
from numba.core.imputils import lower_builtin, lower_cast, lower_getattr_generic
from numba.core.typeconv import Conversion
from numba.core.typing.templates import (
    AbstractTemplate,
    AttributeTemplate,
    infer_getattr,
    infer_global,
    signature,
)
from numba.extending import models, register_model, typeof_impl
from numba.np import arrayobj

from featherfx.jit.kernel_calls import TupleKind

WORD = ir.IntType(64)
WORDS = WORD.as_pointer()
# words of a tuple from which on it is a StructPointer; smaller ones may be unpacked in kernels
MIN_POINTER_WORDS = 40
# untyped: numba's tuples have types, which their common class does not declare
Tuples: Any = types.BaseTuple
# words of an array's header (PyArrayObject_fields, ndarraytypes.h) after those of all objects:
# data, number of axes, shape, strides
_HEADER = object.__basicsize__ // 8
_DATA, _SHAPE, _STRIDES = _HEADER, _HEADER + 2, _HEADER + 3


class StructPointer(types.Type):
    """The type of a tuple by the address of its words. like: the tuple's own type."""

    def __init__(self, like: Any) -> None:
        super().__init__(name=f"StructPointer({like})")
        self.like = like

    def unify(self, typing_context: Any, other: Any) -> Any:
        """Unify to the tuple where a variable is either."""
        return self.like if other == self.like else None

    def can_convert_to(self, typing_context: Any, other: Any) -> Any:
        return Conversion.safe if other == self.like else None


@register_model(StructPointer)
class _PointerModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, WORDS)


class KindType(types.Type):
    """The type of a TupleKind. like: the type of the tuple."""

    def __init__(self, like: Any) -> None:
        super().__init__(name=f"TupleKind({like})")
        self.like = like


register_model(KindType)(models.OpaqueModel)


@typeof_impl.register(TupleKind)
def _typeof_kind(value: Any, context: Any) -> Any:
    return KindType(typeof(value.like))


def as_argument(kind: Any) -> Any:
    """The type by which kernels take values of a type."""
    whole = _replace_pointers(kind)
    is_large = isinstance(kind, types.BaseNamedTuple) and count_words(whole) >= MIN_POINTER_WORDS
    return StructPointer(whole) if is_large else kind


def _replace_pointers(kind: Any) -> Any:
    """The type with those of struct pointers in it as the tuples' own."""
    if isinstance(kind, StructPointer):
        return kind.like
    if isinstance(kind, Tuples):
        parts = tuple(map(_replace_pointers, kind.types))
        return Tuples.from_types(parts, getattr(kind, "instance_class", None))
    return kind


def count_words(kind: Any) -> int:
    """Number of words of a value of a type."""
    if isinstance(kind, Tuples):
        return sum(map(count_words, kind.types))
    if isinstance(kind, types.Array):
        return 1 + 2 * int(kind.ndim)
    return 1 if isinstance(kind, types.Number | types.Boolean) else 0


def step(builder: Any, line: Any, words: int) -> Any:
    """The address so many words on."""
    return builder.gep(line, [ir.Constant(WORD, words)])


def allocate_words(builder: Any, kind: StructPointer) -> Any:
    """A line for the words of a tuple, on the stack of the function."""
    return cgutils.alloca_once(builder, WORD, size=count_words(kind.like))


def build_array(
    context: Any, builder: Any, kind: Any, data: Any, shape: Any, strides: Any = None
) -> Any:
    """An array of its parts; without strides its numbers are in order."""
    array = arrayobj.make_array(kind)(context, builder)
    size = context.get_constant(
        types.intp, context.get_abi_sizeof(context.get_data_type(kind.dtype))
    )
    if strides is None:
        strides, stride = [size], size
        for length in reversed(shape[1:]):
            stride = builder.mul(stride, length)
            strides.insert(0, stride)
    arrayobj.populate_array(
        array, data=data, shape=shape, strides=strides, itemsize=size, meminfo=None
    )
    return array._getvalue()


def write_words(context: Any, builder: Any, kind: Any, value: Any, line: Any) -> None:
    """Write a value of a type to a line of words."""
    if isinstance(kind, StructPointer):
        for k in range(count_words(kind.like)):
            builder.store(builder.load(step(builder, value, k)), step(builder, line, k))
    elif isinstance(kind, Tuples):
        at = 0
        for k, each in enumerate(kind.types):
            part = builder.extract_value(value, k)
            write_words(context, builder, each, part, step(builder, line, at))
            at += count_words(_replace_pointers(each))
    elif isinstance(kind, types.Array):
        array = arrayobj.make_array(kind)(context, builder, value)
        words = [
            builder.ptrtoint(array.data, WORD),
            *cgutils.unpack_tuple(builder, array.shape, kind.ndim),
            *cgutils.unpack_tuple(builder, array.strides, kind.ndim),
        ]
        for k, word in enumerate(words):
            builder.store(word, step(builder, line, k))
    elif count_words(kind):
        builder.store(value, builder.bitcast(line, value.type.as_pointer()))


def read_words(context: Any, builder: Any, kind: Any, line: Any) -> Any:
    """Read a value of a type from a line of words."""

    def read(at: int, kind: Any) -> Any:
        place = builder.bitcast(step(builder, line, at), kind.as_pointer())
        value = builder.load(place)
        value.set_metadata("invariant.load", builder.module.add_metadata([]))
        return value

    if isinstance(kind, Tuples):
        parts, at = [], 0
        for each in kind.types:
            parts.append(read_words(context, builder, each, step(builder, line, at)))
            at += count_words(each)
        return context.make_tuple(builder, kind, parts)
    if isinstance(kind, types.Array):
        item, axes = context.get_data_type(kind.dtype), kind.ndim
        shape = [read(1 + k, WORD) for k in range(axes)]
        strides = [read(1 + axes + k, WORD) for k in range(axes)]
        if kind.layout == "C" and axes:
            strides[-1] = context.get_constant(types.intp, context.get_abi_sizeof(item))
        return build_array(context, builder, kind, read(0, item.as_pointer()), shape, strides)
    if count_words(kind):
        return read(0, context.get_value_type(kind))
    return context.get_dummy_value()


def decode_arguments(context: Any, builder: Any, kinds: Any, words: Iterator[Any]) -> list[Any]:
    """Values of arguments from the words of a call (kernel_calls.py)."""
    found = []
    for kind in kinds:
        whole = _replace_pointers(kind)
        line = cgutils.alloca_once(builder, WORD, size=max(1, count_words(whole)))
        _copy_words(builder, whole, words, line)
        is_pointer = isinstance(kind, StructPointer)
        found.append(line if is_pointer else read_words(context, builder, kind, line))
    return found


def _copy_words(builder: Any, kind: Any, words: Iterator[Any], line: Any) -> None:
    """Write the words of a call to a line: headers of arrays become addresses and sizes."""
    if isinstance(kind, Tuples):
        at = 0
        for each in kind.types:
            _copy_words(builder, each, words, step(builder, line, at))
            at += count_words(each)
    elif isinstance(kind, types.Array):
        header = builder.inttoptr(next(words), WORDS)
        data, shape, strides = (
            builder.load(step(builder, header, k)) for k in (_DATA, _SHAPE, _STRIDES)
        )
        builder.store(data, line)
        for k, sizes in enumerate((shape, strides)):
            for axis in range(kind.ndim):
                size = builder.load(step(builder, builder.inttoptr(sizes, WORDS), axis))
                builder.store(size, step(builder, line, 1 + k * kind.ndim + axis))
    elif kind == types.float32:
        value = builder.fptrunc(builder.bitcast(next(words), ir.DoubleType()), ir.FloatType())
        builder.store(value, builder.bitcast(line, ir.FloatType().as_pointer()))
    elif count_words(kind):
        builder.store(next(words), line)


def encode_result(builder: Any, kind: Any, value: Any) -> Iterator[Any]:
    """The numbers of a result, as words."""
    if isinstance(kind, Tuples):
        for k, each in enumerate(kind.types):
            yield from encode_result(builder, each, builder.extract_value(value, k))
    elif kind == types.boolean:
        yield builder.zext(value, WORD)
    elif kind == types.float64:
        yield builder.bitcast(value, WORD)
    elif kind != types.none:
        yield value


def _resolve_field(template: Any, kind: StructPointer, name: str) -> Any:
    if name in kind.like.fields:
        return as_argument(kind.like.types[kind.like.fields.index(name)])
    return None


@infer_getattr
class _Fields(AttributeTemplate):
    key = StructPointer
    generic_resolve: Any = _resolve_field


@lower_getattr_generic(StructPointer)
def _read_field(context: Any, builder: Any, kind: Any, line: Any, name: str) -> Any:
    """A field of a tuple; a large tuple in it is a pointer as well."""
    place = kind.like.fields.index(name)
    at = step(builder, line, sum(map(count_words, kind.like.types[:place])))
    field = kind.like.types[place]
    if isinstance(as_argument(field), StructPointer):
        return at
    return read_words(context, builder, field, at)


@infer_global(operator.getitem)
class _Places(AbstractTemplate):
    """Places of tuples whose fields are all of one type."""

    def generic(self, args: Any, kws: Any) -> Any:
        kind = args[0]
        if not isinstance(kind, StructPointer) or not isinstance(kind.like, types.NamedUniTuple):
            return None
        return signature(as_argument(kind.like.types[0]), kind, types.intp)


@lower_builtin(operator.getitem, StructPointer, types.Integer)
def _read_place(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind = sig.args[0].like.types[0]
    at = builder.gep(args[0], [builder.mul(args[1], ir.Constant(WORD, count_words(kind)))])
    if isinstance(sig.return_type, StructPointer):
        return at
    return read_words(context, builder, kind, at)


@lower_cast(StructPointer, types.BaseNamedTuple)
def _read_whole(context: Any, builder: Any, kind: Any, to: Any, line: Any) -> Any:
    return read_words(context, builder, to, line)
