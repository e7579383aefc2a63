"""Curve prims as polylines, checked: shafts of a groom, guides and lines of a skin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import UsdGeom

from featherfx.groom.keys.values import Place
from featherfx.groom.read.rachis_curve import BASES, spline_points
from featherfx.usd.read.values import INTEGERS, VECTORS, array_of, at, text_of

Array = NDArray[np.float64]

_TYPES, _WRAPS = ("linear", "cubic"), ("nonperiodic", "pinned")


@dataclass(frozen=True)
class Curves:
    """The curves of one prim in its own space.

    points: (V, 3) control points of all. starts: (N + 1,) first point of each, and V. basis: of
    cubic curves, empty for linear ones. pinned: whether cubic curves run to their end points.
    """

    points: Array
    starts: NDArray[np.int64]
    basis: str
    pinned: bool

    def __len__(self) -> int:
        return len(self.starts) - 1

    def control(self, number: int) -> Array:
        """(k, 3) points of one curve as they are authored."""
        return self.points[self.starts[number] : self.starts[number + 1]]

    def line(self, number: int) -> Array:
        """(k, 3) points on one curve."""
        points = self.control(number)
        return spline_points(points, self.basis, self.pinned) if self.basis else points


def curves_of(prim: Any, code: Any, place: Place) -> Curves | None:
    """The curves of a BasisCurves prim at a time; None after adding problems."""
    curves, problems = UsdGeom.BasisCurves(prim), len(place.problems)
    points = array_of(curves.GetPointsAttr(), code, VECTORS)
    counts = array_of(curves.GetCurveVertexCountsAttr(), code, INTEGERS)
    if points is None or counts is None:
        missing = "points" if points is None else "curveVertexCounts"
        place.child(missing).fail(f"has no value {at(code)}")
        return None
    points, counts = points.astype(np.float64), counts.astype(np.int64)
    kind, wrap = text_of(curves.GetTypeAttr()), text_of(curves.GetWrapAttr())
    for name, value, allowed in (("type", kind, _TYPES), ("wrap", wrap, _WRAPS)):
        if value == "periodic":
            place.child(name).fail("is periodic; a shaft has two ends")
        elif value not in allowed:
            place.child(name).fail(f"'{value}' is not one of {', '.join(allowed)}")
    basis = text_of(curves.GetBasisAttr()) if kind == "cubic" else ""
    _check_sizes(points, counts, basis, wrap == "pinned", place)
    if len(place.problems) > problems:
        return None
    return Curves(points, np.concatenate([[0], np.cumsum(counts)]), basis, wrap == "pinned")


def _check_sizes(
    points: Array, counts: NDArray[np.int64], basis: str, pinned: bool, place: Place
) -> None:
    if counts.sum() != len(points) or (counts < 0).any():
        place.child("curveVertexCounts").fail(f"add up to {counts.sum()}, there are {len(points)}")
    if not np.isfinite(points).all():
        place.child("points").fail("hold values that are not finite")
    if basis and basis not in BASES:
        place.child("basis").fail(f"'{basis}' is not one of {', '.join(BASES)}")
    least = 4 if basis and not (pinned and basis != "bezier") else 2
    short = np.flatnonzero(counts < least)
    if len(short):
        few = f"curve {short[0]} has {counts[short[0]]} points, a shaft has {least} at least"
        more = f" (and {len(short) - 1} more curves)" if len(short) > 1 else ""
        place.child("curveVertexCounts").fail(few + more)
    elif basis == "bezier" and ((counts - 4) % 3).any():
        wrong = int(np.flatnonzero((counts - 4) % 3)[0])
        place.child("curveVertexCounts").fail(
            f"curve {wrong} has {counts[wrong]} points, a bezier has 4, 7, 10, ..."
        )
