"""Numpy arrays as USD value arrays.

USD converts a buffer element by element, ten times slower than memory. Large values are therefore
computed in the memory of a new USD array (InPlace).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pxr import Vt


class _Memory:
    """Memory of a USD array for numpy to write to; numpy keeps it, and with it the array."""

    def __init__(self, owner: Any) -> None:
        seen = np.asarray(owner)
        self.owner = owner
        self.__array_interface__ = {
            "shape": seen.shape,
            "typestr": seen.dtype.str,
            "data": (seen.__array_interface__["data"][0], False),
            "version": 3,
        }


def _writes_through() -> bool:
    """Return whether numpy writes to the memory of USD arrays.

    No documentation of USD promises it.
    """
    value = Vt.Vec3fArray(1)
    np.asarray(_Memory(value))[0] = (1.0, 2.0, 3.0)
    return tuple(value[0]) == (1.0, 2.0, 3.0)


_IN_PLACE = _writes_through()


class InPlace:
    """A USD array that is computed in place. numbers: its elements, to be written to.

    USD shares an array between its copies, so the numbers may change again only when no layer holds
    the value any more.
    """

    __slots__ = ("_kind", "_value", "numbers")

    def __init__(self, kind: Any, shape: tuple[int, ...], number: Any = np.float32) -> None:
        self._kind = kind
        self._value = kind(shape[0]) if _IN_PLACE else None
        self.numbers: NDArray[Any] = (
            np.empty(shape, number) if self._value is None else np.asarray(_Memory(self._value))
        )

    @property
    def value(self) -> Any:
        """Return the array as USD takes it, with the present numbers."""
        return self._kind.FromNumpy(self.numbers) if self._value is None else self._value


def new_vectors(count: int) -> InPlace:
    """Return an array of vectors; numbers: (count, 3)."""
    return InPlace(Vt.Vec3fArray, (count, 3))


def new_scalars(count: int) -> InPlace:
    """Return an array of numbers (count,)."""
    return InPlace(Vt.FloatArray, (count,))


def new_rotations(count: int) -> InPlace:
    """Return an array of quaternions.

    numbers: (count, 4) in half precision, the real part last, as in USD.
    """
    return InPlace(Vt.QuathArray, (count, 4), np.float16)


def new_integers(count: int) -> InPlace:
    """Return an array of integers (count,)."""
    return InPlace(Vt.IntArray, (count,), np.int32)


def vec3f(values: ArrayLike) -> Any:
    """Return (N, 3) values as Vt.Vec3fArray."""
    array = new_vectors(len(np.asarray(values)))
    array.numbers[...] = values
    return array.value


def _to(kind: Any, number: Any) -> Callable[[ArrayLike], Any]:
    return lambda values: kind.FromNumpy(np.ascontiguousarray(values, dtype=number))


# of (N, 2), (N, 4) and (N,) numbers
vec2d, vec2i = _to(Vt.Vec2dArray, np.float64), _to(Vt.Vec2iArray, np.int32)
vec2f, vec4f = _to(Vt.Vec2fArray, np.float32), _to(Vt.Vec4fArray, np.float32)
floats, ints = _to(Vt.FloatArray, np.float32), _to(Vt.IntArray, np.int32)


def strings(*values: str) -> Any:
    """Return strings as Vt.StringArray."""
    return Vt.StringArray(list(values))
