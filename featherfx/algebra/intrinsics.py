"""Functions of kernels as LLVM does them: lanes (views.py) are a vector of the processor, views
(views.py) lines of words, and counters of teams (views.py) atomic."""

from __future__ import annotations

import ctypes
import math
import operator
import os
from collections.abc import Callable
from typing import Any, ClassVar

from llvmlite import binding, ir
from numba.core import cgutils, types
from numba.core.cgutils import get_or_insert_function
from numba.core.errors import TypingError
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model

from featherfx.algebra.views import COUNT
from featherfx.jit.kernel_types import build_array, read_words

_VECTOR = ir.VectorType(ir.DoubleType(), COUNT)
# arrays are aligned as their numbers are
_ALIGN = 8


class _Lanes(types.Type):
    def __init__(self) -> None:
        super().__init__("lanes")


LANES: Any = _Lanes()


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


def _spread(builder: Any, value: Any) -> Any:
    """Four equal numbers; what is four already stays."""
    if value.type == _VECTOR:
        return value
    one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, _index(0))
    return builder.shuffle_vector(one, one, _mask(0, 0, 0, 0))


def _index(k: int) -> Any:
    return ir.Constant(ir.IntType(32), k)


def _mask(*places: int) -> Any:
    return ir.Constant(ir.VectorType(ir.IntType(32), COUNT), list(places))


def _declare(function: Any, emit: Callable[[Any, Any, Any], Any]) -> None:
    """Let kernels call a function of two numbers with lanes for either of them or both."""
    pairs = (LANES, LANES), (LANES, types.float64), (types.float64, LANES)

    @infer_global(function)
    class _Typed(ConcreteTemplate):
        cases: ClassVar = [signature(LANES, *pair) for pair in pairs]

    for pair in pairs:

        @lower_builtin(function, *pair)
        def lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return emit(builder, *(_spread(builder, each) for each in args))


def _larger(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered(">", a, b), a, b)


def _smaller(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered("<", a, b), a, b)


_declare(operator.add, lambda builder, a, b: builder.fadd(a, b))
_declare(operator.sub, lambda builder, a, b: builder.fsub(a, b))
_declare(operator.mul, lambda builder, a, b: builder.fmul(a, b))
_declare(operator.truediv, lambda builder, a, b: builder.fdiv(a, b))
_declare(max, _larger)
_declare(min, _smaller)


def _declare_single(function: Any, emit: Callable[[Any, Any], Any]) -> None:
    """As _declare, of one number."""

    @infer_global(function)
    class _Typed(ConcreteTemplate):
        cases: ClassVar = [signature(LANES, LANES)]

    @lower_builtin(function, LANES)
    def lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return emit(builder, args[0])


def _by_llvm(name: str) -> Callable[[Any, Any], Any]:
    """A function of LLVM's own."""
    kind = ir.FunctionType(_VECTOR, (_VECTOR,))

    def emit(builder: Any, value: Any) -> Any:
        function = get_or_insert_function(builder.module, kind, f"llvm.{name}.v{COUNT}f64")
        return builder.call(function, (value,))

    return emit


_declare_single(operator.neg, lambda builder, value: builder.fneg(value))
_declare_single(math.sqrt, _by_llvm("sqrt"))
_declare_single(math.ceil, _by_llvm("ceil"))


def _place(context: Any, builder: Any, kind: Any, line: Any, first: Any) -> Any:
    data = context.make_array(kind)(context, builder, line).data
    return builder.bitcast(builder.gep(data, [first]), _VECTOR.as_pointer())


@intrinsic
def load(typing: Any, line: Any, first: Any) -> Any:
    """The four numbers of a line (.,) from one of them on; the line's are neighbours in memory."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = _place(context, builder, sig.args[0], *args)
        return builder.load(place, align=_ALIGN)

    return LANES(line, types.intp), emit


@intrinsic
def put(typing: Any, line: Any, first: Any, value: Any) -> Any:
    """Write four numbers to a line (.,), from one of its places on."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = _place(context, builder, sig.args[0], *args[:2])
        builder.store(args[2], place, align=_ALIGN)
        return context.get_dummy_value()

    return types.void(line, types.intp, LANES), emit


@intrinsic
def spread(typing: Any, value: Any) -> Any:
    """Four equal numbers."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _spread(builder, args[0])

    return LANES(types.float64), emit


@intrinsic
def lane(typing: Any, value: Any, k: Any) -> Any:
    """One of four numbers."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.extract_element(*args)

    return types.float64(LANES, types.intp), emit


@intrinsic
def increase(typing: Any, line: Any, place: Any, value: Any) -> Any:
    """Add a number to one of a line (.,), at a place that is not counted from its end."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        number = builder.gep(data, [args[1]])
        builder.store(builder.fadd(builder.load(number), args[2]), number)
        return context.get_dummy_value()

    return types.void(line, types.intp, types.float64), emit


@intrinsic
def follow(typing: Any, before: Any, value: Any) -> Any:
    """The last of four numbers and the first three of the next four."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.shuffle_vector(*args, _mask(3, 4, 5, 6))

    return LANES(LANES, LANES), emit


@intrinsic
def transposed(typing: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """The first numbers of all four, the second ones, and so on."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        low, high = _mask(0, 4, 2, 6), _mask(1, 5, 3, 7)
        pairs = [builder.shuffle_vector(*args[k : k + 2], m) for k in (0, 2) for m in (low, high)]
        first, last = _mask(0, 1, 4, 5), _mask(2, 3, 6, 7)
        lines = [
            builder.shuffle_vector(pairs[k], pairs[k + 2], m) for m in (first, last) for k in (0, 1)
        ]
        return context.make_tuple(builder, sig.return_type, lines)

    return types.UniTuple(LANES, COUNT)(LANES, LANES, LANES, LANES), emit


@intrinsic
def totals(typing: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """Sums of the four numbers of each."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        def pairs(x: Any, y: Any, even: Any, odd: Any) -> Any:
            return builder.fadd(
                builder.shuffle_vector(x, y, even), builder.shuffle_vector(x, y, odd)
            )

        low = pairs(args[0], args[1], _mask(0, 4, 2, 6), _mask(1, 5, 3, 7))
        high = pairs(args[2], args[3], _mask(0, 4, 2, 6), _mask(1, 5, 3, 7))
        return pairs(low, high, _mask(0, 1, 4, 5), _mask(2, 3, 6, 7))

    return LANES(LANES, LANES, LANES, LANES), emit


@intrinsic
def where_there(typing: Any, weight: Any, value: Any) -> Any:
    """The numbers where a weight is not zero, else zero, also where they are none."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        nothing = ir.Constant(_VECTOR, [0.0] * COUNT)
        return builder.select(builder.fcmp_unordered("!=", args[0], nothing), args[1], nothing)

    return LANES(LANES, LANES), emit


@intrinsic
def chosen(typing: Any, a: Any, b: Any, larger: Any, other: Any) -> Any:
    """The numbers of larger where a is above b, else those of other."""

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", args[0], args[1]), args[2], args[3])

    return LANES(LANES, LANES, LANES, LANES), emit


@intrinsic
def viewed(typing_context: Any, kind: Any, words: Any, line: Any) -> Any:
    """The tuple of a line of words (views.py)."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        whole = context.make_array(words)(context, builder, args[1])
        width = builder.extract_value(whole.shape, 1)
        start = builder.gep(whole.data, [builder.mul(args[2], width)])
        return read_words(context, builder, kind.like, start)

    return kind.like(kind, words, types.intp), lower


@intrinsic
def shaped(typing_context: Any, array: Any, shape: Any) -> Any:
    """The numbers of an array in order, in another shape of as many."""
    if array.layout != "C":
        raise TypingError(f"only arrays in order can have another shape, not {array}")
    kind = array.copy(ndim=len(shape))

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        whole = context.make_array(array)(context, builder, args[0])
        lengths = cgutils.unpack_tuple(builder, args[1])
        return build_array(context, builder, kind, whole.data, lengths)

    return kind(array, shape), lower


@intrinsic
def fetch_add(typing_context: Any, counters: Any, place: Any, more: Any) -> Any:
    """Add to a counter in one atomic step; its value before."""

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        array = context.make_array(counters)(context, builder, args[0])
        at = cgutils.get_item_pointer(context, builder, counters, array, [args[1]], False)
        return builder.atomic_rmw("add", at, args[2], "seq_cst")

    return types.int64(counters, types.intp, types.int64), lower


_SLEEP = "usleep"
if os.name == "nt":
    # Windows sleeps for milliseconds at least, so threads give way, however long they are told
    _SLEEP, _system = "SwitchToThread", vars(ctypes)["windll"].kernel32
    binding.add_symbol(_SLEEP, ctypes.cast(_system.SwitchToThread, ctypes.c_void_p).value)
# argument: microseconds
sleep = types.ExternalFunction(_SLEEP, types.int32(types.uint32))
