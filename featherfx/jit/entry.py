"""What Python calls of a kernel: a function that reads its arguments from words (forms.py).

numba's own takes Python's objects, by functions of numba's libraries. This one reads no more than
words and the headers of arrays, whose fields' places are part of numpy's ABI, so stored code needs
neither numba nor LLVM to run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.compiler_machinery import register_pass
from numba.np import arrayobj

from featherfx.jit.lowering import KernelLower, KernelLowering
from featherfx.jit.struct_pointer import HeldType, Tuples, after, keep, room, words_of

# name of the module that holds it
WRAPPER = "wrapper"
_WORD, _STATUS = ir.IntType(64), ir.IntType(32)
_WORDS = _WORD.as_pointer()
# words of an array's header (PyArrayObject_fields, ndarraytypes.h) after what all objects have:
# data, number of axes, shape, strides
_HEAD = object.__basicsize__ // 8
_DATA, _SHAPE, _STRIDES = _HEAD, _HEAD + 2, _HEAD + 3


class EntryLower(KernelLower):
    """As KernelLower, with what Python calls."""

    def create_cpython_wrapper(self, release_gil: bool = False) -> None:
        context, described = self.context, self.fndesc
        module = context.create_module(WRAPPER)
        kind = context.call_conv.get_function_type(described.restype, described.argtypes)
        own = ir.Function(module, kind, described.llvm_func_name)
        kind = ir.FunctionType(_STATUS, (_WORDS, _WORDS))
        entry = ir.Function(module, kind, described.llvm_cpython_wrapper_name)
        builder = ir.IRBuilder(entry.append_basic_block())
        words = _words(builder, entry.args[0])
        given = [_argument(context, builder, each, words) for each in described.argtypes]
        status, value = context.call_conv.call_function(
            builder, own, described.restype, described.argtypes, given, attrs=("noinline",)
        )
        with builder.if_then(status.is_ok):
            places = iter(range(1 << 16))
            for number in _numbers(builder, described.restype, value):
                builder.store(number, _place(builder, entry.args[1], next(places)))
        # nothing returned is told by a status of its own
        builder.ret(builder.select(status.is_ok, ir.Constant(_STATUS, 0), status.code))
        self.library.add_ir_module(module)


@register_pass(mutates_CFG=True, analysis_only=False)
class EntryLowering(KernelLowering):
    """numba's step from typed to LLVM's intermediate code, by EntryLower."""

    _name = "entry_lowering"

    @property
    def lowering_class(self) -> type[EntryLower]:
        return EntryLower


def _place(builder: Any, line: Any, k: int) -> Any:
    return builder.gep(line, [ir.Constant(_WORD, k)])


def _words(builder: Any, line: Any) -> Iterator[Any]:
    """The words of a line, one after another."""
    for k in range(1 << 16):
        yield builder.load(_place(builder, line, k))


def _argument(context: Any, builder: Any, kind: Any, words: Iterator[Any]) -> Any:
    """A value of a type from the words that come next."""
    if isinstance(kind, HeldType):
        line = room(builder, kind)
        _write(context, builder, kind.like, words, line)
        return line
    if isinstance(kind, Tuples):
        parts = [_argument(context, builder, each, words) for each in kind.types]
        return context.make_tuple(builder, kind, parts)
    if isinstance(kind, types.Array):
        return _array(context, builder, kind, next(words))
    reader = _READERS.get(kind)
    return context.get_dummy_value() if reader is None else reader(builder, next(words))


def _write(context: Any, builder: Any, kind: Any, words: Iterator[Any], line: Any) -> None:
    """Words of what is held, from those that come next."""
    if not isinstance(kind, Tuples):
        keep(context, builder, kind, _argument(context, builder, kind, words), line)
        return
    at = 0
    for each in kind.types:
        _write(context, builder, each, words, after(builder, line, at))
        at += words_of(each)


_READERS: dict[Any, Callable[[Any, Any], Any]] = {
    types.int64: lambda builder, word: word,
    types.boolean: lambda builder, word: builder.trunc(word, ir.IntType(1)),
    types.float64: lambda builder, word: builder.bitcast(word, ir.DoubleType()),
    types.float32: lambda builder, word: builder.fptrunc(
        builder.bitcast(word, ir.DoubleType()), ir.FloatType()
    ),
}


def _array(context: Any, builder: Any, kind: Any, word: Any) -> Any:
    """An array of which a word is the address of the header."""
    header = builder.inttoptr(word, _WORDS)
    array = arrayobj.make_array(kind)(context, builder)
    item = context.get_data_type(kind.dtype)
    data, shape, strides = (
        builder.load(_place(builder, header, k)) for k in (_DATA, _SHAPE, _STRIDES)
    )
    sizes, steps = (
        [builder.load(_place(builder, builder.inttoptr(each, _WORDS), k)) for k in range(kind.ndim)]
        for each in (shape, strides)
    )
    arrayobj.populate_array(
        array,
        data=builder.inttoptr(data, item.as_pointer()),
        shape=sizes,
        strides=steps,
        itemsize=context.get_constant(types.intp, context.get_abi_sizeof(item)),
        meminfo=None,
    )
    return array._getvalue()


def _numbers(builder: Any, kind: Any, value: Any) -> Iterator[Any]:
    """The numbers of what a kernel returns, as words."""
    if isinstance(kind, Tuples):
        for k, each in enumerate(kind.types):
            yield from _numbers(builder, each, builder.extract_value(value, k))
    elif kind == types.boolean:
        yield builder.zext(value, _WORD)
    elif kind == types.float64:
        yield builder.bitcast(value, _WORD)
    elif kind != types.none:
        yield value
