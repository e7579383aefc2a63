"""Primvars of curves and instancers, element by element, whatever their interpolation and type."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, UsdGeom

from featherfx.groom.keys.groom import DEFAULT_NAMES
from featherfx.groom.keys.values import Place
from featherfx.usd.read.values import (
    EARLIEST,
    INTEGERS,
    NUMBERS,
    VECTORS,
    array_of,
    described,
    elements,
    flattened,
    numbers_of,
)

Array = NDArray[np.float64]


class Values:
    """Named primvars of a prim, inherited ones included.

    names: primvars by what they hold, over the default names. elements: number of curves or
    instances. starts: index of each element's first point, where they have points (else None).
    """

    def __init__(
        self, prim: Any, names: Mapping[str, str | None], code: Any, starts: Any, place: Place
    ) -> None:
        self._names = DEFAULT_NAMES | {key: name for key, name in names.items() if name}
        self._primvars, self._code = UsdGeom.PrimvarsAPI(prim), code
        self._starts, self._place = starts, place
        self._read: dict[str, Any] = {}

    def get(self, what: str, element: int, elements: int) -> Any:
        """The value of one element, None where there is none."""
        if what not in self._read:
            self._read[what] = self._flattened(what)
        values = self._read[what]
        if values is None:
            return None
        if len(values) == 1:
            return values[0]
        if len(values) == elements:
            return values[element]
        if self._starts is not None and len(values) == self._starts[-1]:
            return values[self._starts[element]]
        self._read[what] = None
        self._fail(what, f"has {len(values)} values for {elements} elements")
        return None

    def text(self, what: str, element: int, elements: int) -> str:
        value = self.get(what, element, elements)
        if value is not None and not isinstance(value, str | int):
            self._fail(what, f"is {described(value)}, expects a text")
            return ""
        return "" if value is None else str(value)

    def number(self, what: str, element: int, elements: int, fallback: float) -> float:
        value = self.get(what, element, elements)
        if value is None:
            return fallback
        if not isinstance(value, int | float) or not np.isfinite(value) or not value > 0.0:
            self._fail(what, f"is {described(value)}, expects a number above 0")
            return fallback
        return float(value)

    def vector(self, what: str, element: int, elements: int, size: int) -> Array | None:
        """(size,) numbers; None where there are none, after adding a problem if they are bad."""
        value = self.get(what, element, elements)
        if value is None:
            return None
        try:
            array = np.array(value, dtype=np.float64).reshape(-1)
        except (TypeError, ValueError):
            array = np.zeros(0)
        if array.shape != (size,) or not np.isfinite(array).all():
            self._fail(what, f"is {described(value)}, expects {size} finite numbers")
            return None
        return array

    def frame(self, element: int, elements: int) -> Array | None:
        """(3, 3) rows x, y, z of the feather's frame, from a matrix or a quaternion."""
        value = self.get("frame", element, elements)
        if value is None:
            return None
        if isinstance(value, Gf.Quatf | Gf.Quatd | Gf.Quath):
            value = Gf.Matrix3d(Gf.Rotation(Gf.Quatd(value)))
        if isinstance(value, Gf.Matrix3f | Gf.Matrix3d | Gf.Matrix4f | Gf.Matrix4d):
            array = np.array(value, dtype=np.float64)
            if np.isfinite(array).all():
                return array[:3, :3]
        message = f"is {described(value)}, expects a quaternion or a 3 x 3 or 4 x 4 matrix"
        self._fail("frame", message)
        return None

    def barbs(self, what: str, points: int) -> Array | None:
        """(points, m, 3) array attribute per point, of points or of numbers, flattened; or None."""
        values, primvar = self._flattened(what), self._primvar(what)
        if values is None or len(values) == 0:
            return None
        counts = array_of(self._primvar(what, ":lengths").GetAttr(), self._code, INTEGERS)
        if counts is not None and len(set(counts.tolist())) > 1:
            self._fail(what, "has different counts at different points, expects one")
            return None
        kind = NUMBERS if np.ndim(values[0]) == 0 else VECTORS
        numbers = numbers_of(values, kind, primvar.GetAttr()).astype(np.float64)
        if points == 0 or numbers.size % (3 * points) or not np.isfinite(numbers).all():
            self._fail(what, f"has {len(values)} values for {points} points, or not finite ones")
            return None
        return numbers.reshape(points, -1, 3)

    def _flattened(self, what: str) -> Any:
        """The primvar's values as a sequence, indices resolved; None where it is not authored."""
        primvar = self._primvar(what)
        value = flattened(primvar, self._code)
        if value is None:
            value = flattened(primvar, EARLIEST)
        return None if value is None else elements(value)

    def _primvar(self, what: str, suffix: str = "") -> Any:
        return self._primvars.FindPrimvarWithInheritance(self._names[what] + suffix)

    def _fail(self, what: str, message: str) -> None:
        self._place.child("primvars:" + self._names[what]).fail(message)
