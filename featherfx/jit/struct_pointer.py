"""How kernels see large named tuples of arrays: as the address of a line of words.

numba hands a tuple on field by field, and an array as some ten numbers: a model, a state and what a
step works in are a thousand, which every call of a shared kernel wrote to the stack and read again.
Such a tuple is written once, where Python calls (entry.py) or where a kernel that has made one
calls a shared one (parts.py), to words: of an array address, shape and strides, of a number itself,
tuple in tuple. What reads a field reads these. They stay as they are for as long as a kernel runs,
which LLVM is told.
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
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
from numba.extending import models, register_model
from numba.np import arrayobj

WORD = ir.IntType(64)
# words of a tuple from which on it is held: fewer are handed on field by field, and may be unpacked
LARGE = 40
# untyped: numba's tuples have types, of which their common class does not tell
Tuples: Any = types.BaseTuple


class HeldType(types.Type):
    """A tuple by the address of its words. like: the tuple's own type."""

    def __init__(self, like: Any) -> None:
        super().__init__(name=f"Held({like})")
        self.like = like

    def unify(self, typing_context: Any, other: Any) -> Any:
        """Where a variable is either, it is the tuple."""
        return self.like if other == self.like else None

    def can_convert_to(self, typing_context: Any, other: Any) -> Any:
        return Conversion.safe if other == self.like else None


@register_model(HeldType)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, WORD.as_pointer())


def held(kind: Any) -> Any:
    """The type by which kernels take what is of a type."""
    is_large = isinstance(kind, types.BaseNamedTuple) and words_of(_whole(kind)) >= LARGE
    return HeldType(_whole(kind)) if is_large else kind


def _whole(kind: Any) -> Any:
    """The type with those of held tuples in it as the tuples' own."""
    if isinstance(kind, HeldType):
        return kind.like
    if isinstance(kind, Tuples):
        parts = tuple(map(_whole, kind.types))
        return Tuples.from_types(parts, getattr(kind, "instance_class", None))
    return kind


def room(builder: Any, kind: HeldType) -> Any:
    """A line for the words of a held tuple, on the stack of the function."""
    return cgutils.alloca_once(builder, WORD, size=words_of(kind.like))


def words_of(kind: Any) -> int:
    """How many words what is of a type takes."""
    if isinstance(kind, Tuples):
        return sum(map(words_of, kind.types))
    if isinstance(kind, types.Array):
        return 1 + 2 * int(kind.ndim)
    return 1 if isinstance(kind, types.Number | types.Boolean) else 0


def after(builder: Any, line: Any, words: int) -> Any:
    """The address so many words on."""
    return builder.gep(line, [ir.Constant(WORD, words)])


def keep(context: Any, builder: Any, kind: Any, value: Any, line: Any) -> None:
    """Write a value of a type to words."""
    if isinstance(kind, HeldType):
        for k in range(words_of(kind.like)):
            builder.store(builder.load(after(builder, value, k)), after(builder, line, k))
    elif isinstance(kind, Tuples):
        at = 0
        for k, each in enumerate(kind.types):
            part = builder.extract_value(value, k)
            keep(context, builder, each, part, after(builder, line, at))
            at += words_of(_whole(each))
    elif isinstance(kind, types.Array):
        array = arrayobj.make_array(kind)(context, builder, value)
        words = [
            builder.ptrtoint(array.data, WORD),
            *cgutils.unpack_tuple(builder, array.shape, kind.ndim),
            *cgutils.unpack_tuple(builder, array.strides, kind.ndim),
        ]
        for k, word in enumerate(words):
            builder.store(word, after(builder, line, k))
    elif words_of(kind):
        builder.store(value, builder.bitcast(line, value.type.as_pointer()))


def _read(builder: Any, line: Any, kind: Any) -> Any:
    """A number or an address in a word."""
    value = builder.load(builder.bitcast(line, kind.as_pointer()))
    value.set_metadata("invariant.load", builder.module.add_metadata([]))
    return value


def _value(context: Any, builder: Any, kind: Any, line: Any) -> Any:
    """What is of a type, from its words."""
    if isinstance(kind, Tuples):
        parts, at = [], 0
        for each in kind.types:
            parts.append(_value(context, builder, each, after(builder, line, at)))
            at += words_of(each)
        return context.make_tuple(builder, kind, parts)
    if isinstance(kind, types.Array):
        return _array(context, builder, kind, line)
    if words_of(kind):
        return _read(builder, line, context.get_value_type(kind))
    return context.get_dummy_value()


def _array(context: Any, builder: Any, kind: Any, line: Any) -> Any:
    array = arrayobj.make_array(kind)(context, builder)
    item, count = context.get_data_type(kind.dtype), kind.ndim
    size = context.get_constant(types.intp, context.get_abi_sizeof(item))
    shape = [_read(builder, after(builder, line, 1 + k), WORD) for k in range(count)]
    strides = [_read(builder, after(builder, line, 1 + count + k), WORD) for k in range(count)]
    if kind.layout == "C" and count:
        strides[-1] = size
    data = _read(builder, line, item.as_pointer())
    arrayobj.populate_array(
        array, data=data, shape=shape, strides=strides, itemsize=size, meminfo=None
    )
    return array._getvalue()


def _type_of_field(template: Any, kind: HeldType, name: str) -> Any:
    if name in kind.like.fields:
        return held(kind.like.types[kind.like.fields.index(name)])
    return None


@infer_getattr
class _Fields(AttributeTemplate):
    key = HeldType
    generic_resolve: Any = _type_of_field


@lower_getattr_generic(HeldType)
def _field(context: Any, builder: Any, kind: Any, line: Any, name: str) -> Any:
    """A field of a held tuple; a tuple of arrays in it is held as well."""
    place = kind.like.fields.index(name)
    at = after(builder, line, sum(map(words_of, kind.like.types[:place])))
    field = kind.like.types[place]
    return at if isinstance(held(field), HeldType) else _value(context, builder, field, at)


@infer_global(operator.getitem)
class _Places(AbstractTemplate):
    """Of tuples whose fields are all of one type."""

    def generic(self, args: Any, kws: Any) -> Any:
        kind = args[0]
        if not isinstance(kind, HeldType) or not isinstance(kind.like, types.NamedUniTuple):
            return None
        return signature(held(kind.like.types[0]), kind, types.intp)


@lower_builtin(operator.getitem, HeldType, types.Integer)
def _place(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind = sig.args[0].like.types[0]
    size = ir.Constant(WORD, words_of(kind))
    at = builder.gep(args[0], [builder.mul(args[1], size)])
    return at if isinstance(sig.return_type, HeldType) else _value(context, builder, kind, at)


@lower_cast(HeldType, types.BaseNamedTuple)
def _whole_value(context: Any, builder: Any, kind: Any, to: Any, line: Any) -> Any:
    return _value(context, builder, to, line)
