"""Curve prims as checked polylines, and primvars of curves and instancers by element.

They are rachises of a groom, guides and lines of a skin.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from pxr import Gf, UsdGeom

from featherfx.algebra.types import Array, Indices
from featherfx.groom.keys.groom import DEFAULT_PRIMVARS
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.read.rachis_curve import (
    CURVE_BASES,
    hermite_points,
    nurbs_points,
    spline_points,
)
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
    read_sized_array,
    read_text,
    to_numpy,
)

_TYPES, _WRAPS = ("linear", "cubic"), ("nonperiodic", "pinned")


@dataclass(frozen=True)
class PrimCurves:
    """The curves of one prim in its own space.

    points: (V, 3) control points of all. starts: (N + 1,) first point of each, and V. line: from
    the number of a curve to (k, 3) points on it.
    """

    points: Array
    starts: Indices
    line: Callable[[int], Array]

    def __len__(self) -> int:
        return len(self.starts) - 1

    def own(self, number: int) -> slice:
        """Return the points of one curve."""
        return slice(self.starts[number], self.starts[number + 1])


def read_prim_curves(prim: Any, code: Any, place: Place) -> PrimCurves:
    """Return the curves of a prim at a time: BasisCurves, NurbsCurves or HermiteCurves.

    Raises InputError with all problems.
    """
    found = Problems()
    place = replace(place, problems=found)
    curves = UsdGeom.Curves(prim)
    points = read_array(curves.GetPointsAttr(), code, VECTOR_ARRAY)
    counts = read_array(curves.GetCurveVertexCountsAttr(), code, INTEGER_ARRAY)
    if points is None or counts is None:
        missing = "points" if points is None else "curveVertexCounts"
        place.child(missing).refuse(f"has no value {describe_time(code)}")
    points, counts = points.astype(np.float64), counts.astype(np.int64)
    if counts.sum() != len(points) or (counts < 0).any():
        told = f"add up to {counts.sum()}, there are {len(points)}"
        place.child("curveVertexCounts").fail(told)
    if not np.isfinite(points).all():
        place.child("points").fail("hold values that are not finite")
    reader = next(own for kind, own in _READERS.items() if prim.IsA(kind))
    starts = np.concatenate([[0], np.cumsum(counts)])
    line = reader(prim, code, PrimCurves(points, starts, lambda number: points), place)
    found.hand_on()
    return PrimCurves(points, starts, line)


def _read_basis(prim: Any, code: Any, given: PrimCurves, place: Place) -> Callable[[int], Array]:
    curves, counts = UsdGeom.BasisCurves(prim), np.diff(given.starts)
    kind, wrap = read_text(curves.GetTypeAttr()), read_text(curves.GetWrapAttr())
    for name, value, allowed in (("type", kind, _TYPES), ("wrap", wrap, _WRAPS)):
        if value == "periodic":
            place.child(name).fail("is periodic. Give an open curve, since a rachis has two ends")
        elif value not in allowed:
            place.child(name).fail(f"'{value}' is not one of {', '.join(allowed)}")
    basis = read_text(curves.GetBasisAttr()) if kind == "cubic" else ""
    pinned = wrap == "pinned"
    if basis and basis not in CURVE_BASES:
        place.child("basis").fail(f"'{basis}' is not one of {', '.join(CURVE_BASES)}")
    least = 4 if basis and not (pinned and basis != "bezier") else 2
    uneven = np.flatnonzero((counts - 4) % 3)
    if not _has_short_curve(counts, least, place) and basis == "bezier" and len(uneven):
        wrong = int(uneven[0])
        place.child("curveVertexCounts").fail(
            f"curve {wrong} has {counts[wrong]} points, a bezier has 4, 7, 10, ..."
        )

    def line(number: int) -> Array:
        control = given.points[given.own(number)]
        return spline_points(control, basis, pinned) if basis else control

    return line


def _read_hermite(prim: Any, code: Any, given: PrimCurves, place: Place) -> Callable[[int], Array]:
    attribute = UsdGeom.HermiteCurves(prim).GetTangentsAttr()
    tangents = read_sized_array(attribute, code, VECTOR_ARRAY).astype(np.float64)
    _has_short_curve(np.diff(given.starts), 2, place)
    if tangents.shape != given.points.shape or not np.isfinite(tangents).all():
        told = f"has {len(tangents)} values for {len(given.points)} points, or not finite ones"
        place.child("tangents").fail(told)
    return lambda number: hermite_points(
        given.points[given.own(number)], tangents[given.own(number)]
    )


def _read_nurbs(prim: Any, code: Any, given: PrimCurves, place: Place) -> Callable[[int], Array]:
    curves, counts = UsdGeom.NurbsCurves(prim), np.diff(given.starts)
    orders = read_sized_array(curves.GetOrderAttr(), code, INTEGER_ARRAY).astype(np.int64)
    knots = read_sized_array(curves.GetKnotsAttr(), code, NUMBER_ARRAY).astype(np.float64)
    weights = read_sized_array(curves.GetPointWeightsAttr(), code, NUMBER_ARRAY).astype(np.float64)
    orders = np.repeat(orders, len(counts)) if len(orders) == 1 else orders
    weights = weights if len(weights) else np.ones(len(given.points))
    if len(orders) != len(counts) or (orders < 2).any() or (orders > counts).any():
        place.child("order").fail("does not fit. Give each curve an order from 2 to its points")
        orders = np.full(len(counts), 2)
    ends = np.concatenate([[0], np.cumsum(counts + orders)])
    rises = all((np.diff(knots[a:b]) >= 0.0).all() for a, b in pairwise(ends))
    if ends[-1] != len(knots) or not np.isfinite(knots).all() or not rises:
        told = f"has {len(knots)} values that do not fit. Give each curve its points plus its order"
        place.child("knots").fail(f"{told}, not decreasing")
    if len(weights) != len(given.points) or not (weights > 0.0).all():
        place.child("pointWeights").fail("does not fit the points. Give each a number above 0")

    def line(number: int) -> Array:
        part, own = given.own(number), slice(*ends[number : number + 2])
        return nurbs_points(given.points[part], int(orders[number]), knots[own], weights[part])

    return line


# the first that a prim is
_READERS = {
    UsdGeom.BasisCurves: _read_basis,
    UsdGeom.HermiteCurves: _read_hermite,
    UsdGeom.NurbsCurves: _read_nurbs,
}
CURVE_KINDS = tuple(_READERS)


def is_curves(prim: Any) -> bool:
    """Return whether read_prim_curves reads a prim."""
    return any(prim.IsA(kind) for kind in CURVE_KINDS)


def _has_short_curve(counts: Indices, least: int, place: Place) -> bool:
    short = np.flatnonzero(counts < least)
    if len(short):
        few = f"curve {short[0]} has {counts[short[0]]} points, a rachis has {least} at least"
        more = f" (and {len(short) - 1} more curves)" if len(short) > 1 else ""
        place.child("curveVertexCounts").fail(few + more)
    return len(short) > 0


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

    def scale(self) -> float:
        value = self.get("scale")
        if value is None:
            return 1.0
        if not isinstance(value, int | float) or not np.isfinite(value) or not value > 0.0:
            self.values.fail("scale", f"is {describe_value(value)}, expects a number above 0")
            return 1.0
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
