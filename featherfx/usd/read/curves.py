"""Curve prims as checked polylines, and primvars of curves and instancers by element.

They are rachises of a groom, guides and lines of a skin.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pxr import Gf, UsdGeom

from featherfx.algebra.types import Array, Indices
from featherfx.groom.keys.groom import DEFAULT_PRIMVARS
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.read.rachis_curve import CURVE_BASES, spline_points
from featherfx.usd.read.values import (
    EARLIEST_TIME,
    INTEGER_ARRAY,
    NUMBER_ARRAY,
    VECTOR_ARRAY,
    describe_time,
    describe_value,
    list_elements,
    read_array,
    read_flattened,
    read_text,
    to_numpy,
)

_TYPES, _WRAPS = ("linear", "cubic"), ("nonperiodic", "pinned")


@dataclass(frozen=True)
class PrimCurves:
    """The curves of one prim in its own space.

    points: (V, 3) control points of all. starts: (N + 1,) first point of each, and V. basis: of
    cubic curves, empty for linear ones. pinned: whether cubic curves run to their end points.
    """

    points: Array
    starts: Indices
    basis: str
    pinned: bool

    def __len__(self) -> int:
        return len(self.starts) - 1

    def control(self, number: int) -> Array:
        """Return (k, 3) points of one curve as they are authored."""
        return self.points[self.starts[number] : self.starts[number + 1]]

    def line(self, number: int) -> Array:
        """Return (k, 3) points on one curve."""
        points = self.control(number)
        return spline_points(points, self.basis, self.pinned) if self.basis else points


def read_prim_curves(prim: Any, code: Any, place: Place) -> PrimCurves:
    """Return the curves of a BasisCurves prim at a time. Raises InputError with all problems."""
    curves, found = UsdGeom.BasisCurves(prim), Problems()
    place = replace(place, problems=found)
    points = read_array(curves.GetPointsAttr(), code, VECTOR_ARRAY)
    counts = read_array(curves.GetCurveVertexCountsAttr(), code, INTEGER_ARRAY)
    if points is None or counts is None:
        missing = "points" if points is None else "curveVertexCounts"
        place.child(missing).refuse(f"has no value {describe_time(code)}")
    points, counts = points.astype(np.float64), counts.astype(np.int64)
    kind, wrap = read_text(curves.GetTypeAttr()), read_text(curves.GetWrapAttr())
    for name, value, allowed in (("type", kind, _TYPES), ("wrap", wrap, _WRAPS)):
        if value == "periodic":
            place.child(name).fail("is periodic. Give an open curve, since a rachis has two ends")
        elif value not in allowed:
            place.child(name).fail(f"'{value}' is not one of {', '.join(allowed)}")
    basis = read_text(curves.GetBasisAttr()) if kind == "cubic" else ""
    _check_sizes(points, counts, basis, wrap == "pinned", place)
    found.hand_on()
    return PrimCurves(points, np.concatenate([[0], np.cumsum(counts)]), basis, wrap == "pinned")


def _check_sizes(points: Array, counts: Indices, basis: str, pinned: bool, place: Place) -> None:
    if counts.sum() != len(points) or (counts < 0).any():
        place.child("curveVertexCounts").fail(f"add up to {counts.sum()}, there are {len(points)}")
    if not np.isfinite(points).all():
        place.child("points").fail("hold values that are not finite")
    if basis and basis not in CURVE_BASES:
        place.child("basis").fail(f"'{basis}' is not one of {', '.join(CURVE_BASES)}")
    least = 4 if basis and not (pinned and basis != "bezier") else 2
    short = np.flatnonzero(counts < least)
    if len(short):
        few = f"curve {short[0]} has {counts[short[0]]} points, a rachis has {least} at least"
        more = f" (and {len(short) - 1} more curves)" if len(short) > 1 else ""
        place.child("curveVertexCounts").fail(few + more)
    elif basis == "bezier" and ((counts - 4) % 3).any():
        wrong = int(np.flatnonzero((counts - 4) % 3)[0])
        place.child("curveVertexCounts").fail(
            f"curve {wrong} has {counts[wrong]} points, a bezier has 4, 7, 10, ..."
        )


class PrimvarReader:
    """Named primvars of a prim, inherited ones included.

    names: primvars by their meaning, over the default names. starts: index of the first point of
    each curve, and of the end; None: of instances.
    """

    def __init__(
        self, prim: Any, names: Mapping[str, str | None], code: Any, starts: Any, place: Place
    ) -> None:
        self._names = DEFAULT_PRIMVARS | {key: name for key, name in names.items() if name}
        self._primvars, self._code = UsdGeom.PrimvarsAPI(prim), code
        self._starts, self._place = starts, place
        self._read: dict[str, Any] = {}

    def get(self, what: str, element: int, elements: int) -> Any:
        """Return the value of one element, None where there is none."""
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
        self.fail(what, f"has {len(values)} values for {elements} elements")
        return None

    def barbs(self, what: str, points: int) -> Array | None:
        """Return (points, m, 3) array attribute per point, of points or numbers; or None."""
        values, primvar = self._flattened(what), self._primvar(what)
        if values is None or len(values) == 0:
            return None
        counts = read_array(self._primvar(what, ":lengths").GetAttr(), self._code, INTEGER_ARRAY)
        if counts is not None and len(set(counts.tolist())) > 1:
            self.fail(what, "has different counts at different points, expects one")
            return None
        kind = NUMBER_ARRAY if np.ndim(values[0]) == 0 else VECTOR_ARRAY
        numbers = to_numpy(values, kind, primvar.GetAttr()).astype(np.float64)
        if points == 0 or numbers.size % (3 * points) or not np.isfinite(numbers).all():
            self.fail(what, f"has {len(values)} values for {points} points, or not finite ones")
            return None
        return numbers.reshape(points, -1, 3)

    def _flattened(self, what: str) -> Any:
        """Return the primvar's values with indices resolved; None where it is not authored."""
        primvar = self._primvar(what)
        value = read_flattened(primvar, self._code)
        if value is None:
            value = read_flattened(primvar, EARLIEST_TIME)
        return None if value is None else list_elements(value)

    def _primvar(self, what: str, suffix: str = "") -> Any:
        return self._primvars.FindPrimvarWithInheritance(self._names[what] + suffix)

    def fail(self, what: str, message: str) -> None:
        """Add a problem of a primvar by its meaning."""
        self._place.child("primvars:" + self._names[what]).fail(message)


@dataclass(frozen=True)
class CurveElement:
    """One curve or instance of a prim with its primvars.

    number: which one, of how many.
    """

    values: PrimvarReader
    number: int
    of: int

    def get(self, what: str) -> Any:
        """Return the value, None where there is none."""
        return self.values.get(what, self.number, self.of)

    def text(self, what: str) -> str:
        value = self.get(what)
        if value is not None and not isinstance(value, str | int):
            self.values.fail(what, f"is {describe_value(value)}, expects a text")
            return ""
        return "" if value is None else str(value)

    def positive(self, what: str, fallback: float) -> float:
        value = self.get(what)
        if value is None:
            return fallback
        if not isinstance(value, int | float) or not np.isfinite(value) or not value > 0.0:
            self.values.fail(what, f"is {describe_value(value)}, expects a number above 0")
            return fallback
        return float(value)

    def vector(self, what: str, size: int) -> Array | None:
        """Return (size,) numbers; None without them, after adding a problem if they are bad."""
        value = self.get(what)
        if value is None:
            return None
        try:
            array = np.array(value, dtype=np.float64).reshape(-1)
        except (TypeError, ValueError):
            array = np.zeros(0)
        if array.shape != (size,) or not np.isfinite(array).all():
            self.values.fail(what, f"is {describe_value(value)}, expects {size} finite numbers")
            return None
        return array

    def frame(self) -> Array | None:
        """Return (3, 3) rows x, y, z of the feather's frame, from a matrix or a quaternion."""
        value = self.get("frame")
        if value is None:
            return None
        if isinstance(value, Gf.Quatf | Gf.Quatd | Gf.Quath):
            value = Gf.Matrix3d(Gf.Rotation(Gf.Quatd(value)))
        if isinstance(value, Gf.Matrix3f | Gf.Matrix3d | Gf.Matrix4f | Gf.Matrix4d):
            array = np.array(value, dtype=np.float64)
            if np.isfinite(array).all():
                return array[:3, :3]
        message = f"is {describe_value(value)}, expects a quaternion or a 3 x 3 or 4 x 4 matrix"
        self.values.fail("frame", message)
        return None
